//! Why a mesh has no curvature.

use maquette_node::Cancelled;
use maquette_value::MeshError;

use crate::SubdivideError;

/// Why there is no curvature.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CurvatureError {
    /// A mesh that the scheme cannot refine.
    #[error(transparent)]
    Subdivide(#[from] SubdivideError),
    /// Faces at the border that the surface does not have.
    #[error(
        "with `boundary: None` the surface ends before the border, so that vertices there have no curvature"
    )]
    NoBorder,
    /// Places out of all bounds.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
