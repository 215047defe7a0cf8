//! Alignment of two sequences: finds the items that they have in common.

/// Maximum number of cells in the table for the longest common subsequence. If the table would be larger, only the common beginning and end
/// of the sequences are matched.
const MAX_PAIRS: usize = 4_000_000;

/// For each item of `new`, returns its index in `old` according to the longest common subsequence. `None` if `old` does not have the item.
pub(super) fn match_items<T: PartialEq>(old: &[T], new: &[T]) -> Vec<Option<usize>> {
    let shorter = old.len().min(new.len());
    let first = (0..shorter).take_while(|&k| old[k] == new[k]).count();
    let last = (0..shorter - first)
        .take_while(|&k| old[old.len() - 1 - k] == new[new.len() - 1 - k])
        .count();
    let (a, b) = (&old[first..old.len() - last], &new[first..new.len() - last]);
    let mut found: Vec<_> = (0..first).map(Some).collect();
    found.extend(match_middle(a, b).into_iter().map(|place| place.map(|place| place + first)));
    found.extend((old.len() - last..old.len()).map(Some));
    found
}

/// Matches the items between the common beginning and the common end, by the table of the longest common subsequence.
fn match_middle<T: PartialEq>(old: &[T], new: &[T]) -> Vec<Option<usize>> {
    let mut found = vec![None; new.len()];
    if old.len() * new.len() > MAX_PAIRS {
        return found;
    }
    let width = new.len() + 1;
    // Each cell is the length of the longest common subsequence of the remaining items.
    let mut common = vec![0u32; (old.len() + 1) * width];
    for i in (0..old.len()).rev() {
        for j in (0..new.len()).rev() {
            common[i * width + j] = match old[i] == new[j] {
                true => common[(i + 1) * width + j + 1] + 1,
                false => common[(i + 1) * width + j].max(common[i * width + j + 1]),
            };
        }
    }
    let (mut i, mut j) = (0, 0);
    while i < old.len() && j < new.len() {
        if old[i] == new[j] {
            found[j] = Some(i);
            (i, j) = (i + 1, j + 1);
        } else if common[(i + 1) * width + j] >= common[i * width + j + 1] {
            i += 1;
        } else {
            j += 1;
        }
    }
    found
}

/// Like [`match_items`], but also pairs unmatched items between two matches, in order, as changed items.
pub(super) fn pair_items<T: PartialEq>(old: &[T], new: &[T]) -> Vec<Option<usize>> {
    let mut found = match_items(old, new);
    let mut next = 0;
    for k in 0..found.len() {
        let end = found[k..].iter().flatten().next().map_or(old.len(), |&end| end);
        if found[k].is_none() && next < end {
            found[k] = Some(next);
        }
        next = found[k].map_or(next, |place| place + 1);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_items_are_matched_in_order_and_those_between_are_paired() {
        fn letters(text: &str) -> Vec<char> {
            text.chars().collect::<Vec<_>>()
        }
        fn check(old: &str, new: &str, found: &[Option<usize>], pairs: &[Option<usize>]) {
            assert_eq!(match_items(&letters(old), &letters(new)), found, "{old} {new}");
            assert_eq!(pair_items(&letters(old), &letters(new)), pairs, "{old} {new}");
        }
        check("abc", "abc", &[Some(0), Some(1), Some(2)], &[Some(0), Some(1), Some(2)]);
        check("abc", "axc", &[Some(0), None, Some(2)], &[Some(0), Some(1), Some(2)]);
        check("abc", "bcd", &[Some(1), Some(2), None], &[Some(1), Some(2), None]);
        check("ab", "xyb", &[None, None, Some(1)], &[Some(0), None, Some(1)]);
        check("aa", "a", &[Some(0)], &[Some(0)]);
        check("", "a", &[None], &[None]);
    }
}
