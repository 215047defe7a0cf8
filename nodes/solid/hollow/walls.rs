//! Walls that are nowhere thinner than asked.

use maquette_base::topology::union_find::UnionFind;
use maquette_node::{Cancelled, Progress};
use maquette_value::TriangleTree;
use nalgebra::{Point3, Vector3, center};

use crate::contour::Contour;

/// After so many rounds walls are as thick as they become on their grid.
const ROUNDS: usize = 8;

/// Walls may be thinner than asked by this share.
const CLOSE: f64 = 1e-3;

/// How far a vertex goes at most towards the end of its edge of the grid, where others may go, too: faces keep a size.
const FARTHEST: f64 = 0.9;

/// So many places are measured between two looks at whether to stop: some milliseconds.
const CHUNK: usize = 4096;

/// Moves vertices of a cavity deeper where the wall in front of the faces around is thinner than `thickness`, along their edges of the grid, so that faces
/// nowhere cross: distances are known at the nodes of the grid only, and where the skin has an inner edge, the cavity around it is made of flat faces.
pub(super) fn keep_walls(
    contour: &mut Contour,
    tree: &TriangleTree,
    thickness: f64,
    progress: &Progress<'_>,
) -> Result<(), Cancelled> {
    // Faces whose walls were measured, and are right until a corner moves.
    let mut open = Vec::from_iter(0..contour.triangles.len());
    let starts = contour.points.clone();
    // How far each has gone of the way to the end of its edge.
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

/// Places on a triangle at which the wall is measured.
const PROBES: usize = 7;

fn probes([a, b, c]: [Point3<f64>; 3]) -> [Point3<f64>; PROBES] {
    let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
    [a, b, c, center(&a, &b), center(&b, &c), center(&c, &a), middle]
}

/// Leaves out the skins of a contour that enclose less than `least` mm3.
pub(super) fn leave_out_bubbles(contour: &mut Contour, least: f64) {
    let mut skins = UnionFind::new(contour.points.len());
    for &[a, b, c] in &contour.triangles {
        skins.join(a, b);
        skins.join(a, c);
    }
    let mut volumes = vec![0.0; contour.points.len()];
    for &corners in &contour.triangles {
        let skin = skins.first(corners[0]) as usize;
        let near = contour.points[skin];
        let [a, b, c]: [Vector3<f64>; 3] =
            corners.map(|vertex| contour.points[vertex as usize] - near);
        volumes[skin] += a.dot(&b.cross(&c)) / 6.0;
    }
    contour.triangles.retain(|corners| least <= volumes[skins.first(corners[0]) as usize].abs());
}
