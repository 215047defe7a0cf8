//! Where a mesh runs through itself.

use maquette::parallel::*;
use maquette::value::Mesh;
use maquette::{Cancelled, Progress};
use nalgebra::Point3;
use robust::{Coord3D, orient3d};

use crate::boxes::{Bounds, Boxes};

/// Pairs of faces of which an edge of one pierces the other, ascending, decided by exact predicates (Shewchuk, "Adaptive precision
/// floating-point arithmetic and fast robust geometric predicates", 1997). Faces that merely touch, or lie in one plane, do not count.
pub(crate) fn crossings(mesh: &Mesh, progress: &Progress<'_>) -> Result<Vec<[u32; 2]>, Cancelled> {
    let faces = (0..).zip(mesh.faces().iter());
    let triangles = faces.flat_map(|(number, face)| {
        face[1..].windows(2).map(move |pair| (number, [face[0], pair[0], pair[1]]))
    });
    let triangles: Vec<(u32, [u32; 3])> = triangles.collect();
    let corners =
        |(_, triangle): &(u32, [u32; 3])| triangle.map(|it| mesh.positions()[it as usize]);
    let bounds = Vec::from_iter(triangles.iter().map(|it| Bounds::around(&corners(it))));
    let boxes = Boxes::new(bounds.iter().copied());
    const CHUNK: usize = 1024;
    let numbers = Vec::from_iter(0..triangles.len());
    let of_chunk = |chunk: &[usize]| {
        progress.check()?;
        let mut pairs = Vec::new();
        for &index in chunk {
            let own = &triangles[index];
            boxes.near(&bounds[index], |other| {
                let other = &triangles[other as usize];
                if own.0 < other.0 && cross(mesh, own.1, other.1) {
                    pairs.push([own.0, other.0]);
                }
            });
        }
        Ok(pairs)
    };
    let found: Vec<Vec<[u32; 2]>> =
        numbers.par_chunks(CHUNK).map(of_chunk).collect::<Result<_, Cancelled>>()?;
    let mut pairs = found.concat();
    pairs.sort_unstable();
    pairs.dedup();
    Ok(pairs)
}

/// Whether an edge of one triangle pierces the other one. One with a corner in common begins on the other and pierces nothing.
fn cross(mesh: &Mesh, a: [u32; 3], b: [u32; 3]) -> bool {
    let pierces = |a: [u32; 3], b: [u32; 3]| {
        (0..3).any(|k| {
            let ends = [a[k], a[(k + 1) % 3]];
            !ends.iter().any(|end| b.contains(end)) && {
                let [p, q] = ends.map(|it| mesh.positions()[it as usize]);
                pierces(p, q, b.map(|it| mesh.positions()[it as usize]))
            }
        })
    };
    pierces(a, b) || pierces(b, a)
}

fn pierces(p: Point3<f64>, q: Point3<f64>, [u, v, w]: [Point3<f64>; 3]) -> bool {
    let coord = |it: Point3<f64>| Coord3D { x: it.x, y: it.y, z: it.z };
    let side = |a, b, c, d| orient3d(coord(a), coord(b), coord(c), coord(d));
    let sides = [side(u, v, w, p), side(u, v, w, q)];
    if !(sides[0] < 0.0 && 0.0 < sides[1] || sides[1] < 0.0 && 0.0 < sides[0]) {
        return false;
    }
    let around = [side(p, q, u, v), side(p, q, v, w), side(p, q, w, u)];
    around.iter().all(|x| *x > 0.0) || around.iter().all(|x| *x < 0.0)
}
