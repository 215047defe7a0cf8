//! Local update: if a few control points move, recomputes only the refined vertices that depend on them, from the control points.
//!
//! A new vertex depends on the faces around the vertex, edge or face that creates it. After all steps a control point therefore affects at
//! most two rings of faces of the control mesh: one ring in the first step, another half in the second, and so on. The *core* consists of
//! these faces; all steps are computed for it. All steps but the last are also computed for the *halo*, the faces around the core. At the
//! outer border of the halo the computed points are wrong, because the faces beyond it are missing. After the first step only the border
//! itself is wrong, after the second the points up to half a face away from it, and so on. The errors do not reach the core.

use std::ops::Range;

use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::*;
use maquette_value::{Faces, Mesh, MeshError};
use nalgebra::Point3;

use super::half_edges::HalfEdges;
use super::primal::Primal;

/// Indices of half-edges, faces or vertices, as ascending ranges.
pub(crate) type Rows = Vec<Range<u32>>;

/// The maximum number of vertices per parallel task.
const BLOCK: usize = 1024;

/// A set of faces of the control mesh, which is refined in each step.
struct Part {
    /// The half-edges, in the control mesh, of the faces in the set.
    halves: Rows,
    /// The vertices of the refined faces of the set, except for some vertices at the border of the set.
    vertices: Rows,
}

/// The core and the halo during the refinement steps.
pub(crate) struct LocalRefinement<'a> {
    control: &'a [Point3<f64>],
    core: Part,
    halo: Part,
    /// The refinement steps taken so far, each with the vertex positions after the step. Positions are valid only in the halo and the core.
    taken: Vec<(&'a Primal, Vec<Point3<f64>>)>,
}

impl Drop for LocalRefinement<'_> {
    fn drop(&mut self) {
        self.taken.drain(..).for_each(|(step, positions)| step.recycle_vertices(positions));
    }
}

impl<'a> LocalRefinement<'a> {
    /// Starts the update after the vertices `moved` of the control mesh have moved. `wider` is the number of additional rings of faces in
    /// the core.
    pub(crate) fn new(
        faces: &Faces,
        control: &'a [Point3<f64>],
        moved: &[u32],
        wider: usize,
    ) -> Self {
        let [core, halo] = surroundings(faces, control.len(), moved, wider);
        Self { control, core, halo, taken: Vec::new() }
    }

    /// Performs the given refinement steps in the core and the halo.
    ///
    /// # Errors
    /// If the evaluation is cancelled.
    pub(crate) fn take(
        &mut self,
        steps: &[&'a Primal],
        progress: &Progress<'_>,
    ) -> Result<(), CancelledError> {
        for step in steps {
            progress.check()?;
            let mut new = self.split(step);
            let (kept_and_split, in_faces) = new.split_at_mut(step.first_middle());
            let (in_faces, old) = (&*in_faces, self.positions());
            let pieces = kept_and_split.par_rows_mut(&self.halo.vertices, BLOCK);
            pieces.for_each(|(row, to)| step.write_row(row, old, in_faces, to));
            let level = self.taken.len();
            self.taken.push((step, new));
            self.halo.add_middles(step, level);
            self.core.add_middles(step, level);
        }
        Ok(())
    }

    /// Performs the last refinement step, in the core only. Returns `refined`, the previous result, with updated positions in the core.
    ///
    /// # Errors
    /// If a position is not finite.
    pub(crate) fn end(mut self, last: &'a Primal, refined: &Mesh) -> Result<Mesh, MeshError> {
        let new = self.split(last);
        let level = self.taken.len();
        self.core.add_middles(last, level);
        let first = last.first_middle();
        let (in_faces, old) = (&new[first..], self.positions());
        let moved = refined.with_moved_by(&self.core.vertices, |row, to| {
            match (row.start as usize).checked_sub(first) {
                Some(face) => to.copy_from_slice(&in_faces[face..face + to.len()]),
                None => last.write_row(row, old, in_faces, to),
            }
        });
        self.taken.push((last, new));
        moved
    }

    /// The vertices of the core, as ranges.
    pub(crate) fn core(&self) -> &Rows {
        &self.core.vertices
    }

    /// Returns all positions after the last step. Only the positions in and around the core are valid.
    pub(crate) fn positions(&self) -> &[Point3<f64>] {
        self.taken.last().map_or(self.control, |(_, positions)| positions)
    }

    /// Adds the new vertices on edges to the core and the halo. Returns a list for the positions after the step, in which the new vertices
    /// inside faces are already set.
    fn split(&mut self, step: &Primal) -> Vec<Point3<f64>> {
        let (level, old) = (self.taken.len(), self.positions());
        let mut new = step.allocate_vertices();
        let faces = self.halo.faces(step, level);
        let pieces = new[step.first_middle()..].par_rows_mut(&faces, BLOCK);
        pieces.for_each(|(faces, to)| {
            faces.zip(to).for_each(|(face, to)| *to = step.centroid(face, old));
        });
        self.core.add_edges(step, level);
        self.halo.add_edges(step, level);
        new
    }
}

impl Part {
    /// Returns the half-edges that the part's faces have after `level` steps. In both schemes a step gives each face four times as many
    /// half-edges.
    fn finer(&self, level: usize) -> impl Iterator<Item = Range<u32>> {
        self.halves.iter().map(move |row| row.start << (2 * level)..row.end << (2 * level))
    }

