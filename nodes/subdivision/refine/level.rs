//! The meshes between the steps of a primal scheme, and the neighborhoods of their regular vertices.
//!
//! Almost all vertices of a refined mesh are *regular*: all their edges are smooth, and they have the regular valence of the scheme. Their
//! masks have fixed weights, and their neighborhoods follow from their origin: the half-edges of a vertex that was created on the edge `e`
//! are computed from the half-edges of `e`; after each later step, the vertex has the first halves of its previous half-edges. So neither
//! weights nor indices are stored for regular vertices. The other vertices are *odd*: the irregular vertices of the first mesh, and the
//! vertices on borders and creases.
//!
//! Vertices are numbered in the order of creation, so the neighborhoods of consecutive vertices are far apart in memory. For cache
//! efficiency a task of `Level::at_regular` first reads the corners and positions of a few faces in order (about 300 KB, which fit into a
//! core's cache), and then computes all vertices that these faces have created in three steps. For 1.5 million quads, this reduces the time
//! for positions from 41 to 28 ms, and for limits with normals from 225 to 150 ms (the fastest of 15 runs each, in turn, two threads). Two
//! variants of the mask function were slower: inlined into the loop it takes a third more time, and if it returns its tangents through
//! memory the loop has to wait for them.

use std::hint::black_box;
use std::iter;
use std::ops::Range;
use std::sync::Arc;

use maquette_node::{Error, bail};
use maquette_value::Faces;
use maquette_value::parallel::*;
use nalgebra::Point3;

use super::connectivity::Connectivity;
use super::half_edges::{HalfEdges, NONE, Ring};
use super::split::{Corners, Split, Triangles, split_halves};
use super::topology::Topology;
use crate::masks::sharpness::Sharpness;
use crate::rules::Rules;
use crate::scheme::PrimalScheme;

/// The number of vertices per parallel task: enough to outweigh the cost of starting a task, about 10 us.
pub(crate) const BLOCK: usize = 4096;

/// The number of refinement steps whose new vertices one task computes. Only one vertex in 64 is older than three steps.
const STEPS_PER_TASK: usize = 3;

/// One of the meshes in a sequence of refinement steps.
#[derive(Debug)]
pub(crate) struct Level {
    pub(crate) rules: Rules<PrimalScheme>,
    /// The mesh before the last refinement step; `None` for the first mesh of the sequence.
    coarser: Option<Arc<Self>>,
    pub(crate) mesh: Connectivity,
    /// The sharp edges with their sharpness, sorted by edge, including border edges, whose sharpness is infinite.
    pub(crate) creases: Vec<(u32, f64)>,
    /// The odd (irregular or sharp) vertices, sorted, each with a half-edge from it for [`HalfEdges::ring`].
    pub(crate) odd: Vec<[u32; 2]>,
    /// Only for the first mesh: the half-edges that start at each regular vertex; [`NONE`] for odd vertices.
    rings: Vec<u32>,
}

impl Level {
    /// Creates the first mesh of a sequence. `scheme` must be the scheme in `topology`.
    ///
    /// # Errors
    /// If the scheme needs triangles and a face is not a triangle, or the mesh is not manifold.
    pub(crate) fn from_topology(topology: &Topology, scheme: PrimalScheme) -> Result<Self, Error> {
        let rules = topology.rules.with_scheme(scheme);
        if rules.scheme.needs_triangles() {
            check_triangles(&topology.faces, "Loop's scheme")?;
        }
        let (mesh, starts) = Connectivity::new(&topology.faces, topology.vertices)?;
        let creases = creases(topology, &mesh);
        let (rings, odd) = match rules.scheme {
            PrimalScheme::Loop => rings(&mesh, &starts, &creases, Triangles),
            PrimalScheme::CatmullClark => rings(&mesh, &starts, &creases, Corners),
        };
        Ok(Self { rules, coarser: None, mesh, creases, odd, rings })
    }

