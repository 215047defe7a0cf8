//! Many short lists in one.

/// Lists, one after the other in one piece of memory.
#[derive(Clone, Debug, Default)]
pub struct Lists<T = u32> {
    /// Where each list begins in `items`, with the end behind the last.
    starts: Vec<u32>,
    items: Vec<T>,
}

impl Lists {
    /// One list after the other.
    pub fn collect(lists: impl Iterator<Item = impl AsRef<[u32]>>) -> Self {
        let mut all = Self { starts: vec![0], items: Vec::new() };
        for list in lists {
            all.items.extend(list.as_ref());
            all.starts.push(all.items.len() as u32);
        }
        all
    }
}

impl<T: Copy + Default> Lists<T> {
    /// A list for each number below `count`: the items that are paired with it, in their order.
    pub fn group<I: Iterator<Item = (u32, T)>>(count: usize, pairs: impl Fn() -> I) -> Self {
        let mut starts = vec![0u32; count + 1];
        pairs().for_each(|(list, _)| starts[list as usize + 1] += 1);
        for list in 0..count {
            starts[list + 1] += starts[list];
        }
        let mut ends = starts.clone();
        let mut items = vec![T::default(); starts[count] as usize];
        for (list, item) in pairs() {
            let end = &mut ends[list as usize];
            items[*end as usize] = item;
            *end += 1;
        }
        Self { starts, items }
    }
}

impl<T> Lists<T> {
    /// The number of lists.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Where the items of a list are among all.
    pub fn range(&self, list: usize) -> std::ops::Range<usize> {
        self.starts[list] as usize..self.starts[list + 1] as usize
    }

    /// The items of a list.
    pub fn of(&self, list: usize) -> &[T] {
        &self.items[self.range(list)]
    }

    /// The items of all lists.
    pub fn all(&self) -> &[T] {
        &self.items
    }
}
