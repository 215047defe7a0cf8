//! One step of the scheme of Doo and Sabin on polygons, and its limit.
//!
//! Doo and Sabin, "Behaviour of recursive division surfaces near extraordinary points" (1978): the new vertex at corner `k` of a face with the `m` corners `p_j` is `sum_j alpha_j p_{k + j}`, where
//! `alpha_0 = 1/4 + 5/(4m)` and `alpha_j = (3 + 2 cos(2 pi j/m)) / (4m)`. So it is `p_k / 4 + 3/4 c + (cos(2 pi k/m) a + sin(2 pi
//! k/m) b) / (2m)` with the centroid `c` and the sums `a` of `cos(2 pi j/m) p_j` and `b` of `sin(2 pi j/m) p_j`.
//!
//! New vertices: those at the corners in their order; then, unless the border shrinks, for each edge of the border that at 1/4
//! and that at 3/4 of its way. New faces: one inside each old one; one across each old edge, that is two inner vertices and
//! two on the border at an edge of the border; one around each old vertex, at the border with two vertices on it.

use std::sync::Arc;

use maquette_base::linear::mix::Mix;
use maquette_value::Faces;
use maquette_value::memory::huge_vec;
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::by_faces::{BLOCK, by_faces};
use super::connectivity::Connectivity;
use super::dual_halves::{DualFaces, FinerHalves, Rings};
use super::half_edges::{HalfEdges, NONE, Ring};
use super::topology::Topology;
use crate::masks::turns::{turn, turns};
use crate::{Boundary, SubdivideError};

/// How to refine a mesh once.
#[derive(Debug)]
pub(crate) struct Dual {
    boundary: Boundary,
    pub(crate) mesh: Arc<Connectivity>,
    starts: Vec<u32>,
    /// The edges of the border which get new vertices, in order.
    border: Vec<u32>,
    /// The refined faces.
    pub(crate) finer: Faces,
    /// The old edges and vertices which have become faces, in order.
    edges: Vec<u32>,
    vertices: Vec<u32>,
    /// Whether two faces alone meet at a vertex inside, which then gets none.
    has_pairs: bool,
}

/// The new faces around some old vertices.
#[derive(Default)]
struct Around {
    corners: Vec<u32>,
    sides: Vec<usize>,
    vertices: Vec<u32>,
    has_pairs: bool,
}

impl Dual {
    /// How to refine the mesh of a topology.
    ///
    /// # Errors
    /// If it is not manifold.
    pub(crate) fn first(topology: &Topology) -> Result<Self, SubdivideError> {
        let halves = searched(&topology.faces, topology.vertices)?;
        Ok(Self::new(halves, topology.rules.boundary))
    }

    /// How to refine the refined mesh.
    ///
    /// # Errors
    /// If it is not manifold.
    pub(crate) fn next(&self) -> Result<Self, SubdivideError> {
        Ok(Self::new(self.finer_halves()?, self.boundary))
    }

    /// The half-edges of the refined faces.
    ///
    /// # Errors
    /// If the refined mesh is not manifold.
    pub(crate) fn finer_halves(&self) -> Result<FinerHalves, SubdivideError> {
        let (vertices, faces) = (self.n_finer(), &self.finer);
        if self.has_pairs {
            return searched(faces, vertices);
        }
        Ok(DualFaces { mesh: &self.mesh, faces, edges: &self.edges, vertices }.connectivity())
    }

    /// What happens at the border.
    pub(crate) fn boundary(&self) -> Boundary {
        self.boundary
    }

    fn new(halves: FinerHalves, boundary: Boundary) -> Self {
        let FinerHalves { mesh, starts, rings } = halves;
        let border = match boundary {
            Boundary::None => Vec::new(),
            _ => (0..mesh.halves.len() as u32).filter(|&edge| mesh.is_boundary(edge)).collect(),
        };
        let mut dual = Self {
            boundary,
            mesh: Arc::new(mesh),
            starts,
            border,
            finer: Faces::triangles(Vec::new()),
            edges: Vec::new(),
            vertices: Vec::new(),
            has_pairs: false,
        };
        dual.build_faces(&rings);
        dual
    }

