//! The rules of a subdivision, with those of borders and creases.

use super::scheme::PrimalScheme;
use super::{Boundary, Creases, Scheme};

/// The rules of a subdivision, of any scheme or of some of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rules<S = Scheme> {
    pub(super) scheme: S,
    pub(super) boundary: Boundary,
    pub(super) creases: Creases,
}

impl<S> Rules<S> {
    /// Those of borders and creases alone.
    pub(super) fn of_edges(self) -> Rules<()> {
        self.of(())
    }

    /// The same for another scheme.
    pub(super) fn of<T>(self, scheme: T) -> Rules<T> {
        Rules { scheme, boundary: self.boundary, creases: self.creases }
    }
}

impl Rules {
    /// The same, if the scheme makes vertices for the old ones.
    pub(super) fn primal(self) -> Option<Rules<PrimalScheme>> {
        Some(self.of(self.scheme.primal()?))
    }
}
