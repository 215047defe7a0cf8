//! Tables of bytes, filled column by column: what binary formats store.

use bytemuck::{NoUninit, bytes_of};
use rayon::prelude::*;

/// Rows of equal length, one after the other.
pub(super) struct Rows {
    bytes: Vec<u8>,
    stride: usize,
}

/// Below this many rows a thread has too little to do to be woken.
const LEAST_ROWS: usize = 4096;

impl Rows {
    /// `count` rows of `stride` bytes (at least 1), all zero.
    pub(super) fn new(count: usize, stride: usize) -> Self {
        Self { bytes: vec![0; count * stride], stride }
    }

    /// Writes the bytes of `entry(item)` at `offset` of each row, one item per row.
    pub(super) fn fill<T: Sync, B: NoUninit>(
        &mut self,
        offset: usize,
        items: &[T],
        entry: impl Fn(&T) -> B + Sync,
    ) {
        self.bytes.par_chunks_exact_mut(self.stride).with_min_len(LEAST_ROWS).zip(items).for_each(
            |(row, item)| {
                row[offset..][..size_of::<B>()].copy_from_slice(bytes_of(&entry(item)));
            },
        );
    }

    pub(super) fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }
}

/// Numbers as single precision floats, little endian.
pub(super) fn floats<const N: usize>(numbers: [f64; N]) -> [[u8; 4]; N] {
    numbers.map(|number| (number as f32).to_le_bytes())
}

/// Whole numbers, little endian.
pub(super) fn indices<const N: usize>(numbers: [u32; N]) -> [[u8; 4]; N] {
    numbers.map(u32::to_le_bytes)
}
