//! Motion of captured meshes into a common coordinate system.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Motion of captured meshes from camera to world coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Poses {
    /// Applied if the pose of every mesh is known.
    #[default]
    Auto,
    /// Applied; a mesh without a pose is an error.
    Apply,
    /// Not applied.
    Ignore,
}
