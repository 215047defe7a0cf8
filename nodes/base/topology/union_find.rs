//! Disjoint sets that are joined one by one.

/// Numbers in sets, each of which is known by its lowest number: Tarjan, "Efficiency of a good but not linear set union algorithm" (1975),
/// with paths halved.
pub struct UnionFind {
    parents: Vec<u32>,
}

impl UnionFind {
    /// Each number below `count` alone.
    pub fn new(count: usize) -> Self {
        Self { parents: (0..count as u32).collect() }
    }

    /// The lowest number of the set that this one is in.
    pub fn first(&mut self, mut number: u32) -> u32 {
        while self.parents[number as usize] != number {
            let parent = self.parents[number as usize];
            self.parents[number as usize] = self.parents[parent as usize];
            number = self.parents[number as usize];
        }
        number
    }

    /// Makes one set of those that `a` and `b` are in.
    pub fn join(&mut self, a: u32, b: u32) {
        // Nearly always both are in one set already, and have the same parent.
        if self.parents[a as usize] != self.parents[b as usize] {
            let [a, b] = [self.first(a), self.first(b)];
            self.parents[a.max(b) as usize] = a.min(b);
        }
    }

    /// The set of each number, where sets are numbered in the order of their lowest numbers; and these lowest numbers.
    pub fn numbered(mut self) -> (Vec<u32>, Vec<u32>) {
        let mut firsts = Vec::new();
        let mut numbers = vec![0; self.parents.len()];
        for number in 0..self.parents.len() as u32 {
            let first = self.first(number);
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
    fn sets_are_numbered_by_their_lowest_members() {
        let mut sets = UnionFind::new(6);
        for (a, b) in [(5, 3), (1, 4), (4, 5), (3, 1)] {
            sets.join(a, b);
        }
        assert_eq!([5, 2, 0].map(|number| sets.first(number)), [1, 2, 0]);
        assert_eq!(sets.numbered(), (vec![0, 1, 2, 1, 1, 1], vec![0, 1, 2]));
    }
}
