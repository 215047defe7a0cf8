//! The minimum-weight triangulation of a rim, where the weight is first the sharpest bend and then the area.
//!
//! Liepa, "Filling holes in meshes" (2003), section 3: of all triangulations the one whose sharpest edge bends least, edges to the data
//! around included; of equals the one with the least area. Found by dynamic programming: Barequet and Sharir, "Filling gaps in the
//! boundary of a polyhedron" (1995).

use nalgebra::{Point3, Vector3};

use super::large_hole::triangulate_large;
use super::min_weight::min_weight;

/// Above this many edges the minimum is found for some of the rim's vertices alone, since the cost grows with the cube of their number.
pub(crate) const MOST_EDGES: usize = 200;

/// Triangles with corners by place on the rim, counter-clockwise as the rim is, from the side that `normals` look to.
///
/// `normals` are the unit normals of the data beyond each rim edge, from its vertex to the next. `is_taken` says of two vertices
/// whether the mesh has an edge between them; no triangle gets such an edge. None if there is no triangulation without one.
pub(crate) fn triangulate(
    points: &[Point3<f64>],
    normals: &[Vector3<f64>],
    is_taken: &dyn Fn(usize, usize) -> bool,
) -> Option<Vec<[u32; 3]>> {
    match points.len() {
        0..3 => None,
        3..=MOST_EDGES => min_weight(points, normals, is_taken),
        _ => triangulate_large(points, normals, is_taken),
    }
}