    fn build_faces(&mut self, rings: &Rings) {
        let mesh = &self.mesh;
        let (inner, n_faces) = (mesh.corners().len(), mesh.faces.len());
        let edges = (0..mesh.halves.len() as u32).into_par_iter().with_min_len(BLOCK);
        let has_border = self.boundary != Boundary::None;
        self.edges = edges.filter(|&edge| has_border || !mesh.is_boundary(edge)).collect();
        let blocks = self.starts.par_chunks(BLOCK).enumerate();
        let around = blocks.map(|(block, starts)| self.around(block, starts, rings));
        let around: Vec<Around> = around.collect();
        fn count(list: fn(&Around) -> usize, around: &[Around]) -> usize {
            around.iter().map(list).sum::<usize>()
        }

        let mut sides = huge_vec(n_faces + self.edges.len() + count(|it| it.sides.len(), &around));
        sides.clear();
        sides.extend(mesh.faces.iter().map(<[u32]>::len));
        sides.resize(n_faces + self.edges.len(), 4);
        let across = inner + 4 * self.edges.len();
        let mut corners = huge_vec(across + count(|it| it.corners.len(), &around));
        let own = corners[..inner].par_iter_mut().enumerate().with_min_len(BLOCK);
        own.for_each(|(half, to)| *to = half as u32);
        let quads = corners[inner..across].as_chunks_mut::<4>().0.par_iter_mut();
        quads.zip(&self.edges).with_min_len(BLOCK).for_each(|(to, &edge)| {
            let [owner, twin] = mesh.halves[edge as usize];
            let beyond = match twin {
                NONE => self.on_border(edge).expect("an edge of the border"),
                twin => [mesh.next(twin), twin],
            };
            *to = [mesh.next(owner), owner, beyond[0], beyond[1]];
        });
        let mut rest = &mut corners[across..];
        for around in around {
            let to = rest.split_off_mut(..around.corners.len()).expect("as many as counted");
            to.copy_from_slice(&around.corners);
            sides.extend(around.sides);
            self.vertices.extend(around.vertices);
            self.has_pairs |= around.has_pairs;
        }
        self.finer = Faces::polygons(&sides, corners).expect("as many corners as counted");
    }

    /// The faces around the vertices of a block, from which `starts` run.
    fn around(&self, block: usize, starts: &[u32], rings: &Rings) -> Around {
        let mesh = &self.mesh;
        let mut around = Around::default();
        for (vertex, &start) in (block * BLOCK..).zip(starts) {
            let is_open = start != NONE && mesh.twin(start) == NONE;
            if start == NONE || is_open && self.boundary == Boundary::None {
                continue;
            }
            let first = around.corners.len();
            let on_border = |half: u32, end: usize| {
                let points = is_open.then(|| self.on_border(mesh.edge_of[half as usize]));
                points.flatten().map(|points| points[end])
            };
            around.corners.extend(on_border(start, 0));
            rings.fan(mesh, vertex, start, &mut around.corners);
            let last = around.corners[around.corners.len() - 1];
            around.corners.extend(on_border(mesh.previous(last), 1));
            let count = around.corners.len() - first;
            if count < 3 {
                around.has_pairs = true;
                around.corners.truncate(first);
            } else {
                around.sides.push(count);
                around.vertices.push(vertex as u32);
            }
        }
        around
    }

    /// The two new vertices on an edge of the border, the one near its owner's start first.
    fn on_border(&self, edge: u32) -> Option<[u32; 2]> {
        let place = self.border.binary_search(&edge).ok()?;
        let first = (self.mesh.corners().len() + 2 * place) as u32;
        Some([first, first + 1])
    }

    /// Number of vertices of the refined mesh.
    pub(crate) fn n_finer(&self) -> usize {
        self.mesh.corners().len() + 2 * self.border.len()
    }

