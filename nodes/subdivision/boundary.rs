//! What happens at the border of an open mesh.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What happens at the border of an open mesh. The words are those of USD and OpenSubdiv.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Boundary {
    /// The border becomes a smooth curve, which passes through the vertices that have only one face; not through these with
    /// `DooSabin`, for which this is as `EdgeOnly`.
    #[default]
    EdgeAndCorner,
    /// The whole border becomes a smooth curve.
    EdgeOnly,
    /// Faces that touch the border only support their neighbors and are left out of the result; with `DooSabin` the border gets no
    /// faces of its own, and shrinks.
    None,
}
