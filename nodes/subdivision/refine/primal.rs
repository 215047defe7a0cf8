//! One step of a primal scheme (Loop or Catmull-Clark): the part that depends only on the topology, and its application.

use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use maquette_base::linear::stencils::Stencils;
use maquette_base::linear::weighted_mean::WeightedMean;
use maquette_value::Faces;
use maquette_value::memory::{huge_vec, sparse_vec};
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::connectivity::Connectivity;
use super::final_mesh::FinalMesh;
use super::half_edges::HalfEdges;
use super::level::{BLOCK, Level, VertexInput, fetch};
use super::split::{Corners, Split, Triangles, split_faces};
use crate::masks::regular_rules::{QuadMesh, RegularRules, TriangleMesh, Walk};
use crate::masks::sharpness::Sharpness;
use crate::masks::vertex_rings::{RingMasks, Scratch};
use crate::rules::Rules;
use crate::scheme::PrimalScheme;

/// A step of a primal scheme for a fixed topology.
#[derive(Debug)]
pub(crate) struct Primal {
    /// The mesh that this step refines.
    pub(crate) level: Arc<Level>,
    /// The new vertices that need matrix rows: those of odd (irregular or sharp) vertices, and those on sharp edges.
    odd_rows: Vec<u32>,
    /// The matrix rows of the vertices in `odd_rows`. The columns are the old vertices, followed by the new vertices inside faces.
    stencils: Stencils,
    /// The faces of the mesh after this refinement step.
    pub(crate) finer: Faces,
    /// A buffer for the positions of new vertices, kept from an earlier call for reuse; `None` if no call has left one.
    left: Mutex<Option<Vec<Point3<f64>>>>,
}

impl Primal {
    /// Computes the refinement step that is applied to the mesh `level`.
    pub(crate) fn new(level: Arc<Level>) -> Self {
        match level.rules.scheme {
            PrimalScheme::Loop => Self::from_level(level, Triangles),
            PrimalScheme::CatmullClark => Self::from_level(level, Corners),
        }
    }

    fn from_level<K: RegularRules>(level: Arc<Level>, kind: K) -> Self {
        let Level { rules, mesh, creases, odd, .. } = &*level;
        let sharpness = Sharpness::new(mesh, *rules, creases);
        let stars = RingMasks {
            mesh,
            sharpness: &sharpness,
            rules: rules.of_edges(),
            masks: K::Masks::default(),
        };
        let items = odd.len() + creases.len();
        let (stencils, _) = Stencils::build(items, |scratch: &mut Scratch, item, rows| {
            match odd.get(item) {
                Some(&[vertex, start]) => stars.vertex(scratch, vertex, start, rows),
                None => stars.edge(creases[item - odd.len()].0, rows),
            }
            rows.end();
        });
        let kept = mesh.vertices as u32;
        let on_edges = creases.iter().map(|(edge, _)| kept + edge);
        let odd_rows = odd.iter().map(|[vertex, _]| *vertex).chain(on_edges).collect();
        let finer = split_faces(mesh, kind);
        Self { level, odd_rows, stencils, finer, left: Mutex::new(None) }
    }

    /// Returns the mesh after this refinement step, for use by a further step.
    pub(crate) fn next(&self) -> Level {
        Level::from_coarser(&self.level, &self.finer)
    }

    /// Returns the mesh after this step, for use if this is the last step: its half-edges are not stored.
    pub(crate) fn final_mesh(&self) -> FinalMesh {
        FinalMesh::from_coarser(self.level.clone(), self.finer.clone())
    }

    /// The number of vertices of the refined mesh.
    pub(crate) fn n_finer(&self) -> usize {
        match self.level.rules.scheme {
            PrimalScheme::Loop => Triangles.vertices(&self.level.mesh),
            PrimalScheme::CatmullClark => Corners.vertices(&self.level.mesh),
        }
    }

    /// The index of the first new vertex inside a face, or the number of all new vertices if the scheme makes no vertices inside faces.
    pub(crate) fn first_middle(&self) -> usize {
        self.level.mesh.vertices + self.level.mesh.halves.len()
    }

