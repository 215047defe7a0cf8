//! How the faces of a manifold mesh hang together, and how those of its refinement do.
//!
//! Notation: the *half-edge* `h` runs from corner `h` of a mesh to the next corner of the same face; its *twin* runs the other
//! way along the same edge, in the neighboring face. The *owner* of an edge is the first of its half-edges; edges are numbered
//! by their owners, which is the order of [`maquette::value::Mesh::edges`]. A *ring* is what lies around a vertex,
//! counter-clockwise.

use std::iter;
use std::ops::Range;

use maquette::memory::huge_vec;
use maquette::parallel::*;
use maquette::value::{Edges, Faces};

use crate::SubdivideError;

/// Elements that one task looks at: enough to outweigh the cost of giving it to a thread, some 10 us.
pub(crate) const BLOCK: usize = 4096;

/// In place of a half-edge that does not exist.
pub(crate) const NONE: u32 = u32::MAX;

/// The half-edges of a mesh whose edges have at most two faces, and whose vertices have their faces in one fan.
#[derive(Debug)]
pub(crate) struct Connectivity {
    pub(crate) faces: Faces,
    /// Number of vertices.
    pub(crate) vertices: usize,
    /// The edge of each half-edge.
    pub(crate) edge_of: Vec<u32>,
    /// The owner of each edge, and its twin or [`NONE`]. Owners ascend.
    pub(crate) halves: Vec<[u32; 2]>,
    turns: Turns,
}

/// Where a half-edge's neighbors are in its face.
#[derive(Debug)]
enum Turns {
    Triangles,
    Quads,
    /// Faces of any number of sides: the face of each half-edge, and the first half-edge of each face and behind the last.
    Polygons(Vec<u32>, Vec<u32>),
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

impl Connectivity {
    /// The half-edges of `faces`, which name vertices below `vertices`, and a half-edge from each vertex: at a boundary the
    /// clockwise-most one, and [`NONE`] for a vertex of no face.
    ///
    /// # Errors
    /// If the mesh is not manifold, or neighboring faces disagree about their sides.
    pub(crate) fn new(faces: &Faces, vertices: usize) -> Result<(Self, Vec<u32>), SubdivideError> {
        let edges = faces.edges();
        let mesh = Self::paired(faces, vertices, &edges);
        check_edges(&edges, &mesh)?;
        let mut starts = vec![NONE; vertices];
        for (half, &vertex) in (0u32..).zip(mesh.corners()) {
            let start = &mut starts[vertex as usize];
            if *start == NONE || mesh.twin(half) == NONE {
                *start = half;
            }
        }
        mesh.check_vertices(&starts)?;
        Ok((mesh, starts))
    }

    /// The half-edges of faces whose edges are known to have two faces at most.
    pub(crate) fn unchecked(faces: &Faces, vertices: usize) -> Self {
        Self::paired(faces, vertices, &faces.edges())
    }

    fn paired(faces: &Faces, vertices: usize, edges: &Edges) -> Self {
        let mut halves = vec![[NONE; 2]; edges.vertices.len()];
        for (half, &edge) in (0u32..).zip(&edges.of_corner) {
            let [owner, twin] = &mut halves[edge as usize];
            *if *owner == NONE { owner } else { twin } = half;
        }
        let (faces, edge_of) = (faces.clone(), edges.of_corner.clone());
        Self::from_parts(faces, vertices, edge_of, halves)
    }

    /// The half-edges of faces that are known to be manifold, from their parts.
    pub(crate) fn from_parts(
        faces: Faces,
        vertices: usize,
        edge_of: Vec<u32>,
        halves: Vec<[u32; 2]>,
    ) -> Self {
        let turns = Turns::of(&faces);
        Self { faces, vertices, edge_of, halves, turns }
    }

    /// The vertices at the half-edges' starts.
    pub(crate) fn corners(&self) -> &[u32] {
        self.faces.corners()
    }

    /// Whether the edge has only one face.
    pub(crate) fn is_boundary(&self, edge: u32) -> bool {
        self.halves[edge as usize][1] == NONE
    }

    /// The ends of an edge; the first one is where its owner starts.
    pub(crate) fn ends(&self, edge: u32) -> [u32; 2] {
        let owner = self.halves[edge as usize][0];
        [owner, self.next(owner)].map(|half| self.corners()[half as usize])
    }

    /// The one or two half-edges of an edge.
    pub(crate) fn halves_of(&self, edge: u32) -> impl Iterator<Item = u32> {
        self.halves[edge as usize].into_iter().filter(|&half| half != NONE)
    }

    /// The half-edges of a face.
    pub(crate) fn halves_around(&self, face: u32) -> Range<u32> {
        let first = self.faces.first_corner(face as usize) as u32;
        first..self.faces.first_corner(face as usize + 1) as u32
    }

    /// The half-edge that runs the other way, or [`NONE`].
    pub(crate) fn twin(&self, half: u32) -> u32 {
        let [owner, twin] = self.halves[self.edge_of[half as usize] as usize];
        if owner == half { twin } else { owner }
    }

    pub(crate) fn next(&self, half: u32) -> u32 {
        match &self.turns {
            Turns::Triangles if half % 3 == 2 => half - 2,
            Turns::Triangles => half + 1,
            Turns::Quads => half & !3 | (half + 1) & 3,
            Turns::Polygons(faces, firsts) => {
                let face = faces[half as usize] as usize;
                if half + 1 == firsts[face + 1] { firsts[face] } else { half + 1 }
            }
        }
    }

