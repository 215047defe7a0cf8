//! What a hole is filled with.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::exemplar::ExemplarOptions;

/// What a hole is filled with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum FillMethod {
    /// The shapes of other parts of the mesh, from coarse to fine.
    Exemplar(ExemplarOptions),
    /// The surface that bends least and goes on as the data ends.
    ThinPlate,
    /// The smallest surface: it meets the data at an angle.
    Membrane,
    /// Flat triangles from rim to rim.
    Flat,
    /// As `ThinPlate`, but the smooth parts of the data that meet in creases at the rim go on until they meet: the creases stay sharp.
    CreaseAware,
}

impl Default for FillMethod {
    fn default() -> Self {
        Self::Exemplar(ExemplarOptions::default())
    }
}
