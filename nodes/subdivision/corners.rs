//! How data at the corners of faces run.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How data at the corners of faces run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Corners {
    /// Straight within each old face, so that a picture stays where it is.
    #[default]
    Linear,
    /// Numbers, pairs and vectors by the rules of the scheme, as if the mesh were cut at the seams, where they jump: a picture is
    /// less distorted, but moves. Other data, and all with `DooSabin`, run straight.
    Smooth,
}