    pub(crate) fn previous(&self, half: u32) -> u32 {
        match &self.turns {
            Turns::Triangles if half.is_multiple_of(3) => half + 2,
            Turns::Triangles => half - 1,
            Turns::Quads => half & !3 | half.wrapping_sub(1) & 3,
            Turns::Polygons(faces, firsts) => {
                let face = faces[half as usize] as usize;
                if half == firsts[face] { firsts[face + 1] - 1 } else { half - 1 }
            }
        }
    }

    /// The face of a half-edge.
    pub(crate) fn face_of(&self, half: u32) -> u32 {
        match &self.turns {
            Turns::Triangles => half / 3,
            Turns::Quads => half / 4,
            Turns::Polygons(faces, _) => faces[half as usize],
        }
    }

    /// The clockwise-most half-edge from the vertex from which `half` runs, or `half` itself at a vertex without a boundary.
    pub(crate) fn first(&self, half: u32) -> u32 {
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

    /// Fills `ring` with what lies around the vertex from which `start` runs, at a boundary the clockwise-most half-edge.
    pub(crate) fn ring(&self, start: u32, ring: &mut Ring) {
        ring.halves.clear();
        ring.halves.extend(self.fan(start));
        let corner = |&half: &u32| self.corners()[half as usize];
        let edge = |&half: &u32| self.edge_of[half as usize];
        ring.neighbors.clear();
        ring.neighbors.extend(ring.halves.iter().map(|&half| corner(&self.next(half))));
        ring.edges.clear();
        ring.edges.extend(ring.halves.iter().map(edge));
        let end = ring.halves.last().map(|&last| self.previous(last));
        ring.closed = end.is_some_and(|end| self.twin(end) != NONE);
        if let Some(end) = end.filter(|_| !ring.closed) {
            ring.neighbors.push(corner(&end));
            ring.edges.push(edge(&end));
        }
    }

    /// The half-edges from the vertex from which `start` runs, counter-clockwise, to a boundary or all around.
    pub(crate) fn fan(&self, start: u32) -> impl Iterator<Item = u32> {
        let after = move |&half: &u32| {
            let after = self.twin(self.previous(half));
            (after != NONE && after != start).then_some(after)
        };
        iter::successors((start != NONE).then_some(start), after)
    }

    /// Compares the faces in the fan around each vertex with the faces that name it.
    fn check_vertices(&self, starts: &[u32]) -> Result<(), SubdivideError> {
        let mut degrees = vec![0u32; starts.len()];
        self.corners().iter().for_each(|&vertex| degrees[vertex as usize] += 1);
        let vertices: Vec<u32> = (0..starts.len() as u32)
            .into_par_iter()
            .with_min_len(4096)
            .filter(|&vertex| {
                let fan = self.fan(starts[vertex as usize]);
                fan.count() != degrees[vertex as usize] as usize
            })
            .collect();
        match vertices.is_empty() {
            true => Ok(()),
            false => Err(SubdivideError::NonManifold { edges: Vec::new(), vertices }),
        }
    }

    /// How many bytes it holds.
    pub(crate) fn size(&self) -> usize {
        let turns = match &self.turns {
            Turns::Polygons(faces, firsts) => 4 * (faces.len() + firsts.len()),
            _ => 0,
        };
        self.faces.corners().size() + self.edge_of.len() * 4 + self.halves.len() * 8 + turns
    }
}

impl Turns {
    fn of(faces: &Faces) -> Self {
        match faces.sides() {
            Some(3) => Self::Triangles,
            Some(4) => Self::Quads,
            _ => {
                let mut of_halves = huge_vec(faces.corners().len());
                by_faces(faces, 0..faces.len(), &mut of_halves, |here, to| {
                    let of_halves =
                        here.flat_map(|k| iter::repeat_n(k as u32, faces.face(k).len()));
                    to.iter_mut().zip(of_halves).for_each(|(to, face)| *to = face);
                });
                let first = |face: usize| faces.first_corner(face) as u32;
                Self::Polygons(of_halves, Vec::from_iter((0..=faces.len()).map(first)))
            }
        }
    }
}

/// Calls `f` with some of these faces at a time and the items of their corners, on all threads.
pub(crate) fn by_faces<T: Send>(
    faces: &Faces,
    which: Range<usize>,
    mut items: &mut [T],
    f: impl Fn(Range<usize>, &mut [T]) + Sync,
) {
    let blocks = which.clone().step_by(BLOCK).map(|first| {
        let here = first..which.end.min(first + BLOCK);
        let count = faces.first_corner(here.end) - faces.first_corner(first);
        (here, items.split_off_mut(..count).expect("an item for each corner"))
    });
    Vec::from_iter(blocks).into_par_iter().for_each(|(here, items)| f(here, items));
}

/// Finds edges with more than two faces, and those that both faces run through in the same direction.
fn check_edges(edges: &Edges, mesh: &Connectivity) -> Result<(), SubdivideError> {
    if edges.misoriented == 0 && edges.faces.iter().all(|&faces| faces <= 2) {
        return Ok(());
    }
    let start = |half: u32| mesh.corners()[half as usize];
    let is_bad = |edge: &usize| {
        let [owner, twin] = mesh.halves[*edge];
        edges.faces[*edge] > 2 || (edges.faces[*edge] == 2 && start(owner) == start(twin))
    };
    let bad = (0..mesh.halves.len()).filter(is_bad).map(|edge| edges.vertices[edge]).collect();
    Err(SubdivideError::NonManifold { edges: bad, vertices: Vec::new() })
}
