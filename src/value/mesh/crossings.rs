//! Where a mesh runs through itself.

use nalgebra::Point3;
use robust::{Coord3D, orient3d};

use super::Mesh;
use crate::parallel::*;
use crate::value::{Bounds, BoxTree};

impl Mesh {
    /// Pairs of faces of which an edge of one pierces the other, ascending, decided by exact predicates (Shewchuk, "Adaptive precision
    /// floating-point arithmetic and fast robust geometric predicates", 1997). Faces that merely touch, or lie in one plane, do not count. Cost
    /// grows with n log n; `check` is asked from time to time whether to go on.
    ///
    /// # Errors
    /// That of `check`.
    pub fn crossings<E: Send>(
        &self,
        check: impl Fn() -> Result<(), E> + Sync,
    ) -> Result<Vec<[u32; 2]>, E> {
        let faces = (0..).zip(self.faces().iter());
        let triangles = faces.flat_map(|(number, face)| {
            face[1..].windows(2).map(move |pair| (number, [face[0], pair[0], pair[1]]))
        });
        let triangles: Vec<(u32, [u32; 3])> = triangles.collect();
        let corners =
            |(_, triangle): &(u32, [u32; 3])| triangle.map(|it| self.positions()[it as usize]);
        let bounds = Vec::from_iter(triangles.iter().map(|it| Bounds::around(&corners(it))));
        let boxes = BoxTree::new(bounds.iter().copied());
        const CHUNK: usize = 1024;
        let numbers = Vec::from_iter(0..triangles.len());
        let of_chunk = |chunk: &[usize]| {
            check()?;
            let mut pairs = Vec::new();
            for &index in chunk {
                let own = &triangles[index];
                boxes.near(&bounds[index], |other| {
                    let other = &triangles[other as usize];
                    if own.0 < other.0 && cross(self, own.1, other.1) {
                        pairs.push([own.0, other.0]);
                    }
                });
            }
            Ok(pairs)
        };
        let found: Vec<Vec<[u32; 2]>> =
            numbers.par_chunks(CHUNK).map(of_chunk).collect::<Result<_, E>>()?;
        let mut pairs = found.concat();
        pairs.sort_unstable();
        pairs.dedup();
        Ok(pairs)
    }
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

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;
    use crate::value::Faces;

    fn crossings(positions: Vec<Point3<f64>>, faces: &[[u32; 3]]) -> Vec<[u32; 2]> {
        let mesh = Mesh::new(positions, Faces::triangles(faces.to_vec())).unwrap();
        mesh.crossings(|| Ok::<_, Infallible>(())).unwrap()
    }

    #[test]
    fn two_crossing_triangles_are_named_and_neighbors_are_not() {
        let at = |x: f64, y: f64, z: f64| Point3::new(x, y, z);
        let flat = [at(0., 0., 0.), at(4., 0., 0.), at(0., 4., 0.), at(4., 4., 0.)];
        let spike = [at(1., 1., -1.), at(1., 1.2, 1.), at(1.3, 1., 1.)];
        let faces = [[0, 1, 2], [1, 3, 2], [4, 5, 6]];
        let all = |height: f64| {
            let moved = spike.map(|p| p + nalgebra::Vector3::z() * height);
            Vec::from_iter(flat.into_iter().chain(moved))
        };
        assert_eq!(crossings(all(0.0), &faces), [[0, 2]]);
        assert!(crossings(all(2.0), &faces).is_empty());
        // It touches with its tip.
        assert!(crossings(all(1.0), &faces).is_empty());
    }

    #[test]
    fn faces_with_a_vertex_in_common_may_cross() {
        let at = |x: f64, y: f64, z: f64| Point3::new(x, y, z);
        let places =
            vec![at(0., 0., 0.), at(4., 0., 0.), at(0., 4., 0.), at(2., 1., -1.), at(1., 2., 1.)];
        assert_eq!(crossings(places, &[[0, 1, 2], [0, 3, 4]]), [[0, 1]]);
    }
}
