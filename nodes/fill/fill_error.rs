//! Why holes cannot be filled.

use maquette_node::{Cancelled, TooMuch};
use maquette_value::{MeshError, TraceError};

use super::border::regions::NoMarks;

/// Why holes were not filled.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FillError {
    /// The mesh is no surface.
    #[error(
        "the mesh is no surface at {}: edges have at most two faces, which agree about their side, and faces around a vertex hang together",
        places(edges, vertices)
    )]
    NonManifold {
        /// Edges with more than two faces, or two that disagree about their side; the first ones, by vertices.
        edges: Vec<[u32; 2]>,
        /// Vertices where parts of the mesh touch; the first ones.
        vertices: Vec<u32>,
    },
    /// The filled mesh would be no surface.
    #[error("filled, the mesh would be no surface at {}", places(edges, vertices))]
    Clash {
        /// Edges that would have more than two faces; the first ones, by vertices.
        edges: Vec<[u32; 2]>,
        /// Vertices where parts of the mesh would touch; the first ones.
        vertices: Vec<u32>,
    },
    /// A rim that does not exist.
    #[error("there is no rim {number}: the mesh has {count}, numbered from 0")]
    NoRim {
        /// Its number.
        number: usize,
        /// How many there are.
        count: usize,
    },
    /// An attribute that marks nothing.
    #[error(transparent)]
    NoMarks(#[from] NoMarks),
    /// A hole that would take too many triangles.
    #[error(transparent)]
    TooMuch(#[from] TooMuch),
    /// Too many vertices or faces.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// Distances of iterations that make no trace.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

fn places(edges: &[[u32; 2]], vertices: &[u32]) -> String {
    let edges = edges.iter().map(|[a, b]| format!("edge {a}-{b}"));
    let vertices = vertices.iter().map(|vertex| format!("vertex {vertex}"));
    edges.chain(vertices).collect::<Vec<_>>().join(", ")
}
