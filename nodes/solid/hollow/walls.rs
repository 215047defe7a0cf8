//! Ensures the minimum thickness of the wall between a cavity and the outer surface of a solid.

use maquette_base::topology::union_find::UnionFind;
use maquette_node::{CancelledError, Progress};
use maquette_value::TriangleTree;
use nalgebra::{Point3, Vector3, center};

use crate::contour::Contour;

/// Maximum number of rounds in which vertices move. More rounds do not improve a cavity that was extracted from a grid.
const ROUNDS: usize = 8;

/// Allowed deficit of a wall's thickness, as a fraction of the thickness.
const CLOSE: f64 = 1e-3;

/// Maximum motion of a vertex along its grid edge, as a fraction of the edge. Several vertices may move toward the same grid node. With a
/// limit below 1 the vertices never coincide, so their faces keep an area.
const FARTHEST: f64 = 0.9;

/// Number of points whose distances are measured between two checks for cancellation. Measuring this many points takes some milliseconds.
const CHUNK: usize = 4096;

/// Moves vertices of a cavity deeper into the solid where the wall between the cavity's faces and the outer surface is thinner than
/// `thickness` mm. A vertex moves along its grid edge only, so faces never intersect. Thin walls occur because distances are known at grid
/// nodes only, and because the cavity has flat faces where the surface has a concave edge.
pub(super) fn keep_walls(
    contour: &mut Contour,
    tree: &TriangleTree,
    thickness: f64,
    progress: &Progress<'_>,
) -> Result<(), CancelledError> {
    // The faces at which the thickness of the wall must be measured. A measurement stays valid until a corner of the face moves.
    let mut open = Vec::from_iter(0..contour.triangles.len());
    let starts = contour.points.clone();
    // For each vertex, the distance by which the vertex has moved along its grid edge, as a fraction of the edge.
    let mut gone = vec![0.0; starts.len()];
    for _ in 0..ROUNDS {
        let mut lacks = vec![0.0; contour.points.len()];
        for faces in open.chunks(CHUNK / PROBES) {
            progress.check()?;
            let probes: Vec<_> = faces
                .iter()
                .flat_map(|&face| {
                    probes(contour.triangles[face].map(|vertex| contour.points[vertex as usize]))
                })
                .collect();
            let walls = tree.nearest_to_all(&probes);
            for (&face, walls) in faces.iter().zip(walls.chunks(PROBES)) {
                let least = walls.iter().flatten().map(|wall| wall.distance_sq);
                let lack = thickness - least.fold(f64::INFINITY, f64::min).sqrt();
                for vertex in contour.triangles[face] {
                    lacks[vertex as usize] = lack.max(lacks[vertex as usize]);
                }
            }
        }
        let mut moves = vec![false; lacks.len()];
        for (vertex, &lack) in lacks.iter().enumerate().filter(|it| CLOSE * thickness < *it.1) {
            let (end, depth) = contour.deep_ends[vertex];
            moves[vertex] = gone[vertex] < FARTHEST;
            gone[vertex] = f64::min(gone[vertex] + lack / depth, FARTHEST);
            contour.points[vertex] = starts[vertex] + (end - starts[vertex]) * gone[vertex];
        }
        open = (0..contour.triangles.len())
            .filter(|&face| contour.triangles[face].iter().any(|&vertex| moves[vertex as usize]))
            .collect();
    }
    Ok(())
}

/// Number of points on a triangle at which the wall is measured.
const PROBES: usize = 7;

fn probes([a, b, c]: [Point3<f64>; 3]) -> [Point3<f64>; PROBES] {
    let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
    [a, b, c, center(&a, &b), center(&b, &c), center(&c, &a), middle]
}

/// Removes the connected surfaces of a contour that enclose less than `least` mm^3.
pub(super) fn leave_out_bubbles(contour: &mut Contour, least: f64) {
    let mut skins = UnionFind::new(contour.points.len());
    for &[a, b, c] in &contour.triangles {
        skins.union(a, b);
        skins.union(a, c);
    }
    let mut volumes = vec![0.0; contour.points.len()];
    for &corners in &contour.triangles {
        let skin = skins.find(corners[0]) as usize;
        let near = contour.points[skin];
        let [a, b, c]: [Vector3<f64>; 3] =
            corners.map(|vertex| contour.points[vertex as usize] - near);
        volumes[skin] += a.dot(&b.cross(&c)) / 6.0;
    }
    contour.triangles.retain(|corners| least <= volumes[skins.find(corners[0]) as usize].abs());
}
