//! The minimum-weight triangulation of a rim. The weight is the sharpest bend; among equal bends, the area.
//!
//! Liepa, "Filling holes in meshes" (2003), section 3: the triangulation whose sharpest edge, including edges to the surrounding data,
//! bends least; among equals, the one with the smallest area. Found by dynamic programming: Barequet and Sharir, "Filling gaps in the
//! boundary of a polyhedron" (1995).

use nalgebra::{Point3, Vector3};

use super::large_hole::triangulate_large;
use super::min_weight::min_weight;

/// Maximum number of rim edges for which the exact minimum is computed; the cost grows with the cube of the number. For longer rims, the
/// minimum is computed for some of the vertices only.
pub(crate) const MAX_EDGES: usize = 200;

/// Triangulates a rim. Corners are indices of rim vertices, counter-clockwise as seen from the side to which `normals` point, like the rim.
///
/// `normals` are the unit normals of the data at each rim edge, from its vertex to the next. `is_taken` returns true if the mesh has an
/// edge between two vertices; no triangle gets such an edge. Returns `None` if no triangulation avoids these edges.
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
