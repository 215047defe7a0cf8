//! Self-intersections of a mesh.
//!
//! The search uses a tree of boxes, because a sweep along one axis took minutes on a mesh of 350 000 faces. Expectations and nodes call
//! `Mesh::crossings`.

use contacts::{Contact, EdgeWings, crossing_contacts};
use nalgebra::Point3;
use robust::{Coord3D, orient3d};

use super::Mesh;
use crate::parallel::*;
use crate::{Bounds, BoxTree};

mod contacts;

/// Number of triangles per parallel task.
const CHUNK: usize = 1024;

/// Distance up to which a point is in a plane, as a fraction of the diagonal of the mesh's box.
const TOUCH: f64 = 1e-12;

/// The corners of a triangle, as vertices.
type Corners = [u32; 3];

impl Mesh {
    /// The pairs of faces at which the surface passes through itself, in ascending order. Exact predicates decide: Shewchuk, "Adaptive
    /// precision floating-point arithmetic and fast robust geometric predicates" (1997).
    ///
    /// Two faces cross if their interiors do. Two surfaces also cross where an edge of one lies in a face or along an edge of the other,
    /// and the faces at the edge are on different sides of the other surface; or where both share a plane region that the one enters from
    /// one side and leaves to the other. Surfaces that merely touch, in a point, an edge or a plane region, do not count. Points within
    /// 1e-12 of the mesh's diagonal count as touching, so that a motion, whose result is rounded, does not make crossings of contacts.
    ///
    /// Cost grows with n log n. `check` is called from time to time; if it returns an error, the search is canceled.
    ///
    /// # Errors
    /// The error of `check`.
    pub fn crossings<E: Send>(
        &self,
        check: impl Fn() -> Result<(), E> + Sync,
    ) -> Result<Vec<[u32; 2]>, E> {
        let triangles: Vec<(u32, Corners)> = (0..self.faces().len())
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
        let predicates = Predicates::new(self);
        let numbers = Vec::from_iter(0..triangles.len());
        let search_chunk = |chunk: &[usize]| {
            check()?;
            let mut found = Found::default();
            for &index in chunk {
                let (face, corners) = triangles[index];
                boxes.visit_overlapping(&bounds[index], |other| {
                    let (other_face, other_corners) = triangles[other as usize];
                    if other_face <= face {
                        return;
                    }
                    fn contacts(own: [u32; 2], of: u32, other: u32) -> Contact {
                        Contact { edge: own, of, other }
                    }
                    match predicates.meet(corners, other_corners) {
                        Meeting::Apart => {}
                        Meeting::Cross => found.pairs.push([face, other_face]),
                        Meeting::EdgesOfFirst(edges) => found
                            .contacts
                            .extend(edges.into_iter().map(|it| contacts(it, index as u32, other))),
                        Meeting::EdgesOfSecond(edges) => found
                            .contacts
                            .extend(edges.into_iter().map(|it| contacts(it, other, index as u32))),
                        Meeting::Coplanar => {
                            let first =
                                edges_of(corners).map(|it| contacts(it, index as u32, other));
                            let second =
                                edges_of(other_corners).map(|it| contacts(it, other, index as u32));
                            found.contacts.extend(first.into_iter().chain(second));
                        }
                    }
                });
            }
            found.contacts.retain(|contact| {
                let other = triangles[contact.other as usize].1;
                contacts::overlaps(&predicates, contact.edge, other)
            });
            Ok(found)
        };
        let found: Vec<Found> =
            numbers.par_chunks(CHUNK).map(search_chunk).collect::<Result<_, E>>()?;
        let (mut pairs, mut contacts) = (Vec::new(), Vec::new());
        for found in found {
            pairs.extend(found.pairs);
            contacts.extend(found.contacts);
        }
        if !contacts.is_empty() {
            check()?;
            let wings = EdgeWings::new(&triangles, &contacts);
            pairs.extend(crossing_contacts(&predicates, &triangles, &wings, &contacts));
        }
        pairs.sort_unstable();
        pairs.dedup();
        Ok(pairs)
    }
}

