//! Adaptors of parallel iterators. Each processes a part with the standard library's iterator of the same name.

use std::iter;
use std::marker::PhantomData;

use super::{MAX_INIT_PARTS, Parallel};

/// Implements `len` and `split_at` for an adaptor whose other fields do not depend on the index.
macro_rules! split_with_items {
    () => {
        fn index_count(&self) -> usize {
            self.items.index_count()
        }

        fn split_at(self, index: usize) -> (Self, Self) {
            let (before, after) = self.items.split_at(index);
            (Self { items: before, ..self }, Self { items: after, ..self })
        }
    };
}

/// The items mapped by a closure.
#[derive(Clone, Debug)]
pub struct Map<P, F> {
    pub(super) items: P,
    pub(super) f: F,
}

impl<P: Parallel, T: Send, F: Fn(P::Item) -> T + Copy + Send> Parallel for Map<P, F> {
    type Item = T;
    type Part = iter::Map<P::Part, F>;
    const EXACT: bool = P::EXACT;

    split_with_items!();

    fn part(self) -> Self::Part {
        self.items.part().map(self.f)
    }

    fn parts(&self) -> usize {
        self.items.parts()
    }
}

/// The items for which a closure returns true.
#[derive(Clone, Debug)]
pub struct Filter<P, F> {
    pub(super) items: P,
    pub(super) f: F,
}

impl<P: Parallel, F: Fn(&P::Item) -> bool + Copy + Send> Parallel for Filter<P, F> {
    type Item = P::Item;
    type Part = iter::Filter<P::Part, F>;
    const EXACT: bool = false;

    split_with_items!();

    fn part(self) -> Self::Part {
        self.items.part().filter(self.f)
    }

    fn parts(&self) -> usize {
        self.items.parts()
    }
}

/// The items mapped by a closure, without `None`.
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

    split_with_items!();

    fn part(self) -> Self::Part {
        self.items.part().filter_map(self.f)
    }

    fn parts(&self) -> usize {
        self.items.parts()
    }
}

/// The items mapped to several items each.
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

    fn index_count(&self) -> usize {
        self.items.index_count()
    }

    fn split_at(self, index: usize) -> (Self, Self) {
        let (before, after) = self.items.split_at(index);
        (Self::new(before, self.f), Self::new(after, self.f))
    }

    fn part(self) -> Self::Part {
        self.items.part().flat_map(self.f)
    }

    fn parts(&self) -> usize {
        self.items.parts()
    }
}

/// The items mapped by a closure that also gets a state, which is created once per part.
#[derive(Clone, Debug)]
pub struct MapInit<P, I, F> {
    pub(super) items: P,
    pub(super) init: I,
    pub(super) f: F,
}

impl<P, S, T, I, F> Parallel for MapInit<P, I, F>
where
    P: Parallel,
    T: Send,
    I: Fn() -> S + Copy + Send,
    F: Fn(&mut S, P::Item) -> T + Copy + Send,
{
    type Item = T;
    type Part = MapInitPart<P::Part, S, F>;
    const EXACT: bool = P::EXACT;

    split_with_items!();

    fn part(self) -> Self::Part {
        MapInitPart { items: self.items.part(), state: (self.init)(), f: self.f }
    }

    fn parts(&self) -> usize {
        self.items.parts().min(MAX_INIT_PARTS)
    }
}

/// The sequential iterator over a part, with the state of that part.
#[derive(Clone, Debug)]
pub struct MapInitPart<P, S, F> {
    items: P,
    state: S,
    f: F,
}

impl<P: Iterator, S, T, F: Fn(&mut S, P::Item) -> T> Iterator for MapInitPart<P, S, F> {
    type Item = T;

    fn next(&mut self) -> Option<T> {
        Some((self.f)(&mut self.state, self.items.next()?))
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        self.items.size_hint()
    }
}

/// Copies of borrowed items.
#[derive(Clone, Debug)]
pub struct Copied<P>(pub(super) P);

impl<'a, P: Parallel<Item = &'a T>, T: Copy + Send + 'a> Parallel for Copied<P> {
    type Item = T;
    type Part = iter::Copied<P::Part>;
    const EXACT: bool = P::EXACT;

    fn index_count(&self) -> usize {
        self.0.index_count()
    }

    fn split_at(self, index: usize) -> (Self, Self) {
        let (before, after) = self.0.split_at(index);
        (Self(before), Self(after))
    }

    fn part(self) -> Self::Part {
        self.0.part().copied()
    }

    fn parts(&self) -> usize {
        self.0.parts()
    }
}

/// The items with their indices.
#[derive(Clone, Debug)]
pub struct Enumerate<P> {
    pub(super) items: P,
    pub(super) first: usize,
}

impl<P: Parallel> Parallel for Enumerate<P> {
    type Item = (usize, P::Item);
    type Part = iter::Zip<std::ops::Range<usize>, P::Part>;

    fn index_count(&self) -> usize {
        self.items.index_count()
    }

    fn split_at(self, index: usize) -> (Self, Self) {
        let (before, after) = self.items.split_at(index);
        (Self { items: before, ..self }, Self { items: after, first: self.first + index })
    }

    fn part(self) -> Self::Part {
        iter::zip(self.first..self.first + self.items.index_count(), self.items.part())
    }

    fn parts(&self) -> usize {
        self.items.parts()
    }
}

/// Pairs of items with the same index.
#[derive(Clone, Debug)]
pub struct Zip<A, B>(pub(super) A, pub(super) B);

impl<A: Parallel, B: Parallel> Parallel for Zip<A, B> {
    type Item = (A::Item, B::Item);
    type Part = iter::Zip<A::Part, B::Part>;

    fn index_count(&self) -> usize {
        self.0.index_count().min(self.1.index_count())
    }

    fn split_at(self, index: usize) -> (Self, Self) {
        let (a, b) = (self.0.split_at(index), self.1.split_at(index));
        (Self(a.0, b.0), Self(a.1, b.1))
    }

    fn part(self) -> Self::Part {
        iter::zip(self.0.part(), self.1.part())
    }

    fn parts(&self) -> usize {
        self.0.parts().min(self.1.parts())
    }
}

/// An iterator whose parts have a minimum length.
#[derive(Clone, Debug)]
pub struct MinLen<P> {
    pub(super) items: P,
    pub(super) min_len: usize,
}

impl<P: Parallel> Parallel for MinLen<P> {
    type Item = P::Item;
    type Part = P::Part;
    const EXACT: bool = P::EXACT;

    split_with_items!();

    fn part(self) -> Self::Part {
        self.items.part()
    }

    fn parts(&self) -> usize {
        self.items.parts().min(self.items.index_count() / self.min_len.max(1)).max(1)
    }
}
