//! Parallel loops on rayon's threads, with methods named as in rayon.
//!
//! For each loop, rayon compiles its own code for splitting, waiting and collecting. With three hundred loops that code was a quarter of
//! the program and of its build time. Here a single function distributes the parts of all loops to the threads. The number of parts depends
//! only on the length of the loop, so no result depends on the number of threads: neither the last digit of a sum, nor the choice of the
//! reported error among several.
//!
//! ```
//! use maquette_value::parallel::*;
//!
//! let squares: Vec<u64> = (0..1000_u64).into_par_iter().map(|x| x * x).collect();
//! assert_eq!(squares.par_iter().copied().sum::<u64>(), 332_833_500);
//! ```
//!
//! Closures must be `Copy`, because each part of a loop gets a copy. So they may borrow data, but cannot own a list.

use std::iter::Sum;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use rayon::iter::ParallelIterator as _;

mod adaptors;
mod collect;
mod meter;
mod sources;
mod span;
mod stop;

pub use adaptors::{Adapted, Zip};
pub use collect::FromParallel;
pub use meter::Meter;
pub use sources::{
    Chunks, ChunksMut, IntoParallel, Items, ItemsMut, Numbers, ParallelSlice, ParallelSliceMut,
    VecItems,
};
pub use span::{WorkSpan, finish_span, start_span};
use stop::Computation;
pub use stop::{StopFlag, StoppableIter, UntilStopped, caught, check_stop, detached, stoppable};

/// The maximum number of parts of a loop over up to two million items: enough parts that no thread waits long for the last one, and few
/// enough that they are distributed in microseconds.
const MAX_PARTS: usize = 128;

/// The number of indices of a part of a longer loop. A cancelled loop stops when its current parts are finished, so these must not take
/// long.
const MAX_PART_LEN: usize = 1 << 14;

/// The number of parts of a loop over `len` indices.
fn parts_of(len: usize) -> usize {
    len.clamp(1, MAX_PARTS.max(len / MAX_PART_LEN))
}

/// The maximum number of parts of a loop that initializes a state for each part.
const MAX_INIT_PARTS: usize = 32;

/// A parallel iterator. Its items are processed in parts; within a part they are processed in order.
#[must_use = "nothing is done before an item is asked for"]
pub trait Parallel: Sized + Send {
    /// The type of the items.
    type Item: Send;
    /// The sequential iterator over a part.
    type Part: Iterator<Item = Self::Item>;
    /// True if there is exactly one item per index.
    const EXACT: bool = true;

    /// The number of indices: an upper bound of the number of items.
    fn index_count(&self) -> usize;

    /// Splits the iterator at an index.
    fn split_at(self, index: usize) -> (Self, Self);

    /// The sequential iterator over all items, in order.
    fn part(self) -> Self::Part;

    /// The number of items by which the work is measured.
    fn weight(&self) -> usize {
        self.index_count()
    }

    /// The number of parts. It must not depend on the number of threads.
    fn parts(&self) -> usize {
        parts_of(self.index_count())
    }

    /// Maps each item by `f`.
    fn map<T, F>(self, f: F) -> impl Parallel<Item = T>
    where
        T: Send,
        F: Fn(Self::Item) -> T + Copy + Send,
    {
        adapt::<true, _, _>(self, usize::MAX, move |part| part.map(f))
    }

    /// Maps each item by `f`. `f` also gets a state that `init` created for the part that contains the item, such as a reusable buffer.
    fn map_init<S, T, I, F>(self, init: I, f: F) -> impl Parallel<Item = T>
    where
        T: Send,
        I: Fn() -> S + Copy + Send,
        F: Fn(&mut S, Self::Item) -> T + Copy + Send,
    {
        adapt::<true, _, _>(self, MAX_INIT_PARTS, move |part| {
            let mut state = init();
            // The parts are long.
            part.until_stopped().map(move |item| f(&mut state, item))
        })
    }

    /// Keeps the items for which `keep` is true.
    fn filter<F>(self, keep: F) -> impl Parallel<Item = Self::Item>
    where
        F: Fn(&Self::Item) -> bool + Copy + Send,
    {
        adapt::<false, _, _>(self, usize::MAX, move |part| part.filter(keep))
    }

