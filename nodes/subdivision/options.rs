//! How a mesh is to be refined.

use super::boundary::Boundary;
use super::corners::Corners;
use super::creases::Creases;
use super::rules::Rules;
use super::scheme::Scheme;

/// How a mesh is to be refined; the fields are those of [`Subdivide`](super::Subdivide).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Subdivision {
    /// The rules.
    pub scheme: Scheme,
    /// Number of steps.
    pub levels: u32,
    /// Whether the vertices go on to the limit surface.
    pub limit: bool,
    /// What happens at the border.
    pub boundary: Boundary,
    /// How creases are treated.
    pub creases: Creases,
    /// How data at corners run.
    pub corners: Corners,
}

impl Subdivision {
    pub(super) fn rules(self) -> Rules {
        Rules { scheme: self.scheme, boundary: self.boundary, creases: self.creases }
    }
}