    /// The refined vertices' places.
    pub(crate) fn positions(&self, old: &[Point3<f64>]) -> Vec<Point3<f64>> {
        let (mesh, corners) = (&*self.mesh, self.mesh.corners());
        let at = |corner: u32| old[corner as usize].coords;
        let mut new: Vec<Point3<f64>> = huge_vec(self.n_finer());
        let (inner, on_border) = new.split_at_mut(corners.len());
        by_faces(&mesh.faces, 0..mesh.faces.len(), inner, |faces, mut to| {
            for face in faces.map(|face| mesh.faces.face(face)) {
                let turns = turns(face.len());
                let moments = moments(face, &turns, old);
                for (&corner, turn) in face.iter().zip(&*turns) {
                    let to = to.split_off_first_mut().expect("a place for each corner");
                    *to = inside(at(corner), &moments, *turn).into();
                }
            }
        });
        for (to, &edge) in on_border.as_chunks_mut::<2>().0.iter_mut().zip(&self.border) {
            let [a, b] = mesh.ends(edge).map(at);
            *to = [(a * 0.75 + b * 0.25).into(), (a * 0.25 + b * 0.75).into()];
        }
        new
    }

    /// A column of vertex data: at a new vertex the mean of what is at its corner, at the middles of both edges there, and at
    /// the middle of the face.
    pub(crate) fn carry_vertices<T: Mix>(&self, old: &[T]) -> Vec<T> {
        let at_corners: Vec<T> =
            self.mesh.corners().iter().map(|&corner| old[corner as usize]).collect();
        let mut new = self.within_faces(&at_corners);
        for &edge in &self.border {
            let [a, b] = self.mesh.ends(edge).map(|end| old[end as usize]);
            new.extend([mean(a, b, 0.25), mean(a, b, 0.75)]);
        }
        new
    }

    fn within_faces<T: Mix>(&self, old: &[T]) -> Vec<T> {
        let mesh = &self.mesh;
        let mut new = Vec::with_capacity(self.n_finer());
        for face in 0..mesh.faces.len() {
            let old = &old[mesh.faces.first_corner(face)..mesh.faces.first_corner(face + 1)];
            let m = old.len();
            let middle = T::mix(old.iter().map(|&corner| (1.0 / m as f64, corner)));
            new.extend((0..m).map(|k| {
                let [last, next] = [old[(k + m - 1) % m], old[(k + 1) % m]];
                T::mix([(0.5, old[k]), (0.125, last), (0.125, next), (0.25, middle)].into_iter())
            }));
        }
        new
    }

    /// A column of corner data. Within an old face as for vertices; a new face across a seam or around one of its ends
    /// continues one side of it, that of the first half-edge, up to the seam and no farther.
    pub(crate) fn carry_corners<T: Mix>(&self, old: &[T]) -> Vec<T> {
        let mesh = &*self.mesh;
        let mut new = self.within_faces(old);
        let inner = new.clone();
        let along =
            |half: u32, share: f64| mean(old[half as usize], old[mesh.next(half) as usize], share);
        for &edge in &self.edges {
            let [owner, twin] = mesh.halves[edge as usize];
            let next = mesh.next(owner);
            new.extend([inner[next as usize], inner[owner as usize]]);
            let beyond = [(owner, along(owner, 0.25)), (next, along(owner, 0.75))];
            let others = match twin {
                NONE => [None; 2],
                twin => [Some(mesh.next(twin)), Some(twin)],
            };
            for ((near, seam), other) in beyond.into_iter().zip(others) {
                new.push(
                    other
                        .filter(|other| old[*other as usize] == old[near as usize])
                        .map_or(seam, |other| inner[other as usize]),
                );
            }
        }
        let mut ring = Ring::default();
        for &vertex in &self.vertices {
            mesh.ring(self.starts[vertex as usize], &mut ring);
            let first = old[ring.halves[0] as usize];
            let last = ring.halves[ring.halves.len() - 1];
            let is_joined = |half: u32| old[half as usize] == first;
            if !ring.closed {
                new.push(along(ring.halves[0], 0.25));
            }
            new.extend(
                ring.halves
                    .iter()
                    .map(|&half| if is_joined(half) { inner[half as usize] } else { first }),
            );
            if !ring.closed {
                let on_border = along(mesh.previous(last), 0.75);
                new.push(if is_joined(last) { on_border } else { first });
            }
        }
        new
    }

