//! A mesh on its way through the steps of a primal scheme, and what lies around its regular vertices.
//!
//! Almost all vertices of a refined mesh are *regular*: all their edges are smooth, and as many as the scheme likes best. Their
//! masks have fixed weights, and what lies around them follows from where they came from: a vertex that was born on the edge
//! `e` has the half-edges which arithmetic finds from those of `e`, and in each later step the first halves of these. So neither
//! weights nor indices are stored for them. The others, the *odd* ones, are the irregular vertices of the first mesh and those on
//! borders and creases.

use std::sync::Arc;

use maquette::parallel::*;
use maquette::value::Faces;

use super::connectivity::Connectivity;
use super::half_edges::{HalfEdges, NONE, Ring};
use super::split::{Corners, Split, Triangles, split_halves};
use super::topology::Topology;
use crate::SubdivideError;
use crate::masks::sharpness::Sharpness;
use crate::rules::Rules;
use crate::scheme::PrimalScheme;

/// Vertices that one task looks at: enough to outweigh the cost of giving it to a thread, some 10 us.
pub(crate) const BLOCK: usize = 4096;

/// A mesh among those that the steps make of one.
#[derive(Debug)]
pub(crate) struct Level {
    pub(crate) rules: Rules<PrimalScheme>,
    /// The mesh of which this one is the refinement; none for the first one.
    coarser: Option<Arc<Self>>,
    pub(crate) mesh: Connectivity,
    /// The sharp edges, sorted; those of the border among them, as sharp as can be.
    pub(crate) creases: Vec<(u32, f64)>,
    /// The odd vertices, sorted, and a half-edge from each as [`HalfEdges::ring`] wants it.
    pub(crate) odd: Vec<[u32; 2]>,
    /// Of the first mesh alone: the half-edges from each regular vertex, [`NONE`] for the odd ones.
    rings: Vec<u32>,
}

impl Level {
    /// The first mesh, by the scheme that is that of `topology`.
    ///
    /// # Errors
    /// If a face is no triangle though the scheme wants them, or the mesh is not manifold.
    pub(crate) fn first(topology: &Topology, scheme: PrimalScheme) -> Result<Self, SubdivideError> {
        let rules = topology.rules.of(scheme);
        if rules.scheme.needs_triangles() {
            check_triangles(&topology.faces)?;
        }
        let (mesh, starts) = Connectivity::new(&topology.faces, topology.vertices)?;
        let creases = creases(topology, &mesh);
        let (rings, odd) = match rules.scheme {
            PrimalScheme::Loop => rings(&mesh, &starts, &creases, Triangles),
            PrimalScheme::CatmullClark => rings(&mesh, &starts, &creases, Corners),
        };
        Ok(Self { rules, coarser: None, mesh, creases, odd, rings })
    }

    /// A part of a mesh, all of whose vertices are odd; the rows of those are wrong whose faces are not all there.
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

    /// The mesh after `coarser`, whose faces are known.
    pub(crate) fn after(coarser: &Arc<Self>, faces: &Faces) -> Self {
        match coarser.rules.scheme {
            PrimalScheme::Loop => Self::split(coarser, faces, Triangles),
            PrimalScheme::CatmullClark => Self::split(coarser, faces, Corners),
        }
    }

    fn split(coarser: &Arc<Self>, faces: &Faces, split: impl Split) -> Self {
        let (mesh, children) = split_halves(&coarser.mesh, faces.clone(), split);
        let sharpness = Sharpness::new(&coarser.mesh, coarser.rules, &coarser.creases);
        let creases = sharpness.refined(|edge| children[edge as usize]);
        let odd = coarser.odd_children(split);
        let (rules, coarser) = (coarser.rules, Some(coarser.clone()));
        Self { rules, coarser, mesh, creases, odd, rings: Vec::new() }
    }

    /// The odd vertices of the refined mesh: the old ones, those on sharp edges, and those in faces of another number of
    /// corners than regular vertices have neighbors.
    pub(crate) fn odd_children(&self, split: impl Split) -> Vec<[u32; 2]> {
        let mesh = &self.mesh;
        let old = self.odd.iter().map(|&[vertex, start]| {
            [vertex, if start == NONE { NONE } else { split.first(start) }]
        });
        let on_edges = self.creases.iter().map(|&(edge, _)| {
            let owner = mesh.halves[edge as usize][0];
            [mesh.vertices as u32 + edge, split.second(mesh, owner)]
        });
        let in_faces = (mesh.vertices + mesh.halves.len()) as u32;
        let is_odd = |face: &u32| mesh.faces.face(*face as usize).len() != 4;
        let has_odd = self.rules.scheme.has_middles() && mesh.faces.sides() != Some(4);
        let faces = 0..if has_odd { mesh.faces.len() as u32 } else { 0 };
        let in_faces = faces
            .filter(is_odd)
            .map(|face| [in_faces + face, 4 * mesh.faces.first_corner(face as usize) as u32 + 2]);
        old.chain(on_edges).chain(in_faces).collect()
    }

    /// Writes what `make` gives for each regular vertex to two lists, from its number and the half-edges from it, counter-clockwise.
    pub(crate) fn at_regular<A: Send, B: Send, K: Split>(
        &self,
        to: Both<'_, A, B>,
        split: K,
        make: impl Fn(usize, &[u32]) -> (A, B) + Sync,
    ) {
        self.at_own(0, to, split, &make);
    }

