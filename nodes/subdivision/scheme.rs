//! The rules of a subdivision.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The rules of a subdivision.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Scheme {
    /// Loop (1987): triangles, which become box splines.
    Loop,
    /// Catmull and Clark (1978): polygons, which become bicubic B-splines.
    CatmullClark,
    /// Doo and Sabin (1978): polygons, which become biquadratic B-splines. It knows no creases, and drops them.
    DooSabin,
}

/// A scheme whose step makes vertices for the old ones, on edges and in faces, so that a mesh may have creases.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PrimalScheme {
    /// [`Scheme::Loop`].
    Loop,
    /// [`Scheme::CatmullClark`].
    CatmullClark,
}

impl Scheme {
    /// The same among those that make vertices for the old ones; none if it makes one for each corner of a face instead.
    pub(crate) fn primal(self) -> Option<PrimalScheme> {
        match self {
            Self::Loop => Some(PrimalScheme::Loop),
            Self::CatmullClark => Some(PrimalScheme::CatmullClark),
            Self::DooSabin => None,
        }
    }

    /// Whether it refines triangles alone.
    pub(crate) fn needs_triangles(self) -> bool {
        self.primal().is_some_and(PrimalScheme::needs_triangles)
    }

    /// Whether a step makes a vertex for each corner of a face and none that stands for an old one, so that there are no creases.
    pub(crate) fn is_dual(self) -> bool {
        self.primal().is_none()
    }
}

impl PrimalScheme {
    /// Whether it refines triangles alone.
    pub(crate) fn needs_triangles(self) -> bool {
        match self {
            Self::Loop => true,
            Self::CatmullClark => false,
        }
    }

    /// Whether a step makes a vertex in each face, beside those at vertices and on edges.
    pub(crate) fn has_middles(self) -> bool {
        match self {
            Self::CatmullClark => true,
            Self::Loop => false,
        }
    }
}
