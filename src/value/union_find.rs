//! Disjoint sets of integers.

use crate::parallel::StopFlag;

/// Disjoint sets of the integers from 0 to a count (excluded). The representative of a set is its smallest member.
///
/// Merging stops with the running computation.
pub(crate) struct UnionFind(Vec<u32>, StopFlag);

impl UnionFind {
    /// Builds one set for each integer.
    pub(crate) fn new(count: usize) -> Self {
        Self((0..count as u32).collect(), StopFlag::current())
    }

    /// The representative of the set that contains `number`.
    pub(crate) fn find(&mut self, mut number: u32) -> u32 {
        while self.0[number as usize] != number {
            // Path halving, which shortens later searches.
            self.0[number as usize] = self.0[self.0[number as usize] as usize];
            number = self.0[number as usize];
        }
        number
    }

    /// Merges the sets of two numbers.
    pub(crate) fn union(&mut self, a: u32, b: u32) {
        self.1.check();
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
