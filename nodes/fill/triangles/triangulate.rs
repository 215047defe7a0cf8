//! The minimum-weight triangulation of a hole's rim. The weight is the largest bend at an edge; among equal bends, the area.
//!
//! Liepa, "Filling holes in meshes" (2003), section 3: minimizes the largest bend, where edges to the surrounding triangles count, too.
//! Among triangulations with equal bends, minimizes the area. Found by dynamic programming: Barequet and Sharir, "Filling gaps in the
//! boundary of a polyhedron" (1995).

use nalgebra::{Point3, Vector3};

use super::large_hole::triangulate_large;
use super::min_weight::min_weight;

/// Maximum number of rim edges for which the exact minimum is computed; the cost grows with the cube of the number. For longer rims, the
/// exact minimum is computed for a subset of the vertices only.
pub(crate) const MAX_EDGES: usize = 200;

/// Triangulates a hole. Corners are indices of rim vertices. Triangles and rim are counter-clockwise seen from the side to which `normals`
/// point.
///
/// `normals[k]` is the unit normal of the input triangle at the rim edge from vertex `k` to the next vertex. `is_taken` returns true if the
/// mesh has an edge between two vertices; no triangle gets such an edge. Returns `None` if no triangulation avoids these edges.
pub(crate) fn triangulate(
    points: &[Point3<f64>],
    normals: &[Vector3<f64>],
    is_taken: &dyn Fn(usize, usize) -> bool,
) -> Option<Vec<[u32; 3]>> {
    match points.len() {
        0..3 => None,
        3..=MAX_EDGES => min_weight(points, normals, is_taken),
        _ => triangulate_large(points, normals, is_taken),
    }
}
