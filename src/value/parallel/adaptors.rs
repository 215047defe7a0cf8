//! Adaptors of parallel iterators. Each processes a part with the standard library's iterator of the same name.

use std::iter;

use super::Parallel;

/// The items of `P`, where `adapt` converts the sequential iterator of each part. `EXACT` is true if the conversion keeps the number of
/// items.
#[derive(Clone, Debug)]
pub struct Adapted<P, F, const EXACT: bool> {
    pub(super) items: P,
    pub(super) max_parts: usize,
    pub(super) adapt: F,
}

impl<P, I, F, const EXACT: bool> Parallel for Adapted<P, F, EXACT>
where
    P: Parallel,
    I: Iterator<Item: Send>,
    F: Fn(P::Part) -> I + Copy + Send,
{
    type Item = I::Item;
    type Part = I;
    const EXACT: bool = EXACT && P::EXACT;

    fn index_count(&self) -> usize {
        self.items.index_count()
    }

    fn split_at(self, index: usize) -> (Self, Self) {
        let (before, after) = self.items.split_at(index);
        (Self { items: before, ..self }, Self { items: after, ..self })
    }

    fn part(self) -> I {
        (self.adapt)(self.items.part())
    }

    fn weight(&self) -> usize {
        self.items.weight()
    }

    fn parts(&self) -> usize {
        self.items.parts().min(self.max_parts)
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

    fn weight(&self) -> usize {
        self.0.weight().max(self.1.weight())
    }

    fn parts(&self) -> usize {
        self.0.parts().min(self.1.parts())
    }
}
