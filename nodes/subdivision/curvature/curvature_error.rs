//! Errors of the computation of curvature.

use maquette_node::CancelledError;
use maquette_value::MeshError;

use crate::SubdivideError;

/// An error of the computation of curvature.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CurvatureError {
    /// The scheme cannot refine the mesh.
    #[error(transparent)]
    Subdivide(#[from] SubdivideError),
    /// The mesh has border faces, which the surface lacks with `boundary: None`.
    #[error(
        "with `boundary: None` the surface ends before the border, so that vertices there have no curvature"
    )]
    NoBorder,
    /// A position became infinite.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was cancelled.
    #[error(transparent)]
    Cancelled(#[from] CancelledError),
}
