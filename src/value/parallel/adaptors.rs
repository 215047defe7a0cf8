//! What is done to items on their way to a loop's end: part by part, by the iterators of the standard library.

use std::iter;
use std::marker::PhantomData;

use super::{INITIALIZED_PARTS, Parallel};

/// The methods of what has a place for each of its `items`, and else nothing that depends on the place.
macro_rules! cut_where_its_items_are {
    () => {
        fn places(&self) -> usize {
            self.items.places()
        }

        fn split_at(self, place: usize) -> (Self, Self) {
            let (before, after) = self.items.split_at(place);
            (Self { items: before, ..self }, Self { items: after, ..self })
        }
    };
}

/// What a closure makes of each item.
#[derive(Clone, Debug)]
pub struct Map<P, F> {
    pub(super) items: P,
    pub(super) f: F,
}

impl<P: Parallel, T: Send, F: Fn(P::Item) -> T + Copy + Send> Parallel for Map<P, F> {
    type Item = T;
    type Part = iter::Map<P::Part, F>;
    const EXACT: bool = P::EXACT;

    cut_where_its_items_are!();

    fn part(self) -> Self::Part {
        self.items.part().map(self.f)
    }

    fn parts(&self) -> usize {
        self.items.parts()
    }
}

/// The items that are kept.
#[derive(Clone, Debug)]
pub struct Filter<P, F> {
    pub(super) items: P,
    pub(super) f: F,
}

impl<P: Parallel, F: Fn(&P::Item) -> bool + Copy + Send> Parallel for Filter<P, F> {
    type Item = P::Item;
    type Part = iter::Filter<P::Part, F>;
    const EXACT: bool = false;

    cut_where_its_items_are!();

    fn part(self) -> Self::Part {
        self.items.part().filter(self.f)
    }

    fn parts(&self) -> usize {
        self.items.parts()
    }
}

/// What a closure makes of some items.
#[derive(Clone, Debug)]
pub struct FilterMap<P, F> {
    pub(super) items: P,
    pub(super) f: F,
}

impl<P, T, F> Parallel for FilterMap<P, F>
where
    P: Parallel,
    T: Send,
    F: Fn(P::Item) -> Option<T> + Copy + Send,
{
    type Item = T;
    type Part = iter::FilterMap<P::Part, F>;
    const EXACT: bool = false;

    cut_where_its_items_are!();

    fn part(self) -> Self::Part {
        self.items.part().filter_map(self.f)
    }

    fn parts(&self) -> usize {
        self.items.parts()
    }
}

/// All that a closure makes of each item.
#[derive(Clone, Debug)]
pub struct FlatMap<P, I, F> {
    items: P,
    f: F,
    made: PhantomData<fn() -> I>,
}

impl<P, I, F> FlatMap<P, I, F> {
    pub(super) fn new(items: P, f: F) -> Self {
        Self { items, f, made: PhantomData }
    }
}

impl<P, I, F> Parallel for FlatMap<P, I, F>
where
    P: Parallel,
    I: IntoIterator<Item: Send>,
    F: Fn(P::Item) -> I + Copy + Send,
{
    type Item = I::Item;
    type Part = iter::FlatMap<P::Part, I, F>;
    const EXACT: bool = false;

    fn places(&self) -> usize {
        self.items.places()
    }

    fn split_at(self, place: usize) -> (Self, Self) {
        let (before, after) = self.items.split_at(place);
        (Self::new(before, self.f), Self::new(after, self.f))
    }

    fn part(self) -> Self::Part {
        self.items.part().flat_map(self.f)
    }

    fn parts(&self) -> usize {
        self.items.parts()
    }
}

/// What a closure makes of each item with the help of what another one made for the part.
#[derive(Clone, Debug)]
pub struct Initialized<P, I, F> {
    pub(super) items: P,
    pub(super) init: I,
    pub(super) f: F,
}

