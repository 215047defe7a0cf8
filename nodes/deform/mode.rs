//! What handles share out.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What handles share out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Mode {
    /// How far they move: handles that stay leave everything as it is.
    #[default]
    Displacement,
    /// Where they are, as published: even handles that stay squeeze the object, the more the smaller their deviations are.
    Absolute,
    /// How far they move beside the affine motion that fits best: handles that are moved, turned, scaled or sheared as one do
    /// so with the whole object.
    Affine,
}
