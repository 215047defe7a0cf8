//! Interpolation of the attributes of corners and vertices.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Interpolation of the attributes of corners and vertices, such as texture coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Corners {
    /// Linear within each old face and along old edges, so that a texture does not move.
    #[default]
    Linear,
    /// Numbers, pairs and vectors by the rules of the scheme, as if the mesh were cut at the seams where they jump and had no creases: a
    /// texture is less distorted, but moves. Attributes of vertices have no seams. Other attributes are linear, and all of them are with
    /// `DooSabin`.
    Smooth,
}
