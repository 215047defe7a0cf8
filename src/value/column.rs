//! A list of plain items, shared between values and hashed once.

use std::fmt;
use std::ops::{Deref, Range};
use std::sync::{Arc, OnceLock, Weak};

use bytemuck::{NoUninit, Pod};

use super::Hash;
use crate::memory::huge_vec;
use crate::parallel::*;

mod blocks;
mod changed;

use blocks::{Blocks, of_one_block};

/// A list of plain items: cloning it copies nothing, and its hash is computed when first asked for.
#[derive(Clone)]
pub struct Column<T>(Arc<Shared<T>>);

struct Shared<T> {
    items: Vec<T>,
    hash: OnceLock<Hash>,
    /// Of a column that has several.
    blocks: OnceLock<Blocks>,
}

impl<T> Shared<T> {
    fn new(items: Vec<T>) -> Self {
        Self { items, hash: OnceLock::new(), blocks: OnceLock::new() }
    }
}

/// Items that are copied at once: enough to outweigh the cost of giving them to a thread.
const COPIED: usize = 1 << 14;

impl<T: NoUninit + Send + Sync> Column<T> {
    /// The hash of the items' bytes and their number.
    pub(crate) fn hash(&self) -> Hash {
        *self.0.hash.get_or_init(|| {
            let one = of_one_block(self.len(), self.bytes());
            one.unwrap_or_else(|| self.blocks().whole())
        })
    }

    /// Hashes what tells the items in these rows, and where they are, from others. It looks at no item if the hash of the column is known.
    pub(crate) fn hash_rows(&self, rows: Range<usize>, to: &mut blake3::Hasher) {
        if rows.is_empty() {
            return;
        }
        let bytes = rows.start * size_of::<T>()..rows.end * size_of::<T>();
        match of_one_block(0, self.bytes()) {
            Some(_) => _ = to.update(&self.hash().0),
            None => self.blocks().hash_around(bytes, to),
        }
    }

    fn blocks(&self) -> &Blocks {
        self.0.blocks.get_or_init(|| Blocks::new(self.len(), self.bytes()))
    }

    fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(&self.0.items)
    }

    /// How much memory the items hold, in bytes: what follows from their number, because nothing is set aside for more of them.
    pub fn size(&self) -> usize {
        size_of_val(&self.0.items[..])
    }
}

impl<T: Pod + Send + Sync> Column<T> {
    /// The same column with other items in some rows: those of all rows, one row after the other. All are copied, but only what is around
    /// those that are others is hashed again.
    ///
    /// # Panics
    /// If there are no such rows, or more or fewer items than they take.
    #[must_use]
    pub fn with_rows(&self, rows: &[Range<u32>], others: &[T]) -> Self {
        let mut items: Vec<T> = huge_vec(self.len());
        let copies = items.par_chunks_mut(COPIED).zip(self.par_chunks(COPIED));
        copies.for_each(|(to, from)| to.copy_from_slice(from));
        let mut rest = others;
        let mut changed = Vec::new();
        for row in rows.iter().map(|row| row.start as usize..row.end as usize) {
            let (others, behind) = rest.split_at(row.len());
            items[row.clone()].copy_from_slice(others);
            rest = behind;
            changed.push(row);
        }
        assert!(rest.is_empty(), "more items than rows");
        let column = Self(Arc::new(Shared::new(items)));
        if of_one_block(0, self.bytes()).is_none() {
            let blocks = self.blocks().after(&changed, size_of::<T>(), column.bytes());
            // Nobody else knows the column yet.
            let _ = column.0.blocks.set(blocks);
        }
        column
    }
}

/// A column that may be gone.
pub(super) struct WeakColumn<T>(Weak<Shared<T>>);

impl<T> Clone for WeakColumn<T> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<T> WeakColumn<T> {
    /// The column, if somebody still has it.
    pub(super) fn upgrade(&self) -> Option<Column<T>> {
        self.0.upgrade().map(Column)
    }
}

impl<T> Column<T> {
    /// What does not keep it.
    pub(super) fn downgrade(&self) -> WeakColumn<T> {
        WeakColumn(Arc::downgrade(&self.0))
    }

    /// A column of which the hash is known.
    pub(super) fn of_hash(items: Vec<T>, hash: Hash) -> Self {
        Self(Arc::new(Shared { hash: hash.into(), ..Shared::new(items) }))
    }
}

impl<T> From<Vec<T>> for Column<T> {
    fn from(mut items: Vec<T>) -> Self {
        // There will be no more of them; what was set aside would be held as long as the value.
        items.shrink_to_fit();
        Self(Arc::new(Shared::new(items)))
    }
}

impl<T> FromIterator<T> for Column<T> {
    fn from_iter<I: IntoIterator<Item = T>>(items: I) -> Self {
        Vec::from_iter(items).into()
    }
}

impl<T> Default for Column<T> {
    fn default() -> Self {
        Vec::new().into()
    }
}

impl<T> Deref for Column<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.0.items
    }
}

impl<T: PartialEq> PartialEq for Column<T> {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0) || self.0.items == other.0.items
    }
}

impl<T: fmt::Debug> fmt::Debug for Column<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.items.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_items_have_equal_hashes_and_different_ones_do_not() {
        let a = Column::from(vec![1.0f64, 2.0]);
        assert_eq!(a.hash(), Column::from(vec![1.0f64, 2.0]).hash());
        assert_ne!(a.hash(), Column::from(vec![1.0f64, 3.0]).hash());
        assert_ne!(Column::<u8>::from(vec![]).hash(), Column::from(vec![0u8]).hash());
    }

    #[test]
    fn a_column_with_other_rows_is_as_one_made_of_them() {
        for len in [3_u32, 1000, 50_000] {
            let mut items = Vec::from_iter((0..len).map(f64::from));
            let column = Column::from(items.clone());
            let rows = [0..1, len / 2..len / 2, len / 2..len - 1, len - 1..len];
            let places = Vec::from_iter(rows.iter().cloned().flatten());
            let others = Vec::from_iter(places.iter().map(|&place| -2.0 * f64::from(place)));
            let other = column.with_rows(&rows, &others);
            places.iter().zip(&others).for_each(|(&place, &item)| items[place as usize] = item);
            assert_eq!(other[..], items);
            assert_eq!(other.hash(), Column::from(items).hash());
            assert_eq!(column.with_rows(&[], &[]).hash(), column.hash());
        }
    }

    #[test]
    fn a_large_column_hashes_the_same_with_several_threads() {
        let items: Vec<u32> = (0..200_000).collect();
        let several = Column::from(items.clone()).hash();
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(several, one.install(|| Column::from(items).hash()));
    }
}