impl<P, S, T, I, F> Parallel for Initialized<P, I, F>
where
    P: Parallel,
    T: Send,
    I: Fn() -> S + Copy + Send,
    F: Fn(&mut S, P::Item) -> T + Copy + Send,
{
    type Item = T;
    type Part = InitializedPart<P::Part, S, F>;
    const EXACT: bool = P::EXACT;

    cut_where_its_items_are!();

    fn part(self) -> Self::Part {
        InitializedPart { items: self.items.part(), state: (self.init)(), f: self.f }
    }

    fn parts(&self) -> usize {
        self.items.parts().min(INITIALIZED_PARTS)
    }
}

/// The items of a part, and what was made for it.
#[derive(Clone, Debug)]
pub struct InitializedPart<P, S, F> {
    items: P,
    state: S,
    f: F,
}

impl<P: Iterator, S, T, F: Fn(&mut S, P::Item) -> T> Iterator for InitializedPart<P, S, F> {
    type Item = T;

    fn next(&mut self) -> Option<T> {
        Some((self.f)(&mut self.state, self.items.next()?))
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        self.items.size_hint()
    }
}

/// The items, copied.
#[derive(Clone, Debug)]
pub struct Copied<P>(pub(super) P);

impl<'a, P: Parallel<Item = &'a T>, T: Copy + Send + 'a> Parallel for Copied<P> {
    type Item = T;
    type Part = iter::Copied<P::Part>;
    const EXACT: bool = P::EXACT;

    fn places(&self) -> usize {
        self.0.places()
    }

    fn split_at(self, place: usize) -> (Self, Self) {
        let (before, after) = self.0.split_at(place);
        (Self(before), Self(after))
    }

    fn part(self) -> Self::Part {
        self.0.part().copied()
    }

    fn parts(&self) -> usize {
        self.0.parts()
    }
}

/// The items with their places.
#[derive(Clone, Debug)]
pub struct Enumerate<P> {
    pub(super) items: P,
    pub(super) first: usize,
}

impl<P: Parallel> Parallel for Enumerate<P> {
    type Item = (usize, P::Item);
    type Part = iter::Zip<std::ops::Range<usize>, P::Part>;

    fn places(&self) -> usize {
        self.items.places()
    }

    fn split_at(self, place: usize) -> (Self, Self) {
        let (before, after) = self.items.split_at(place);
        (Self { items: before, ..self }, Self { items: after, first: self.first + place })
    }

    fn part(self) -> Self::Part {
        iter::zip(self.first..self.first + self.items.places(), self.items.part())
    }

    fn parts(&self) -> usize {
        self.items.parts()
    }
}

/// The items of two lists at the same places.
#[derive(Clone, Debug)]
pub struct Zip<A, B>(pub(super) A, pub(super) B);

impl<A: Parallel, B: Parallel> Parallel for Zip<A, B> {
    type Item = (A::Item, B::Item);
    type Part = iter::Zip<A::Part, B::Part>;

    fn places(&self) -> usize {
        self.0.places().min(self.1.places())
    }

    fn split_at(self, place: usize) -> (Self, Self) {
        let (a, b) = (self.0.split_at(place), self.1.split_at(place));
        (Self(a.0, b.0), Self(a.1, b.1))
    }

    fn part(self) -> Self::Part {
        iter::zip(self.0.part(), self.1.part())
    }

    fn parts(&self) -> usize {
        self.0.parts().min(self.1.parts())
    }
}

/// Parts of at least so many places.
#[derive(Clone, Debug)]
pub struct MinLen<P> {
    pub(super) items: P,
    pub(super) places: usize,
}

impl<P: Parallel> Parallel for MinLen<P> {
    type Item = P::Item;
    type Part = P::Part;
    const EXACT: bool = P::EXACT;

    cut_where_its_items_are!();

    fn part(self) -> Self::Part {
        self.items.part()
    }

    fn parts(&self) -> usize {
        self.items.parts().min(self.items.places() / self.places.max(1)).max(1)
    }
}
