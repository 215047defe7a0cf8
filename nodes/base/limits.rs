//! What several nodes make at most.

use maquette_node::Limit;

/// Vertices of a mesh that a node makes from a few numbers: with normals, texture coordinates and faces some 2 GB while it is made.
pub const VERTICES: Limit =
    Limit { most: 1 << 24, of: "vertices", help: "choose fewer rows, columns or sides" };

/// Points of a net or grid that is made anew: some 400 MB while it is made.
pub const POINTS: Limit =
    Limit { most: 1 << 22, of: "points", help: "choose fewer rows or columns" };
