//! Detection of sharp edges.

use maquette_base::topology::flat_faces::unit_normals;
use maquette_value::Mesh;
use maquette_value::parallel::*;
use nalgebra::Vector3;

/// Marks as creases those edges of `mesh` whose two faces have normals that differ by more than `angle` degrees. Edges without exactly two
/// faces are left unchanged. Faces without area have the normals of their neighbors, as [`unit_normals`] finds them.
pub fn crease(mesh: &Mesh, angle: f64, sharpness: f64) -> Mesh {
    let limit = angle.to_radians();
    let bent = edge_angles(mesh).into_iter().filter(|(_, angle)| *angle > limit);
    merge_creases(mesh, bent.map(|(ends, _)| (ends, sharpness)), f64::max)
}

/// Returns the largest angle between the normals of two faces at an edge, in degrees; 0 if no edge has two faces.
pub(super) fn largest_angle(mesh: &Mesh) -> f64 {
    edge_angles(mesh).into_iter().map(|(_, angle)| angle.to_degrees()).fold(0.0, f64::max)
}

/// Returns the edges with two faces, each with the angle between the normals of its faces, in radians.
fn edge_angles(mesh: &Mesh) -> Vec<([u32; 2], f64)> {
    let edges = mesh.edges();
    let normals = unit_normals(mesh, &edges);
    let mut sums = vec![[Vector3::zeros(); 2]; edges.vertices.len()];
    let mut seen = vec![0u8; edges.vertices.len()];
    for (face, normal) in normals.iter().enumerate().until_stopped() {
        for corner in mesh.faces().first_corner(face)..mesh.faces().first_corner(face + 1) {
            let edge = edges.of_corner[corner] as usize;
            if let Some(side) = sums[edge].get_mut(usize::from(seen[edge])) {
                *side = *normal;
                seen[edge] += 1;
            }
        }
    }
    let inner = (0..sums.len()).into_par_iter().filter(|&edge| edges.faces[edge] == 2);
    fn angle([a, b]: [Vector3<f64>; 2]) -> f64 {
        libm::atan2(a.cross(&b).norm(), a.dot(&b))
    }
    inner.map(|edge| (edges.vertices[edge], angle(sums[edge]))).collect()
}

/// Returns the mesh with additional creases. If an edge is a crease already, `choose` combines the old and the new sharpness.
pub(super) fn merge_creases(
    mesh: &Mesh,
    more: impl Iterator<Item = ([u32; 2], f64)>,
    choose: fn(f64, f64) -> f64,
) -> Mesh {
    let more = more.map(|([a, b], sharpness)| ([a.min(b), a.max(b)], sharpness));
    let mut creases: Vec<([u32; 2], f64)> = mesh.creases().chain(more).collect();
    let stop = StopFlag::current();
    creases.sort_by_key(|(ends, _)| {
        stop.check();
        *ends
    });
    let same = creases.chunk_by(|a, b| a.0 == b.0);
    let chosen = same.map(|same| {
        let sharpness = same.iter().map(|crease| crease.1).reduce(choose).unwrap_or_default();
        (same[0].0, sharpness)
    });
    let sharp: Vec<_> = chosen.filter(|(_, sharpness)| *sharpness > 0.0).collect();
    mesh.clone().with_creases(sharp).expect("edges end at vertices of the mesh")
}
