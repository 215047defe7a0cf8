//! How creases are treated.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How creases are treated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Creases {
    /// A crease is a cubic B-spline whatever is beside it, and each step takes 1 off its sharpness.
    #[default]
    OpenSubdiv,
    /// The same, but the sharpness of neighboring edges of a crease that softens flows together.
    Chaikin,
    /// The rules of Hoppe et al. (1994) for triangles, which differ at irregular vertices of a crease.
    Hoppe94,
}
