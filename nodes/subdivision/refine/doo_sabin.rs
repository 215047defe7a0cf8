//! One step of the Doo-Sabin scheme for polygons.
//!
//! Doo and Sabin, "Behaviour of recursive division surfaces near extraordinary points" (1978): the new vertex at corner `k` of a face with
//! the `m` corners `p_j` is `sum_j alpha_j p_{k + j}`, where `alpha_0 = 1/4 + 5/(4m)` and `alpha_j = (3 + 2 cos(2 pi j/m)) / (4m)`. It
//! follows that the new vertex is `p_k / 4 + 3/4 c + (cos(2 pi k/m) a + sin(2 pi k/m) b) / (2m)` with the centroid `c` and the sums `a` of
//! `cos(2 pi j/m) p_j` and `b` of `sin(2 pi j/m) p_j`.
//!
//! Order of new vertices: first one for each corner of the old faces; then, unless the border shrinks, two for each border edge, at 1/4 and
//! 3/4 of its length. Order of new faces: first one inside each old face; then one across each old edge (across a border edge it has two
//! inner vertices and two on the border); then one around each old vertex (around a border vertex it has two vertices on the border).

use std::sync::Arc;

use maquette_base::linear::weighted_mean::WeightedMean;
use maquette_node::Error;
use maquette_value::Faces;
use maquette_value::memory::huge_vec;
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::by_faces::{BLOCK, by_faces};
use super::connectivity::Connectivity;
use super::dual_halves::{DualFaces, FinerHalves, Rings};
use super::half_edges::{HalfEdges, NONE, Ring};
use super::topology::Topology;
use crate::Boundary;
use crate::masks::roots_of_unity::{root_of_unity, roots_of_unity};

/// A step of the Doo-Sabin scheme for a fixed topology.
#[derive(Debug)]
pub(crate) struct Dual {
    boundary: Boundary,
    pub(crate) mesh: Arc<Connectivity>,
    starts: Vec<u32>,
    /// The border edges that get new vertices, ascending.
    border: Vec<u32>,
    /// The faces of the mesh after this refinement step.
    pub(crate) finer: Faces,
    /// The old edges with a new face across them, ascending. `vertices` has the old vertices with a new face around them.
    edges: Vec<u32>,
    vertices: Vec<u32>,
    /// True if an inner vertex has only two faces. Such a vertex gets no new face.
    has_pairs: bool,
}

/// The new faces around a block of old vertices: the corners of all these faces, and for each face its number of sides and its old vertex.
#[derive(Default)]
struct VertexFaces {
    corners: Vec<u32>,
    sides: Vec<usize>,
    vertices: Vec<u32>,
    has_pairs: bool,
}

impl Dual {
    /// Computes the first refinement step, for the control mesh with a topology.
    ///
    /// # Errors
    /// If the mesh is not manifold.
    pub(crate) fn from_topology(topology: &Topology) -> Result<Self, Error> {
        let halves = search_half_edges(&topology.faces, topology.vertices)?;
        Ok(Self::new(halves, topology.rules.boundary))
    }

    /// Computes the step that follows this one: it refines the mesh that this step makes.
    ///
    /// # Errors
    /// If the mesh is not manifold.
    pub(crate) fn next(&self) -> Result<Self, Error> {
        Ok(Self::new(self.finer_halves()?, self.boundary))
    }

    /// Computes the half-edges of the faces that this step makes.
    ///
    /// # Errors
    /// If the refined mesh is not manifold.
    pub(crate) fn finer_halves(&self) -> Result<FinerHalves, Error> {
        let (vertices, faces) = (self.n_finer(), &self.finer);
        if self.has_pairs {
            return search_half_edges(faces, vertices);
        }
        Ok(DualFaces { mesh: &self.mesh, faces, edges: &self.edges, vertices }.connectivity())
    }

