//! A mesh on its way through the steps of a primal scheme, and what lies around its regular vertices.
//!
//! Almost all vertices of a refined mesh are *regular*: all their edges are smooth, and as many as the scheme likes best. Their
//! masks have fixed weights, and what lies around them follows from where they came from: a vertex that was born on the edge
//! `e` has the half-edges which arithmetic finds from those of `e`, and in each later step the first halves of these. So neither
//! weights nor indices are stored for them. The others, the *odd* ones, are the irregular vertices of the first mesh and those on
//! borders and creases.
//!
//! Vertices are numbered by birth, so that the surroundings of the next vertex are far from those of the last one and come from memory each
//! time. So a task of `Level::at_regular` makes all vertices that a few faces have borne in three steps, after it has read the corners and
//! places of these faces in order: some 300 KB, which fit into a core's cache. For 1.5 million quads places take 28 ms instead of 41, and
//! limits with normals 150 ms instead of 225 (the fastest of 15 runs each, in turn, two threads). A mask that is inlined into the loop is
//! slower by a third, and one that returns its tangents in memory waits for them.

use std::hint::black_box;
use std::iter;
use std::ops::Range;
use std::sync::Arc;

use maquette_value::Faces;
use maquette_value::parallel::*;
use nalgebra::Point3;

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

/// Steps whose children one task looks at: what is older is one of 64 vertices.
const STEPS: usize = 3;

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
        let has_odd = self.rules.scheme.has_middles() && mesh.faces.sides() != Some(4);
        let faces = 0..if has_odd { mesh.faces.len() as u32 } else { 0 };
        let in_faces = faces
            .filter(|face| mesh.faces.face(*face as usize).len() != 4)
            .map(|face| [in_faces + face, 4 * mesh.faces.first_corner(face as usize) as u32 + 2]);
        old.chain(on_edges).chain(in_faces).collect()
    }

    /// Writes what `make` gives for each regular vertex to two lists, from its number and the half-edges from it, counter-clockwise.
    pub(crate) fn at_regular<A: Send, B: Send, K: Split>(
        &self,
        around: Around<'_>,
        to: Both<'_, A, B>,
        split: K,
        make: impl Fn(usize, &[u32]) -> (A, B) + Sync,
    ) {
        match &self.coarser {
            Some(coarser) => coarser.at_children(around, to, split, make),
            None => self.at_own(0, to, split, &make),
        }
    }

    /// The same in the mesh that the next step makes.
    pub(crate) fn at_children<A: Send, B: Send, K: Split>(
        &self,
        around: Around<'_>,
        to: Both<'_, A, B>,
        split: K,
        make: impl Fn(usize, &[u32]) -> (A, B) + Sync,
    ) {
        self.at_descendants(Some(around), 0, to, split, &make);
    }

    /// [`Self::at_regular`] in the mesh so many steps later, for the vertices that are here.
    fn at_own<A: Send, B: Send, K: Split>(
        &self,
        age: usize,
        to: Both<'_, A, B>,
        split: K,
        make: &(impl Fn(usize, &[u32]) -> (A, B) + Sync),
    ) {
        if let Some(coarser) = &self.coarser {
            return coarser.at_descendants(None, age, to, split, make);
        }
        let blocks = to.0.par_chunks_mut(BLOCK).zip(to.1.par_chunks_mut(BLOCK)).enumerate();
        blocks.for_each(|(block, to)| {
            at_born(to, [BLOCK * block, 0, age], split, make, |index, ring| {
                ring.copy_from_slice(&self.rings[K::VALENCE * index..][..K::VALENCE]);
                ring[0] != NONE
            });
        });
    }

    /// [`Self::at_children`], `age` steps after that. What is around a few faces of the last mesh is in them and next to them, but vertices are
    /// in the order of their births: so a task looks at all that a few faces have borne in some steps, and first reads in order what is
    /// around it.
    fn at_descendants<A: Send, B: Send, K: Split>(
        &self,
        around: Option<Around<'_>>,
        age: usize,
        to: Both<'_, A, B>,
        split: K,
        make: &(impl Fn(usize, &[u32]) -> (A, B) + Sync),
    ) {
        let levels = iter::successors(Some(self), |level| level.coarser.as_deref()).take(STEPS);
        let levels = Vec::from_iter(levels);
        let faces = &levels[levels.len() - 1].mesh.faces;
        fn corner(face: usize, faces: &Faces) -> usize {
            faces.first_corner(face.min(faces.len()))
        }
        let size = BLOCK >> (2 * levels.len());
        let starts = (0..faces.len()).step_by(size);
        let corners = starts.map(|face| corner(face, faces)..corner(face + size, faces));
        let mut tasks: Vec<_> =
            corners.map(|corners| (corners, Vec::with_capacity(STEPS))).collect();
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
                task.push(Born { mesh, age: older, on_edges, in_faces });
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

/// What is read around the vertices of a mesh.
#[derive(Clone, Copy)]
pub(crate) struct Around<'a> {
    pub(crate) corners: &'a [u32],
    /// The places of the vertices.
    pub(crate) places: &'a [Point3<f64>],
    /// The new vertices in the faces, if they are needed.
    pub(crate) in_faces: &'a [Point3<f64>],
}

