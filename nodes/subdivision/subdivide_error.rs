//! Why a mesh cannot be refined.

use maquette_node::{Cancelled, TooMuch};
use maquette_value::MeshError;

/// Why a mesh cannot be refined.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SubdivideError {
    /// A face that the scheme has no rule for.
    #[error("face {face} has {corners} corners, but Loop's scheme needs triangles")]
    NotTriangles {
        /// The first such face.
        face: usize,
        /// Its corners.
        corners: usize,
    },
    /// Edges with more than two faces or with faces of opposite orientation, or vertices at which several fans of faces meet.
    #[error("the mesh is not a surface: {}", list(edges, vertices))]
    NonManifold {
        /// The ends of the bad edges.
        edges: Vec<[u32; 2]>,
        /// The bad vertices; not looked for if there are bad edges.
        vertices: Vec<u32>,
    },
    /// A result that memory could not hold.
    #[error(transparent)]
    TooMuch(#[from] TooMuch),
    /// A scheme whose limit surface is not made of patches over faces.
    #[error("the surface of Doo and Sabin has patches over vertices, not over faces")]
    NoPatches,
    /// A mesh with other faces, creases or numbers of vertices than those that a plan was made for.
    #[error("the plan was made for a mesh of another topology")]
    OtherTopology,
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// A place became infinite.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

/// How many bad edges or vertices a message lists.
const LISTED: usize = 5;

fn list(edges: &[[u32; 2]], vertices: &[u32]) -> String {
    let (count, what, mut first) = match edges {
        [] => {
            let first: Vec<String> = vertices.iter().take(LISTED).map(u32::to_string).collect();
            (vertices.len(), "vertices join fans of faces", first)
        }
        edges => {
            let first = edges.iter().take(LISTED).map(|[a, b]| format!("({a}, {b})")).collect();
            (
                edges.len(),
                "edges have more than two faces or faces that disagree about their side",
                first,
            )
        }
    };
    if count > LISTED {
        first.push("...".to_owned());
    }
    format!("{count} {what}: {}", first.join(", "))
}
