//! Collects the items of parallel loops in lists.

#![allow(unsafe_code, reason = "a list is told its length when all of its items are written")]

use std::sync::atomic::{AtomicUsize, Ordering};

use super::sources::ItemsMut;
use super::{Parallel, Zip, each_part, of_parts};
use crate::memory::reserve_huge;

/// Types that can collect the items of a parallel loop, in order.
pub trait FromParallel<T: Send>: Sized {
    /// Collects all items.
    fn from_parallel<P: Parallel<Item = T>>(items: P) -> Self;
}

impl<T: Send> FromParallel<T> for Vec<T> {
    fn from_parallel<P: Parallel<Item = T>>(items: P) -> Self {
        let mut list = Self::new();
        append(items, &mut list);
        list
    }
}

/// Collects all items, or returns the first error.
impl<T: Send, E: Send> FromParallel<Result<T, E>> for Result<Vec<T>, E> {
    fn from_parallel<P: Parallel<Item = Result<T, E>>>(items: P) -> Self {
        let failed = AtomicUsize::new(usize::MAX);
        let lists = of_parts(items, &|index: usize, part: P| {
            if failed.load(Ordering::Relaxed) < index {
                return Ok(Vec::new());
            }
            let list: Self = part.part().collect();
            if list.is_err() {
                failed.fetch_min(index, Ordering::Relaxed);
            }
            list
        });
        let lists: Result<Vec<_>, E> = lists.into_iter().collect();
        lists.map(|parts| {
            let mut all = Vec::new();
            append_all(parts, &mut all);
            all
        })
    }
}

/// Appends all items, in order.
pub(super) fn append<P: Parallel>(items: P, list: &mut Vec<P::Item>) {
    if !P::EXACT {
        let parts = of_parts(items, &|_, part: P| part.part().collect());
        return append_all(parts, list);
    }
    // Each item is written directly to its final position in the list.
    let count = items.index_count();
    reserve_huge(list, count);
    let slots = ItemsMut(&mut list.spare_capacity_mut()[..count]);
    let written = each_item(Zip(items, slots), |(item, slot)| {
        slot.write(item);
    });
    assert_eq!(written, count, "items are missing");
    // SAFETY: the first `count` slots of the spare capacity were handed out as parts of one slice, each slot once, and `count` items were
    // written into them.
    unsafe { list.set_len(list.len() + count) };
}

/// Splits pairs into two lists.
pub(super) fn unzip<A: Send, B: Send, P: Parallel<Item = (A, B)>>(items: P) -> (Vec<A>, Vec<B>) {
    if !P::EXACT {
        return items.collect::<Vec<_>>().into_iter().unzip();
    }
    let count = items.index_count();
    let (mut firsts, mut seconds) = (Vec::new(), Vec::new());
    reserve_huge(&mut firsts, count);
    reserve_huge(&mut seconds, count);
    let first_slots = ItemsMut(&mut firsts.spare_capacity_mut()[..count]);
    let second_slots = ItemsMut(&mut seconds.spare_capacity_mut()[..count]);
    let slots = Zip(first_slots, second_slots);
    let written = each_item(Zip(items, slots), |((a, b), (first, second))| {
        first.write(a);
        second.write(b);
    });
    assert_eq!(written, count, "items are missing");
    // SAFETY: as in `append`. Both lists satisfy the same conditions.
    unsafe {
        firsts.set_len(count);
        seconds.set_len(count);
    }
    (firsts, seconds)
}

/// Calls `f` with each item and returns their number.
fn each_item<P: Parallel>(items: P, f: impl Fn(P::Item) + Sync) -> usize {
    let all = AtomicUsize::new(0);
    each_part(items, &|_, part: P| {
        let mut count = 0;
        part.part().for_each(|item| {
            f(item);
            count += 1;
        });
        all.fetch_add(count, Ordering::Relaxed);
    });
    all.into_inner()
}

fn append_all<T>(parts: Vec<Vec<T>>, list: &mut Vec<T>) {
    reserve_huge(list, parts.iter().map(Vec::len).sum());
    parts.into_iter().for_each(|mut part| list.append(&mut part));
}