    /// Returns the part's faces after `level` steps, to which `step` is applied next. Returns nothing if the step makes no vertices inside
    /// faces.
    fn faces(&self, step: &Primal, level: usize) -> Rows {
        let mesh = &step.level.mesh;
        let rows = self.finer(level).filter(|_| step.has_middles());
        rows.map(|row| mesh.face_of(row.start)..mesh.face_of(row.end - 1) + 1).collect()
    }

    /// Adds to `vertices` the new vertices that the step makes on the edges of the part's faces. Edges are numbered by their owners, so
    /// consecutive faces own consecutive edges. Each edge between two of the faces is owned by one of them and is thus included.
    fn add_edges(&mut self, step: &Primal, level: usize) {
        let mesh = &step.level.mesh;
        fn edge(half: u32, mesh_halves: &[[u32; 2]]) -> usize {
            mesh_halves.partition_point(|[owner, _]| *owner < half)
        }
        fn vertex(half: u32, mesh_vertices: usize, mesh_halves: &[[u32; 2]]) -> u32 {
            (mesh_vertices + edge(half, mesh_halves)) as u32
        }
        let rows = Rows::from_iter(self.finer(level).map(|row| {
            vertex(row.start, mesh.vertices, &mesh.halves)
                ..vertex(row.end, mesh.vertices, &mesh.halves)
        }));
        self.vertices.extend(rows);
    }

    /// Adds to `vertices` the new vertices that the step makes inside the part's faces.
    fn add_middles(&mut self, step: &Primal, level: usize) {
        let first = step.first_middle() as u32;
        let rows = self.faces(step, level).into_iter();
        self.vertices.extend(rows.map(|row| first + row.start..first + row.end));
    }
}

/// Finds the faces of the core and of the halo.
fn surroundings(faces: &Faces, vertices: usize, moved: &[u32], wider: usize) -> [Part; 2] {
    let mut is_near = vec![false; vertices];
    moved.iter().for_each(|&vertex| is_near[vertex as usize] = true);
    for _ in 0..=wider {
        grow(faces, &mut is_near);
    }
    [(); 2].map(|()| grow(faces, &mut is_near))
}

/// Finds the faces that have a marked vertex, and marks all vertices of these faces.
fn grow(faces: &Faces, is_near: &mut [bool]) -> Part {
    let near: Vec<u32> = (0..faces.len() as u32)
        .filter(|&face| faces.face(face as usize).iter().any(|&vertex| is_near[vertex as usize]))
        .collect();
    for &face in &near {
        faces.face(face as usize).iter().for_each(|&vertex| is_near[vertex as usize] = true);
    }
    let halves = to_ranges(&near).into_iter().map(|row| {
        let [start, end] =
            [row.start, row.end].map(|face| faces.first_corner(face as usize) as u32);
        start..end
    });
    let vertices: Vec<u32> =
        (0..is_near.len() as u32).filter(|&vertex| is_near[vertex as usize]).collect();
    Part { halves: halves.collect(), vertices: to_ranges(&vertices) }
}

/// Converts ascending numbers to ranges.
fn to_ranges(numbers: &[u32]) -> Rows {
    let rows = numbers.chunk_by(|a, b| a + 1 == *b);
    rows.map(|row| row[0]..row[row.len() - 1] + 1).collect()
}
