//! Errors of remeshing.

use maquette_node::{CancelledError, LimitError};
use maquette_value::MeshError;
use thiserror::Error;

/// Reasons why a surface cannot be remeshed.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum RemeshError {
    /// The length is out of range.
    #[error("`length` is {0} mm, but must be a number from 0 on")]
    Length(f64),
    /// The angle is out of range.
    #[error("`angle` is {0}, but must be from 0 to 180 degrees")]
    Angle(f64),
    /// Some edges have more than two faces.
    #[error("{edges} edges have more than two faces: the mesh is not a surface there")]
    Crowded {
        /// The number of edges with more than two faces.
        edges: usize,
    },
    /// Adjacent faces have inconsistent orientations.
    #[error(
        "{edges} edges have faces with different orientations; use `Orient` to make them consistent"
    )]
    Twisted {
        /// The number of edges whose faces have different orientations.
        edges: usize,
    },
    /// The result would have too many triangles for the memory.
    #[error(transparent)]
    TooMuch(#[from] LimitError),
    /// The positions exceed the largest coordinate of a mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was cancelled.
    #[error(transparent)]
    Cancelled(#[from] CancelledError),
}