    /// Returns a list for the new vertices with arbitrary contents, for callers that write and read only a few entries. Memory pages that
    /// are not written need no physical memory.
    pub(crate) fn allocate_vertices(&self) -> Vec<Point3<f64>> {
        let left = self.left.lock().unwrap_or_else(PoisonError::into_inner).take();
        left.unwrap_or_else(|| sparse_vec(self.n_finer()))
    }

    /// Keeps a list for the next call of [`Self::allocate_vertices`], which will then probably write to memory pages that exist already.
    pub(crate) fn recycle_vertices(&self, list: Vec<Point3<f64>>) {
        *self.left.lock().unwrap_or_else(PoisonError::into_inner) = Some(list);
    }

    /// Returns the creases of the refined mesh, sorted by their vertices.
    pub(crate) fn finer_creases(&self) -> Vec<([u32; 2], f64)> {
        refined_creases(&self.level.mesh, self.level.rules, &self.level.creases)
    }

    /// Computes the positions of all vertices after this step, given the positions `old` before the step.
    pub(crate) fn positions(&self, old: &[Point3<f64>]) -> Vec<Point3<f64>> {
        match self.level.rules.scheme {
            PrimalScheme::Loop => self.refine(old, Triangles),
            PrimalScheme::CatmullClark => self.refine(old, Corners),
        }
    }

    fn refine(&self, old: &[Point3<f64>], kind: impl RegularRules) -> Vec<Point3<f64>> {
        match self.level.mesh.faces.sides() {
            Some(3) => self.refine_along(old, kind, &TriangleMesh),
            Some(4) => self.refine_along(old, kind, &QuadMesh),
            _ => self.refine_along(old, kind, &self.level.mesh.turns),
        }
    }

    fn refine_along(
        &self,
        old: &[Point3<f64>],
        kind: impl RegularRules,
        walk: &impl Walk,
    ) -> Vec<Point3<f64>> {
        let corners = self.level.mesh.corners();
        let mut new: Vec<Point3<f64>> = huge_vec(self.n_finer());
        let (kept, rest) = new.split_at_mut(old.len());
        let (on_edges, in_faces) = rest.split_at_mut(self.level.mesh.halves.len());
        self.centroids(old, in_faces);
        let in_faces = &in_faces[..];
        let blocks = on_edges.par_chunks_mut(BLOCK).zip(self.level.mesh.halves.par_chunks(BLOCK));
        blocks.for_each(|(new, halves)| {
            let owners = [halves[0][0], halves[halves.len() - 1][0]];
            let [first, last] = owners.map(|half| walk.face(half) as usize);
            fetch(in_faces, first..last);
            for (new, &halves) in new.iter_mut().zip(halves) {
                *new = kind.on_edge(walk, corners, halves, old, in_faces);
            }
        });
        let nothing = &mut vec![(); kept.len()][..];
        let around = VertexInput { corners, positions: old, in_faces };
        self.level.at_regular(around, (kept, nothing), kind, |vertex, halves| {
            let neighbors = halves.iter().map(|&h| old[corners[walk.next(h) as usize] as usize]);
            let faces = halves.iter().map(|&half| in_faces[walk.face(half) as usize]);
            (kind.regular(old[vertex], neighbors, faces), ())
        });
        let rows = (0..self.stencils.len()).into_par_iter().with_min_len(BLOCK);
        let odd: Vec<Point3<f64>> = rows
            .map(|row| self.stencils.point(row, |column| column_point(column, old, in_faces)))
            .collect();
        self.odd_rows.iter().zip(odd).for_each(|(&row, point)| new[row as usize] = point);
        new
    }

    /// Returns the new vertex of the old vertex at the start of a half-edge, and a new half-edge from the new vertex.
    pub(crate) fn at_start(&self, half: u32) -> [u32; 2] {
        let vertex = self.level.mesh.corners()[half as usize];
        match self.level.rules.scheme {
            PrimalScheme::Loop => [vertex, Triangles.first_half(half)],
            PrimalScheme::CatmullClark => [vertex, Corners.first_half(half)],
        }
    }

