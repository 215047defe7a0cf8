//! How the faces of a manifold mesh hang together, as lists. Edges are numbered by their owners, which is the order of
//! [`maquette_value::Mesh::edges`].

use maquette_value::parallel::*;
use maquette_value::{Edges, Faces};

use super::half_edges::{HalfEdges, NONE};
use super::turns::Turns;
use crate::SubdivideError;

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
    pub(crate) turns: Turns,
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

    /// How many edges the faces own whose corners are before this one.
    pub(crate) fn edges_before(&self, corner: usize) -> usize {
        self.halves.partition_point(|[owner, _]| (*owner as usize) < corner)
    }

    /// How many faces end before this corner, with which one begins or which is behind all.
    pub(crate) fn faces_before(&self, corner: usize) -> usize {
        match corner < self.corners().len() {
            true => self.face_of(corner as u32) as usize,
            false => self.faces.len(),
        }
    }

    /// How many bytes it holds.
    pub(crate) fn size(&self) -> usize {
        let lists = self.edge_of.len() * 4 + self.halves.len() * 8;
        self.faces.corners().size() + lists + self.turns.size()
    }
}

impl HalfEdges for Connectivity {
    fn vertices(&self) -> usize {
        self.vertices
    }

    fn faces(&self) -> &Faces {
        &self.faces
    }

    fn turns(&self) -> &Turns {
        &self.turns
    }

    fn twin(&self, half: u32) -> u32 {
        let [owner, twin] = self.halves(self.edge_of(half));
        if owner == half { twin } else { owner }
    }

    fn edge_of(&self, half: u32) -> u32 {
        self.edge_of[half as usize]
    }

    fn halves(&self, edge: u32) -> [u32; 2] {
        self.halves[edge as usize]
    }
}

/// Finds edges with more than two faces, and those that both faces run through in the same direction.
fn check_edges(edges: &Edges, mesh: &Connectivity) -> Result<(), SubdivideError> {
    if edges.misoriented == 0 && edges.faces.iter().all(|&faces| faces <= 2) {
        return Ok(());
    }
    fn start(half: u32, mesh: &Connectivity) -> u32 {
        mesh.corners()[half as usize]
    }
    let bad = (0..mesh.halves.len())
        .filter(|edge| {
            let [owner, twin] = mesh.halves[*edge];
            edges.faces[*edge] > 2
                || (edges.faces[*edge] == 2 && start(owner, mesh) == start(twin, mesh))
        })
        .map(|edge| edges.vertices[edge])
        .collect();
    Err(SubdivideError::NonManifold { edges: bad, vertices: Vec::new() })
}
