//! Whether meshes from captures are brought into one coordinate system.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Whether meshes of captures are moved from their cameras' places to the world's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Poses {
    /// They are if the pose of every mesh is known.
    #[default]
    Auto,
    /// They are; a mesh without a pose is an error.
    Apply,
    /// They stay as they lie.
    Ignore,
}