    /// Maps each item by `f` and drops `None`.
    fn filter_map<T, F>(self, f: F) -> impl Parallel<Item = T>
    where
        T: Send,
        F: Fn(Self::Item) -> Option<T> + Copy + Send,
    {
        adapt::<false, _, _>(self, usize::MAX, move |part| part.filter_map(f))
    }

    /// Maps each item to several items by `f`, and concatenates these.
    fn flat_map_iter<I, F>(self, f: F) -> impl Parallel<Item = I::Item>
    where
        I: IntoIterator<Item: Send>,
        F: Fn(Self::Item) -> I + Copy + Send,
    {
        adapt::<false, _, _>(self, usize::MAX, move |part| part.flat_map(f))
    }

    /// Pairs each item with its index. This does not compile after a filter, because the indices of filtered items are not known.
    fn enumerate(self) -> Zip<Numbers<usize>, Self> {
        let indices = 0..self.index_count();
        indices.into_par_iter().zip(self)
    }

    /// Pairs the items of two iterators that have the same index, up to the length of the shorter iterator. This does not compile after a
    /// filter.
    fn zip<B: IntoParallel>(self, others: B) -> Zip<Self, B::Items> {
        const { assert!(Self::EXACT && B::Items::EXACT, "the indices are not known") };
        Zip(self, others.into_par_iter())
    }

    /// Copies borrowed items.
    fn copied<'a, T>(self) -> impl Parallel<Item = T>
    where
        Self: Parallel<Item = &'a T>,
        T: Copy + Send + 'a,
    {
        adapt::<true, _, _>(self, usize::MAX, |part| part.copied())
    }

    /// Sets the minimum number of indices per part, for items that take little time.
    fn with_min_len(self, min_len: usize) -> MinLen<Self> {
        let max_parts = (self.index_count() / min_len.max(1)).max(1);
        Adapted { items: self, max_parts, adapt: |part| part }
    }

    /// Calls `f` with each item.
    fn for_each(self, f: impl Fn(Self::Item) + Sync) {
        each_part(self, &|_, part: Self| part.part().for_each(&f));
    }

    /// Calls `f` with each item and with the state that `init` created for the part that contains the item.
    fn for_each_init<S, I, F>(self, init: I, f: F)
    where
        I: Fn() -> S + Copy + Send,
        F: Fn(&mut S, Self::Item) + Copy + Send,
    {
        self.map_init(init, f).for_each(drop);
    }

    /// Collects all items, in order.
    fn collect<C: FromParallel<Self::Item>>(self) -> C {
        C::from_parallel(self)
    }

    /// Appends all items to a list, in order.
    fn collect_into(self, list: &mut Vec<Self::Item>) {
        collect::append(self, list);
    }

    /// Splits pairs into two lists.
    fn unzip<A: Send, B: Send>(self) -> (Vec<A>, Vec<B>)
    where
        Self: Parallel<Item = (A, B)>,
    {
        collect::unzip(self)
    }

    /// Counts the items.
    fn count(self) -> usize {
        of_parts(self, &|_, part: Self| part.part().count()).into_iter().sum()
    }

    /// The sum of all items. The items of each part are summed first, then these sums.
    fn sum<S: Sum<Self::Item> + Sum<S> + Send>(self) -> S {
        of_parts(self, &|_, part: Self| part.part().sum::<S>()).into_iter().sum()
    }

    /// Folds the items of each part, beginning with `init()`, and returns the results of the parts in order.
    fn fold_parts<A: Send>(
        self,
        init: impl Fn() -> A + Sync,
        f: impl Fn(A, Self::Item) -> A + Sync,
    ) -> Vec<A> {
        of_parts(self, &|_, part: Self| part.part().fold(init(), &f))
    }

    /// Reduces all items to one by `f`. Each part starts with an identity element.
    fn reduce<F>(self, identity: impl Fn() -> Self::Item + Sync, f: F) -> Self::Item
    where
        F: Fn(Self::Item, Self::Item) -> Self::Item + Sync,
    {
        self.fold_parts(&identity, &f).into_iter().fold(identity(), &f)
    }

