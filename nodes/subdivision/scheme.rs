//! Subdivision schemes.

use maquette_node::{Error, FieldError, bail};
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
    /// Modified butterfly (Zorin, Schroeder and Sweldens 1996): for triangles; interpolates, so that the given vertices keep their
    /// positions bit for bit. The limit is smooth, but has no curvature. Only for `Subdivide`.
    Butterfly,
}

/// An approximating primal scheme: a step makes a new vertex for each old vertex, each edge and, in some schemes, each face. Creases are
/// supported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PrimalScheme {
    /// [`Scheme::Loop`].
    Loop,
    /// [`Scheme::CatmullClark`].
    CatmullClark,
}

impl Scheme {
    /// Converts the scheme to an approximating primal scheme; returns `None` for the dual scheme `DooSabin` and the interpolating scheme
    /// `Butterfly`.
    pub(crate) fn primal(self) -> Option<PrimalScheme> {
        match self {
            Self::Loop => Some(PrimalScheme::Loop),
            Self::CatmullClark => Some(PrimalScheme::CatmullClark),
            Self::DooSabin | Self::Butterfly => None,
        }
    }

    /// Returns true if the scheme requires all faces to be triangles.
    pub(crate) fn needs_triangles(self) -> bool {
        matches!(self, Self::Loop | Self::Butterfly)
    }

    /// Returns true for a dual scheme: a step makes a vertex for each corner of a face, but none for the old vertices. Creases are not
    /// supported.
    pub(crate) fn is_dual(self) -> bool {
        self == Self::DooSabin
    }

    /// Checks that the limit surface of the scheme is known, and returns an error that names the field.
    pub(crate) fn check_limit_field(self) -> Result<(), FieldError> {
        let help = "take `scheme: Loop`";
        self.check_limit().map_err(|why| FieldError::new("scheme", why, help))
    }

    /// Checks that the limit surface of the scheme can be computed.
    ///
    /// # Errors
    /// If the scheme is `Butterfly`.
    pub(crate) fn check_limit(self) -> Result<(), Error> {
        match self {
            Self::Butterfly => bail!(
                "`Butterfly` has no formulas for its limit surface; the vertices that it makes are on that surface already"
            ),
            Self::Loop | Self::CatmullClark | Self::DooSabin => Ok(()),
        }
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
