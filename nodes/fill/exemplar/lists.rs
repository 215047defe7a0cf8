//! Many short lists in one.

/// Lists of numbers, one after the other in one piece of memory.
#[derive(Clone, Debug, Default)]
pub(super) struct Lists {
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Lists {
    /// One list after the other.
    pub(super) fn collect(lists: impl Iterator<Item = impl AsRef<[u32]>>) -> Self {
        let mut all = Self { starts: vec![0], items: Vec::new() };
        for list in lists {
            all.items.extend(list.as_ref());
            all.starts.push(all.items.len() as u32);
        }
        all
    }

    /// For each number below `count` the items that come with it, in their order.
    pub(super) fn group<I: Iterator<Item = (u32, u32)>>(
        count: usize,
        pairs: impl Fn() -> I,
    ) -> Self {
        let mut starts = vec![0u32; count + 1];
        pairs().for_each(|(list, _)| starts[list as usize + 1] += 1);
        for list in 0..count {
            starts[list + 1] += starts[list];
        }
        let mut ends = starts.clone();
        let mut items = vec![0; starts[count] as usize];
        for (list, item) in pairs() {
            let end = &mut ends[list as usize];
            items[*end as usize] = item;
            *end += 1;
        }
        Self { starts, items }
    }

    /// The number of lists.
    pub(super) fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Where the items of a list are among all.
    pub(super) fn range(&self, list: usize) -> std::ops::Range<usize> {
        self.starts[list] as usize..self.starts[list + 1] as usize
    }

    /// The items of a list.
    pub(super) fn of(&self, list: usize) -> &[u32] {
        &self.items[self.range(list)]
    }

    /// The items of all lists.
    pub(super) fn all(&self) -> &[u32] {
        &self.items
    }
}
