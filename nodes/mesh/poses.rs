//! Motion of captured meshes into a common coordinate system.

use maquette_node::Error;
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

/// Returns the error for a mesh without a pose. `mesh` is the number of the mesh in the list, from 1.
pub(super) fn no_pose_error(mesh: usize) -> Error {
    Error::new(format!(
        "mesh {mesh} has no pose: only captures whose camera file has `world_from_camera_mm` have one, and only until they are moved"
    ))
}