    /// Returns the new vertex on the edge of a half-edge, and a new half-edge from the new vertex.
    pub(crate) fn on_edge(&self, half: u32) -> [u32; 2] {
        let mesh = &self.level.mesh;
        let vertex = mesh.vertices as u32 + mesh.edge_of[half as usize];
        match self.level.rules.scheme {
            PrimalScheme::Loop => [vertex, Triangles.second(mesh, half)],
            PrimalScheme::CatmullClark => [vertex, Corners.second(mesh, half)],
        }
    }

    /// Returns the new vertex inside a face and a new half-edge from this vertex; `None` if the scheme makes no vertices inside faces.
    pub(crate) fn middle(&self, face: u32) -> Option<[u32; 2]> {
        let mesh = &self.level.mesh;
        let vertex = (mesh.vertices + mesh.halves.len()) as u32 + face;
        let half = 4 * mesh.faces.first_corner(face as usize) as u32 + 2;
        self.level.rules.scheme.has_middles().then_some([vertex, half])
    }

    /// Computes the position of one new vertex, equal bit for bit to the result of [`Self::positions`]. `new` must already contain the new
    /// vertices inside the faces around this vertex.
    pub(crate) fn vertex_position(
        &self,
        vertex: u32,
        old: &[Point3<f64>],
        new: &[Point3<f64>],
    ) -> Point3<f64> {
        match self.level.rules.scheme {
            PrimalScheme::Loop => self.vertex_position_by(vertex, old, new, Triangles),
            PrimalScheme::CatmullClark => self.vertex_position_by(vertex, old, new, Corners),
        }
    }

    fn vertex_position_by<K: RegularRules>(
        &self,
        vertex: u32,
        old: &[Point3<f64>],
        new: &[Point3<f64>],
        kind: K,
    ) -> Point3<f64> {
        let Level { mesh, creases, odd, .. } = &*self.level;
        let in_faces = &new[old.len() + mesh.halves.len()..];
        let Some(born) = (vertex as usize).checked_sub(old.len()) else {
            if let Ok(row) = odd.binary_search_by_key(&vertex, |odd| odd[0]) {
                return self.stencils.point(row, |column| column_point(column, old, in_faces));
            }
            let halves = self.level.ring_of(vertex as usize, kind);
            let halves = &halves[..K::VALENCE];
            let neighbors =
                halves.iter().map(|&h| old[mesh.corners()[mesh.next(h) as usize] as usize]);
            let faces = halves.iter().map(|&half| in_faces[mesh.face_of(half) as usize]);
            return kind.regular(old[vertex as usize], neighbors, faces);
        };
        let Some(&halves) = mesh.halves.get(born) else {
            return centroid(&mesh.faces, born - mesh.halves.len(), old);
        };
        match creases.binary_search_by_key(&(born as u32), |crease| crease.0) {
            Ok(crease) => self
                .stencils
                .point(odd.len() + crease, |column| column_point(column, old, in_faces)),
            Err(_) => kind.on_edge(&mesh.turns, mesh.corners(), halves, old, in_faces),
        }
    }

    /// Computes the positions of consecutive new vertices, either all at old vertices or all on edges, equal bit for bit to the result of
    /// [`Self::positions`]. The old vertices and the new vertices inside the surrounding faces must be valid.
    pub(crate) fn write_row(
        &self,
        row: Range<u32>,
        old: &[Point3<f64>],
        in_faces: &[Point3<f64>],
        to: &mut [Point3<f64>],
    ) {
        match self.level.rules.scheme {
            PrimalScheme::Loop => self.write(row, old, in_faces, to, (Triangles, &TriangleMesh)),
            PrimalScheme::CatmullClark => match self.level.mesh.faces.sides() {
                Some(4) => self.write(row, old, in_faces, to, (Corners, &QuadMesh)),
                _ => self.write(row, old, in_faces, to, (Corners, &self.level.mesh.turns)),
            },
        }
    }

