//! Which items of one sequence are those of another.

/// Longer sequences are matched at their ends alone.
const MOST_PAIRS: usize = 4_000_000;

/// For each item of `new`, its place in `old`: as many as can be, in the order of both (the longest common subsequence).
pub(super) fn matched<T: PartialEq>(old: &[T], new: &[T]) -> Vec<Option<usize>> {
    let shorter = old.len().min(new.len());
    let first = (0..shorter).take_while(|&k| old[k] == new[k]).count();
    let last = (0..shorter - first)
        .take_while(|&k| old[old.len() - 1 - k] == new[new.len() - 1 - k])
        .count();
    let (a, b) = (&old[first..old.len() - last], &new[first..new.len() - last]);
    let mut found: Vec<_> = (0..first).map(Some).collect();
    found.extend(longest(a, b).into_iter().map(|place| place.map(|place| place + first)));
    found.extend((old.len() - last..old.len()).map(Some));
    found
}

/// The same without what both begin and end with.
fn longest<T: PartialEq>(old: &[T], new: &[T]) -> Vec<Option<usize>> {
    let mut found = vec![None; new.len()];
    if old.len() * new.len() > MOST_PAIRS {
        return found;
    }
    let width = new.len() + 1;
    // How many the rests have in common.
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

/// The same, and what stands between two matches on both sides counts as changed, in order.
pub(super) fn paired<T: PartialEq>(old: &[T], new: &[T]) -> Vec<Option<usize>> {
    let mut found = matched(old, new);
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
    fn what_is_the_same_is_matched_in_order_and_what_is_between_is_paired() {
        fn letters(text: &str) -> Vec<char> {
            text.chars().collect::<Vec<_>>()
        }
        fn check(old: &str, new: &str, found: &[Option<usize>], pairs: &[Option<usize>]) {
            assert_eq!(matched(&letters(old), &letters(new)), found, "{old} {new}");
            assert_eq!(paired(&letters(old), &letters(new)), pairs, "{old} {new}");
        }
        check("abc", "abc", &[Some(0), Some(1), Some(2)], &[Some(0), Some(1), Some(2)]);
        check("abc", "axc", &[Some(0), None, Some(2)], &[Some(0), Some(1), Some(2)]);
        check("abc", "bcd", &[Some(1), Some(2), None], &[Some(1), Some(2), None]);
        check("ab", "xyb", &[None, None, Some(1)], &[Some(0), None, Some(1)]);
        check("aa", "a", &[Some(0)], &[Some(0)]);
        check("", "a", &[None], &[None]);
    }
}
