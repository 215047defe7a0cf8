//! Why no control mesh can be fitted.

use maquette_node::Cancelled;
use maquette_value::MeshError;

use crate::SubdivideError;

/// Why no surface was fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitSubdivisionError {
    /// No points near the mesh.
    #[error("none of the {count} points is near the mesh: are both in the same place and unit?")]
    Apart {
        /// Number of points.
        count: usize,
    },
    /// Points without a surface, where faces are to change.
    #[error(
        "`moves: ByEnergy` looks at what lies between the points, too: give a mesh with faces as `points`, which `Reconstruct` makes of \
         points and `Triangulate` of range data"
    )]
    NoSurface,
    /// A mesh that Loop's scheme cannot refine.
    #[error(transparent)]
    Subdivide(#[from] SubdivideError),
    /// Places out of all bounds.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