    fn write<K: RegularRules>(
        &self,
        row: Range<u32>,
        old: &[Point3<f64>],
        in_faces: &[Point3<f64>],
        to: &mut [Point3<f64>],
        (kind, walk): (K, &impl Walk),
    ) {
        let Level { mesh, creases, odd, .. } = &*self.level;
        let (corners, kept) = (mesh.corners(), old.len() as u32);
        let Some(first) = row.start.checked_sub(kept) else {
            let first = odd.partition_point(|odd| odd[0] < row.start);
            let mut odd = (first..).zip(&odd[first..]).peekable();
            for (vertex, to) in row.zip(to) {
                if let Some((item, _)) = odd.next_if(|(_, odd)| odd[0] == vertex) {
                    *to = self.stencils.point(item, |column| column_point(column, old, in_faces));
                    continue;
                }
                let halves = self.level.ring_of(vertex as usize, kind);
                let halves = &halves[..K::VALENCE];
                let neighbors =
                    halves.iter().map(|&h| old[corners[walk.next(h) as usize] as usize]);
                let faces = halves.iter().map(|&half| in_faces[walk.face(half) as usize]);
                *to = kind.regular(old[vertex as usize], neighbors, faces);
            }
            return;
        };
        let edges = first..row.end - kept;
        for (to, &halves) in to.iter_mut().zip(&mesh.halves[first as usize..edges.end as usize]) {
            *to = kind.on_edge(walk, corners, halves, old, in_faces);
        }
        let [from, end] =
            [edges.start, edges.end].map(|edge| creases.partition_point(|crease| crease.0 < edge));
        for (item, (edge, _)) in (from..).zip(&creases[from..end]) {
            to[(edge - first) as usize] =
                self.stencils.point(odd.len() + item, |column| column_point(column, old, in_faces));
        }
    }

    /// Returns true if the scheme makes new vertices inside faces.
    pub(crate) fn has_middles(&self) -> bool {
        self.level.rules.scheme.has_middles()
    }

    /// The centroid of a face.
    pub(crate) fn centroid(&self, face: u32, old: &[Point3<f64>]) -> Point3<f64> {
        centroid(&self.level.mesh.faces, face as usize, old)
    }

    /// Writes the centroids of the first faces, one for each entry of `to`.
    fn centroids(&self, old: &[Point3<f64>], to: &mut [Point3<f64>]) {
        let faces = &self.level.mesh.faces;
        to.par_chunks_mut(BLOCK).enumerate().for_each(|(block, to)| {
            if faces.sides() == Some(4) {
                let quads = faces.corners()[4 * BLOCK * block..].as_chunks::<4>().0;
                for (to, quad) in to.iter_mut().zip(quads) {
                    let [a, b, c, d] = quad.each_ref().map(|&corner| old[corner as usize].coords);
                    *to = (((a + b) + (c + d)) * 0.25).into();
                }
            } else {
                (BLOCK * block..).zip(to).for_each(|(face, to)| *to = centroid(faces, face, old));
            }
        });
    }

    /// Refines vertex data, linearly along old edges and within old faces.
    pub(crate) fn carry_vertices<T: WeightedMean>(&self, old: &[T]) -> Vec<T> {
        let mut new = Vec::with_capacity(self.n_finer());
        new.extend_from_slice(old);
        carry_on_edges(&self.level.mesh, old, &mut new);
        if self.level.rules.scheme.has_middles() {
            let faces = (0..self.level.mesh.faces.len()).into_par_iter().with_min_len(BLOCK);
            let middles = faces.map(|face| {
                let face = self.level.mesh.faces.face(face);
                let weight = 1.0 / face.len() as f64;
                T::weighted_mean(face.iter().map(|&corner| (weight, old[corner as usize])))
            });
            middles.collect_into(&mut new);
        }
        new
    }

    /// Refines corner data, linearly within old faces.
    pub(crate) fn carry_corners<T: WeightedMean>(&self, old: &[T]) -> Vec<T> {
        if self.level.rules.scheme.needs_triangles() {
            return carry_triangle_corners(old);
        }
        let faces = (0..self.level.mesh.faces.len()).into_par_iter().with_min_len(BLOCK);
        faces
            .flat_map_iter(|face| {
                let first = self.level.mesh.faces.first_corner(face);
                let old = &old[first..self.level.mesh.faces.first_corner(face + 1)];
                let weight = 1.0 / old.len() as f64;
                let middle = T::weighted_mean(old.iter().map(|&corner| (weight, corner)));
                (0..old.len()).flat_map(move |k| {
                    let [last, next] = [k + old.len() - 1, k + 1].map(|k| old[k % old.len()]);
                    [old[k], midpoint(old[k], next), middle, midpoint(last, old[k])]
                })
            })
            .collect()
    }