    /// Creates the first mesh of a sequence from a few faces of a larger mesh. All its vertices count as odd. The masks of vertices whose
    /// faces are partly missing are not valid.
    pub(crate) fn piece(
        rules: Rules<PrimalScheme>,
        mesh: Connectivity,
        creases: Vec<(u32, f64)>,
    ) -> Self {
        let mut starts = vec![NONE; mesh.vertices];
        for (half, &vertex) in (0u32..).zip(mesh.corners()) {
            if starts[vertex as usize] == NONE || mesh.twin(half) == NONE {
                starts[vertex as usize] = half;
            }
        }
        let odd = (0..).zip(&starts).map(|(vertex, &start)| [vertex, start]).collect();
        let valence = if rules.scheme.needs_triangles() { 6 } else { 4 };
        let rings = vec![NONE; valence * mesh.vertices];
        Self { rules, coarser: None, mesh, creases, odd, rings }
    }

    /// Creates the mesh that results from refining `coarser`; `faces` are the faces after the step.
    pub(crate) fn from_coarser(coarser: &Arc<Self>, faces: &Faces) -> Self {
        match coarser.rules.scheme {
            PrimalScheme::Loop => Self::split(coarser, faces, Triangles),
            PrimalScheme::CatmullClark => Self::split(coarser, faces, Corners),
        }
    }

    fn split(coarser: &Arc<Self>, faces: &Faces, split: impl Split) -> Self {
        let (mesh, children) = split_halves(&coarser.mesh, faces.clone(), split);
        let sharpness = Sharpness::new(&coarser.mesh, coarser.rules, &coarser.creases);
        let creases = sharpness.refine(|edge| children[edge as usize]);
        let odd = coarser.odd_children(split);
        let (rules, coarser) = (coarser.rules, Some(coarser.clone()));
        Self { rules, coarser, mesh, creases, odd, rings: Vec::new() }
    }

    /// Returns the odd vertices of the refined mesh: the old odd vertices, the new vertices on sharp edges, and the new vertices in faces
    /// whose number of corners is not the regular valence.
    pub(crate) fn odd_children(&self, split: impl Split) -> Vec<[u32; 2]> {
        let mesh = &self.mesh;
        let old = self.odd.iter().map(|&[vertex, start]| {
            [vertex, if start == NONE { NONE } else { split.first_half(start) }]
        });
        let on_edges = self.creases.iter().map(|&(edge, _)| {
            let owner = mesh.halves[edge as usize][0];
            [mesh.vertices as u32 + edge, split.second(mesh, owner)]
        });
        let in_faces = (mesh.vertices + mesh.halves.len()) as u32;
        let has_odd = self.rules.scheme.has_middles() && mesh.faces.sides() != Some(4);
        let faces = 0..if has_odd { mesh.faces.len() as u32 } else { 0 };
        let in_faces = faces
            .filter(|face| mesh.faces.face(*face as usize).len() != 4)
            .map(|face| [in_faces + face, 4 * mesh.faces.first_corner(face as usize) as u32 + 2]);
        old.chain(on_edges).chain(in_faces).collect()
    }

    /// Calls `make` for each regular vertex, with the vertex's index and its half-edges counter-clockwise, and writes the two results of
    /// each call to two lists.
    pub(crate) fn at_regular<A: Send, B: Send, K: Split>(
        &self,
        around: VertexInput<'_>,
        to: PairedSlices<'_, A, B>,
        split: K,
        make: impl Fn(usize, &[u32]) -> (A, B) + Sync,
    ) {
        match &self.coarser {
            Some(coarser) => coarser.at_children(around, to, split, make),
            None => self.at_own(0, to, split, &make),
        }
    }

    /// Performs [`Self::at_regular`] for the mesh after the next step.
    pub(crate) fn at_children<A: Send, B: Send, K: Split>(
        &self,
        around: VertexInput<'_>,
        to: PairedSlices<'_, A, B>,
        split: K,
        make: impl Fn(usize, &[u32]) -> (A, B) + Sync,
    ) {
        self.at_descendants(Some(around), 0, to, split, &make);
    }

    /// Performs [`Self::at_regular`] for the vertices of this mesh, with their half-edges in the mesh that is `age` steps later.
    fn at_own<A: Send, B: Send, K: Split>(
        &self,
        age: usize,
        to: PairedSlices<'_, A, B>,
        split: K,
        make: &(impl Fn(usize, &[u32]) -> (A, B) + Sync),
    ) {
        if let Some(coarser) = &self.coarser {
            return coarser.at_descendants(None, age, to, split, make);
        }
        let blocks = to.0.par_chunks_mut(BLOCK).zip(to.1.par_chunks_mut(BLOCK)).enumerate();
        blocks.for_each(|(block, to)| {
            visit_new_vertices(to, [BLOCK * block, 0, age], split, make, |index, ring| {
                ring.copy_from_slice(&self.rings[K::VALENCE * index..][..K::VALENCE]);
                ring[0] != NONE
            });
        });
    }

