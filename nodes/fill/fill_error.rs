//! Errors of filling holes.

use maquette_node::{CancelledError, LimitError};
use maquette_value::{MeshError, TraceError};

use super::border::regions::MissingMarks;

/// The reason why holes were not filled.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FillError {
    /// The input mesh is not manifold.
    #[error(
        "the mesh is not manifold at {}: an edge may have at most two faces, of equal orientation, and the faces around a vertex must be connected",
        format_positions(edges, vertices)
    )]
    NonManifold {
        /// The first edges with more than two faces or with two faces of opposite orientation, as pairs of vertices.
        edges: Vec<[u32; 2]>,
        /// The first vertices at which separate fans of faces touch.
        vertices: Vec<u32>,
    },
    /// The filled mesh would not be manifold, although the mesh is.
    #[error("the filled mesh would not be manifold at {}", format_positions(edges, vertices))]
    Clash {
        /// The first edges that would have more than two faces, as pairs of vertices.
        edges: Vec<[u32; 2]>,
        /// The first vertices at which separate fans of faces would touch.
        vertices: Vec<u32>,
    },
    /// A chosen rim number does not exist.
    #[error("the mesh has no rim {number}: it has {count} rims, numbered from 0")]
    NoRim {
        /// The chosen rim number.
        number: usize,
        /// The number of rims of the mesh.
        count: usize,
    },
    /// The chosen attribute does not exist, or is not a flag or number.
    #[error(transparent)]
    NoMarks(#[from] MissingMarks),
    /// The fill of a hole would have too many triangles.
    #[error(transparent)]
    LimitExceeded(#[from] LimitError),
    /// The filled mesh would have too many vertices or faces.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The trace of the fill is not valid.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// The evaluation was cancelled.
    #[error(transparent)]
    Cancelled(#[from] CancelledError),
}

fn format_positions(edges: &[[u32; 2]], vertices: &[u32]) -> String {
    let edges = edges.iter().map(|[a, b]| format!("edge {a}-{b}"));
    let vertices = vertices.iter().map(|vertex| format!("vertex {vertex}"));
    edges.chain(vertices).collect::<Vec<_>>().join(", ")
}
