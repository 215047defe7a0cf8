//! Subdivision schemes.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A subdivision scheme.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Scheme {
    /// Loop (1987): for triangles; the limit consists of quartic box splines.
    Loop,
    /// Catmull and Clark (1978): for polygons; the limit consists of bicubic B-splines.
    CatmullClark,
    /// Doo and Sabin (1978): for polygons; the limit consists of biquadratic B-splines. Creases are not supported and dropped.
    DooSabin,
}

/// A primal scheme: a step makes a new vertex for each old vertex, each edge and, in some schemes, each face. Creases are supported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PrimalScheme {
    /// [`Scheme::Loop`].
    Loop,
    /// [`Scheme::CatmullClark`].
    CatmullClark,
}

impl Scheme {
    /// Converts the scheme to a primal scheme; returns `None` for the dual scheme `DooSabin`.
    pub(crate) fn primal(self) -> Option<PrimalScheme> {
        match self {
            Self::Loop => Some(PrimalScheme::Loop),
            Self::CatmullClark => Some(PrimalScheme::CatmullClark),
            Self::DooSabin => None,
        }
    }

    /// Returns true if the scheme requires all faces to be triangles.
    pub(crate) fn needs_triangles(self) -> bool {
        self.primal().is_some_and(PrimalScheme::needs_triangles)
    }

    /// Returns true for a dual scheme: a step makes a vertex for each corner of a face, but none for the old vertices. Creases are not
    /// supported.
    pub(crate) fn is_dual(self) -> bool {
        self.primal().is_none()
    }
}

impl PrimalScheme {
    /// Returns true if the scheme requires all faces to be triangles.
    pub(crate) fn needs_triangles(self) -> bool {
        match self {
            Self::Loop => true,
            Self::CatmullClark => false,
        }
    }

    /// Returns true if a step makes a new vertex in each face, in addition to those for old vertices and edges.
    pub(crate) fn has_middles(self) -> bool {
        match self {
            Self::CatmullClark => true,
            Self::Loop => false,
        }
    }
}
