//! Interpolation of corner attributes.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Interpolation of corner attributes, such as texture coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Corners {
    /// Linear within each old face, so that a texture does not move.
    #[default]
    Linear,
    /// Numbers, pairs and vectors by the rules of the scheme, as if the mesh were cut at the seams where they jump: a texture is less
    /// distorted, but moves. Other attributes are linear, and all of them are with `DooSabin`.
    Smooth,
}
