//! Self-intersections of a mesh.
//!
//! The search uses a tree of boxes, because a sweep along one axis took minutes on a mesh of 350 000 faces. Expectations and nodes call
//! `Mesh::crossings`.

use nalgebra::Point3;
use robust::{Coord3D, orient3d};

use super::Mesh;
use crate::parallel::*;
use crate::{Bounds, BoxTree};

impl Mesh {
    /// The pairs of faces where an edge of one face pierces the other, in ascending order. Exact predicates decide: Shewchuk, "Adaptive
    /// precision floating-point arithmetic and fast robust geometric predicates" (1997). Faces that merely touch, or are coplanar, do not
    /// count. Cost grows with n log n. `check` is called from time to time; if it returns an error, the search is canceled.
    ///
    /// # Errors
    /// The error of `check`.
    pub fn crossings<E: Send>(
        &self,
        check: impl Fn() -> Result<(), E> + Sync,
    ) -> Result<Vec<[u32; 2]>, E> {
        let triangles: Vec<(u32, [u32; 3])> = (0..self.faces().len())
            .flat_map(|number: usize| {
                let face = self.faces().face(number);
                let triangles = self.face_triangles(number);
                triangles.map(move |it| (number as u32, it.map(|corner| face[corner as usize])))
            })
            .collect();
        let bounds: Vec<_> = triangles
            .iter()
            .map(|(_, vertices)| {
                Bounds::from_points(&vertices.map(|vertex| self.positions()[vertex as usize]))
            })
            .collect();
        let boxes = BoxTree::new(bounds.iter().copied());
        const CHUNK: usize = 1024;
        let numbers = Vec::from_iter(0..triangles.len());
        let of_chunk = |chunk: &[usize]| {
            check()?;
            let mut pairs = Vec::new();
            for &index in chunk {
                let own = &triangles[index];
                boxes.visit_overlapping(&bounds[index], |other| {
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

/// Returns true if an edge of one triangle pierces the other triangle. An edge that begins at a corner of both triangles only touches the
/// other triangle, so it does not count.
///
/// If two triangles cross, each has corners on both sides of the other's plane. The three signs of these sides decide most pairs. For a
/// triangle without area, which has no plane, all signs are 0.
fn cross(mesh: &Mesh, a: [u32; 3], b: [u32; 3]) -> bool {
    if 2 <= a.iter().filter(|corner| b.contains(corner)).count() {
        return false;
    }
    let of_a = sides(mesh, a, b);
    let may_be_pierced = straddles(of_a) || of_a == [0.0; 3];
    pierces(mesh, (a, of_a), b) || may_be_pierced && pierces(mesh, (b, sides(mesh, b, a)), a)
}

/// For each corner of one triangle, the side of the other triangle's plane on which the corner is, as a sign. A shared corner has side 0.
fn sides(mesh: &Mesh, corners: [u32; 3], plane: [u32; 3]) -> [f64; 3] {
    corners.map(|corner| if plane.contains(&corner) { 0.0 } else { side(mesh, plane, corner) })
}

fn straddles(sides: [f64; 3]) -> bool {
    sides.iter().any(|side| *side < 0.0) && sides.iter().any(|side| 0.0 < *side)
}

/// Returns true if an edge of the triangle `corners` pierces the triangle `[u, v, w]`. For each of the corners, `sides` has the side of the
/// plane of `[u, v, w]` on which the corner is, as a sign.
fn pierces(mesh: &Mesh, (corners, sides): ([u32; 3], [f64; 3]), [u, v, w]: [u32; 3]) -> bool {
    let edges = [[0, 1], [1, 2], [2, 0]].into_iter();
    let mut through = edges
        .filter(|&[p, q]| sides[p] < 0.0 && 0.0 < sides[q] || sides[q] < 0.0 && 0.0 < sides[p]);
    through.any(|ends| {
        let [p, q] = ends.map(|end| corners[end]);
        let around = [[u, v], [v, w], [w, u]].map(|[from, to]| side(mesh, [p, q, from], to));
        around.iter().all(|x| *x > 0.0) || around.iter().all(|x| *x < 0.0)
    })
}

/// The side of the plane through three vertices on which a fourth vertex is, as the sign of a determinant.
fn side(mesh: &Mesh, plane: [u32; 3], corner: u32) -> f64 {
    let [a, b, c] = plane.map(|vertex| coord(mesh, vertex));
    orient3d(a, b, c, coord(mesh, corner))
}

fn coord(mesh: &Mesh, vertex: u32) -> Coord3D<f64> {
    let Point3 { coords } = mesh.positions()[vertex as usize];
    Coord3D { x: coords.x, y: coords.y, z: coords.z }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;
    use crate::Faces;

    fn crossings(positions: Vec<Point3<f64>>, faces: &[[u32; 3]]) -> Vec<[u32; 2]> {
        let mesh = Mesh::new(positions, Faces::triangles(faces.to_vec())).unwrap();
        mesh.crossings(|| Ok::<_, Infallible>(())).unwrap()
    }

    #[test]
    fn crossing_triangles_are_found_and_neighbors_are_not() {
        let flat = [
            Point3::new(0., 0., 0.),
            Point3::new(4., 0., 0.),
            Point3::new(0., 4., 0.),
            Point3::new(4., 4., 0.),
        ];
        let spike = [Point3::new(1., 1., -1.), Point3::new(1., 1.2, 1.), Point3::new(1.3, 1., 1.)];
        let faces = [[0, 1, 2], [1, 3, 2], [4, 5, 6]];
        fn corners_at(
            height: f64,
            spike: [Point3<f64>; 3],
            flat: [Point3<f64>; 4],
        ) -> Vec<Point3<f64>> {
            let moved = spike.map(|p| p + nalgebra::Vector3::z() * height);
            flat.into_iter().chain(moved).collect()
        }
        assert_eq!(crossings(corners_at(0.0, spike, flat), &faces), [[0, 2]]);
        assert!(crossings(corners_at(2.0, spike, flat), &faces).is_empty());
        // The tip of the spike only touches the other triangle.
        assert!(crossings(corners_at(1.0, spike, flat), &faces).is_empty());
    }

    #[test]
    fn faces_with_a_vertex_in_common_may_cross() {
        let positions = vec![
            Point3::new(0., 0., 0.),
            Point3::new(4., 0., 0.),
            Point3::new(0., 4., 0.),
            Point3::new(2., 1., -1.),
            Point3::new(1., 2., 1.),
        ];
        assert_eq!(crossings(positions, &[[0, 1, 2], [0, 3, 4]]), [[0, 1]]);
    }

    /// Reference implementation: returns true if an edge of one triangle pierces the other, without the shortcuts of [`cross`].
    fn meets(mesh: &Mesh, a: [u32; 3], b: [u32; 3]) -> bool {
        fn pierces(a: [u32; 3], b: [u32; 3], mesh: &Mesh) -> bool {
            [[0, 1], [1, 2], [2, 0]].into_iter().any(|ends| {
                let [p, q] = ends.map(|end| a[end]);
                let [u, v, w] = b;
                let ends = side(mesh, b, p) * side(mesh, b, q);
                let around = [[u, v], [v, w], [w, u]].map(|[f, t]| side(mesh, [p, q, f], t));
                let is_inside = around.iter().all(|x| *x > 0.0) || around.iter().all(|x| *x < 0.0);
                !b.contains(&p) && !b.contains(&q) && ends < 0.0 && is_inside
            })
        }
        pierces(a, b, mesh) || pierces(b, a, mesh)
    }

    #[test]
    fn triangles_of_a_lattice_cross_as_their_edges_pierce() {
        // Many of the random triangles are coplanar, touch, or have no area.
        let positions = (0..27).map(|k| [k % 3, k / 3 % 3, k / 9].map(f64::from));
        let positions: Vec<_> = positions.map(Point3::from).collect();
        let mesh = Mesh::new(positions, Faces::triangles(Vec::new())).unwrap();
        let triangles = (0..27 * 27 * 27)
            .step_by(61)
            .map(|k| [k % 27, k / 27 % 27, k / 729])
            .collect::<Vec<_>>();
        let mut found = 0;
        for &a in &triangles {
            for &b in &triangles {
                assert_eq!(cross(&mesh, a, b), meets(&mesh, a, b), "{a:?} {b:?}");
                found += usize::from(meets(&mesh, a, b));
            }
        }
        assert!(1000 < found, "{found}");
    }
}
