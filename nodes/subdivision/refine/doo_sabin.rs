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

use maquette::memory::huge_vec;
use maquette::parallel::*;
use maquette::value::Faces;
use nalgebra::{Point3, Vector3};

use super::connectivity::{Connectivity, NONE, Ring};
use super::dual_halves::DualFaces;
use super::topology::Topology;
use crate::masks::turns::turn;
use crate::{Boundary, SubdivideError};
use maquette_base::linear::mix::Mix;

/// Elements that one task looks at: enough to outweigh the cost of giving it to a thread, some 10 us.
const BLOCK: usize = 4096;

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

impl Dual {
    /// How to refine the mesh of a topology.
    ///
    /// # Errors
    /// If it is not manifold.
    pub(crate) fn first(topology: &Topology) -> Result<Self, SubdivideError> {
        let (mesh, starts) = Connectivity::new(&topology.faces, topology.vertices)?;
        Ok(Self::new(mesh, starts, topology.rules.boundary))
    }

    /// How to refine the refined mesh.
    ///
    /// # Errors
    /// If it is not manifold.
    pub(crate) fn next(&self) -> Result<Self, SubdivideError> {
        let (mesh, starts) = self.finer_halves()?;
        Ok(Self::new(mesh, starts, self.boundary))
    }

    /// The half-edges of the refined faces, and one from each vertex.
    ///
    /// # Errors
    /// If the refined mesh is not manifold.
    pub(crate) fn finer_halves(&self) -> Result<(Connectivity, Vec<u32>), SubdivideError> {
        let (vertices, faces) = (self.n_finer(), &self.finer);
        if self.has_pairs {
            return Connectivity::new(faces, vertices);
        }
        Ok(DualFaces { mesh: &self.mesh, faces, edges: &self.edges, vertices }.connectivity())
    }

    /// What happens at the border.
    pub(crate) fn boundary(&self) -> Boundary {
        self.boundary
    }

    fn new(mesh: Connectivity, starts: Vec<u32>, boundary: Boundary) -> Self {
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
        dual.build_faces();
        dual
    }

    fn build_faces(&mut self) {
        let mesh = &self.mesh;
        let n_halves = mesh.corners().len() as u32;
        let mut sides: Vec<usize> = mesh.faces.iter().map(<[u32]>::len).collect();
        let mut corners: Vec<u32> = Vec::with_capacity(4 * n_halves as usize);
        corners.extend(0..n_halves);
        for (edge, &[owner, twin]) in (0..).zip(&mesh.halves) {
            if twin != NONE {
                corners.extend([mesh.next(owner), owner, mesh.next(twin), twin]);
            } else if let Some([near, far]) = self.on_border(edge) {
                corners.extend([mesh.next(owner), owner, near, far]);
            } else {
                continue;
            }
            sides.push(4);
            self.edges.push(edge);
        }
        let mut ring = Ring::default();
        for (vertex, &start) in (0..).zip(&self.starts) {
            mesh.ring(start, &mut ring);
            let [first, last] = self.border_points(&ring);
            let count = ring.halves.len() + usize::from(first.is_some()) * 2;
            if count < 3 || (!ring.closed && first.is_none()) {
                self.has_pairs |= ring.closed;
                continue;
            }
            corners.extend(first.into_iter().chain(ring.halves.iter().copied()).chain(last));
            sides.push(count);
            self.vertices.push(vertex);
        }
        self.finer = Faces::polygons(&sides, corners).expect("as many corners as counted");
    }

    /// The two new vertices on an edge of the border, the one near its owner's start first.
    fn on_border(&self, edge: u32) -> Option<[u32; 2]> {
        let place = self.border.binary_search(&edge).ok()?;
        let first = (self.mesh.corners().len() + 2 * place) as u32;
        Some([first, first + 1])
    }

    /// The new vertices on the border next to the one inside `ring`: that on its first edge, and that on its last.
    fn border_points(&self, ring: &Ring) -> [Option<u32>; 2] {
        let (Some(first), Some(last), false) = (ring.edges.first(), ring.edges.last(), ring.closed)
        else {
            return [None; 2];
        };
        [
            self.on_border(*first).map(|points| points[0]),
            self.on_border(*last).map(|points| points[1]),
        ]
    }

    /// Number of vertices of the refined mesh.
    pub(crate) fn n_finer(&self) -> usize {
        self.mesh.corners().len() + 2 * self.border.len()
    }

    /// The refined vertices' places.
    pub(crate) fn positions(&self, old: &[Point3<f64>]) -> Vec<Point3<f64>> {
        let (mesh, corners) = (&*self.mesh, self.mesh.corners());
        let at = |corner: u32| old[corner as usize].coords;
        let inside = Inside::new(mesh, old);
        let mut new: Vec<Point3<f64>> = huge_vec(self.n_finer());
        let (inner, on_border) = new.split_at_mut(corners.len());
        inner.par_iter_mut().with_min_len(BLOCK).enumerate().for_each(|(half, to)| {
            *to = inside.at(half as u32).into();
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
                let is_joined = |other: &u32| old[*other as usize] == old[near as usize];
                new.push(other.filter(is_joined).map_or(seam, |other| inner[other as usize]));
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
            let joined = |&half: &u32| if is_joined(half) { inner[half as usize] } else { first };
            new.extend(ring.halves.iter().map(joined));
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

/// The new vertices inside the faces.
pub(crate) struct Inside<'a> {
    mesh: &'a Connectivity,
    old: &'a [Point3<f64>],
    /// The parts of each face's corners that its new vertices have in common: 3/4 of the centroid, and shares of the sums of cosines and of
    /// sines.
    moments: Vec<[[f64; 3]; 3]>,
}

impl<'a> Inside<'a> {
    pub(crate) fn new(mesh: &'a Connectivity, old: &'a [Point3<f64>]) -> Self {
        let mut moments: Vec<[[f64; 3]; 3]> = huge_vec(mesh.faces.len());
        moments.par_iter_mut().with_min_len(BLOCK).enumerate().for_each(|(face, to)| {
            let face = mesh.faces.face(face);
            let m = face.len();
            let mut sums = [Vector3::zeros(); 3];
            for (j, &corner) in face.iter().enumerate() {
                let [cosine, sine] = turn(j, m);
                let point = old[corner as usize].coords;
                sums[0] += point;
                sums[1] += point * cosine;
                sums[2] += point * sine;
            }
            let m = m as f64;
            *to = [sums[0] * (0.75 / m), sums[1] * (0.5 / m), sums[2] * (0.5 / m)].map(Into::into);
        });
        Self { mesh, old, moments }
    }

    /// The new vertex at a corner.
    #[inline]
    pub(crate) fn at(&self, half: u32) -> Vector3<f64> {
        let (faces, face) = (&self.mesh.faces, self.mesh.face_of(half) as usize);
        let (first, end) = (faces.first_corner(face), faces.first_corner(face + 1));
        let [cosine, sine] = turn(half as usize - first, end - first);
        let [center, a, b] = self.moments[face].map(Vector3::from);
        let own = self.old[self.mesh.corners()[half as usize] as usize].coords;
        own * 0.25 + center + (a * cosine + b * sine)
    }
}

/// What is at a share of the way from `a` to `b`.
fn mean<T: Mix>(a: T, b: T, share: f64) -> T {
    T::mix([(1.0 - share, a), (share, b)].into_iter())
}
