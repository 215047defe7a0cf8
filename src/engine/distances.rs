//! Distances between meshes.

use maquette_value::{Mesh, TriangleTree};
use nalgebra::Point3;

/// Returns the distance of each vertex of `from` from the surface of `to`, in mm.
pub fn distances(from: &Mesh, to: &Mesh) -> Vec<f64> {
    distances_of(from.positions(), to)
}

/// Returns the distance of each point from the surface of the mesh `to`, in mm.
pub fn distances_of(places: &[Point3<f64>], to: &Mesh) -> Vec<f64> {
    let hits = TriangleTree::new(to).nearest_to_all(places);
    hits.iter().map(|hit| hit.map_or(f64::INFINITY, |hit| hit.distance_sq.sqrt())).collect()
}