/// The results of one parallel task.
#[derive(Default)]
struct Found {
    /// Pairs of faces whose interiors cross.
    pairs: Vec<[u32; 2]>,
    /// Edges that may lie in a face or along an edge of another face.
    contacts: Vec<Contact>,
}

/// The common points of two triangles that do not share an edge.
#[derive(Debug, PartialEq)]
enum Meeting {
    /// None, or a point.
    Apart,
    /// A line through the interiors of both.
    Cross,
    /// Only edges of the first triangle are in the plane of the second.
    EdgesOfFirst(Vec<[u32; 2]>),
    /// Only edges of the second triangle are in the plane of the first.
    EdgesOfSecond(Vec<[u32; 2]>),
    /// Both triangles are in one plane.
    Coplanar,
}

/// Predicates for the vertices of a mesh.
struct Predicates<'a> {
    mesh: &'a Mesh,
    /// Distance in mm up to which a vertex is in a plane.
    tolerance: f64,
    /// A determinant of three edges above this number is that of a vertex farther than the tolerance from the plane.
    clear: f64,
}

impl<'a> Predicates<'a> {
    fn new(mesh: &'a Mesh) -> Self {
        let diagonal = mesh.bounds().map_or(0.0, |(low, high)| (high - low).norm());
        let tolerance = TOUCH * diagonal;
        Self { mesh, tolerance, clear: tolerance * diagonal * diagonal }
    }

    /// Classifies the common points of two triangles. The signs of the sides on which the corners of one are of the other's plane decide
    /// most pairs. For a triangle without area, which has no plane, all signs are 0: it crosses a triangle that one of its edges pierces.
    fn meet(&self, a: Corners, b: Corners) -> Meeting {
        if 2 <= a.iter().filter(|corner| b.contains(corner)).count() {
            return Meeting::Apart;
        }
        let of_a = self.sides(a, b);
        let zeros = of_a.iter().filter(|side| **side == 0.0).count();
        if !straddles(of_a) && zeros < 2 {
            return Meeting::Apart;
        }
        if zeros == 2 {
            return Meeting::EdgesOfFirst(edges_in_plane(a, of_a));
        }
        // Most pairs in one plane are neighbors with a common corner.
        if zeros == 3 && contacts::are_apart(self, a, b) {
            return Meeting::Apart;
        }
        let of_b = self.sides(b, a);
        match (straddles(of_a), straddles(of_b)) {
            (true, true) if self.do_interiors_cross((a, of_a), (b, of_b)) => Meeting::Cross,
            (true, false) if of_b == [0.0; 3] && self.pierces((a, of_a), b) => Meeting::Cross,
            (false, true) if self.pierces((b, of_b), a) => Meeting::Cross,
            (true, false) => match edges_in_plane(b, of_b) {
                edges if edges.len() == 1 => Meeting::EdgesOfSecond(edges),
                _ => Meeting::Apart,
            },
            (false, false) if of_b == [0.0; 3] => Meeting::Coplanar,
            _ => Meeting::Apart,
        }
    }

    /// For each corner of one triangle, the side of the other triangle's plane on which the corner is, as a sign. A shared corner has side
    /// 0.
    fn sides(&self, corners: Corners, plane: Corners) -> [f64; 3] {
        corners.map(|corner| if plane.contains(&corner) { 0.0 } else { self.side(plane, corner) })
    }

    /// Returns true if the interiors of two triangles have a line in common. Each has corners on both sides of the other's plane, as given
    /// by the signs beside the corners.
    ///
    /// Both triangles intersect the common line of their planes in an interval, and two determinants tell whether the intervals overlap:
    /// Guigue and Devillers, "Fast and robust triangle-triangle overlap test using orientation predicates" (2003), section 3.
    fn do_interiors_cross(&self, a: (Corners, [f64; 3]), b: (Corners, [f64; 3])) -> bool {
        let (mut first, is_first_below) = lone_corner_first(a);
        let (mut second, is_second_below) = lone_corner_first(b);
        // Turn each triangle such that the lone corner of the other one is above it.
        if is_first_below {
            second.swap(1, 2);
        }
        if is_second_below {
            first.swap(1, 2);
        }
        let ([p, q, r], [u, v, w]) = (first, second);
        self.turn([p, q], [u, v]) < 0.0 && self.turn([p, r], [w, u]) < 0.0
    }

