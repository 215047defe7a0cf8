//! Shards: parts of all test cases, each of which runs on a different machine.

use std::str::FromStr;

/// The part number `index` of `count` parts, both counted from 1. Each case belongs to exactly one part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    index: usize,
    count: usize,
}

impl Shard {
    /// For each name, returns true if it belongs to this part. The names are sorted and assigned to the parts in turn, so that the parts
    /// have nearly equal sizes.
    pub(super) fn contains(self, names: &[String]) -> Vec<bool> {
        let mut sorted = Vec::from_iter(0..names.len());
        sorted.sort_by_key(|&place| &names[place]);
        let mut is_in = vec![false; names.len()];
        for place in sorted.into_iter().skip(self.index - 1).step_by(self.count) {
            is_in[place] = true;
        }
        is_in
    }

    /// Returns true if this is the first part. Only the first part reports errors that belong to no case.
    pub(super) fn is_first(self) -> bool {
        self.index == 1
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/').and_then(|(index, count)| {
            Some(Self { index: index.parse().ok()?, count: count.parse().ok()? })
        });
        parts
            .filter(|shard| (1..=shard.count).contains(&shard.index))
            .ok_or_else(|| "expected K/N with K from 1 to N, such as 2/8".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_partition_the_cases_evenly_in_any_order() {
        let mut names: Vec<_> = (0..29).map(|k| format!("g{}.ron default", k * 7 % 29)).collect();
        for count in [1, 2, 8, 40] {
            fn part(index: usize, names: &[String], count: usize) -> Vec<String> {
                let is_in = Shard { index, count }.contains(names);
                let selected = names.iter().zip(is_in).filter(|(_, is_in)| *is_in);
                let mut own: Vec<_> = selected.map(|(name, _)| name.clone()).collect();
                own.sort();
                own
            }
            let parts: Vec<_> = (1..=count).map(|index| part(index, &names, count)).collect();
            assert!(parts.iter().all(|part| part.len().abs_diff(29 / count) <= 1), "{parts:?}");
            names.reverse();
            assert_eq!(
                parts,
                (1..=count).map(|index| part(index, &names, count)).collect::<Vec<_>>()
            );
            let (mut all, mut sorted) = (parts.concat(), names.clone());
            all.sort();
            sorted.sort();
            assert_eq!(all, sorted);
        }
    }

    #[test]
    fn invalid_shards_are_rejected() {
        for wrong in ["0/8", "9/8", "0/0", "1/0", "2", "/", "a/b", "-1/8", "1/8/2", " 1/8", ""] {
            assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
        }
        assert_eq!("2/8".parse(), Ok(Shard { index: 2, count: 8 }));
    }
}