    /// Returns, for each new face, the index of the old face from which it was made.
    pub(crate) fn parents(&self) -> Vec<u32> {
        match self.level.rules.scheme {
            PrimalScheme::Loop => (0..self.finer.len() as u32).map(|face| face / 4).collect(),
            PrimalScheme::CatmullClark => {
                (0..self.finer.len() as u32).map(|half| self.level.mesh.face_of(half)).collect()
            }
        }
    }

    /// Returns the memory that this value uses, in bytes.
    pub(crate) fn size(&self) -> usize {
        self.level.size() + self.finer.corners().size() + self.stencils.size()
    }
}

/// Returns the creases of the mesh after a step that divides each edge into two, sorted by their vertices. New vertices on edges come after
/// the old vertices.
pub(super) fn refined_creases<S>(
    mesh: &Connectivity,
    rules: Rules<S>,
    creases: &[(u32, f64)],
) -> Vec<([u32; 2], f64)> {
    let sharpness = Sharpness::new(mesh, rules, creases);
    // The old edge `e` is divided into two new edges, numbered `2 e` and `2 e + 1`.
    let refined = sharpness.refine(|edge| [2 * edge, 2 * edge + 1]);
    let lasting = refined.into_iter().filter(|(_, sharpness)| sharpness.is_finite());
    let by_vertices = lasting.map(|(half, sharpness)| {
        let end = mesh.ends(half / 2)[half as usize % 2];
        ([end, mesh.vertices as u32 + half / 2], sharpness)
    });
    let mut creases: Vec<_> = by_vertices.collect();
    creases.sort_unstable_by_key(|(ends, _)| *ends);
    creases
}

/// Appends the means of vertex data at the ends of each edge.
pub(super) fn carry_on_edges<T: WeightedMean>(mesh: &Connectivity, old: &[T], new: &mut Vec<T>) {
    let halves = mesh.halves.par_iter().with_min_len(BLOCK);
    let middles = halves.map(|[owner, _]| {
        let mut ends = [*owner, mesh.next(*owner)].map(|half| mesh.corners()[half as usize]);
        ends.sort_unstable();
        T::weighted_mean(ends.into_iter().map(|end| (0.5, old[end as usize])))
    });
    middles.collect_into(new);
}

/// Refines the corner data of triangles, linearly within each.
pub(super) fn carry_triangle_corners<T: WeightedMean>(old: &[T]) -> Vec<T> {
    let triangles = old.par_chunks_exact(3).with_min_len(BLOCK);
    triangles
        .flat_map_iter(|old| {
            let [a, b, c] = [old[0], old[1], old[2]];
            let [ab, bc, ca] = [midpoint(a, b), midpoint(b, c), midpoint(c, a)];
            [a, ab, ca, b, bc, ab, c, ca, bc, ab, bc, ca]
        })
        .collect()
}

/// Returns the point of a matrix column: an old vertex, or a new vertex inside a face.
fn column_point(column: u32, old: &[Point3<f64>], in_faces: &[Point3<f64>]) -> Point3<f64> {
    match old.get(column as usize) {
        Some(point) => *point,
        None => in_faces[column as usize - old.len()],
    }
}

/// The mean of two attribute values.
fn midpoint<T: WeightedMean>(a: T, b: T) -> T {
    T::weighted_mean([(0.5, a), (0.5, b)].into_iter())
}

/// The mean of the corners of a face.
fn centroid(faces: &Faces, face: usize, positions: &[Point3<f64>]) -> Point3<f64> {
    let face = faces.face(face);
    let at = |&corner: &u32| positions[corner as usize].coords;
    if let [a, b, c, d] = face
        && faces.sides() == Some(4)
    {
        return (((at(a) + at(b)) + (at(c) + at(d))) * 0.25).into();
    }
    (face.iter().map(at).sum::<Vector3<f64>>() / face.len() as f64).into()
}
