//! Options of a subdivision.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::boundary::Boundary;
use super::corners::Corners;
use super::creases::Creases;
use super::rules::Rules;
use super::scheme::Scheme;

/// Options of a subdivision.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Subdivision {
    /// Subdivision scheme.
    pub scheme: Scheme,
    /// Number of refinement steps. Each step makes four times as many faces.
    #[schemars(
        range(max = 12),
        extend("limit" = "8 levels make 65536 faces of one already")
    )]
    #[serde(default = "default_levels")]
    pub levels: u32,
    /// Moves the vertices to their limit positions after infinitely many steps, and adds the normals of the limit surface. Not for
    /// `Butterfly`, whose vertices are on the limit surface already.
    #[serde(default)]
    pub limit: bool,
    /// Treatment of the border of an open mesh.
    #[serde(default)]
    pub boundary: Boundary,
    /// Treatment of creases.
    #[serde(default)]
    pub creases: Creases,
    /// Interpolation of the attributes of corners and vertices, such as texture coordinates.
    #[serde(default)]
    pub corners: Corners,
}

fn default_levels() -> u32 {
    2
}

impl Subdivision {
    pub(super) fn rules(self) -> Rules {
        Rules { scheme: self.scheme, boundary: self.boundary, creases: self.creases }
    }
}
