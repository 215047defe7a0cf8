//! The connectivity of a manifold mesh, as half-edges.
//!
//! Notation: the *half-edge* `h` starts at corner `h` of a mesh and ends at the next corner of the same face. Its *twin* is the half-edge
//! of the neighboring face that runs along the same edge in the opposite direction. The *owner* of an edge is the first of its half-edges.
//! A *ring* is the neighborhood of a vertex, counter-clockwise.

use std::iter;
use std::ops::Range;

use maquette_value::Faces;

use super::face_order::FaceOrder;

/// Marks a half-edge that does not exist.
pub(crate) const NONE: u32 = u32::MAX;

/// A manifold mesh: its edges have at most two faces, and its vertices one fan of faces.
pub(crate) trait HalfEdges: Sync {
    /// The number of vertices.
    fn vertices(&self) -> usize;

    fn faces(&self) -> &Faces;

    fn face_order(&self) -> &FaceOrder;

    /// Returns the half-edge in the opposite direction along the same edge, or [`NONE`] at a boundary.
    fn twin(&self, half: u32) -> u32;

    /// Returns the edge to which a half-edge belongs. Edges are numbered in the order of their owners.
    fn edge_of(&self, half: u32) -> u32;

    /// Returns the owner of an edge and the owner's twin, or [`NONE`] for the twin at a boundary.
    fn halves(&self, edge: u32) -> [u32; 2];

    /// The vertex at the start of each half-edge.
    fn corners(&self) -> &[u32] {
        self.faces().corners()
    }

    fn next(&self, half: u32) -> u32 {
        self.face_order().next(half)
    }

    fn previous(&self, half: u32) -> u32 {
        self.face_order().previous(half)
    }

    /// Returns the next half-edge counter-clockwise that starts at the same vertex, or [`NONE`] at a boundary.
    fn next_around(&self, half: u32) -> u32 {
        self.twin(self.previous(half))
    }

    /// The face of a half-edge.
    fn face_of(&self, half: u32) -> u32 {
        self.face_order().face(half)
    }

    /// The half-edges of a face.
    fn halves_around(&self, face: u32) -> Range<u32> {
        let first = self.faces().first_corner(face as usize) as u32;
        first..self.faces().first_corner(face as usize + 1) as u32
    }

    /// Returns true if the edge has only one face.
    fn is_boundary(&self, edge: u32) -> bool {
        self.halves(edge)[1] == NONE
    }

    /// Returns the two vertices of an edge, in the direction of its owner.
    fn ends(&self, edge: u32) -> [u32; 2] {
        let [owner, _] = self.halves(edge);
        [owner, self.next(owner)].map(|half| self.corners()[half as usize])
    }

    /// Returns the half-edges of an edge: two, or one at a boundary.
    fn halves_of(&self, edge: u32) -> impl Iterator<Item = u32> {
        self.halves(edge).into_iter().filter(|&half| half != NONE)
    }

    /// Returns the clockwise-most half-edge that starts at the same vertex as `half`. If the vertex is not on a boundary, returns `half`
    /// itself.
    fn clockwise_most(&self, half: u32) -> u32 {
        let mut first = half;
        loop {
            match self.twin(first) {
                NONE => return first,
                twin => first = self.next(twin),
            }
            if first == half {
                return half;
            }
        }
    }

    /// Returns the half-edges that start at the same vertex as `start`, counter-clockwise from `start`, up to a boundary or all around.
    fn fan(&self, start: u32) -> impl Iterator<Item = u32> {
        iter::successors((start != NONE).then_some(start), move |&half| {
            let after = self.twin(self.previous(half));
            (after != NONE && after != start).then_some(after)
        })
    }

    /// Fills `ring` with the neighborhood of the vertex at which `start` starts. At a boundary `start` must be the clockwise-most
    /// half-edge.
    fn ring(&self, start: u32, ring: &mut Ring) {
        ring.halves.clear();
        ring.halves.extend(self.fan(start));
        let corners = self.corners();
        ring.neighbors.clear();
        ring.neighbors.extend(ring.halves.iter().map(|&half| corners[self.next(half) as usize]));
        ring.edges.clear();
        ring.edges.extend(ring.halves.iter().map(|&half| self.edge_of(half)));
        let end = ring.halves.last().map(|&last| self.previous(last));
        ring.closed = end.is_some_and(|end| self.twin(end) != NONE);
        if let Some(end) = end.filter(|_| !ring.closed) {
            ring.neighbors.push(corners[end as usize]);
            ring.edges.push(self.edge_of(end));
        }
    }
}

/// The neighborhood of a vertex, counter-clockwise; for a boundary vertex, from one boundary edge to the other.
#[derive(Default)]
pub(crate) struct Ring {
    /// The half-edges that start at the vertex. On a boundary, the vertex's last edge has no half-edge that starts at the vertex.
    pub(crate) halves: Vec<u32>,
    /// The neighboring vertices: the other ends of the vertex's edges.
    pub(crate) neighbors: Vec<u32>,
    /// The vertex's edges, in the order of `neighbors`.
    pub(crate) edges: Vec<u32>,
    /// True if there is a face between the last edge and the first one.
    pub(crate) closed: bool,
}

impl Ring {
    /// The number of faces around the vertex.
    pub(crate) fn n_faces(&self) -> usize {
        self.halves.len()
    }
}