    /// The old face of each new one: itself, that of the edge's owner, the first one around the vertex.
    pub(crate) fn parents(&self) -> Vec<u32> {
        let mesh = &self.mesh;
        let edges = self.edges.iter().map(|&edge| mesh.face_of(mesh.halves[edge as usize][0]));
        let vertices =
            self.vertices.iter().map(|&vertex| mesh.face_of(self.starts[vertex as usize]));
        (0..mesh.faces.len() as u32).chain(edges).chain(vertices).collect()
    }

    /// How many bytes it holds.
    pub(crate) fn size(&self) -> usize {
        let lists = self.starts.len() + self.border.len() + self.edges.len() + self.vertices.len();
        self.mesh.size() + self.finer.corners().size() + 4 * lists
    }
}

/// The half-edges of faces, by a search.
fn searched(faces: &Faces, vertices: usize) -> Result<FinerHalves, SubdivideError> {
    let (mesh, starts) = Connectivity::new(faces, vertices)?;
    Ok(FinerHalves { mesh, starts, rings: Rings::default() })
}

/// The new vertices inside the faces.
pub(crate) struct Inside<'a> {
    mesh: &'a Connectivity,
    old: &'a [Point3<f64>],
    /// The [`moments()`] of each face.
    moments: Vec<[[f64; 3]; 3]>,
}

impl<'a> Inside<'a> {
    pub(crate) fn new(mesh: &'a Connectivity, old: &'a [Point3<f64>]) -> Self {
        let mut of_faces = huge_vec(mesh.faces.len());
        of_faces.par_iter_mut().with_min_len(BLOCK).enumerate().for_each(|(face, to)| {
            let face = mesh.faces.face(face);
            *to = moments(face, &turns(face.len()), old);
        });
        Self { mesh, old, moments: of_faces }
    }

    /// The new vertex at a corner.
    #[inline]
    pub(crate) fn at(&self, half: u32) -> Vector3<f64> {
        let (faces, face) = (&self.mesh.faces, self.mesh.face_of(half) as usize);
        let (first, end) = (faces.first_corner(face), faces.first_corner(face + 1));
        let own = self.old[self.mesh.corners()[half as usize] as usize].coords;
        inside(own, &self.moments[face], turn(half as usize - first, end - first))
    }
}

/// The parts of a face's corners that its new vertices have in common: 3/4 of the centroid, and shares of the sums of cosines and of
/// sines.
fn moments(face: &[u32], turns: &[[f64; 2]], old: &[Point3<f64>]) -> [[f64; 3]; 3] {
    let mut sums = [Vector3::zeros(); 3];
    for (&corner, [cosine, sine]) in face.iter().zip(turns) {
        let point = old[corner as usize].coords;
        sums[0] += point;
        sums[1] += point * *cosine;
        sums[2] += point * *sine;
    }
    let m = face.len() as f64;
    [sums[0] * (0.75 / m), sums[1] * (0.5 / m), sums[2] * (0.5 / m)].map(Into::into)
}

/// The new vertex at a corner whose place is `own`.
#[inline]
fn inside(own: Vector3<f64>, moments: &[[f64; 3]; 3], [cosine, sine]: [f64; 2]) -> Vector3<f64> {
    let [center, a, b] = moments.map(Vector3::from);
    own * 0.25 + center + (a * cosine + b * sine)
}

/// What is at a share of the way from `a` to `b`.
fn mean<T: Mix>(a: T, b: T, share: f64) -> T {
    T::mix([(1.0 - share, a), (share, b)].into_iter())
}
