//! The elements of a value that a `ForEach` iterates over: each is a value by itself.

use thiserror::Error;

use super::{AnyValue, ValueType};

/// One way to split values of a type into elements, for a `ForEach`.
///
/// An element depends only on its own part of the value: if another part changes, appears or disappears, the element stays equal, so that
/// results computed from it stay valid.
pub struct Elements<T> {
    /// The word that selects these elements in graph files: `Parts` for `over: Parts("mesh")`. Empty for the elements that are used if the
    /// file names no word: `over: "spots"`.
    pub word: &'static str,
    /// The plural noun for the elements in messages, such as `components`.
    pub name: &'static str,
    /// The type of each element.
    pub kind: &'static ValueType,
    /// Splits a value into all its elements, in order, if there are at most `max_count`. `before` holds the elements of another value, and
    /// may be empty. An element of `before` that is equal to a new one may be reused instead of being built again.
    pub cut: fn(value: &T, max_count: usize, before: &[AnyValue]) -> ElementsResult,
}

/// The elements of a value, or the reason why the value has none.
type ElementsResult = Result<Vec<AnyValue>, NoElements>;

/// Error of splitting a value into elements.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum NoElements {
    /// The value has more elements than the limit.
    #[error("there are {count} elements")]
    TooMany {
        /// The number of elements of the value.
        count: usize,
    },
    /// The value cannot be split; contains the reason.
    #[error("{0}")]
    Impossible(String),
}

/// The result of splitting a value. `None` if the value's type has no elements of the requested kind.
pub(crate) type Cut = Option<ElementsResult>;

/// A type-erased [`Elements`]: one way to split the values of a type into elements.
#[derive(Clone, Copy)]
pub struct ElementType {
    pub word: &'static str,
    pub name: &'static str,
    pub kind: &'static ValueType,
}

impl<T> From<&Elements<T>> for ElementType {
    fn from(&Elements { word, name, kind, .. }: &Elements<T>) -> Self {
        Self { word, name, kind }
    }
}
