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

impl Scheme {
    /// Whether it refines triangles alone.
    pub(crate) fn needs_triangles(self) -> bool {
        match self {
            Self::Loop => true,
            Self::CatmullClark | Self::DooSabin => false,
        }
    }

    /// Whether a step makes a vertex in each face, beside those at vertices and on edges.
    pub(crate) fn has_middles(self) -> bool {
        match self {
            Self::CatmullClark => true,
            Self::Loop | Self::DooSabin => false,
        }
    }

    /// Whether a step makes a vertex for each corner of a face and none that stands for an old one, so that there are no creases.
    pub(crate) fn is_dual(self) -> bool {
        match self {
            Self::DooSabin => true,
            Self::Loop | Self::CatmullClark => false,
        }
    }
}