    /// Returns true if an edge of the triangle `corners` pierces the triangle `[u, v, w]`. For each of the corners, `sides` has the side of
    /// the plane of `[u, v, w]` on which the corner is, as a sign.
    fn pierces(&self, (corners, sides): (Corners, [f64; 3]), [u, v, w]: Corners) -> bool {
        let edges = [[0, 1], [1, 2], [2, 0]].into_iter();
        let mut through = edges
            .filter(|&[p, q]| sides[p] < 0.0 && 0.0 < sides[q] || sides[q] < 0.0 && 0.0 < sides[p]);
        through.any(|ends| {
            let [p, q] = ends.map(|end| corners[end]);
            let around = [[u, v], [v, w], [w, u]].map(|edge| self.turn([p, q], edge));
            around.iter().all(|x| *x > 0.0) || around.iter().all(|x| *x < 0.0)
        })
    }

    /// The side of the plane through three vertices on which a fourth vertex is, as the sign of a determinant. It is negative for a vertex
    /// above the plane, from where the three vertices are counter-clockwise, and 0 for a vertex in the plane.
    fn side(&self, plane: Corners, corner: u32) -> f64 {
        let [a, b, c] = plane.map(|vertex| self.coord(vertex));
        let determinant = orient3d(a, b, c, self.coord(corner));
        if self.clear < determinant.abs() || determinant == 0.0 {
            return determinant;
        }
        let [a, b, c] = plane.map(|vertex| self.mesh.positions()[vertex as usize]);
        let area: f64 = (b - a).cross(&(c - a)).norm();
        if determinant.abs() <= self.tolerance * area { 0.0 } else { determinant }
    }

    /// The direction in which one edge passes another one, as the sign of a determinant. It is 0 for edges whose lines meet.
    fn turn(&self, [p, q]: [u32; 2], [u, v]: [u32; 2]) -> f64 {
        let [a, b, c, d] = [p, q, u, v].map(|vertex| self.coord(vertex));
        let determinant = orient3d(a, b, c, d);
        if self.clear < determinant.abs() || determinant == 0.0 {
            return determinant;
        }
        let [p, q, u, v] = [p, q, u, v].map(|vertex| self.mesh.positions()[vertex as usize]);
        let lengths = (q - p).norm() * (v - u).norm();
        if determinant.abs() <= self.tolerance * lengths { 0.0 } else { determinant }
    }

    fn coord(&self, vertex: u32) -> Coord3D<f64> {
        let Point3 { coords } = self.mesh.positions()[vertex as usize];
        Coord3D { x: coords.x, y: coords.y, z: coords.z }
    }
}

fn straddles(sides: [f64; 3]) -> bool {
    sides.iter().any(|side| *side < 0.0) && sides.iter().any(|side| 0.0 < *side)
}

fn edges_of([a, b, c]: Corners) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

/// The edges of a triangle whose two ends have side 0.
fn edges_in_plane(corners: Corners, sides: [f64; 3]) -> Vec<[u32; 2]> {
    let edges = edges_of(corners).into_iter().enumerate();
    edges
        .filter(|&(k, _)| sides[k] == 0.0 && sides[(k + 1) % 3] == 0.0)
        .map(|(_, edge)| edge)
        .collect()
}

/// Rotates a triangle such that its first corner is strictly on one side of a plane, and no other corner is strictly on the same side.
/// Returns true if the sign of that corner is negative.
fn lone_corner_first(([a, b, c], sides): (Corners, [f64; 3])) -> (Corners, bool) {
    let lone = (0..3).find(|&k| {
        let others = [sides[(k + 1) % 3], sides[(k + 2) % 3]];
        match sides[k] < 0.0 {
            true => others.iter().all(|other| 0.0 <= *other),
            false => 0.0 < sides[k] && others.iter().all(|other| *other <= 0.0),
        }
    });
    let lone = lone.expect("a triangle with corners on both sides of a plane has a lone corner");
    ([[a, b, c], [b, c, a], [c, a, b]][lone], sides[lone] < 0.0)
}

#[cfg(test)]
mod tests;
