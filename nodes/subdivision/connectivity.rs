//! How the faces of a manifold mesh hang together.
//!
//! Notation: the *half-edge* `h` runs from corner `h` of a mesh to the next corner of the same face; its *twin* runs the other
//! way along the same edge, in the neighboring face. A *ring* is what lies around a vertex, counter-clockwise.

use maquette::value::{Edges, Faces};
use rayon::prelude::*;

use super::SubdivideError;

/// In place of a half-edge that does not exist.
const NONE: u32 = u32::MAX;

/// How many bad edges or vertices an error lists.
const LISTED: usize = 5;

/// The half-edges of a mesh whose edges have at most two faces, and whose vertices have their faces in one fan.
pub(super) struct Connectivity<'a> {
    corners: &'a [u32],
    /// Next and previous half-edge in the face; none if all faces are triangles, where they are computed.
    turns: Option<Vec<[u32; 2]>>,
    edges: Edges,
    twins: Vec<u32>,
    /// A half-edge of each edge.
    halves: Vec<u32>,
    /// A half-edge from each vertex; at a boundary the clockwise-most one.
    starts: Vec<u32>,
}

/// What lies around a vertex, counter-clockwise; at a boundary from one boundary edge to the other.
#[derive(Default)]
pub(super) struct Ring {
    /// The other ends of the vertex's edges.
    pub(super) neighbors: Vec<u32>,
    /// The edges, in the same order.
    pub(super) edges: Vec<u32>,
    /// Whether a face lies between the last edge and the first one.
    pub(super) closed: bool,
}

impl Ring {
    /// Number of faces around the vertex.
    pub(super) fn n_faces(&self) -> usize {
        self.edges.len() - usize::from(!self.closed && !self.edges.is_empty())
    }
}

impl<'a> Connectivity<'a> {
    /// The half-edges of `faces`, which name vertices below `vertices`.
    ///
    /// # Errors
    /// If the mesh is not manifold, or neighboring faces disagree about their sides.
    pub(super) fn new(faces: &'a Faces, vertices: usize) -> Result<Self, SubdivideError> {
        let corners: &[u32] = faces.corners();
        let edges = faces.edges();
        let mut twins = vec![NONE; corners.len()];
        let mut halves = vec![NONE; edges.vertices.len()];
        for (half, &edge) in (0u32..).zip(&edges.of_corner) {
            let first = halves[edge as usize];
            if first == NONE {
                halves[edge as usize] = half;
            } else {
                twins[first as usize] = half;
                twins[half as usize] = first;
            }
        }
        check_edges(&edges, corners, &twins, &halves)?;
        let mut starts = vec![NONE; vertices];
        for ((half, &vertex), &twin) in (0u32..).zip(corners).zip(&twins) {
            let start = &mut starts[vertex as usize];
            if twin == NONE || *start == NONE {
                *start = half;
            }
        }
        let turns = (faces.sides() != Some(3)).then(|| turns(faces));
        let connectivity = Self { corners, turns, edges, twins, halves, starts };
        connectivity.check_vertices()?;
        Ok(connectivity)
    }

    /// The edges.
    pub(super) fn edges(&self) -> &Edges {
        &self.edges
    }

    /// Whether the edge has only one face.
    pub(super) fn is_boundary(&self, edge: u32) -> bool {
        self.edges.faces[edge as usize] == 1
    }

    /// The vertices that complete an edge of triangles to its one or two faces.
    pub(super) fn opposite(&self, edge: u32) -> impl Iterator<Item = u32> {
        let half = self.halves[edge as usize];
        let halves = [Some(half), self.twin(half)];
        halves.into_iter().flatten().map(|half| self.corners[self.previous(half) as usize])
    }

    /// Fills `ring` with what lies around a vertex; empty for a vertex of no face.
    pub(super) fn ring(&self, vertex: usize, ring: &mut Ring) {
        ring.neighbors.clear();
        ring.edges.clear();
        ring.closed = false;
        let start = self.starts[vertex];
        let mut half = start;
        while half != NONE {
            ring.neighbors.push(self.corners[self.next(half) as usize]);
            ring.edges.push(self.edges.of_corner[half as usize]);
            let previous = self.previous(half);
            match self.twin(previous) {
                None => {
                    ring.neighbors.push(self.corners[previous as usize]);
                    ring.edges.push(self.edges.of_corner[previous as usize]);
                    return;
                }
                Some(twin) if twin == start => {
                    ring.closed = true;
                    return;
                }
                Some(twin) => half = twin,
            }
        }
    }

    fn twin(&self, half: u32) -> Option<u32> {
        Some(self.twins[half as usize]).filter(|&twin| twin != NONE)
    }

    fn next(&self, half: u32) -> u32 {
        match &self.turns {
            None if half % 3 == 2 => half - 2,
            None => half + 1,
            Some(turns) => turns[half as usize][0],
        }
    }

    fn previous(&self, half: u32) -> u32 {
        match &self.turns {
            None if half.is_multiple_of(3) => half + 2,
            None => half - 1,
            Some(turns) => turns[half as usize][1],
        }
    }

    /// Compares the faces in the fan around each vertex with the faces that name it.
    fn check_vertices(&self) -> Result<(), SubdivideError> {
        let mut degrees = vec![0u32; self.starts.len()];
        self.corners.iter().for_each(|&vertex| degrees[vertex as usize] += 1);
        let bad: Vec<usize> = (0..self.starts.len())
            .into_par_iter()
            .with_min_len(4096)
            .filter(|&vertex| self.n_fan(self.starts[vertex]) != degrees[vertex])
            .collect();
        if bad.is_empty() {
            return Ok(());
        }
        let first = bad.iter().take(LISTED).map(ToString::to_string).collect::<Vec<_>>();
        let first = format!("vertices {}", first.join(", "));
        Err(SubdivideError::NonManifold { edges: 0, vertices: bad.len(), first })
    }

    /// Number of faces in the fan that begins with a half-edge.
    fn n_fan(&self, start: u32) -> u32 {
        let (mut half, mut count) = (start, 0);
        while half != NONE {
            count += 1;
            half = self.twins[self.previous(half) as usize];
            if half == start {
                break;
            }
        }
        count
    }
}

/// Next and previous half-edge of each half-edge, for faces of any number of sides.
fn turns(faces: &Faces) -> Vec<[u32; 2]> {
    let mut turns = Vec::with_capacity(faces.corners().len());
    for face in faces.iter() {
        let first = turns.len() as u32;
        let sides = face.len() as u32;
        turns
            .extend((0..sides).map(|k| [first + (k + 1) % sides, first + (k + sides - 1) % sides]));
    }
    turns
}

/// Finds edges with more than two faces, and those that both faces run through in the same direction.
fn check_edges(
    edges: &Edges,
    corners: &[u32],
    twins: &[u32],
    halves: &[u32],
) -> Result<(), SubdivideError> {
    if edges.misoriented == 0 && edges.faces.iter().all(|&faces| faces <= 2) {
        return Ok(());
    }
    let is_bad = |edge: &usize| {
        let half = halves[*edge] as usize;
        let twin = twins[half];
        edges.faces[*edge] > 2 || (twin != NONE && corners[half] == corners[twin as usize])
    };
    let bad: Vec<usize> = (0..halves.len()).filter(is_bad).collect();
    let ends =
        |&edge: &usize| format!("({}, {})", edges.vertices[edge][0], edges.vertices[edge][1]);
    let first = bad.iter().take(LISTED).map(ends).collect::<Vec<_>>();
    let first = format!("edges {}", first.join(", "));
    Err(SubdivideError::NonManifold { edges: bad.len(), vertices: 0, first })
}
