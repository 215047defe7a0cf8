//! Columns: immutable lists of plain items, shared between values and hashed once.

use std::fmt;
use std::ops::{Deref, Range};
use std::sync::{Arc, OnceLock, Weak};

use bytemuck::{NoUninit, Pod};

use super::Hash;
use crate::memory::huge_vec;
use crate::parallel::*;

mod blocks;
mod buffer_pool;
mod diff;

pub(crate) use blocks::ColumnHasher;
use blocks::{Blocks, of_one_block};
use buffer_pool::{BufferPool, SpareBuffer, copy};

/// An immutable list of plain items. Cloning it copies no items; its hash is computed on first use.
#[derive(Clone)]
pub struct Column<T>(Arc<SharedItems<T>>);

struct SharedItems<T> {
    items: Vec<T>,
    hash: OnceLock<Hash>,
    /// The hashes of the column's blocks, if there are several.
    blocks: OnceLock<Blocks>,
    /// The buffer pool of a large column. Columns that are made from one another share a pool.
    pool: OnceLock<Arc<BufferPool<T>>>,
}

impl<T> SharedItems<T> {
    fn new(items: Vec<T>) -> Self {
        Self { items, hash: OnceLock::new(), blocks: OnceLock::new(), pool: OnceLock::new() }
    }
}

impl<T> Drop for SharedItems<T> {
    /// Gives the buffer of the items to the pool, if another column still shares the pool.
    fn drop(&mut self) {
        let (Some(pool), Some(blocks)) = (self.pool.take(), self.blocks.take()) else { return };
        if Arc::strong_count(&pool) > 1 {
            pool.put(SpareBuffer { items: std::mem::take(&mut self.items), blocks });
        }
    }
}

impl<T: NoUninit + Send + Sync> Column<T> {
    /// The hash of the items' bytes and their number.
    pub fn hash(&self) -> Hash {
        *self.0.hash.get_or_init(|| {
            let one = of_one_block(self.len(), self.bytes());
            one.unwrap_or_else(|| self.blocks().root())
        })
    }

    /// Returns false if the items were overwritten after their hash was computed.
    pub(super) fn is_intact(&self) -> bool {
        let Some(known) = self.0.hash.get() else { return true };
        let hash = of_one_block(self.len(), self.bytes())
            .unwrap_or_else(|| Blocks::new(self.len(), self.bytes()).root());
        *known == hash
    }

    /// Feeds the hasher with bytes that identify the items in the given rows and the positions of these items. Different items or positions
    /// give different bytes. If the hash of the column is known, no item is read.
    pub fn hash_rows(&self, rows: Range<usize>, to: &mut blake3::Hasher) {
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

    /// The memory that the items hold, in bytes. A column reserves no capacity for more items.
    pub fn size(&self) -> usize {
        size_of_val(&self.0.items[..])
    }
}

impl<T: Pod + Send + Sync> Column<T> {
    /// A copy of the column in which the items of some rows (ranges of indices) are replaced. `others` holds the new items of all rows, one
    /// row after the other. Only the blocks that contain changed items are hashed again. All items are copied, unless the pool has the
    /// buffer of a dropped column: then only the items that have changed since that column was made are copied.
    ///
    /// # Panics
    /// If a row is out of bounds, rows overlap or are not in ascending order, or `others` has the wrong length.
    #[must_use]
    pub fn with_rows(&self, rows: &[Range<u32>], others: &[T]) -> Self {
        let mut count = 0;
        let firsts: Vec<_> = rows
            .iter()
            .map(|row| {
                count += row.len();
                count - row.len()
            })
            .collect();
        assert!(count == others.len(), "{} items for rows of {count} items", others.len());
        self.with_rows_by(rows, |piece, to| {
            let row = rows.partition_point(|row| row.end <= piece.start);
            let first = firsts[row] + (piece.start - rows[row].start) as usize;
            to.copy_from_slice(&others[first..first + to.len()]);
        })
    }

    /// As [`Self::with_rows`], but the new items are written by a function, which gets one piece of a row at a time and is called on all
    /// threads.
    ///
    /// # Panics
    /// If a row is out of bounds, or rows overlap or are not in ascending order.
    #[must_use]
    pub fn with_rows_by(
        &self,
        rows: &[Range<u32>],
        write: impl Fn(Range<u32>, &mut [T]) + Sync,
    ) -> Self {
        let is_large = buffer_pool::MIN_POOLED_BYTES <= self.size();
        let pool = is_large.then(|| self.0.pool.get_or_init(|| Arc::new(BufferPool::new())));
        let mut items = match pool.and_then(|pool| pool.take()) {
            Some(spare) => spare.update_to(self, self.blocks()),
            None => {
                let mut items = huge_vec(self.len());
                copy(self, &mut items);
                items
            }
        };
        items.par_rows_mut(rows, buffer_pool::PIECE_LEN).for_each(|(row, to)| write(row, to));
        let column = Self(Arc::new(SharedItems::new(items)));
        if let Some(pool) = pool {
            // No other thread has access to the new column yet, so neither of the two calls of `set` fails.
            let _ = column.0.pool.set(pool.clone());
        }
        if of_one_block(0, self.bytes()).is_none() {
            let blocks = self.blocks().with_changed_rows(rows, size_of::<T>(), column.bytes());
            let _ = column.0.blocks.set(blocks);
        }
        column
    }
}

/// A weak reference to a column.
pub(super) struct WeakColumn<T>(Weak<SharedItems<T>>);

impl<T> Clone for WeakColumn<T> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<T> WeakColumn<T> {
    /// Returns the column if it still exists.
    pub(super) fn upgrade(&self) -> Option<Column<T>> {
        self.0.upgrade().map(Column)
    }
}

impl<T> Column<T> {
    /// Returns a weak reference.
    pub(super) fn downgrade(&self) -> WeakColumn<T> {
        WeakColumn(Arc::downgrade(&self.0))
    }

