//! Why meshes do not make one.

use maquette_node::TooMuch;
use maquette_value::MeshError;

/// Why meshes do not make one.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MergeError {
    /// A mesh without a pose.
    #[error(
        "mesh {mesh} has no pose: only captures whose camera file has `world_from_camera_mm` have one, and only until they are moved"
    )]
    NoPose {
        /// Its place among the meshes, from 1.
        mesh: usize,
    },
    /// More than memory should hold.
    #[error(transparent)]
    TooMuch(#[from] TooMuch),
    /// Too many vertices, or places out of the numbers.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}
