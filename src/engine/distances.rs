//! How far meshes are from each other.

use maquette_value::{Mesh, TriangleTree};
use nalgebra::Point3;

/// How far each vertex of one mesh is from the surface of another one, in mm.
pub fn distances(from: &Mesh, to: &Mesh) -> Vec<f64> {
    distances_of(from.positions(), to)
}

/// How far each place is from the surface of a mesh, in mm.
pub fn distances_of(places: &[Point3<f64>], to: &Mesh) -> Vec<f64> {
    let hits = TriangleTree::new(to).nearest_to_all(places);
    hits.iter().map(|hit| hit.map_or(f64::INFINITY, |hit| hit.distance_sq.sqrt())).collect()
}
