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
mod line;

use blocks::{Blocks, of_one_block};
use line::{Line, Spare, copy};

/// A list of plain items: cloning it copies nothing, and its hash is computed when first asked for.
#[derive(Clone)]
pub struct Column<T>(Arc<Shared<T>>);

struct Shared<T> {
    items: Vec<T>,
    hash: OnceLock<Hash>,
    /// Of a column that has several.
    blocks: OnceLock<Blocks>,
    /// Of a large column of which others were made, or that was made of another one.
    line: OnceLock<Arc<Line<T>>>,
}

impl<T> Shared<T> {
    fn new(items: Vec<T>) -> Self {
        Self { items, hash: OnceLock::new(), blocks: OnceLock::new(), line: OnceLock::new() }
    }
}

impl<T> Drop for Shared<T> {
    /// What nobody has any more becomes a spare of the next one of its line, if there will be any.
    fn drop(&mut self) {
        let (Some(line), Some(blocks)) = (self.line.take(), self.blocks.take()) else { return };
        if Arc::strong_count(&line) > 1 {
            line.put(Spare { items: std::mem::take(&mut self.items), blocks });
        }
    }
}

impl<T: NoUninit + Send + Sync> Column<T> {
    /// The hash of the items' bytes and their number.
    pub fn hash(&self) -> Hash {
        *self.0.hash.get_or_init(|| {
            let one = of_one_block(self.len(), self.bytes());
            one.unwrap_or_else(|| self.blocks().whole())
        })
    }

    /// Returns false if something has written into the items since their hash was computed.
    pub(super) fn is_intact(&self) -> bool {
        let hash = || {
            of_one_block(self.len(), self.bytes())
                .unwrap_or_else(|| Blocks::new(self.len(), self.bytes()).whole())
        };
        self.0.hash.get().is_none_or(|known| *known == hash())
    }

    /// Hashes what tells the items in these rows, and where they are, from others. It looks at no item if the hash of the column is known.
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

    /// How much memory the items hold, in bytes: what follows from their number, because nothing is set aside for more of them.
    pub fn size(&self) -> usize {
        size_of_val(&self.0.items[..])
    }
}

impl<T: Pod + Send + Sync> Column<T> {
    /// The same column with other items in some rows: those of all rows, one row after the other. Only what is around those that are others
    /// is hashed again. All are copied, but where a large column that was made of this one, or of which this one was made, is gone: of
    /// its copy only what has changed since.
    ///
    /// # Panics
    /// If there are no such rows, they are not in order and apart from each other, or take more or fewer items.
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
        assert!(count == others.len(), "{} items for {count} places", others.len());
        self.with_rows_by(rows, |piece, to| {
            let row = rows.partition_point(|row| row.end <= piece.start);
            let first = firsts[row] + (piece.start - rows[row].start) as usize;
            to.copy_from_slice(&others[first..first + to.len()]);
        })
    }

    /// [`Self::with_rows`], by what writes the items of a piece of a row to their places; it is called on all threads.
    ///
    /// # Panics
    /// If there are no such rows, or they are not in order and apart from each other.
    #[must_use]
    pub fn with_rows_by(
        &self,
        rows: &[Range<u32>],
        write: impl Fn(Range<u32>, &mut [T]) + Sync,
    ) -> Self {
        let is_large = line::LEAST <= self.size();
        let line = is_large.then(|| self.0.line.get_or_init(|| Arc::new(Line::new())));
        let mut items = match line.and_then(|line| line.take()) {
            Some(spare) => spare.turned_into(self, self.blocks()),
            None => {
                let mut items = huge_vec(self.len());
                copy(self, &mut items);
                items
            }
        };
        items.par_rows_mut(rows, line::PIECE).for_each(|(row, to)| write(row, to));
        let column = Self(Arc::new(Shared::new(items)));
        if let Some(line) = line {
            // Nobody else knows the column yet: neither this nor what follows is there.
            let _ = column.0.line.set(line.clone());
        }
        if of_one_block(0, self.bytes()).is_none() {
            let blocks = self.blocks().after(rows, size_of::<T>(), column.bytes());
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
    pub fn of_hash(items: Vec<T>, hash: Hash) -> Self {
        let column = Self(Arc::new(Shared::new(items)));
        let _ = column.0.hash.set(hash);
        column
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
            let mut items: Vec<_> = (0..len).map(f64::from).collect();
            let column = Column::from(items.clone());
            let rows = [0..1, len / 2..len / 2, len / 2..len - 1, len - 1..len];
            let places: Vec<_> = rows.iter().cloned().flatten().collect();
            let others: Vec<_> = places.iter().map(|&place| -2.0 * f64::from(place)).collect();
            let other = column.with_rows(&rows, &others);
            places.iter().zip(&others).for_each(|(&place, &item)| items[place as usize] = item);
            assert_eq!(other[..], items);
            assert_eq!(other.hash(), Column::from(items).hash());
            assert_eq!(column.with_rows(&[], &[]).hash(), column.hash());
        }
    }

    /// Columns are made of any others of a line, and dropped in any order: each has the items and the hash that it should have.
    #[test]
    fn a_column_made_of_what_is_left_of_others_is_as_one_made_anew() {
        let mut random = 20_070_115_u64;
        fn below(most: usize, random: &mut u64) -> usize {
            *random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (*random >> 33) as usize % most
        }
        let len = line::LEAST / size_of::<[f64; 3]>() + 1;
        let first: Vec<_> = (0..len).map(|k| [k as f64, 0.0, -1.0]).collect();
        let mut known = vec![(Column::from(first.clone()), first)];
        let mut from_spares = 0;
        for step in 0..300 {
            let (column, mut items) = known[below(known.len(), &mut random)].clone();
            // Few rows, and now and then most of them.
            let most = if below(10, &mut random) == 0 { len } else { 1 + len / 50 };
            let starts = [below(len / 2, &mut random), len / 2 + below(len / 2, &mut random)];
            let rows = starts.map(|start| {
                (
                    start,
                    (start + below(most, &mut random)).min(if start < len / 2 {
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
            from_spares += usize::from(column.0.line.get().is_some_and(|line| line.has_spare()));
            let made =
                column.with_rows(&rows.map(|(start, end)| start as u32..end as u32), &others);
            assert!(made[..] == items[..] && made.hash() == Column::from(items.clone()).hash());
            known.push((made, items));
            if 1 + below(4, &mut random) < known.len() {
                known.swap_remove(below(known.len(), &mut random));
            }
        }
        assert!(from_spares > 100, "{from_spares}");
        for (column, items) in known {
            assert!(column[..] == items[..]);
        }
    }

    #[test]
    fn nothing_is_left_of_the_last_column_of_a_line() {
        let column = Column::from(vec![0_u8; line::LEAST]);
        let other = column.with_rows(&[7..8, 8..8], &[1]);
        let line = Arc::downgrade(column.0.line.get().unwrap());
        drop(column);
        assert!(line.upgrade().unwrap().has_spare());
        drop(other);
        assert!(line.upgrade().is_none());
    }

    #[test]
    fn a_large_column_hashes_the_same_with_several_threads() {
        let items: Vec<u32> = (0..200_000).collect();
        let several = Column::from(items.clone()).hash();
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(several, one.install(|| Column::from(items).hash()));
    }
}