    /// The first `Some` that `f` returns, in the order of the items. `None` if `f` returns `None` for all items. `f` may also be called
    /// with later items.
    fn find_map_first<T: Send>(self, f: impl Fn(Self::Item) -> Option<T> + Sync) -> Option<T> {
        let first = AtomicUsize::new(usize::MAX);
        let found_by_part = of_parts(self, &|index: usize, part: Self| {
            if first.load(Ordering::Relaxed) < index {
                return None;
            }
            let found = part.part().find_map(&f);
            if found.is_some() {
                first.fetch_min(index, Ordering::Relaxed);
            }
            found
        });
        found_by_part.into_iter().flatten().next()
    }

    /// The index of the first item for which `f` is true; `None` if there is no such item.
    fn position_first(self, f: impl Fn(Self::Item) -> bool + Sync) -> Option<usize> {
        self.enumerate().find_map_first(|(index, item)| f(item).then_some(index))
    }

    /// Returns true if `f` is true for some item.
    fn any(self, f: impl Fn(Self::Item) -> bool + Sync) -> bool {
        self.find_map_first(|item| f(item).then_some(())).is_some()
    }

    /// Returns true if `f` is true for all items.
    fn all(self, f: impl Fn(Self::Item) -> bool + Sync) -> bool {
        !self.any(|item| !f(item))
    }
}

/// Items in parts of a minimum length.
pub type MinLen<P> = Adapted<P, fn(<P as Parallel>::Part) -> <P as Parallel>::Part, true>;

/// Converts the sequential iterator of each part by `adapt`. `EXACT` is true if `adapt` keeps the number of items.
fn adapt<const EXACT: bool, P: Parallel, I: Iterator<Item: Send>>(
    items: P,
    max_parts: usize,
    adapt: impl Fn(P::Part) -> I + Copy + Send,
) -> impl Parallel<Item = I::Item> {
    Adapted::<_, _, EXACT> { items, max_parts, adapt }
}

/// Calls `f` with each part and its index, and returns the results in order.
fn of_parts<P: Parallel, T: Send>(items: P, f: &(dyn Fn(usize, P) -> T + Sync)) -> Vec<T> {
    let all = Mutex::new((0..items.parts()).map(|_| None).collect::<Vec<_>>());
    each_part(items, &|index, part| {
        let made = f(index, part);
        all.lock().unwrap_or_else(PoisonError::into_inner)[index] = Some(made);
    });
    all.into_inner().unwrap_or_else(PoisonError::into_inner).into_iter().flatten().collect()
}

/// Splits items into parts and calls `f` with each part and its index.
fn each_part<P: Parallel>(items: P, f: &(dyn Fn(usize, P) + Sync)) {
    let (len, count) = (items.index_count(), items.parts());
    if count <= 1 {
        return f(0, items);
    }
    let (computation, weight) = (Computation::current(), items.weight() / count);
    // The parts are split off from the end, because splitting off the front of a list would move all remaining items.
    let mut parts = Vec::with_capacity(count);
    let mut rest = items;
    for index in (1..count).rev() {
        let first = len / count * index + len % count * index / count;
        let (before, part) = rest.split_at(first);
        parts.push(Mutex::new(Some(part)));
        rest = before;
    }
    parts.push(Mutex::new(Some(rest)));
    parts.reverse();
    on_threads(count, &|index| {
        let part = parts[index].lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(part) = part {
            f(index, part);
        }
        computation.count(weight);
    });
}

/// Calls `f` with each index below `count` on rayon's threads.
fn on_threads(count: usize, f: &(dyn Fn(usize) + Sync)) {
    if let Some(mut parts) = span::Loop::begin() {
        (0..count).for_each(|index| parts.run(|| f(index)));
        return parts.end();
    }
    let computation = Computation::current();
    rayon::iter::IntoParallelIterator::into_par_iter(0..count)
        .for_each(|index| computation.part().run(|| f(index)));
}

/// Calls two functions, on two threads if one is free, and returns both results.
pub fn join<A: Send, B: Send>(
    a: impl FnOnce() -> A + Send,
    b: impl FnOnce() -> B + Send,
) -> (A, B) {
    if let Some(mut parts) = span::Loop::begin() {
        let results = (parts.run(a), parts.run(b));
        parts.end();
        return results;
    }
    let computation = Computation::current();
    let of_b = computation.clone();
    rayon::join(|| computation.run(a), || of_b.run(b))
}

#[cfg(test)]
mod tests;
