//! How the faces of a manifold mesh hang together.
//!
//! Notation: the *half-edge* `h` runs from corner `h` of a mesh to the next corner of the same face; its *twin* runs the other
//! way along the same edge, in the neighboring face. The *owner* of an edge is the first of its half-edges. A *ring* is what lies
//! around a vertex, counter-clockwise.

use std::iter;
use std::ops::Range;

use maquette_value::Faces;

use super::turns::Turns;

/// In place of a half-edge that does not exist.
pub(crate) const NONE: u32 = u32::MAX;

/// A mesh whose edges have at most two faces, and whose vertices have their faces in one fan.
pub(crate) trait HalfEdges: Sync {
    /// Number of vertices.
    fn vertices(&self) -> usize;

    fn faces(&self) -> &Faces;

    fn turns(&self) -> &Turns;

    /// The half-edge that runs the other way, or [`NONE`].
    fn twin(&self, half: u32) -> u32;

    /// The edge of a half-edge. Edges have numbers that ascend with their owners.
    fn edge_of(&self, half: u32) -> u32;

    /// The owner of an edge, and its twin or [`NONE`].
    fn halves(&self, edge: u32) -> [u32; 2];

    /// The vertices at the half-edges' starts.
    fn corners(&self) -> &[u32] {
        self.faces().corners()
    }

    fn next(&self, half: u32) -> u32 {
        self.turns().next(half)
    }

    fn previous(&self, half: u32) -> u32 {
        self.turns().previous(half)
    }

    /// The face of a half-edge.
    fn face_of(&self, half: u32) -> u32 {
        self.turns().face(half)
    }

    /// The half-edges of a face.
    fn halves_around(&self, face: u32) -> Range<u32> {
        let first = self.faces().first_corner(face as usize) as u32;
        first..self.faces().first_corner(face as usize + 1) as u32
    }

    /// Whether the edge has only one face.
    fn is_boundary(&self, edge: u32) -> bool {
        self.halves(edge)[1] == NONE
    }

    /// The ends of an edge; the first one is where its owner starts.
    fn ends(&self, edge: u32) -> [u32; 2] {
        let [owner, _] = self.halves(edge);
        [owner, self.next(owner)].map(|half| self.corners()[half as usize])
    }

    /// The one or two half-edges of an edge.
    fn halves_of(&self, edge: u32) -> impl Iterator<Item = u32> {
        self.halves(edge).into_iter().filter(|&half| half != NONE)
    }

    /// The clockwise-most half-edge from the vertex from which `half` runs, or `half` itself at a vertex without a boundary.
    fn first(&self, half: u32) -> u32 {
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

    /// The half-edges from the vertex from which `start` runs, counter-clockwise, to a boundary or all around.
    fn fan(&self, start: u32) -> impl Iterator<Item = u32> {
        iter::successors((start != NONE).then_some(start), move |&half| {
            let after = self.twin(self.previous(half));
            (after != NONE && after != start).then_some(after)
        })
    }

    /// Fills `ring` with what lies around the vertex from which `start` runs, at a boundary the clockwise-most half-edge.
    fn ring(&self, start: u32, ring: &mut Ring) {
        ring.halves.clear();
        ring.halves.extend(self.fan(start));
        let corner = |&half: &u32| self.corners()[half as usize];
        ring.neighbors.clear();
        ring.neighbors.extend(ring.halves.iter().map(|&half| corner(&self.next(half))));
        ring.edges.clear();
        ring.edges.extend(ring.halves.iter().map(|&half| self.edge_of(half)));
        let end = ring.halves.last().map(|&last| self.previous(last));
        ring.closed = end.is_some_and(|end| self.twin(end) != NONE);
        if let Some(end) = end.filter(|_| !ring.closed) {
            ring.neighbors.push(corner(&end));
            ring.edges.push(self.edge_of(end));
        }
    }
}

/// What lies around a vertex, counter-clockwise; at a boundary from one boundary edge to the other.
#[derive(Default)]
pub(crate) struct Ring {
    /// The half-edges from the vertex; at a boundary the last edge has none.
    pub(crate) halves: Vec<u32>,
    /// The other ends of the vertex's edges.
    pub(crate) neighbors: Vec<u32>,
    /// The edges, in the same order.
    pub(crate) edges: Vec<u32>,
    /// Whether a face lies between the last edge and the first one.
    pub(crate) closed: bool,
}

impl Ring {
    /// Number of faces around the vertex.
    pub(crate) fn n_faces(&self) -> usize {
        self.halves.len()
    }
}
