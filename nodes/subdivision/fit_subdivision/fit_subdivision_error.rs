//! Errors of fitting a subdivision surface.

use maquette_node::CancelledError;
use maquette_value::MeshError;

use crate::SubdivideError;

/// An error of fitting a subdivision surface.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitSubdivisionError {
    /// None of the points is near the mesh.
    #[error("none of the {count} points is near the mesh; check the positions and units of both")]
    Apart {
        /// The number of given points.
        count: usize,
    },
    /// `points` has no faces, but `moves: ByEnergy` needs them.
    #[error(
        "`moves: ByEnergy` also measures distances between the points: expected a mesh with faces as `points`; use `Reconstruct` for \
         points and `Triangulate` for range images"
    )]
    NoSurface,
    /// Loop's scheme cannot refine the mesh.
    #[error(transparent)]
    Subdivide(#[from] SubdivideError),
    /// A position became infinite.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was cancelled.
    #[error(transparent)]
    Cancelled(#[from] CancelledError),
}
