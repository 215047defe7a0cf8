//! The connectivity of a manifold mesh, stored as lists. Edges are numbered by their owners, the first of their half-edges, as in
//! [`maquette_value::Mesh::edges`].

use maquette_node::Error;
use maquette_value::parallel::*;
use maquette_value::{Edges, Faces};

use super::face_order::FaceOrder;
use super::half_edges::{HalfEdges, NONE};

/// The half-edges of a manifold mesh: each edge has at most two faces, and each vertex one fan of faces.
#[derive(Debug)]
pub(crate) struct Connectivity {
    pub(crate) faces: Faces,
    /// The number of vertices of the mesh, including those without faces.
    pub(crate) vertices: usize,
    /// The index of the edge to which each half-edge belongs.
    pub(crate) edge_of: Vec<u32>,
    /// For each edge its owner (the first of its half-edges) and the owner's twin, or [`NONE`]. Owners ascend.
    pub(crate) halves: Vec<[u32; 2]>,
    pub(crate) turns: FaceOrder,
}

impl Connectivity {
    /// Computes the half-edges of `faces`, whose vertex indices are less than `vertices`. Also returns for each vertex a half-edge that
    /// starts there: at a boundary the clockwise-most one, and [`NONE`] for a vertex without faces.
    ///
    /// # Errors
    /// If the mesh is not manifold, or neighboring faces have opposite orientations.
    pub(crate) fn new(faces: &Faces, vertices: usize) -> Result<(Self, Vec<u32>), Error> {
        let edges = faces.edges();
        let mesh = Self::pair_half_edges(faces, vertices, &edges);
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

    /// Computes the half-edges without checking that the mesh is manifold. Each edge must have at most two faces.
    pub(crate) fn new_unchecked(faces: &Faces, vertices: usize) -> Self {
        Self::pair_half_edges(faces, vertices, &faces.edges())
    }

    fn pair_half_edges(faces: &Faces, vertices: usize, edges: &Edges) -> Self {
        let mut halves = vec![[NONE; 2]; edges.vertices.len()];
        for (half, &edge) in (0u32..).zip(&edges.of_corner) {
            let [owner, twin] = &mut halves[edge as usize];
            *if *owner == NONE { owner } else { twin } = half;
        }
        let (faces, edge_of) = (faces.clone(), edges.of_corner.clone());
        Self::from_parts(faces, vertices, edge_of, halves)
    }

    /// Creates the connectivity from its lists. The mesh must be manifold.
    pub(crate) fn from_parts(
        faces: Faces,
        vertices: usize,
        edge_of: Vec<u32>,
        halves: Vec<[u32; 2]>,
    ) -> Self {
        let turns = FaceOrder::new(&faces);
        Self { faces, vertices, edge_of, halves, turns }
    }

    /// Checks that the faces of each vertex form one fan. `starts` has a half-edge from each vertex.
    fn check_vertices(&self, starts: &[u32]) -> Result<(), Error> {
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
        if vertices.is_empty() {
            return Ok(());
        }
        Err(non_manifold(
            "vertices join fans of faces",
            vertices.iter().map(u32::to_string),
            "use `Remesh`, which separates them",
        ))
    }

    /// The number of edges whose owner is a half-edge before the one at `corner`.
    pub(crate) fn edges_before(&self, corner: usize) -> usize {
        self.halves.partition_point(|[owner, _]| (*owner as usize) < corner)
    }

    /// The number of faces before `corner`, which must be the first corner of a face or the number of all corners.
    pub(crate) fn faces_before(&self, corner: usize) -> usize {
        match corner < self.corners().len() {
            true => self.face_of(corner as u32) as usize,
            false => self.faces.len(),
        }
    }

    /// Returns the memory that this value uses, in bytes.
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

    fn face_order(&self) -> &FaceOrder {
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

/// Checks that no edge has more than two faces, or two faces that traverse it in the same direction.
fn check_edges(edges: &Edges, mesh: &Connectivity) -> Result<(), Error> {
    if edges.misoriented == 0 && edges.faces.iter().all(|&faces| faces <= 2) {
        return Ok(());
    }
    fn start(half: u32, mesh: &Connectivity) -> u32 {
        mesh.corners()[half as usize]
    }
    let bad: Vec<[u32; 2]> = (0..mesh.halves.len())
        .filter(|edge| {
            let [owner, twin] = mesh.halves[*edge];
            edges.faces[*edge] > 2
                || (edges.faces[*edge] == 2 && start(owner, mesh) == start(twin, mesh))
        })
        .map(|edge| edges.vertices[edge])
        .collect();
    Err(non_manifold(
        "edges have more than two faces or faces that disagree about their side",
        bad.iter().map(|[a, b]| format!("({a}, {b})")),
        "use `Orient` to turn faces, or `Reconstruct` to make one surface",
    ))
}

/// The maximum number of non-manifold edges or vertices that a message lists.
const MAX_LISTED: usize = 5;

/// Returns the error of a mesh that is not manifold. `defects` lists its non-manifold edges or vertices, and `what` says what is wrong with
/// them, and `help` what to do.
fn non_manifold(what: &str, defects: impl ExactSizeIterator<Item = String>, help: &str) -> Error {
    let count = defects.len();
    let mut first: Vec<String> = defects.take(MAX_LISTED).collect();
    if count > MAX_LISTED {
        first.push("...".to_owned());
    }
    Error::new(format!("the mesh is not a surface: {count} {what}: {}; {help}", first.join(", ")))
}
