//! Tables of bytes, filled column by column: what binary formats store.

use bytemuck::{NoUninit, bytes_of};

use crate::parallel::*;

/// Rows that one task fills: few enough to stay in a core's cache from column to column.
const BLOCK: usize = 4096;

/// Fills a table with rows of `stride` bytes (at least 1), block by block: `fill` is given a block and the number of its first
/// row.
pub(super) fn fill_blocks(bytes: &mut [u8], stride: usize, fill: impl Fn(&mut [u8], usize) + Sync) {
    bytes
        .par_chunks_mut(BLOCK * stride)
        .enumerate()
        .for_each(|(block, rows)| fill(rows, block * BLOCK));
}

/// Writes the bytes of `entry(item)` at `offset` of each row of `stride` bytes, one item per row.
pub(super) fn fill_column<T, B: NoUninit>(
    rows: &mut [u8],
    stride: usize,
    offset: usize,
    items: &[T],
    entry: impl Fn(&T) -> B,
) {
    for (row, item) in rows.chunks_exact_mut(stride).zip(items) {
        row[offset..][..size_of::<B>()].copy_from_slice(bytes_of(&entry(item)));
    }
}

/// Fills a table of one column.
pub(super) fn fill<T: Sync, B: NoUninit>(
    bytes: &mut [u8],
    items: &[T],
    entry: impl Fn(&T) -> B + Sync,
) {
    let stride = size_of::<B>();
    fill_blocks(bytes, stride, |rows, first| {
        fill_column(rows, stride, 0, &items[first..], &entry);
    });
}

/// Numbers as single precision floats, little endian.
pub(super) fn floats<const N: usize>(numbers: [f64; N]) -> [[u8; 4]; N] {
    numbers.map(|number| (number as f32).to_le_bytes())
}

/// Whole numbers, little endian.
pub(super) fn indices<const N: usize>(numbers: [u32; N]) -> [[u8; 4]; N] {
    numbers.map(u32::to_le_bytes)
}
