//! Errors of refining a mesh.

use maquette_node::{CancelledError, LimitError};
use maquette_value::MeshError;

/// The reason why a mesh cannot be refined.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SubdivideError {
    /// The scheme cannot refine a face: it is not a triangle.
    #[error("face {face} has {corners} corners, but Loop's scheme needs triangles")]
    NotTriangles {
        /// The first face that is not a triangle.
        face: usize,
        /// The number of its corners.
        corners: usize,
    },
    /// The mesh is not manifold: edges have more than two faces or faces of opposite orientation, or several fans of faces meet at a
    /// vertex.
    #[error("the mesh is not a surface: {}", list(edges, vertices))]
    NonManifold {
        /// The ends of the non-manifold edges.
        edges: Vec<[u32; 2]>,
        /// The non-manifold vertices. Empty if there are non-manifold edges.
        vertices: Vec<u32>,
    },
    /// The result would be too large.
    #[error(transparent)]
    TooMuch(#[from] LimitError),
    /// The limit surface of the scheme is not made of patches over faces.
    #[error("the surface of Doo and Sabin has patches over vertices, not over faces")]
    NoPatches,
    /// The faces, creases or number of vertices of the mesh differ from those of the plan.
    #[error("the plan was made for a mesh with another topology")]
    OtherTopology,
    /// The evaluation was cancelled.
    #[error(transparent)]
    Cancelled(#[from] CancelledError),
    /// A position became infinite.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

/// The maximum number of non-manifold edges or vertices that a message lists.
const MAX_LISTED: usize = 5;

fn list(edges: &[[u32; 2]], vertices: &[u32]) -> String {
    let (count, what, mut first) = match edges {
        [] => {
            let first: Vec<String> = vertices.iter().take(MAX_LISTED).map(u32::to_string).collect();
            (vertices.len(), "vertices join fans of faces", first)
        }
        edges => {
            let first = edges.iter().take(MAX_LISTED).map(|[a, b]| format!("({a}, {b})")).collect();
            (
                edges.len(),
                "edges have more than two faces or faces that disagree about their side",
                first,
            )
        }
    };
    if count > MAX_LISTED {
        first.push("...".to_owned());
    }
    format!("{count} {what}: {}", first.join(", "))
}
