//! Why a surface was not given new triangles.

use maquette_node::{Cancelled, TooMuch};
use maquette_value::MeshError;
use thiserror::Error;

/// Why a surface was not given new triangles.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum RemeshError {
    /// A length that is none.
    #[error("`length` is {0} mm, but must be a number from 0 on")]
    Length(f64),
    /// An angle that is none.
    #[error("`angle` is {0}, but must be from 0 to 180 degrees")]
    Angle(f64),
    /// Edges of more than two faces.
    #[error("{edges} edges have more than two faces: the mesh is no surface there")]
    Crowded {
        /// How many.
        edges: usize,
    },
    /// Neighbors that look to different sides.
    #[error("{edges} edges lie between faces that look to different sides; `Orient` turns them")]
    Twisted {
        /// How many.
        edges: usize,
    },
    /// More than memory should hold.
    #[error(transparent)]
    TooMuch(#[from] TooMuch),
    /// Places out of all bounds.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
