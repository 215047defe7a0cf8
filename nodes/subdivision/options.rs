//! How a mesh is to be refined.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::boundary::Boundary;
use super::corners::Corners;
use super::creases::Creases;
use super::rules::Rules;
use super::scheme::Scheme;

/// How a mesh is to be refined.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Subdivision {
    /// The rules.
    pub scheme: Scheme,
    /// How often each face is split; each step makes four times as many faces.
    #[schemars(
        range(max = 12),
        extend("limit" = "8 levels make 65536 faces of one already")
    )]
    #[serde(default = "two")]
    pub levels: u32,
    /// Moves the vertices on to where they would be after endless steps, and adds the surface's normals.
    #[serde(default)]
    pub limit: bool,
    /// What happens at the border of an open mesh.
    #[serde(default)]
    pub boundary: Boundary,
    /// How creases are treated.
    #[serde(default)]
    pub creases: Creases,
    /// How data at corners run, texture coordinates among them.
    #[serde(default)]
    pub corners: Corners,
}

fn two() -> u32 {
    2
}

impl Subdivision {
    pub(super) fn rules(self) -> Rules {
        Rules { scheme: self.scheme, boundary: self.boundary, creases: self.creases }
    }
}