    /// A column whose hash is known.
    pub fn with_known_hash(items: Vec<T>, hash: Hash) -> Self {
        let column = Self(Arc::new(SharedItems::new(items)));
        let _ = column.0.hash.set(hash);
        column
    }
}

impl<T> From<Vec<T>> for Column<T> {
    fn from(mut items: Vec<T>) -> Self {
        // Release the unused capacity, which would otherwise take memory for as long as the column exists.
        items.shrink_to_fit();
        Self(Arc::new(SharedItems::new(items)))
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
    fn a_column_with_replaced_rows_equals_one_made_of_its_items() {
        for len in [3_u32, 1000, 50_000] {
            let mut items: Vec<_> = (0..len).map(f64::from).collect();
            let column = Column::from(items.clone());
            let rows = [0..1, len / 2..len / 2, len / 2..len - 1, len - 1..len];
            let indices: Vec<_> = rows.iter().cloned().flatten().collect();
            let others: Vec<_> = indices.iter().map(|&index| -2.0 * f64::from(index)).collect();
            let other = column.with_rows(&rows, &others);
            indices.iter().zip(&others).for_each(|(&index, &item)| items[index as usize] = item);
            assert_eq!(other[..], items);
            assert_eq!(other.hash(), Column::from(items).hash());
            assert_eq!(column.with_rows(&[], &[]).hash(), column.hash());
        }
    }

    /// Makes columns from each other and drops them in random order. Each must have the right items and the right hash.
    #[test]
    fn columns_in_reused_buffers_have_the_right_items_and_hashes() {
        let mut random = 20_070_115_u64;
        fn random_below(limit: usize, random: &mut u64) -> usize {
            *random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (*random >> 33) as usize % limit
        }
        let len = buffer_pool::MIN_POOLED_BYTES / size_of::<[f64; 3]>() + 1;
        let first: Vec<_> = (0..len).map(|k| [k as f64, 0.0, -1.0]).collect();
        let mut known = vec![(Column::from(first.clone()), first)];
        let mut from_spares = 0;
        for step in 0..300 {
            let (column, mut items) = known[random_below(known.len(), &mut random)].clone();
            // Most steps change few items of the column, and some change most of them.
            let limit = if random_below(10, &mut random) == 0 { len } else { 1 + len / 50 };
            let starts =
                [random_below(len / 2, &mut random), len / 2 + random_below(len / 2, &mut random)];
            let rows = starts.map(|start| {
                (
                    start,
                    (start + random_below(limit, &mut random)).min(if start < len / 2 {
                        len / 2
                    } else {
                        len
                    }),
                )
            });
            let others = rows
                .iter()
                .flat_map(|&(start, end)| (start..end).map(|k| [k as f64, f64::from(step), 0.5]))
                .collect::<Vec<_>>();
            rows.iter().for_each(|&(start, end)| {
                (start..end).for_each(|k| items[k] = [k as f64, f64::from(step), 0.5]);
            });
            from_spares += usize::from(column.0.pool.get().is_some_and(|pool| pool.has_spare()));
            let made =
                column.with_rows(&rows.map(|(start, end)| start as u32..end as u32), &others);
            assert!(made[..] == items[..] && made.hash() == Column::from(items.clone()).hash());
            known.push((made, items));
            if 1 + random_below(4, &mut random) < known.len() {
                known.swap_remove(random_below(known.len(), &mut random));
            }
        }
        assert!(from_spares > 100, "{from_spares}");
        for (column, items) in known {
            assert!(column[..] == items[..]);
        }
    }

    #[test]
    fn the_last_column_of_a_pool_drops_its_buffer() {
        let column = Column::from(vec![0_u8; buffer_pool::MIN_POOLED_BYTES]);
        let other = column.with_rows(&[7..8, 8..8], &[1]);
        let pool = Arc::downgrade(column.0.pool.get().unwrap());
        drop(column);
        assert!(pool.upgrade().unwrap().has_spare());
        drop(other);
        assert!(pool.upgrade().is_none());
    }

    #[test]
    fn a_large_column_hashes_the_same_with_several_threads() {
        let items: Vec<u32> = (0..200_000).collect();
        let several = Column::from(items.clone()).hash();
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(several, one.install(|| Column::from(items).hash()));
    }
}
