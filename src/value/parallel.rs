//! Loops on all threads, in the words of rayon, which lends its threads.
//!
//! rayon compiles cutting, waiting and collecting once more for each loop; of three hundred loops that was a quarter of the program
//! and of the time to build it. Here a loop is cut into parts that follow from its length alone, and one function hands the parts
//! of all loops to the threads. So no result depends on the number of threads: not the last digit of a sum, not which of several
//! errors is told.
//!
//! ```
//! use maquette_value::parallel::*;
//!
//! let squares: Vec<u64> = (0..1000_u64).into_par_iter().map(|x| x * x).collect();
//! assert_eq!(squares.par_iter().copied().sum::<u64>(), 332_833_500);
//! ```
//!
//! What a loop is given to call is copied into each part: closures that borrow what they need can be, those that own a list
//! cannot.

use std::iter::Sum;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use rayon::iter::ParallelIterator as _;

mod adaptors;
mod collect;
mod sources;

pub use adaptors::{
    Copied, Enumerate, Filter, FilterMap, FlatMap, Initialized, InitializedPart, Map, MinLen, Zip,
};
pub use collect::FromParallel;
pub use sources::{
    Chunks, ChunksMut, IntoParallel, Items, ItemsMut, Numbers, Owned, ParallelSlice,
    ParallelSliceMut, Windows,
};

/// The most parts of a loop: enough that no thread waits long for the last one, few enough to be handed out in microseconds.
const PARTS: usize = 128;

/// The most parts of a loop that makes something for each of its parts.
const INITIALIZED_PARTS: usize = 32;

/// Items that threads take in parts, each part in order.
#[must_use = "nothing is done before an item is asked for"]
pub trait Parallel: Sized + Send {
    /// What a loop sees.
    type Item: Send;
    /// The items of a part, one after the other.
    type Part: Iterator<Item = Self::Item>;
    /// Whether there is exactly one item for each place.
    const EXACT: bool = true;

    /// How many places there are to take items from.
    fn places(&self) -> usize;

    /// The places before one, and the others.
    fn split_at(self, place: usize) -> (Self, Self);

    /// All items, in order.
    fn part(self) -> Self::Part;

    /// Into how many parts a loop is cut. It must not depend on the number of threads.
    fn parts(&self) -> usize {
        self.places().clamp(1, PARTS)
    }

    /// What `f` makes of each item.
    fn map<T: Send, F: Fn(Self::Item) -> T + Copy + Send>(self, f: F) -> Map<Self, F> {
        Map { items: self, f }
    }

    /// What `f` makes of each item with the help of what `init` made for the part: memory that is used again, for example.
    fn map_init<S, T, I, F>(self, init: I, f: F) -> Initialized<Self, I, F>
    where
        T: Send,
        I: Fn() -> S + Copy + Send,
        F: Fn(&mut S, Self::Item) -> T + Copy + Send,
    {
        Initialized { items: self, init, f }
    }

    /// The items for which `keep` is true.
    fn filter<F: Fn(&Self::Item) -> bool + Copy + Send>(self, keep: F) -> Filter<Self, F> {
        Filter { items: self, f: keep }
    }

    /// What `f` makes of the items of which it makes something.
    fn filter_map<T, F>(self, f: F) -> FilterMap<Self, F>
    where
        T: Send,
        F: Fn(Self::Item) -> Option<T> + Copy + Send,
    {
        FilterMap { items: self, f }
    }

    /// All of the items that `f` makes of each item, one after the other.
    fn flat_map_iter<I, F>(self, f: F) -> FlatMap<Self, I, F>
    where
        I: IntoIterator<Item: Send>,
        F: Fn(Self::Item) -> I + Copy + Send,
    {
        FlatMap::new(self, f)
    }

    /// The items with their places. Items that were left out before have none: that does not compile.
    fn enumerate(self) -> Enumerate<Self> {
        const { assert!(Self::EXACT, "the places are not known") };
        Enumerate { items: self, first: 0 }
    }

    /// The items with those of another list at the same places, as far as the shorter one goes. Neither can have left out items.
    fn zip<B: IntoParallel>(self, others: B) -> Zip<Self, B::Items> {
        const { assert!(Self::EXACT && B::Items::EXACT, "the places are not known") };
        Zip(self, others.into_par_iter())
    }

    /// The items that are borrowed here, copied.
    fn copied<'a, T>(self) -> Copied<Self>
    where
        Self: Parallel<Item = &'a T>,
        T: Copy + Send + 'a,
    {
        Copied(self)
    }

    /// Parts of at least so many places, for items that take next to no time.
    fn with_min_len(self, places: usize) -> MinLen<Self> {
        MinLen { items: self, places }
    }

    /// Calls `f` with each item.
    fn for_each(self, f: impl Fn(Self::Item) + Sync) {
        each_part(self, &|_, part: Self| part.part().for_each(&f));
    }

