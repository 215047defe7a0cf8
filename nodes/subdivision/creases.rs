//! Treatment of creases.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Treatment of creases.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Creases {
    /// A crease is a cubic B-spline that depends only on its own vertices. Each step subtracts 1 from its sharpness.
    #[default]
    OpenSubdiv,
    /// As `OpenSubdiv`, but the sharpness of a crease is smoothed along its edges by Chaikin's rule while it decreases.
    Chaikin,
    /// The rules of Hoppe et al. (1994) for triangles, with special masks at irregular vertices of a crease.
    Hoppe94,
}
