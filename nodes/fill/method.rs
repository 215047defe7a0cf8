//! The methods of filling a hole.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::exemplar::ExemplarOptions;

/// Surface that fills a hole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum FillMethod {
    /// Copies the shapes of other parts of the mesh, from coarse to fine levels. A hole in a smooth part keeps the thin plate from which it
    /// starts: one whose rim has no relief that the plate lacks, and around which exemplars do not predict the surface better than a plate.
    /// The vertices nearest to the rim count most; how rough the mesh is farther away does not matter. If `radii`, `exemplars` or another
    /// `start` are given, shapes are copied in any case.
    Exemplar(ExemplarOptions),
    /// Thin plate: the surface with the least bending that continues the data smoothly.
    ThinPlate,
    /// Membrane: the surface with the smallest area. It meets the data at an angle.
    Membrane,
    /// Flat triangles between rim vertices.
    Flat,
    /// Like `ThinPlate`, but smooth segments of the data that meet in creases at the rim are extended until they meet, so that the creases
    /// stay sharp, also in corners. Segments are extended as planes, spheres, cylinders, cones or paraboloids, whichever explains the data
    /// best. Creases along circles and splines are continued as curves, also over long gaps.
    CreaseAware,
}

impl Default for FillMethod {
    fn default() -> Self {
        Self::Exemplar(ExemplarOptions::default())
    }
}
