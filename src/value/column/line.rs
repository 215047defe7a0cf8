//! Columns that are made of each other, one after the other, as a hand moves: of what is gone the next one is made.
//!
//! Fresh memory costs more than the copy that goes into it, and of a copy that was right some moves ago only what has changed since has to
//! be copied.
//!
//! A column is one list in one piece, so that every kernel reads a slice, and columns in chunks are not needed. In a drag each move finds a
//! spare as soon as the memory for results is full. The first moves copy everything to fresh pages, which the system clears first; on a
//! virtual machine that takes longer than all else.

use std::sync::{Mutex, PoisonError};

use super::blocks::Blocks;
use crate::parallel::*;

/// Below this many bytes a copy costs next to nothing.
pub(super) const LEAST: usize = 1 << 20;

/// Items that are copied or written at once: enough to outweigh the cost of giving them to a thread.
pub(super) const PIECE: usize = 1 << 12;

/// What is left of columns of as many items each.
pub(super) struct Line<T>(Mutex<Option<Spare<T>>>);

/// The items of a column that nobody has any more, and what tells them.
pub(super) struct Spare<T> {
    pub(super) items: Vec<T>,
    pub(super) blocks: Blocks,
}

impl<T> Line<T> {
    pub(super) fn new() -> Self {
        Self(Mutex::new(None))
    }

    /// Keeps a spare, in place of an older one.
    pub(super) fn put(&self, spare: Spare<T>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(spare);
    }

    #[cfg(test)]
    pub(super) fn has_spare(&self) -> bool {
        self.0.lock().unwrap().is_some()
    }

    pub(super) fn take(&self) -> Option<Spare<T>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

impl<T: Copy + Send + Sync> Spare<T> {
    /// The items of a column of the same line, which these blocks tell.
    pub(super) fn turned_into(mut self, items: &[T], blocks: &Blocks) -> Vec<T> {
        let stale = blocks.changed(&self.blocks, items.len(), size_of::<T>());
        self.items.par_rows_mut(&stale, PIECE).for_each(|(row, to)| {
            to.copy_from_slice(&items[row.start as usize..row.end as usize]);
        });
        self.items
    }
}

/// Copies all items, on all threads.
pub(super) fn copy<T: Copy + Send + Sync>(from: &[T], to: &mut [T]) {
    let copies = to.par_chunks_mut(PIECE).zip(from.par_chunks(PIECE));
    copies.for_each(|(to, from)| to.copy_from_slice(from));
}