impl Around<'_> {
    /// Reads what is around these corners of the mesh, and the vertices that their faces have borne.
    fn fetch<A, B>(self, corners: Range<usize>, born: &[Born<'_, A, B>]) {
        fetch(self.in_faces, corners.start / 4..corners.end / 4);
        fetch(self.corners, corners);
        for Born { mesh, on_edges, in_faces, .. } in born {
            let edges = mesh.vertices + on_edges.0;
            let faces = mesh.vertices + mesh.halves.len() + in_faces.0;
            fetch(self.places, edges..edges + on_edges.1.0.len());
            fetch(self.places, faces..faces + in_faces.1.0.len());
        }
    }
}

/// Reads something of each line of memory of a part of a list, as far as there is one. In order this is fast, and whoever reads it in another
/// order then finds it near.
pub(crate) fn fetch<T: Copy>(list: &[T], part: Range<usize>) {
    let part = list.get(part).unwrap_or_default();
    part.iter().step_by(64 / size_of::<T>()).for_each(|item| {
        black_box(*item);
    });
}

/// Vertices that some faces of a mesh have borne so many steps ago, on edges and in faces from one on.
struct Born<'a, A, B> {
    mesh: &'a Connectivity,
    age: usize,
    on_edges: (usize, Both<'a, A, B>),
    in_faces: (usize, Both<'a, A, B>),
}

impl<A, B> Born<'_, A, B> {
    /// The part of [`Level::at_regular`] for them.
    fn make<K: Split>(self, split: K, make: &impl Fn(usize, &[u32]) -> (A, B)) {
        let Self { mesh, age, on_edges, in_faces } = self;
        let before = mesh.vertices;
        at_born(on_edges.1, [on_edges.0, before, age], split, make, |index, ring| {
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
        at_born(in_faces.1, [in_faces.0, before, age], split, make, |index, ring| {
            let corner = mesh.faces.first_corner(index) as u32;
            (0..).zip(ring).for_each(|(k, half)| *half = 4 * (corner + k) + 2);
            mesh.faces.first_corner(index + 1) as u32 == corner + K::VALENCE as u32
        });
    }
}

/// The part of [`Level::at_regular`] for vertices that were born `age` steps ago in or on the faces or edges from `first` on, of which the
/// first one's number is `before`; `birth` gives the half-edges from a vertex in the mesh in which it was born, or tells that it is odd.
#[inline]
fn at_born<A, B, K: Split>(
    to: Both<'_, A, B>,
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
        grow_older(ring, age, split);
        (*to.0, *to.1) = make(before + index, ring);
    }
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

pub(crate) fn check_triangles(faces: &Faces) -> Result<(), SubdivideError> {
    if faces.sides() == Some(3) {
        return Ok(());
    }
    match (0..faces.len()).find(|&face| faces.face(face).len() != 3) {
        Some(face) => Err(SubdivideError::NotTriangles { face, corners: faces.face(face).len() }),
        None => Ok(()),
    }
}
