//! A list of lists in contiguous memory.

use maquette_value::KeyChunks;
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

impl<T: Copy + Default + Send + Sync> Lists<T> {
    /// Groups items by key in parallel. The pairs `(key, item)` are those that `pairs` returns for the sources `0..sources`, in order; the
    /// result is that of [`group`](Self::group).
    pub fn group_all<I: Iterator<Item = (u32, T)>>(
        count: usize,
        sources: usize,
        pairs: impl Fn(usize) -> I + Sync,
    ) -> Self {
        let chunks = KeyChunks::new(count, sources, |source| pairs(source).map(|(key, _)| key));
        let (chunks, pairs) = (&chunks, &pairs);
        let parts: Vec<Self> = (0..chunks.count())
            .into_par_iter()
            .map(|chunk: usize| Self::group_chunk(chunks, chunk, pairs))
            .collect();
        let mut all = Self { starts: Vec::with_capacity(count + 1), items: Vec::new() };
        all.starts.push(0);
        all.items.reserve_exact(parts.iter().map(|part| part.items.len()).sum());
        for part in parts {
            let first = all.items.len() as u32;
            all.starts.extend(part.starts[1..].iter().map(|start| first + start));
            all.items.extend_from_slice(&part.items);
        }
        all
    }

    /// Groups the items whose keys are in a chunk. List 0 is that of the chunk's first key.
    fn group_chunk<I: Iterator<Item = (u32, T)>>(
        chunks: &KeyChunks,
        chunk: usize,
        pairs: &impl Fn(usize) -> I,
    ) -> Self {
        let keys = chunks.keys(chunk);
        let mut starts = vec![0_u32; keys.len() + 1];
        chunks.for_each_source(chunk, |source| {
            let own = pairs(source).filter(|(key, _)| keys.contains(&(*key as usize)));
            own.for_each(|(key, _)| starts[key as usize - keys.start + 1] += 1);
        });
        for list in 0..keys.len() {
            starts[list + 1] += starts[list];
        }
        let mut ends = starts.clone();
        let mut items = vec![T::default(); starts[keys.len()] as usize];
        chunks.for_each_source(chunk, |source| {
            let own = pairs(source).filter(|(key, _)| keys.contains(&(*key as usize)));
            for (key, item) in own {
                let end = &mut ends[key as usize - keys.start];
                items[*end as usize] = item;
                *end += 1;
            }
        });
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

#[cfg(test)]
mod tests {
    use maquette_value::rng::Random;

    use super::*;

    #[test]
    fn grouping_in_parallel_keeps_the_order_of_the_pairs() {
        let mut random = Random(9);
        for [count, sources] in [[0, 0], [7, 500], [20_000, 30_000], [300_000, 9000]] {
            let keys: Vec<[u32; 3]> =
                (0..sources).map(|_| [0; 3].map(|_| random.next_below(count) as u32)).collect();
            let pairs = |source: usize| {
                keys[source]
                    .into_iter()
                    .zip(0..3_u32)
                    .map(move |(key, k)| (key, [source as u32, k]))
            };
            let expected = Lists::group(count, || (0..sources).flat_map(pairs));
            let found = Lists::group_all(count, sources, pairs);
            assert_eq!((found.starts, found.items), (expected.starts, expected.items));
        }
    }
}
