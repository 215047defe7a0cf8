//! The rules of a subdivision: its scheme and the treatment of borders and creases.

use super::scheme::PrimalScheme;
use super::{Boundary, Creases, Scheme};

/// The rules of a subdivision. `S` is the type of the scheme, such as [`PrimalScheme`], or `()` for rules without a scheme.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rules<S = Scheme> {
    pub(super) scheme: S,
    pub(super) boundary: Boundary,
    pub(super) creases: Creases,
}

impl<S> Rules<S> {
    /// Returns the rules for borders and creases, without the scheme.
    pub(super) fn of_edges(self) -> Rules<()> {
        self.with_scheme(())
    }

    /// Returns these subdivision rules with the scheme replaced by `scheme`.
    pub(super) fn with_scheme<T>(self, scheme: T) -> Rules<T> {
        Rules { scheme, boundary: self.boundary, creases: self.creases }
    }
}

impl Rules {
    /// Returns these subdivision rules with the scheme converted to a [`PrimalScheme`]; `None` for `DooSabin` and `Butterfly`.
    pub(super) fn primal(self) -> Option<Rules<PrimalScheme>> {
        Some(self.with_scheme(self.scheme.primal()?))
    }
}