    /// Calls `f` with each item and what `init` made for its part.
    fn for_each_init<S, I, F>(self, init: I, f: F)
    where
        I: Fn() -> S + Copy + Send,
        F: Fn(&mut S, Self::Item) + Copy + Send,
    {
        self.map_init(init, f).for_each(drop);
    }

    /// All items, in order.
    fn collect<C: FromParallel<Self::Item>>(self) -> C {
        C::from_parallel(self)
    }

    /// Appends all items to a list, in order.
    fn collect_into(self, list: &mut Vec<Self::Item>) {
        collect::append(self, list);
    }

    /// The two lists of the pairs' first and second items.
    fn unzip<A: Send, B: Send>(self) -> (Vec<A>, Vec<B>)
    where
        Self: Parallel<Item = (A, B)>,
    {
        collect::unzipped(self)
    }

    /// How many items there are.
    fn count(self) -> usize {
        of_parts(self, &|_, part: Self| part.part().count()).into_iter().sum()
    }

    /// The sum: of the sums of the parts.
    fn sum<S: Sum<Self::Item> + Sum<S> + Send>(self) -> S {
        of_parts(self, &|_, part: Self| part.part().sum::<S>()).into_iter().sum()
    }

    /// The largest item, of equal ones the last.
    fn max(self) -> Option<Self::Item>
    where
        Self::Item: Ord,
    {
        of_parts(self, &|_, part: Self| part.part().max()).into_iter().flatten().max()
    }

    /// The smallest item, of equal ones the first.
    fn min(self) -> Option<Self::Item>
    where
        Self::Item: Ord,
    {
        of_parts(self, &|_, part: Self| part.part().min()).into_iter().flatten().min()
    }

    /// What each part comes to, which begins with an `init` and takes one item after the other; in order.
    fn fold_parts<A: Send>(
        self,
        init: impl Fn() -> A + Sync,
        f: impl Fn(A, Self::Item) -> A + Sync,
    ) -> Vec<A> {
        of_parts(self, &|_, part: Self| part.part().fold(init(), &f))
    }

    /// The items, two by two, until one is left; each part starts with an identity.
    fn reduce<F>(self, identity: impl Fn() -> Self::Item + Sync, f: F) -> Self::Item
    where
        F: Fn(Self::Item, Self::Item) -> Self::Item + Sync,
    {
        self.fold_parts(&identity, &f).into_iter().fold(identity(), &f)
    }

    /// The first thing that `f` makes of an item. What comes later may be looked at, too.
    fn find_map_first<T: Send>(self, f: impl Fn(Self::Item) -> Option<T> + Sync) -> Option<T> {
        let first = AtomicUsize::new(usize::MAX);
        let of_part = |index: usize, part: Self| {
            if first.load(Ordering::Relaxed) < index {
                return None;
            }
            let found = part.part().find_map(&f);
            if found.is_some() {
                first.fetch_min(index, Ordering::Relaxed);
            }
            found
        };
        of_parts(self, &of_part).into_iter().flatten().next()
    }

    /// The place of the first item for which `f` is true.
    fn position_first(self, f: impl Fn(Self::Item) -> bool + Sync) -> Option<usize> {
        self.enumerate().find_map_first(|(place, item)| f(item).then_some(place))
    }

    /// Whether `f` is true for some item.
    fn any(self, f: impl Fn(Self::Item) -> bool + Sync) -> bool {
        self.find_map_first(|item| f(item).then_some(())).is_some()
    }

    /// Whether `f` is true for all items.
    fn all(self, f: impl Fn(Self::Item) -> bool + Sync) -> bool {
        !self.any(|item| !f(item))
    }
}

/// What is made of each part, in order.
fn of_parts<P: Parallel, T: Send>(items: P, f: &(dyn Fn(usize, P) -> T + Sync)) -> Vec<T> {
    let all = Mutex::new((0..items.parts()).map(|_| None).collect::<Vec<_>>());
    each_part(items, &|index, part| {
        let made = f(index, part);
        all.lock().unwrap_or_else(PoisonError::into_inner)[index] = Some(made);
    });
    all.into_inner().unwrap_or_else(PoisonError::into_inner).into_iter().flatten().collect()
}

/// Cuts items into parts and calls `f` with each of them and its index.
fn each_part<P: Parallel>(items: P, f: &(dyn Fn(usize, P) + Sync)) {
    let (places, count) = (items.places(), items.parts());
    if count <= 1 {
        return f(0, items);
    }
    // From the end: the rest of a list stays where it is.
    let mut parts = Vec::with_capacity(count);
    let mut rest = items;
    for index in (1..count).rev() {
        let first = places / count * index + places % count * index / count;
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
    });
}

/// Calls `f` with each index below `count` on rayon's threads.
fn on_threads(count: usize, f: &(dyn Fn(usize) + Sync)) {
    rayon::iter::IntoParallelIterator::into_par_iter(0..count).for_each(f);
}

#[cfg(test)]
mod tests;
