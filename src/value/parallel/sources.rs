//! Sources of parallel loops: slices, chunks, ranges of integers, and lists that are consumed.

use std::cmp::Ordering;
use std::ops::Range;
use std::{slice, vec};

use super::{Parallel, StopFlag, span};

/// Types that can be converted to a parallel iterator.
pub trait IntoParallel {
    /// The parallel iterator to which the value is converted.
    type Items: Parallel;

    /// Converts the value to a parallel iterator.
    fn into_par_iter(self) -> Self::Items;
}

impl<P: Parallel> IntoParallel for P {
    type Items = P;

    fn into_par_iter(self) -> P {
        self
    }
}

/// Parallel iteration over slices.
pub trait ParallelSlice<T: Sync>: AsRef<[T]> {
    /// Returns a parallel iterator over references to the items.
    fn par_iter(&self) -> Items<'_, T> {
        Items(self.as_ref())
    }

    /// Chunks of `size` items, the last one possibly shorter.
    ///
    /// # Panics
    /// If `size` is 0.
    fn par_chunks(&self, size: usize) -> Chunks<'_, T> {
        assert!(size > 0, "chunks without items");
        Chunks { items: self.as_ref(), size }
    }

    /// Chunks of exactly `size` items. A shorter rest at the end is left out.
    ///
    /// # Panics
    /// If `size` is 0.
    fn par_chunks_exact(&self, size: usize) -> Chunks<'_, T> {
        let items = self.as_ref();
        items[..items.len() - items.len() % size].par_chunks(size)
    }

    /// Overlapping windows of `size` items.
    ///
    /// # Panics
    /// If `size` is 0.
    fn par_windows<'a>(&'a self, size: usize) -> impl Parallel<Item = &'a [T]>
    where
        T: 'a,
    {
        assert!(size > 0, "windows without items");
        let items = self.as_ref();
        let starts = 0..(items.len() + 1).saturating_sub(size);
        starts.into_par_iter().map(move |start| &items[start..start + size])
    }
}

impl<T: Sync> ParallelSlice<T> for [T] {}

/// Parallel mutable iteration over slices.
pub trait ParallelSliceMut<T: Send>: AsMut<[T]> {
    /// Returns a parallel iterator over mutable references to the items.
    fn par_iter_mut(&mut self) -> ItemsMut<'_, T> {
        ItemsMut(self.as_mut())
    }

    /// Chunks of `size` items, the last one possibly shorter.
    ///
    /// # Panics
    /// If `size` is 0.
    fn par_chunks_mut(&mut self, size: usize) -> ChunksMut<'_, T> {
        assert!(size > 0, "chunks without items");
        ChunksMut { items: self.as_mut(), size }
    }

    /// Chunks of at most `size` items of the given rows. Each chunk comes with the range of its indices.
    ///
    /// # Panics
    /// If a row is out of bounds, rows overlap or are not in ascending order, or `size` is 0.
    fn par_rows_mut(
        &mut self,
        rows: &[Range<u32>],
        size: usize,
    ) -> VecItems<(Range<u32>, &mut [T])> {
        let mut pieces = Vec::with_capacity(rows.len());
        let (mut rest, mut first) = (self.as_mut(), 0);
        for row in rows {
            assert!(first <= row.start, "rows are in order and apart from each other");
            let (_, after) = rest.split_at_mut((row.start - first) as usize);
            let (items, after) = after.split_at_mut(row.len());
            let starts = row.clone().step_by(size);
            pieces.extend(starts.zip(items.chunks_mut(size)).map(|(start, items)| {
                let end = start + items.len() as u32;
                (start..end, items)
            }));
            (rest, first) = (after, row.start.max(row.end));
        }
        VecItems(pieces)
    }

    /// Sorts the slice. Equal items may change their order.
    fn par_sort_unstable(&mut self)
    where
        T: Ord,
    {
        let (items, stop) = (self.as_mut(), StopFlag::current());
        span::sort(items.len(), || {
            rayon::slice::ParallelSliceMut::par_sort_unstable_by(items, |a, b| {
                stop.check();
                // Only this comparison matters to the algorithm.
                if a.lt(b) { Ordering::Less } else { Ordering::Greater }
            });
        });
    }

    /// Sorts the slice by keys. Items with equal keys may change their order.
    fn par_sort_unstable_by_key<K: Ord>(&mut self, key: impl Fn(&T) -> K + Sync) {
        let (items, stop) = (self.as_mut(), StopFlag::current());
        span::sort(items.len(), || {
            rayon::slice::ParallelSliceMut::par_sort_unstable_by_key(items, |item| {
                stop.check();
                key(item)
            });
        });
    }
}

impl<T: Send> ParallelSliceMut<T> for [T] {}

