//! Union-find: disjoint sets of numbers.

use maquette_value::parallel::StopFlag;

/// Disjoint sets of numbers. Each set is represented by its lowest number. Tarjan, "Efficiency of a good but not linear set union
/// algorithm" (1975), with path halving. Merging stops with the running computation.
pub struct UnionFind {
    parents: Vec<u32>,
    stop: StopFlag,
}

impl UnionFind {
    /// Creates one set for each number less than `count`.
    pub fn new(count: usize) -> Self {
        Self { parents: (0..count as u32).collect(), stop: StopFlag::current() }
    }

    /// Returns the lowest number of the set that contains `number`.
    pub fn find(&mut self, mut number: u32) -> u32 {
        while self.parents[number as usize] != number {
            let parent = self.parents[number as usize];
            self.parents[number as usize] = self.parents[parent as usize];
            number = self.parents[number as usize];
        }
        number
    }

    /// Merges the sets that contain `a` and `b`.
    pub fn union(&mut self, a: u32, b: u32) {
        self.stop.check();
        // Fast path: in most calls both numbers are already in the same set and have the same parent.
        if self.parents[a as usize] != self.parents[b as usize] {
            let [a, b] = [self.find(a), self.find(b)];
            self.parents[a.max(b) as usize] = a.min(b);
        }
    }

    /// Returns for each number the label of its set, and for each label the lowest number of the set. Labels count from 0 in the order of
    /// the lowest numbers.
    pub fn into_labels(mut self) -> (Vec<u32>, Vec<u32>) {
        let mut firsts = Vec::new();
        let mut numbers = vec![0; self.parents.len()];
        for number in 0..self.parents.len() as u32 {
            self.stop.check();
            let first = self.find(number);
            if first == number {
                numbers[number as usize] = firsts.len() as u32;
                firsts.push(number);
            } else {
                numbers[number as usize] = numbers[first as usize];
            }
        }
        (numbers, firsts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_are_labeled_in_order_of_their_lowest_members() {
        let mut sets = UnionFind::new(6);
        for (a, b) in [(5, 3), (1, 4), (4, 5), (3, 1)] {
            sets.union(a, b);
        }
        assert_eq!([5, 2, 0].map(|number| sets.find(number)), [1, 2, 0]);
        assert_eq!(sets.into_labels(), (vec![0, 1, 2, 1, 1, 1], vec![0, 1, 2]));
    }
}
