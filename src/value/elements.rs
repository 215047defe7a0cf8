//! What a `ForEach` goes over in a value: its elements, each a value by itself.

use thiserror::Error;

use super::{AnyValue, Value, ValueType};

/// One way to take the values of a type apart, for a `ForEach`.
///
/// An element hangs on its own part of the value alone: if another part changes, or comes or goes, it must come out the same, so that
/// what was made of it is still true.
pub struct Elements<T> {
    /// What graph files say: `Parts` for `over: Parts("mesh")`; empty for `over: "spots"`.
    pub word: &'static str,
    /// What they are, in messages: `components`.
    pub name: &'static str,
    /// The type of each.
    pub kind: &'static ValueType,
    /// All of them in order, in one pass over the value, if there are no more than `most`. What comes last are elements of some other
    /// value, perhaps of none: one that is equal may be taken over instead of being made again.
    pub cut: fn(value: &T, most: usize, before: &[AnyValue]) -> Found,
}

/// What a value was taken apart to.
type Found = Result<Vec<AnyValue>, NoElements>;

/// Why a value was not taken apart.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum NoElements {
    /// There are more elements than were asked for.
    #[error("there are {count} elements")]
    TooMany {
        /// How many there are.
        count: usize,
    },
    /// The value has no such elements, because of this.
    #[error("{0}")]
    Impossible(String),
}

/// Elements, if a value has such.
pub(crate) type Cut = Option<Found>;

/// What the engine knows of one way to take values of a type apart.
#[derive(Clone, Copy)]
pub struct ElementType {
    pub word: &'static str,
    pub name: &'static str,
    pub kind: &'static ValueType,
}

impl ElementType {
    /// The ways of a type.
    pub(super) fn all_of<T: Value>() -> Vec<Self> {
        T::elements()
            .iter()
            .map(|it| Self { word: it.word, name: it.name, kind: it.kind })
            .collect()
    }
}

/// The elements of a value that a word means; none if its type has no such.
pub(super) fn cut<T: Value>(value: &T, word: &str, most: usize, before: &[AnyValue]) -> Cut {
    let way = T::elements().into_iter().find(|way| way.word == word)?;
    Some((way.cut)(value, most, before))
}