/// Implements [`IntoParallel`] for a collection.
macro_rules! into_parallel {
    ($($bound:ident $collection:ty => $items:ident<$($lifetime:lifetime)? T>)+) => {$(
        impl<$($lifetime,)? T: $bound> IntoParallel for $collection {
            type Items = $items<$($lifetime,)? T>;

            fn into_par_iter(self) -> Self::Items {
                $items(self)
            }
        }
    )+};
}

into_parallel! {
    Sync &'a [T] => Items<'a T>
    Sync &'a Vec<T> => Items<'a T>
    Send &'a mut [T] => ItemsMut<'a T>
    Send &'a mut Vec<T> => ItemsMut<'a T>
    Send Vec<T> => VecItems<T>
}

/// The items of a slice.
#[derive(Clone, Debug)]
pub struct Items<'a, T>(&'a [T]);

impl<'a, T: Sync> Parallel for Items<'a, T> {
    type Item = &'a T;
    type Part = slice::Iter<'a, T>;

    fn index_count(&self) -> usize {
        self.0.len()
    }

    fn split_at(self, index: usize) -> (Self, Self) {
        let (before, after) = self.0.split_at(index);
        (Self(before), Self(after))
    }

    fn part(self) -> slice::Iter<'a, T> {
        self.0.iter()
    }
}

/// The items of a slice, as mutable references.
#[derive(Debug)]
pub struct ItemsMut<'a, T>(pub(super) &'a mut [T]);

impl<'a, T: Send> Parallel for ItemsMut<'a, T> {
    type Item = &'a mut T;
    type Part = slice::IterMut<'a, T>;

    fn index_count(&self) -> usize {
        self.0.len()
    }

    fn split_at(self, index: usize) -> (Self, Self) {
        let (before, after) = self.0.split_at_mut(index);
        (Self(before), Self(after))
    }

    fn part(self) -> slice::IterMut<'a, T> {
        self.0.iter_mut()
    }
}

/// Chunks of a slice.
#[derive(Clone, Debug)]
pub struct Chunks<'a, T> {
    items: &'a [T],
    size: usize,
}

impl<'a, T: Sync> Parallel for Chunks<'a, T> {
    type Item = &'a [T];
    type Part = slice::Chunks<'a, T>;

    fn index_count(&self) -> usize {
        self.items.len().div_ceil(self.size)
    }

    fn split_at(self, index: usize) -> (Self, Self) {
        let (before, after) = self.items.split_at(self.items.len().min(index * self.size));
        (Self { items: before, ..self }, Self { items: after, ..self })
    }

    fn weight(&self) -> usize {
        self.items.len()
    }

    fn part(self) -> slice::Chunks<'a, T> {
        self.items.chunks(self.size)
    }
}

/// Mutable chunks of a slice.
#[derive(Debug)]
pub struct ChunksMut<'a, T> {
    items: &'a mut [T],
    size: usize,
}

impl<'a, T: Send> Parallel for ChunksMut<'a, T> {
    type Item = &'a mut [T];
    type Part = slice::ChunksMut<'a, T>;

    fn index_count(&self) -> usize {
        self.items.len().div_ceil(self.size)
    }

    fn split_at(self, index: usize) -> (Self, Self) {
        let Self { items, size } = self;
        let (before, after) = items.split_at_mut(items.len().min(index * size));
        (Self { items: before, size }, Self { items: after, size })
    }

    fn weight(&self) -> usize {
        self.items.len()
    }

    fn part(self) -> slice::ChunksMut<'a, T> {
        self.items.chunks_mut(self.size)
    }
}

/// The items of a list, which is consumed.
#[derive(Debug)]
pub struct VecItems<T>(Vec<T>);

impl<T: Send> Parallel for VecItems<T> {
    type Item = T;
    type Part = vec::IntoIter<T>;

    fn index_count(&self) -> usize {
        self.0.len()
    }

    fn split_at(mut self, index: usize) -> (Self, Self) {
        let after = self.0.split_off(index);
        (self, Self(after))
    }

    fn part(self) -> vec::IntoIter<T> {
        self.0.into_iter()
    }
}

/// A range of integers.
#[derive(Clone, Debug)]
pub struct Numbers<N>(Range<N>);

macro_rules! numbers {
    ($($number:ty)+) => {$(
        impl IntoParallel for Range<$number> {
            type Items = Numbers<$number>;

            fn into_par_iter(self) -> Numbers<$number> {
                Numbers(self.start..self.end.max(self.start))
            }
        }

        impl Parallel for Numbers<$number> {
            type Item = $number;
            type Part = Range<$number>;

            fn index_count(&self) -> usize {
                (self.0.end - self.0.start) as usize
            }

            fn split_at(self, index: usize) -> (Self, Self) {
                let middle = self.0.start + index as $number;
                (Self(self.0.start..middle), Self(middle..self.0.end))
            }

            fn part(self) -> Range<$number> {
                self.0
            }
        }
    )+};
}

numbers!(i32 u32 u64 usize);