    /// Performs [`Self::at_children`] with half-edges in the mesh that is `age` steps later. A neighborhood involves only a few faces of
    /// the last mesh, but vertices are numbered in the order of their creation. So a task first reads the neighborhoods of a few faces in
    /// order. Then it computes all vertices that these faces have created in some steps.
    fn at_descendants<A: Send, B: Send, K: Split>(
        &self,
        around: Option<VertexInput<'_>>,
        age: usize,
        to: PairedSlices<'_, A, B>,
        split: K,
        make: &(impl Fn(usize, &[u32]) -> (A, B) + Sync),
    ) {
        let levels =
            iter::successors(Some(self), |level| level.coarser.as_deref()).take(STEPS_PER_TASK);
        let levels: Vec<_> = levels.collect();
        let faces = &levels[levels.len() - 1].mesh.faces;
        fn corner(face: usize, faces: &Faces) -> usize {
            faces.first_corner(face.min(faces.len()))
        }
        let size = BLOCK >> (2 * levels.len());
        let starts = (0..faces.len()).step_by(size);
        let corners = starts.map(|face| corner(face, faces)..corner(face + size, faces));
        let mut tasks: Vec<_> =
            corners.map(|corners| (corners, Vec::with_capacity(STEPS_PER_TASK))).collect();
        let (mut own, mut older) = (to, age);
        for (level, steps) in levels.iter().zip((0..levels.len()).rev()) {
            let mesh = &level.mesh;
            let newer;
            [own, newer] = split_both(own, mesh.vertices);
            let [mut on_edges, mut in_faces] = split_both(newer, mesh.halves.len());
            let (mut edge, mut face, middles) = (0, 0, in_faces.0.len());
            for (corners, task) in &mut tasks {
                let end = corners.end << (2 * steps);
                let edges = mesh.edges_before(end) - edge;
                let faces = mesh.faces_before(end).min(middles) - face;
                let [of_edges, of_faces];
                ([of_edges, on_edges], [of_faces, in_faces]) =
                    (split_both(on_edges, edges), split_both(in_faces, faces));
                let (on_edges, in_faces) = ((edge, of_edges), (face, of_faces));
                task.push(NewVertices { mesh, age: older, on_edges, in_faces });
                (edge, face) = (edge + edges, face + faces);
            }
            older += 1;
        }
        tasks.into_par_iter().for_each(|(corners, task)| {
            if let Some(around) = around {
                let [start, end] =
                    [corners.start, corners.end].map(|corner| corner << (2 * levels.len()));
                around.fetch(start..end, &task);
            }
            task.into_iter().for_each(|born| born.make(split, make));
        });
        levels[levels.len() - 1].at_own(older, own, split, make);
    }

    /// Returns the half-edges from a regular vertex, in the order in which [`Self::at_regular`] passes them.
    pub(crate) fn ring_of<K: Split>(&self, vertex: usize, split: K) -> [u32; 6] {
        self.ring_of_own(vertex, 0, split)
    }

    fn ring_of_own<K: Split>(&self, vertex: usize, age: usize, split: K) -> [u32; 6] {
        if let Some(coarser) = &self.coarser {
            return coarser.ring_of_child(vertex, age, split);
        }
        let mut halves = [0; 6];
        let ring = &mut halves[..K::VALENCE];
        ring.copy_from_slice(&self.rings[K::VALENCE * vertex..][..K::VALENCE]);
        take_first_halves(ring, age, split);
        halves
    }

    /// For a vertex of the mesh after the next step, returns its half-edges in the mesh that is `age` further steps later.
    pub(crate) fn ring_of_child<K: Split>(&self, vertex: usize, age: usize, split: K) -> [u32; 6] {
        let mesh = &self.mesh;
        let Some(born) = vertex.checked_sub(mesh.vertices) else {
            return self.ring_of_own(vertex, age + 1, split);
        };
        let mut halves = [0; 6];
        let ring = &mut halves[..K::VALENCE];
        if let Some(&[owner, twin]) = mesh.halves.get(born) {
            let (left, right) = ring.split_at_mut(K::VALENCE / 2);
            split.around_edge(mesh, owner, left);
            split.around_edge(mesh, twin, right);
        } else {
            let corner = mesh.faces.first_corner(born - mesh.halves.len()) as u32;
            (0..).zip(&mut *ring).for_each(|(k, half)| *half = 4 * (corner + k) + 2);
        }
        take_first_halves(ring, age, split);
        halves
    }

