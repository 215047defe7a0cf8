//! Size limits shared by several nodes.

use maquette_node::Limit;

/// The maximum number of vertices of a mesh that a node generates from a few numbers. A mesh of this size needs about 2 GB of memory,
/// including its normals, texture coordinates and faces.
pub const VERTICES: Limit =
    Limit { max: 1 << 24, items: "vertices", help: "choose fewer rows, columns or sides" };

/// The maximum number of points of a newly created control net or range grid. A control net or range grid of this size needs about 400 MB
/// of memory.
pub const POINTS: Limit =
    Limit { max: 1 << 22, items: "points", help: "choose fewer rows or columns" };
