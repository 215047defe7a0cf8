//! Reuse of the buffers of dropped columns. While a user drags a handle, for example, each move makes a new column from an earlier one.
//!
//! Writing to newly allocated memory costs more than the copying itself. A reused buffer already has the items of a column from a few moves
//! ago, so only the items that have changed since then must be copied.
//!
//! A column is one contiguous list, so that every kernel can read it as a slice. A list in chunks would copy less, but is not needed: once
//! the memory for results is full, old columns are dropped, and each move of a drag finds a spare buffer. Only the first moves copy all
//! items to new memory pages. The system must clear these pages first, which on a virtual machine takes longer than all other work.

use std::sync::{Mutex, PoisonError};

use super::blocks::Blocks;
use crate::parallel::*;

/// The minimum size in bytes of a column that uses a pool. Copies of smaller columns are cheap.
pub(super) const MIN_POOLED_BYTES: usize = 1 << 20;

/// The number of items that one task copies or writes: enough to outweigh the cost of a task.
pub(super) const PIECE_LEN: usize = 1 << 12;

/// A pool of at most one spare buffer, which belonged to a dropped column with the same number of items.
pub(super) struct BufferPool<T>(Mutex<Option<SpareBuffer<T>>>);

/// The items of a dropped column, and the hashes of their blocks.
pub(super) struct SpareBuffer<T> {
    pub(super) items: Vec<T>,
    pub(super) blocks: Blocks,
}

impl<T> BufferPool<T> {
    pub(super) fn new() -> Self {
        Self(Mutex::new(None))
    }

    /// Stores a spare buffer, replacing an older one.
    pub(super) fn put(&self, spare: SpareBuffer<T>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(spare);
    }

    #[cfg(test)]
    pub(super) fn has_spare(&self) -> bool {
        self.0.lock().unwrap().is_some()
    }

    pub(super) fn take(&self) -> Option<SpareBuffer<T>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

impl<T: Copy + Send + Sync> SpareBuffer<T> {
    /// Overwrites the buffer with the items of a column of the same pool. Only the blocks whose hashes differ are copied.
    pub(super) fn update_to(mut self, items: &[T], blocks: &Blocks) -> Vec<T> {
        let stale = blocks.changed_rows(&self.blocks, items.len(), size_of::<T>());
        self.items.par_rows_mut(&stale, PIECE_LEN).for_each(|(row, to)| {
            to.copy_from_slice(&items[row.start as usize..row.end as usize]);
        });
        self.items
    }
}

/// Copies all items, on all threads.
pub(super) fn copy<T: Copy + Send + Sync>(from: &[T], to: &mut [T]) {
    let copies = to.par_chunks_mut(PIECE_LEN).zip(from.par_chunks(PIECE_LEN));
    copies.for_each(|(to, from)| to.copy_from_slice(from));
}