    /// Returns the memory that this mesh and all coarser meshes use, in bytes.
    pub(crate) fn size(&self) -> usize {
        let coarser = self.coarser.as_ref().map_or(0, |coarser| coarser.size());
        coarser
            + self.mesh.size()
            + self.odd.len() * 8
            + self.rings.len() * 4
            + self.creases.len() * 16
    }
}

/// Slices of two lists for the same items.
pub(crate) type PairedSlices<'a, A, B> = (&'a mut [A], &'a mut [B]);

fn split_both<A, B>((a, b): PairedSlices<'_, A, B>, index: usize) -> [PairedSlices<'_, A, B>; 2] {
    let ((a, rest_of_a), (b, rest_of_b)) = (a.split_at_mut(index), b.split_at_mut(index));
    [(a, b), (rest_of_a, rest_of_b)]
}

/// The input data of a pass over vertex neighborhoods.
#[derive(Clone, Copy)]
pub(crate) struct VertexInput<'a> {
    pub(crate) corners: &'a [u32],
    /// The positions of the vertices.
    pub(crate) positions: &'a [Point3<f64>],
    /// The new vertices inside the faces; empty if the scheme makes no new vertices inside faces.
    pub(crate) in_faces: &'a [Point3<f64>],
}

impl VertexInput<'_> {
    /// Loads into the processor cache the neighborhoods of the faces with the given corners, and the new vertices inside these faces.
    fn fetch<A, B>(self, corners: Range<usize>, born: &[NewVertices<'_, A, B>]) {
        fetch(self.in_faces, corners.start / 4..corners.end / 4);
        fetch(self.corners, corners);
        for NewVertices { mesh, on_edges, in_faces, .. } in born {
            let edges = mesh.vertices + on_edges.0;
            let faces = mesh.vertices + mesh.halves.len() + in_faces.0;
            fetch(self.positions, edges..edges + on_edges.1.0.len());
            fetch(self.positions, faces..faces + in_faces.1.0.len());
        }
    }
}

/// Reads each cache line of a part of a list in ascending order, so later accesses in any order find the data in the cache.
pub(crate) fn fetch<T: Copy>(list: &[T], part: Range<usize>) {
    let part = list.get(part).unwrap_or_default();
    part.iter().step_by(64 / size_of::<T>()).for_each(|item| {
        black_box(*item);
    });
}

/// Slices for the vertices that some faces and their edges created `age` steps ago.
struct NewVertices<'a, A, B> {
    mesh: &'a Connectivity,
    age: usize,
    on_edges: (usize, PairedSlices<'a, A, B>),
    in_faces: (usize, PairedSlices<'a, A, B>),
}

impl<A, B> NewVertices<'_, A, B> {
    /// Performs [`Level::at_regular`] for the new vertices to which the slices belong.
    fn make<K: Split>(self, split: K, make: &impl Fn(usize, &[u32]) -> (A, B)) {
        let Self { mesh, age, on_edges, in_faces } = self;
        let before = mesh.vertices;
        visit_new_vertices(on_edges.1, [on_edges.0, before, age], split, make, |index, ring| {
            let [owner, twin] = mesh.halves[index];
            if twin == NONE {
                return false;
            }
            let (left, right) = ring.split_at_mut(K::VALENCE / 2);
            split.around_edge(mesh, owner, left);
            split.around_edge(mesh, twin, right);
            true
        });
        let before = mesh.vertices + mesh.halves.len();
        visit_new_vertices(in_faces.1, [in_faces.0, before, age], split, make, |index, ring| {
            let corner = mesh.faces.first_corner(index) as u32;
            (0..).zip(ring).for_each(|(k, half)| *half = 4 * (corner + k) + 2);
            mesh.faces.first_corner(index + 1) as u32 == corner + K::VALENCE as u32
        });
    }
}