    /// The rule for the border of an open mesh.
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
        let around = blocks.map(|(block, starts)| self.collect_vertex_faces(block, starts, rings));
        let around: Vec<VertexFaces> = around.collect();
        fn count(list: fn(&VertexFaces) -> usize, around: &[VertexFaces]) -> usize {
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

    /// Computes the new faces around the vertices of one block. `starts` has a half-edge from each vertex.
    fn collect_vertex_faces(&self, block: usize, starts: &[u32], rings: &Rings) -> VertexFaces {
        let mesh = &self.mesh;
        let mut around = VertexFaces::default();
        for (vertex, &start) in (block * BLOCK..).zip(starts) {
            let is_open = start != NONE && mesh.twin(start) == NONE;
            if start == NONE || is_open && self.boundary == Boundary::None {
                continue;
            }
            let first = around.corners.len();
            if is_open {
                around.corners.extend(self.border_vertex(start, 0));
            }
            rings.fan(mesh, vertex, start, &mut around.corners);
            let last = around.corners[around.corners.len() - 1];
            if is_open {
                around.corners.extend(self.border_vertex(mesh.previous(last), 1));
            }
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

    /// Returns a new vertex on the edge of a half-edge, or `None` if the edge is not on the border. `end` is 0 for the new vertex near the
    /// start of the edge's owner, 1 for the one near the end.
    fn border_vertex(&self, half: u32, end: usize) -> Option<u32> {
        self.on_border(self.mesh.edge_of[half as usize]).map(|points| points[end])
    }

    /// Returns the two new vertices on a border edge: first the one near the start of the edge's owner. Returns `None` for an inner edge.
    fn on_border(&self, edge: u32) -> Option<[u32; 2]> {
        let index = self.border.binary_search(&edge).ok()?;
        let first = (self.mesh.corners().len() + 2 * index) as u32;
        Some([first, first + 1])
    }

    /// The number of vertices of the refined mesh.
    pub(crate) fn n_finer(&self) -> usize {
        self.mesh.corners().len() + 2 * self.border.len()
    }

    /// Computes the positions of the refined vertices.
    pub(crate) fn positions(&self, old: &[Point3<f64>]) -> Vec<Point3<f64>> {
        let (mesh, corners) = (&*self.mesh, self.mesh.corners());
        let mut new: Vec<Point3<f64>> = huge_vec(self.n_finer());
        let (inner, on_border) = new.split_at_mut(corners.len());
        by_faces(&mesh.faces, 0..mesh.faces.len(), inner, |faces, mut to| {
            for face in faces.map(|face| mesh.faces.face(face)) {
                let roots = roots_of_unity(face.len());
                let moments = moments(face, &roots, old);
                for (&corner, turn) in face.iter().zip(&*roots) {
                    let to = to.split_off_first_mut().expect("a place for each corner");
                    *to = interior_vertex(old[corner as usize].coords, &moments, *turn).into();
                }
            }
        });
        for (to, &edge) in on_border.as_chunks_mut::<2>().0.iter_mut().zip(&self.border) {
            let [a, b] = mesh.ends(edge).map(|end| old[end as usize].coords);
            *to = [(a * 0.75 + b * 0.25).into(), (a * 0.25 + b * 0.75).into()];
        }
        new
    }

    /// Refines vertex data: a new vertex gets the mean of four values: at its old corner, at the midpoints of the two edges at this corner,
    /// and at the center of the face.
    pub(crate) fn carry_vertices<T: WeightedMean>(&self, old: &[T]) -> Vec<T> {
        let at_corners: Vec<T> =
            self.mesh.corners().iter().map(|&corner| old[corner as usize]).collect();
        let mut new = self.within_faces(&at_corners);
        for &edge in &self.border {
            let [a, b] = self.mesh.ends(edge).map(|end| old[end as usize]);
            new.extend([mean(a, b, 0.25), mean(a, b, 0.75)]);
        }
        new
    }

    fn within_faces<T: WeightedMean>(&self, old: &[T]) -> Vec<T> {
        let mesh = &self.mesh;
        let mut new = Vec::with_capacity(self.n_finer());
        for face in 0..mesh.faces.len() {
            let old = &old[mesh.faces.first_corner(face)..mesh.faces.first_corner(face + 1)];
            let m = old.len();
            let middle = T::weighted_mean(old.iter().map(|&corner| (1.0 / m as f64, corner)));
            new.extend((0..m).map(|k| {
                let [last, next] = [old[(k + m - 1) % m], old[(k + 1) % m]];
                T::weighted_mean(
                    [(0.5, old[k]), (0.125, last), (0.125, next), (0.25, middle)].into_iter(),
                )
            }));
        }
        new
    }

    /// Interpolates corner data along a half-edge.
    fn interpolate_along<T: WeightedMean>(&self, old: &[T], half: u32, fraction: f64) -> T {
        mean(old[half as usize], old[self.mesh.next(half) as usize], fraction)
    }

    /// Refines corner data. Within an old face, corner data are interpolated like vertex data. A new face across a seam, or around an end
    /// of a seam, gets the data of only one side of the seam, the side of its first half-edge.
    pub(crate) fn carry_corners<T: WeightedMean>(&self, old: &[T]) -> Vec<T> {
        let mesh = &*self.mesh;
        let mut new = self.within_faces(old);
        let inner = new.clone();
        for &edge in &self.edges {
            let [owner, twin] = mesh.halves[edge as usize];
            let next = mesh.next(owner);
            new.extend([inner[next as usize], inner[owner as usize]]);
            let beyond = [
                (owner, self.interpolate_along(old, owner, 0.25)),
                (next, self.interpolate_along(old, owner, 0.75)),
            ];
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
            if !ring.closed {
                new.push(self.interpolate_along(old, ring.halves[0], 0.25));
            }
            new.extend(ring.halves.iter().map(|&half| {
                if old[half as usize] == first { inner[half as usize] } else { first }
            }));
            if !ring.closed {
                let on_border = self.interpolate_along(old, mesh.previous(last), 0.75);
                new.push(if old[last as usize] == first { on_border } else { first });
            }
        }
        new
    }

    /// Returns the old face from which each new face gets its attributes. For a face inside an old face this is the old face, for a face
    /// across an edge the face of the edge's owner, for a face around a vertex the first face of the vertex.
    pub(crate) fn parents(&self) -> Vec<u32> {
        let mesh = &self.mesh;
        let edges = self.edges.iter().map(|&edge| mesh.face_of(mesh.halves[edge as usize][0]));
        let vertices =
            self.vertices.iter().map(|&vertex| mesh.face_of(self.starts[vertex as usize]));
        (0..mesh.faces.len() as u32).chain(edges).chain(vertices).collect()
    }

    /// Returns the memory that this value uses, in bytes.
    pub(crate) fn size(&self) -> usize {
        let lists = self.starts.len() + self.border.len() + self.edges.len() + self.vertices.len();
        self.mesh.size() + self.finer.corners().size() + 4 * lists
    }
}

/// Computes the half-edges of arbitrary faces by searching for shared edges.
fn search_half_edges(faces: &Faces, vertices: usize) -> Result<FinerHalves, Error> {
    let (mesh, starts) = Connectivity::new(faces, vertices)?;
    Ok(FinerHalves { mesh, starts, rings: Rings::default() })
}

/// Computes the new vertices inside the faces.
pub(crate) struct FaceVertices<'a> {
    mesh: &'a Connectivity,
    old: &'a [Point3<f64>],
    /// The [`moments()`] of each face, from which its new vertices follow.
    moments: Vec<[[f64; 3]; 3]>,
}

impl<'a> FaceVertices<'a> {
    pub(crate) fn new(mesh: &'a Connectivity, old: &'a [Point3<f64>]) -> Self {
        let mut of_faces = huge_vec(mesh.faces.len());
        of_faces.par_iter_mut().with_min_len(BLOCK).enumerate().for_each(|(face, to)| {
            let face = mesh.faces.face(face);
            *to = moments(face, &roots_of_unity(face.len()), old);
        });
        Self { mesh, old, moments: of_faces }
    }

    /// Returns the new vertex at the corner where the half-edge `half` starts.
    #[inline]
    pub(crate) fn vertex_at(&self, half: u32) -> Vector3<f64> {
        let (faces, face) = (&self.mesh.faces, self.mesh.face_of(half) as usize);
        let (first, end) = (faces.first_corner(face), faces.first_corner(face + 1));
        let own = self.old[self.mesh.corners()[half as usize] as usize].coords;
        interior_vertex(own, &self.moments[face], root_of_unity(half as usize - first, end - first))
    }
}

/// Computes the terms that all new vertices of a face share: 3/4 of the centroid, and the scaled sums of the corners times cosines and of
/// the corners times sines.
fn moments(face: &[u32], roots: &[[f64; 2]], old: &[Point3<f64>]) -> [[f64; 3]; 3] {
    let mut sums = [Vector3::zeros(); 3];
    for (&corner, [cosine, sine]) in face.iter().zip(roots) {
        let point = old[corner as usize].coords;
        sums[0] += point;
        sums[1] += point * *cosine;
        sums[2] += point * *sine;
    }
    let m = face.len() as f64;
    [sums[0] * (0.75 / m), sums[1] * (0.5 / m), sums[2] * (0.5 / m)].map(Into::into)
}

/// Computes the new vertex for the corner at the position `own`, from the `moments` of its face.
#[inline]
fn interior_vertex(
    own: Vector3<f64>,
    moments: &[[f64; 3]; 3],
    [cosine, sine]: [f64; 2],
) -> Vector3<f64> {
    let [center, a, b] = moments.map(Vector3::from);
    own * 0.25 + center + (a * cosine + b * sine)
}

/// Interpolates linearly: returns `a` for the fraction 0 and `b` for 1.
fn mean<T: WeightedMean>(a: T, b: T, share: f64) -> T {
    T::weighted_mean([(1.0 - share, a), (share, b)].into_iter())
}
