//! Measures walls by rays from random places, for tests.

use maquette_value::rng::Random;
use maquette_value::{Mesh, TriangleTree};
use nalgebra::Point3;

/// Returns the thickness of the walls of a solid at random places of a surface, in ascending order. It is measured by rays against the
/// normals of the surface.
pub(crate) fn walls(solid: &Mesh, surface: &Mesh, rng: &mut Random, rays: usize) -> Vec<f64> {
    let mut walls: Vec<f64> =
        walls_at(solid, surface, rng, rays).into_iter().map(|(_, wall)| wall).collect();
    walls.sort_by(f64::total_cmp);
    walls
}

/// Returns random places of a surface, each with the thickness of the wall there.
pub(crate) fn walls_at(
    solid: &Mesh,
    surface: &Mesh,
    rng: &mut Random,
    rays: usize,
) -> Vec<(Point3<f64>, f64)> {
    let tree = TriangleTree::new(solid);
    let triangles = surface.triangles();
    let mut sum = 0.0;
    let areas: Vec<f64> = triangles
        .iter()
        .map(|face| {
            sum += surface.area_vector(face).norm();
            sum
        })
        .collect();
    (0..rays)
        .filter_map(|_| {
            let at = sum * rng.even();
            let face = &triangles[areas.partition_point(|area| *area < at).min(areas.len() - 1)];
            let [a, b, c] = [0, 1, 2].map(|k| surface.positions()[face[k] as usize]);
            let (u, v) = (rng.even(), rng.even());
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            let inward = -surface.area_vector(face).try_normalize(0.0)?;
            let start = a + (b - a) * u + (c - a) * v + inward * 1e-7;
            Some((start, tree.first_hit(start, inward).map_or(0.0, |hit| hit.along)))
        })
        .collect()
}

/// Returns the value below which `fraction` of the sorted values are.
pub(crate) fn percentile(sorted: &[f64], fraction: f64) -> f64 {
    sorted[(fraction * sorted.len() as f64) as usize]
}
