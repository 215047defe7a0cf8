//! Cuts the faces of two solids along their intersection, and assembles the result.

use std::collections::BTreeSet;

use maquette_base::topology::lists::Lists;
use maquette_value::parallel::UntilStopped;
use maquette_value::{Mesh, MeshError};
use nalgebra::{Point3, center};

use super::assembly::{CornerOrigin, NewFaces, NewVertices, assemble};
use super::intersections::{Meet, Meeting, Pair};
use crate::operation::Operation;
use crate::polygons::{loops, project_to_plane, triangulate};

/// The parts of two solids that a Boolean operation keeps.
///
/// Vertices are numbered in this order: those of both solids, the intersection points, the midpoints of edges.
pub(super) struct Cut<'a> {
    pair: &'a Pair<'a>,
    meet: &'a Meet,
    /// For each vertex, true if the vertex is inside of the solid to which it does not belong.
    inside: &'a [bool],
    how: Operation,
    pub(super) halfway: Vec<[u32; 2]>,
    /// The faces that the result keeps uncut; the flag is true if the face must be reversed.
    whole: Vec<(u32, bool)>,
    /// The remaining parts of cut triangles.
    pub(super) pieces: Vec<Piece>,
}

/// One triangle of the triangulated part of a cut triangle that the result keeps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    pub(super) triangle: u32,
    pub(super) vertices: [u32; 3],
}

impl<'a> Cut<'a> {
    /// Determines the faces, and the parts of cut faces, of both solids that the result keeps.
    pub(super) fn new(
        pair: &'a Pair<'a>,
        meet: &'a Meet,
        inside: &'a [bool],
        how: Operation,
    ) -> Self {
        let segments = Lists::group(pair.triangles.len(), || {
            let numbered = (0u32..).zip(&meet.segments);
            numbered.flat_map(|(number, it)| it.triangles.map(|triangle| (triangle, number)))
        });
        let mut cut = Self {
            pair,
            meet,
            inside,
            how,
            halfway: Vec::new(),
            whole: Vec::new(),
            pieces: Vec::new(),
        };
        for solid in [0, 1] {
            let wants_inside = how.wants_inside(solid);
            let is_turned = how == Operation::Difference && solid == 1;
            let all = pair.triangles_of(solid);
            let mut next = all.start;
            let faces = pair.triangles[all].chunk_by(|a, b| a.face == b.face);
            for own in faces.until_stopped() {
                let triangles = next..next + own.len();
                next = triangles.end;
                if triangles.clone().all(|it| segments.list(it).is_empty()) {
                    if inside[own[0].vertices[0] as usize] == wants_inside {
                        cut.whole.push((own[0].face, is_turned));
                    }
                    continue;
                }
                for triangle in triangles {
                    let lines = segments.list(triangle).iter().map(|&it| {
                        let [start, end] = meet.segments[it as usize].ends;
                        if (solid == 0) == wants_inside { [start, end] } else { [end, start] }
                    });
                    let sides = cut.sides(triangle, lines);
                    cut.add_pieces(triangle, &sides, is_turned);
                }
            }
        }
        cut
    }

    /// Returns the directed border of the part of a triangle that the result keeps; the part is to the left of each side. The sides are
    /// pieces of the triangle's edges, and `lines`, in which triangles of the other solid cross the triangle.
    fn sides(&self, triangle: usize, lines: impl Iterator<Item = [u32; 2]>) -> Vec<[u32; 2]> {
        let mut sides: Vec<_> =
            lines.map(|ends| ends.map(|it| it + self.first_new_vertex())).collect();
        let vertices = self.pair.triangles[triangle].vertices;
        sides.extend(
            (0..3).flat_map(|k| self.remaining_parts([vertices[k], vertices[(k + 1) % 3]])),
        );
        sides
    }

    /// Returns the pieces of an edge that the result keeps.
    fn remaining_parts(&self, edge: [u32; 2]) -> Vec<[u32; 2]> {
        let wants_inside = self.how.wants_inside(self.pair.solid_of(edge[0]));
        let first = usize::from(self.inside[edge[0] as usize] != wants_inside);
        let stops = self.stops(edge);
        stops.windows(2).skip(first).step_by(2).map(|part| [part[0], part[1]]).collect()
    }

    fn add_pieces(&mut self, triangle: usize, sides: &[[u32; 2]], is_turned: bool) {
        let own = self.pair.triangles[triangle].vertices;
        let [a, b, c] = own.map(|vertex| self.position(vertex));
        let normal = (b - a).cross(&(c - a));
        let found = triangulate(&loops(sides), |vertex: u32| {
            project_to_plane(self.position(vertex), normal)
        });
        self.pieces.extend(found.into_iter().map(|[a, b, c]| Piece {
            triangle: triangle as u32,
            vertices: if is_turned { [a, c, b] } else { [a, b, c] },
        }));
    }

    /// Returns the index of the first vertex that belongs to neither solid.
    pub(super) fn first_new_vertex(&self) -> u32 {
        self.pair.mesh.positions().len() as u32
    }

    /// Returns the number of intersection points.
    pub(super) fn meetings(&self) -> usize {
        self.meet.meetings.len()
    }

    /// Returns the solid, 0 or 1, to which a triangle belongs.
    pub(super) fn solid_of(&self, triangle: u32) -> usize {
        self.pair.solid_of(self.pair.triangles[triangle as usize].vertices[0])
    }

    /// Returns the distance in mm below which two points count as one.
    pub(super) fn tolerance(&self) -> f64 {
        self.pair.tolerance
    }

