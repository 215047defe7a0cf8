//! Lists of what loops make.

#![allow(unsafe_code, reason = "a list is told its length when all of its places are written")]

use std::sync::atomic::{AtomicUsize, Ordering};

use super::sources::ItemsMut;
use super::{Parallel, Zip, each_part, of_parts};
use crate::memory::reserve_huge;

/// What a loop's items can be gathered in, in their order.
pub trait FromParallel<T: Send>: Sized {
    /// All items.
    fn from_parallel<P: Parallel<Item = T>>(items: P) -> Self;
}

impl<T: Send> FromParallel<T> for Vec<T> {
    fn from_parallel<P: Parallel<Item = T>>(items: P) -> Self {
        let mut list = Self::new();
        append(items, &mut list);
        list
    }
}

/// The first error, if there is one.
impl<T: Send, E: Send> FromParallel<Result<T, E>> for Result<Vec<T>, E> {
    fn from_parallel<P: Parallel<Item = Result<T, E>>>(items: P) -> Self {
        let failed = AtomicUsize::new(usize::MAX);
        let of_part = |index: usize, part: P| {
            if failed.load(Ordering::Relaxed) < index {
                return Ok(Vec::new());
            }
            let list: Self = part.part().collect();
            if list.is_err() {
                failed.fetch_min(index, Ordering::Relaxed);
            }
            list
        };
        let lists: Result<Vec<_>, E> = of_parts(items, &of_part).into_iter().collect();
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
    // Each item is written where it stays.
    let count = items.places();
    reserve_huge(list, count);
    let places = ItemsMut(&mut list.spare_capacity_mut()[..count]);
    let written = each_item(Zip(items, places), |(item, place)| {
        place.write(item);
    });
    assert_eq!(written, count, "items for some places are missing");
    // SAFETY: the first `count` places of the spare capacity were handed out once each, as parts of one slice, and as many
    // were written.
    unsafe { list.set_len(list.len() + count) };
}

/// The two lists of the pairs' first and second items.
pub(super) fn unzipped<A: Send, B: Send, P: Parallel<Item = (A, B)>>(items: P) -> (Vec<A>, Vec<B>) {
    if !P::EXACT {
        return items.collect::<Vec<_>>().into_iter().unzip();
    }
    let count = items.places();
    let (mut firsts, mut seconds) = (Vec::new(), Vec::new());
    reserve_huge(&mut firsts, count);
    reserve_huge(&mut seconds, count);
    let first_places = ItemsMut(&mut firsts.spare_capacity_mut()[..count]);
    let second_places = ItemsMut(&mut seconds.spare_capacity_mut()[..count]);
    let places = Zip(first_places, second_places);
    let written = each_item(Zip(items, places), |((a, b), (first, second))| {
        first.write(a);
        second.write(b);
    });
    assert_eq!(written, count, "items for some places are missing");
    // SAFETY: as in `append`, for both lists.
    unsafe {
        firsts.set_len(count);
        seconds.set_len(count);
    }
    (firsts, seconds)
}

/// Calls `f` with each item; how many there were.
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
