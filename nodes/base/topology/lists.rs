//! A list of lists in contiguous memory.

use maquette_value::parallel::*;

/// A list of lists, stored one after another in contiguous memory.
#[derive(Clone, Debug, Default)]
pub struct Lists<T = u32> {
    /// For each list the index in `items` at which it begins, followed by the number of items.
    starts: Vec<u32>,
    items: Vec<T>,
}

impl Lists {
    /// Collects lists. Their order is kept.
    pub fn collect(lists: impl Iterator<Item = impl AsRef<[u32]>>) -> Self {
        let mut all = Self { starts: vec![0], items: Vec::new() };
        for list in lists.until_stopped() {
            all.items.extend(list.as_ref());
            all.starts.push(all.items.len() as u32);
        }
        all
    }
}

impl<T: Copy + Default> Lists<T> {
    /// Groups items by key: list `k` contains the items of all pairs `(k, item)`, in the order of the pairs. All keys must be less than
    /// `count`.
    pub fn group<I: Iterator<Item = (u32, T)>>(count: usize, pairs: impl Fn() -> I) -> Self {
        let mut starts = vec![0u32; count + 1];
        pairs().until_stopped().for_each(|(list, _)| starts[list as usize + 1] += 1);
        for list in 0..count {
            starts[list + 1] += starts[list];
        }
        let mut ends = starts.clone();
        let mut items = vec![T::default(); starts[count] as usize];
        for (list, item) in pairs().until_stopped() {
            let end = &mut ends[list as usize];
            items[*end as usize] = item;
            *end += 1;
        }
        Self { starts, items }
    }
}

impl<T: Copy> Lists<T> {
    /// Concatenates batches of lists. Each batch has the lengths of its lists and all their items.
    pub fn concat(batches: Vec<(Vec<u32>, Vec<T>)>) -> Self {
        let mut starts =
            Vec::with_capacity(batches.iter().map(|batch| batch.0.len()).sum::<usize>() + 1);
        let mut items = Vec::with_capacity(batches.iter().map(|batch| batch.1.len()).sum());
        let mut end = 0;
        starts.push(end);
        for (lengths, batch) in batches {
            starts.extend(lengths.into_iter().map(|length| {
                end += length;
                end
            }));
            items.extend_from_slice(&batch);
        }
        Self { starts, items }
    }
}

impl<T> Lists<T> {
    /// The number of lists.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Returns true if there are no lists.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The range of a list's items among all items.
    pub fn range(&self, list: usize) -> std::ops::Range<usize> {
        self.starts[list] as usize..self.starts[list + 1] as usize
    }

    /// The items of a list.
    pub fn list(&self, list: usize) -> &[T] {
        &self.items[self.range(list)]
    }

    /// The items of all lists, one list after another.
    pub fn items(&self) -> &[T] {
        &self.items
    }
}
