//! The rules of a subdivision, with those of borders and creases.

use super::{Boundary, Creases, Scheme};

/// The rules of a subdivision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rules {
    pub(super) scheme: Scheme,
    pub(super) boundary: Boundary,
    pub(super) creases: Creases,
}