    /// [`Self::at_regular`] in the mesh so many steps later, for the vertices that are here.
    fn at_own<A: Send, B: Send, K: Split>(
        &self,
        age: usize,
        to: Both<'_, A, B>,
        split: K,
        make: &(impl Fn(usize, &[u32]) -> (A, B) + Sync),
    ) {
        match &self.coarser {
            Some(coarser) => coarser.at_children(age, to, split, make),
            None => at_born(to, [0, age], split, make, |index, ring| {
                ring.copy_from_slice(&self.rings[K::VALENCE * index..][..K::VALENCE]);
                ring[0] != NONE
            }),
        }
    }

    /// The same for those of the mesh that the next step makes, `age` steps after that.
    pub(crate) fn at_children<A: Send, B: Send, K: Split>(
        &self,
        age: usize,
        to: Both<'_, A, B>,
        split: K,
        make: &(impl Fn(usize, &[u32]) -> (A, B) + Sync),
    ) {
        let mesh = &self.mesh;
        let born = [mesh.vertices, mesh.vertices + mesh.halves.len()];
        let [own, newer] = split_both(to, born[0]);
        let [on_edges, in_faces] = split_both(newer, mesh.halves.len());
        at_born(on_edges, [born[0], age], split, make, |index, ring| {
            let [owner, twin] = mesh.halves[index];
            if twin == NONE {
                return false;
            }
            let (left, right) = ring.split_at_mut(K::VALENCE / 2);
            split.around_edge(mesh, owner, left);
            split.around_edge(mesh, twin, right);
            true
        });
        at_born(in_faces, [born[1], age], split, make, |index, ring| {
            let corner = mesh.faces.first_corner(index) as u32;
            (0..).zip(ring).for_each(|(k, half)| *half = 4 * (corner + k) + 2);
            mesh.faces.first_corner(index + 1) as u32 == corner + K::VALENCE as u32
        });
        self.at_own(age + 1, own, split, make);
    }

    /// The half-edges from a regular vertex, in the order in which [`Self::at_regular`] gives them.
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
        grow_older(ring, age, split);
        halves
    }

    /// That of a vertex of the mesh that the next step makes, in the mesh `age` steps after that.
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
        grow_older(ring, age, split);
        halves
    }

    /// How many bytes it holds, the coarser ones included.
    pub(crate) fn size(&self) -> usize {
        let coarser = self.coarser.as_ref().map_or(0, |coarser| coarser.size());
        coarser
            + self.mesh.size()
            + self.odd.len() * 8
            + self.rings.len() * 4
            + self.creases.len() * 16
    }
}

/// Items of two lists at the same places.
pub(crate) type Both<'a, A, B> = (&'a mut [A], &'a mut [B]);

fn split_both<A, B>((a, b): Both<'_, A, B>, place: usize) -> [Both<'_, A, B>; 2] {
    let ((a, rest_of_a), (b, rest_of_b)) = (a.split_at_mut(place), b.split_at_mut(place));
    [(a, b), (rest_of_a, rest_of_b)]
}

/// The part of [`Level::at_regular`] for vertices from `first` on, all born `age` steps ago; `birth` gives the half-edges from a
/// vertex in the mesh in which it was born, or tells that it is odd.
#[inline]
fn at_born<A: Send, B: Send, K: Split>(
    to: Both<'_, A, B>,
    [first, age]: [usize; 2],
    split: K,
    make: &(impl Fn(usize, &[u32]) -> (A, B) + Sync),
    birth: impl Fn(usize, &mut [u32]) -> bool + Sync,
) {
    let blocks = to.0.par_chunks_mut(BLOCK).zip(to.1.par_chunks_mut(BLOCK)).enumerate();
    blocks.for_each(|(block, to)| {
        for (index, to) in (BLOCK * block..).zip(to.0.iter_mut().zip(to.1)) {
            let mut ring = [0; 6];
            let ring = &mut ring[..K::VALENCE];
            if !birth(index, ring) {
                continue;
            }
            grow_older(ring, age, split);
            (*to.0, *to.1) = make(first + index, ring);
        }
    });
}

/// Goes from half-edges to their first halves after so many steps.
#[inline]
fn grow_older(ring: &mut [u32], age: usize, split: impl Split) {
    // The first halves are at corners 0, and so each the fourth part of the next.
    if let Some(later) = age.checked_sub(1) {
        ring.iter_mut().for_each(|half| *half = split.first(*half) << (2 * later));
    }
}

/// The half-edges from each regular vertex, and the other vertices with their starts.
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

/// The sharp edges by number: the given creases and the border.
pub(crate) fn creases(topology: &Topology, mesh: &Connectivity) -> Vec<(u32, f64)> {
    let known = &topology.creases;
    let sharpness = |edge: u32| {
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
    };
    let edges = (0..mesh.halves.len() as u32).map(|edge| (edge, sharpness(edge)));
    edges.filter(|(_, sharpness)| *sharpness > 0.0).collect()
}

pub(crate) fn check_triangles(faces: &Faces) -> Result<(), SubdivideError> {
    if faces.sides() == Some(3) {
        return Ok(());
    }
    match (0..faces.len()).find(|&face| faces.face(face).len() != 3) {
        Some(face) => Err(SubdivideError::NotTriangles { face, corners: faces.face(face).len() }),
        None => Ok(()),
    }
}