/// Performs [`Level::at_regular`] for vertices that faces or edges, from index `first` on, created `age` steps ago. `before` is the index
/// of the first of these vertices. `birth` returns the half-edges that a vertex had in the mesh of its creation, or reports that the vertex
/// is odd.
#[inline]
fn visit_new_vertices<A, B, K: Split>(
    to: PairedSlices<'_, A, B>,
    [first, before, age]: [usize; 3],
    split: K,
    make: &impl Fn(usize, &[u32]) -> (A, B),
    birth: impl Fn(usize, &mut [u32]) -> bool,
) {
    for (index, to) in (first..).zip(to.0.iter_mut().zip(to.1)) {
        let mut ring = [0; 6];
        let ring = &mut ring[..K::VALENCE];
        if !birth(index, ring) {
            continue;
        }
        take_first_halves(ring, age, split);
        (*to.0, *to.1) = make(before + index, ring);
    }
}

/// Replaces each half-edge by its first half after `age` steps, in each of which a half-edge is divided into two.
#[inline]
fn take_first_halves(ring: &mut [u32], age: usize, split: impl Split) {
    // After the first step a first half is at corner 0 of a quad or triangle, so each further step multiplies its index by four.
    if let Some(later) = age.checked_sub(1) {
        ring.iter_mut().for_each(|half| *half = split.first_half(*half) << (2 * later));
    }
}

/// Finds the half-edges from each regular vertex, and the odd vertices, each with a half-edge from it.
fn rings<K: Split>(
    mesh: &Connectivity,
    starts: &[u32],
    creases: &[(u32, f64)],
    _: K,
) -> (Vec<u32>, Vec<[u32; 2]>) {
    let mut is_sharp = vec![false; mesh.vertices];
    creases.iter().flat_map(|(edge, _)| mesh.ends(*edge)).for_each(|v| is_sharp[v as usize] = true);
    let mut rings = vec![NONE; K::VALENCE * mesh.vertices];
    let blocks = rings.par_chunks_mut(K::VALENCE * BLOCK).enumerate();
    blocks.for_each_init(Ring::default, |ring, (block, rings)| {
        for (vertex, to) in (BLOCK * block..).zip(rings.chunks_exact_mut(K::VALENCE)) {
            if is_sharp[vertex] || starts[vertex] == NONE {
                continue;
            }
            mesh.ring(starts[vertex], ring);
            if ring.halves.len() == K::VALENCE {
                to.copy_from_slice(&ring.halves);
            }
        }
    });
    let vertices = (0..).zip(rings.chunks_exact(K::VALENCE)).zip(starts);
    let odd = vertices.filter(|((_, ring), _)| ring[0] == NONE);
    let odd = odd.map(|((vertex, _), &start)| [vertex, start]).collect();
    (rings, odd)
}

/// Returns the sharp edges with their sharpness, sorted by edge: the creases of the topology and the border.
pub(crate) fn creases(topology: &Topology, mesh: &Connectivity) -> Vec<(u32, f64)> {
    let known = &topology.creases;
    fn sharpness(edge: u32, mesh: &Connectivity, known: &[([u32; 2], f64)]) -> f64 {
        if mesh.is_boundary(edge) {
            return f64::INFINITY;
        }
        if known.is_empty() {
            return 0.0;
        }
        let [a, b] = mesh.ends(edge);
        let ends = [a.min(b), a.max(b)];
        match known.binary_search_by_key(&ends, |(ends, _)| *ends) {
            Ok(crease) => known[crease].1,
            Err(_) => 0.0,
        }
    }
    let edges = (0..mesh.halves.len() as u32).map(|edge| (edge, sharpness(edge, mesh, known)));
    edges.filter(|(_, sharpness)| *sharpness > 0.0).collect()
}

/// Checks that all faces are triangles. `scheme` names the scheme that needs them.
///
/// # Errors
/// If a face is not a triangle.
pub(crate) fn check_triangles(faces: &Faces, scheme: &str) -> Result<(), Error> {
    if faces.sides() == Some(3) {
        return Ok(());
    }
    match (0..faces.len()).find(|&face| faces.face(face).len() != 3) {
        Some(face) => bail!(
            "face {face} has {} corners, but {scheme} needs triangles; use `CatmullClark`, or `Remesh` to make triangles",
            faces.face(face).len()
        ),
        None => Ok(()),
    }
}