    /// Returns the edges of uncut faces whose ends are both vertices of pieces. The vertices of each edge are in ascending order.
    pub(super) fn edges_of_whole_faces(&self) -> BTreeSet<[u32; 2]> {
        let mut is_near = vec![false; self.first_new_vertex() as usize];
        for vertex in self.pieces.iter().flat_map(|piece| piece.vertices) {
            if let Some(is_near) = is_near.get_mut(vertex as usize) {
                *is_near = true;
            }
        }
        let faces = self.whole.iter().until_stopped();
        let faces = faces.map(|it| self.pair.mesh.faces().face(it.0 as usize));
        let edges = faces.flat_map(|face| face.iter().zip(face[1..].iter().chain(&face[..1])));
        let near = edges.filter(|(a, b)| is_near[**a as usize] && is_near[**b as usize]);
        near.map(|(&a, &b)| [a.min(b), a.max(b)]).collect()
    }

    /// Returns the position of a vertex. An intersection point or a midpoint is interpolated.
    pub(super) fn position(&self, vertex: u32) -> Point3<f64> {
        let positions = self.pair.mesh.positions();
        match self.origin(vertex) {
            Origin::Vertex(vertex) => positions[vertex],
            Origin::Meeting(Meeting { edge, share, .. }) => {
                let [low, high] = edge.map(|it| positions[it as usize]);
                low + (high - low) * *share
            }
            Origin::Halfway(ends) => center(&self.position(ends[0]), &self.position(ends[1])),
        }
    }

    fn origin(&self, vertex: u32) -> Origin<'_> {
        let vertex = vertex as usize;
        let Some(meeting) = vertex.checked_sub(self.first_new_vertex() as usize) else {
            return Origin::Vertex(vertex);
        };
        match self.meet.meetings.get(meeting) {
            Some(meeting) => Origin::Meeting(meeting),
            None => Origin::Halfway(self.halfway[meeting - self.meet.meetings.len()]),
        }
    }

    /// Appends to `shares` the vertices of the solids from which `vertex` is interpolated, with their weights. The sum of the weights is
    /// `whole`.
    fn shares(&self, vertex: u32, whole: f64, shares: &mut Vec<(u32, f64)>) {
        match self.origin(vertex) {
            Origin::Vertex(_) => shares.push((vertex, whole)),
            Origin::Meeting(Meeting { edge: [low, high], share, .. }) => {
                shares.extend([(*low, whole * (1.0 - share)), (*high, whole * share)]);
            }
            Origin::Halfway(ends) => {
                ends.into_iter().for_each(|end| self.shares(end, whole / 2.0, shares));
            }
        }
    }

    /// Returns the vertices along an edge: its start, its intersection points in the order in which the edge passes them, and its end.
    fn stops(&self, [from, to]: [u32; 2]) -> Vec<u32> {
        let mut stops = vec![from];
        stops.extend(
            self.meet.meetings_of_edge([from, to]).iter().map(|it| it + self.first_new_vertex()),
        );
        if to < from {
            stops[1..].reverse();
        }
        stops.push(to);
        stops
    }

    /// Builds the mesh of all parts that the result keeps.
    pub(super) fn mesh(&self) -> Result<Mesh, MeshError> {
        let of = self.pair.mesh;
        let mut made = NewFaces::default();
        for &(face, is_turned) in self.whole.iter().until_stopped() {
            let vertices = of.faces().face(face as usize);
            let numbers = of.faces().first_corner(face as usize) as u32..;
            let first = made.corners.len();
            made.corners.extend(
                vertices
                    .iter()
                    .zip(numbers)
                    .map(|(&it, corner)| (it, CornerOrigin::Corner(corner))),
            );
            if is_turned {
                made.corners[first + 1..].reverse();
            }
            made.sides.push(vertices.len());
            made.faces.push(face);
        }
        for piece in &self.pieces {
            let own = &self.pair.triangles[piece.triangle as usize];
            made.corners.extend(piece.vertices.map(|vertex| {
                let corner = own.vertices.iter().position(|it| *it == vertex);
                let interpolated = CornerOrigin::Triangle(piece.triangle);
                (vertex, corner.map_or(interpolated, |k| CornerOrigin::Corner(own.corners[k])))
            }));
            made.sides.push(3);
            made.faces.push(own.face);
        }
        assemble(of, &self.pair.triangles, self, made)
    }
}

impl NewVertices for Cut<'_> {
    fn count(&self) -> usize {
        self.first_new_vertex() as usize + self.meetings() + self.halfway.len()
    }

    fn position(&self, vertex: u32) -> Point3<f64> {
        self.position(vertex)
    }

    fn add_shares(&self, vertex: u32, shares: &mut Vec<(u32, f64)>) {
        self.shares(vertex, 1.0, shares);
    }

    /// Returns the creases of both solids whose edges remain in the result.
    fn creases(&self, places: &[u32]) -> Vec<([u32; 2], f64)> {
        let parts = self.pair.mesh.creases().flat_map(|(edge, sharpness)| {
            self.remaining_parts(edge).into_iter().map(move |ends| (ends, sharpness))
        });
        let placed = parts.map(|(ends, it)| (ends.map(|vertex| places[vertex as usize]), it));
        placed.filter(|(ends, _)| !ends.contains(&u32::MAX)).collect()
    }
}

/// The origin of a vertex: a solid, an intersection, or the middle of two other vertices.
enum Origin<'a> {
    Vertex(usize),
    Meeting(&'a Meeting),
    Halfway([u32; 2]),
}
