//! Errors of merging.

use maquette_node::LimitError;
use maquette_value::MeshError;

/// Reasons why meshes cannot be merged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MergeError {
    /// A mesh has no pose.
    #[error(
        "mesh {mesh} has no pose: only captures whose camera file has `world_from_camera_mm` have one, and only until they are moved"
    )]
    NoPose {
        /// The number of the mesh in the list, from 1.
        mesh: usize,
    },
    /// The result would not fit into memory.
    #[error(transparent)]
    TooMuch(#[from] LimitError),
    /// The merged mesh has too many vertices, or positions that exceed the largest coordinate.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}
