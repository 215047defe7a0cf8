//! Treatment of the border of an open mesh.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Treatment of the border of an open mesh, named as in USD and OpenSubdiv.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Boundary {
    /// The border becomes a smooth curve through the vertices that have only one face. With `DooSabin` this is the same as `EdgeOnly`.
    #[default]
    EdgeAndCorner,
    /// The whole border becomes a smooth curve.
    EdgeOnly,
    /// Faces at the border only influence their neighbors, and are removed from the result. With `DooSabin` the border gets no faces of its
    /// own and shrinks.
    None,
}
