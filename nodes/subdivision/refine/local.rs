//! Where a few control points move, what they reach after all steps, computed from the control points alone.
//!
//! A new vertex depends on the faces around the place where it is born. So after all steps a control point reaches at most two faces of
//! the control mesh far: one in the first step, a half in the second, and so on. What is computed is the parts of these faces, the
//! *core*, and before the last step also those of the faces around them, the *halo*. At the rim of the halo points are wrong, because
//! what is outside is not there: at the rim itself after the first step, a half of a face far after the second, and so on; this does
//! not come as far as to the core.

use std::ops::Range;

use maquette_node::{Cancelled, Progress};
use maquette_value::parallel::*;
use maquette_value::{Faces, Mesh, MeshError};
use nalgebra::Point3;

use super::half_edges::HalfEdges;
use super::primal::Primal;

/// Half-edges, faces or vertices, in rows that ascend.
pub(crate) type Rows = Vec<Range<u32>>;

/// Vertices that one task computes at most.
const BLOCK: usize = 1024;

/// Some faces of the control mesh on their way through the steps.
struct Part {
    /// Their half-edges in the control mesh.
    halves: Rows,
    /// The vertices of their parts, but for some at the rim.
    vertices: Rows,
}

/// Core and halo on their way through the steps.
pub(crate) struct Front<'a> {
    control: &'a [Point3<f64>],
    core: Part,
    halo: Part,
    /// The steps that were taken, with the places after each: they are there in the halo, elsewhere is anything.
    taken: Vec<(&'a Primal, Vec<Point3<f64>>)>,
}

impl Drop for Front<'_> {
    fn drop(&mut self) {
        self.taken.drain(..).for_each(|(step, places)| step.leave(places));
    }
}

impl<'a> Front<'a> {
    /// Where these vertices of the control mesh have moved; the core is wider by so many faces more.
    pub(crate) fn new(
        faces: &Faces,
        control: &'a [Point3<f64>],
        moved: &[u32],
        wider: usize,
    ) -> Self {
        let [core, halo] = surroundings(faces, control.len(), moved, wider);
        Self { control, core, halo, taken: Vec::new() }
    }

    /// Takes some steps.
    ///
    /// # Errors
    /// If the evaluation is told to stop.
    pub(crate) fn take(
        &mut self,
        steps: &[&'a Primal],
        progress: &Progress<'_>,
    ) -> Result<(), Cancelled> {
        for step in steps {
            progress.check()?;
            let mut new = self.split(step);
            let (kept_and_split, in_faces) = new.split_at_mut(step.first_middle());
            let (in_faces, old) = (&*in_faces, self.places());
            let pieces = kept_and_split.par_rows_mut(&self.halo.vertices, BLOCK);
            pieces.for_each(|(row, to)| step.write_row(row, old, in_faces, to));
            let level = self.taken.len();
            self.taken.push((step, new));
            self.halo.add_middles(step, level);
            self.core.add_middles(step, level);
        }
        Ok(())
    }

    /// Takes the last step, in the core alone: `refined` with the places that it comes to.
    ///
    /// # Errors
    /// If one of them is not finite.
    pub(crate) fn end(mut self, last: &'a Primal, refined: &Mesh) -> Result<Mesh, MeshError> {
        let new = self.split(last);
        let level = self.taken.len();
        self.core.add_middles(last, level);
        let first = last.first_middle();
        let (in_faces, old) = (&new[first..], self.places());
        let moved = refined.with_moved_by(&self.core.vertices, |row, to| {
            match (row.start as usize).checked_sub(first) {
                Some(face) => to.copy_from_slice(&in_faces[face..face + to.len()]),
                None => last.write_row(row, old, in_faces, to),
            }
        });
        self.taken.push((last, new));
        moved
    }

    /// The vertices of the core, in rows.
    pub(crate) fn core(&self) -> &Rows {
        &self.core.vertices
    }

    /// All places, of which those in the core and around it are there.
    pub(crate) fn places(&self) -> &[Point3<f64>] {
        self.taken.last().map_or(self.control, |(_, places)| places)
    }

    /// Adds the new vertices on edges to core and halo; a list for the places after the step, in which those inside of faces are.
    fn split(&mut self, step: &Primal) -> Vec<Point3<f64>> {
        let (level, old) = (self.taken.len(), self.places());
        let mut new = step.left();
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
    /// Their half-edges after so many steps: both schemes make four of each.
    fn finer(&self, level: usize) -> impl Iterator<Item = Range<u32>> {
        self.halves.iter().map(move |row| row.start << (2 * level)..row.end << (2 * level))
    }

    /// Their parts before a step, if it makes vertices inside of them.
    fn faces(&self, step: &Primal, level: usize) -> Rows {
        let mesh = &step.level.mesh;
        let rows = self.finer(level).filter(|_| step.has_middles());
        rows.map(|row| mesh.face_of(row.start)..mesh.face_of(row.end - 1) + 1).collect()
    }

    /// Adds the new vertices on edges: since edges are numbered by their owners, those that faces in a row own are in a row, and those
    /// between two of the faces are among them.
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

    /// Adds the new vertices inside of faces.
    fn add_middles(&mut self, step: &Primal, level: usize) {
        let first = step.first_middle() as u32;
        let rows = self.faces(step, level).into_iter();
        self.vertices.extend(rows.map(|row| first + row.start..first + row.end));
    }
}

/// Core and halo.
fn surroundings(faces: &Faces, vertices: usize, moved: &[u32], wider: usize) -> [Part; 2] {
    let mut is_near = vec![false; vertices];
    moved.iter().for_each(|&vertex| is_near[vertex as usize] = true);
    let mut grow = || {
        let near =
            |face: &u32| faces.face(*face as usize).iter().any(|&vertex| is_near[vertex as usize]);
        let near: Vec<_> = (0..faces.len() as u32).filter(near).collect();
        let corners = near.iter().flat_map(|&face| faces.face(face as usize));
        corners.for_each(|&vertex| is_near[vertex as usize] = true);
        fn corner(face: u32, faces: &Faces) -> u32 {
            faces.first_corner(face as usize) as u32
        }
        let halves =
            in_rows(&near).into_iter().map(|row| corner(row.start, faces)..corner(row.end, faces));
        let vertices = (0..vertices as u32).filter(|&vertex| is_near[vertex as usize]);
        Part { halves: halves.collect(), vertices: in_rows(&Vec::from_iter(vertices)) }
    };
    for _ in 0..=wider {
        grow();
    }
    [grow(), grow()]
}

/// Ascending numbers, those in a row together.
fn in_rows(numbers: &[u32]) -> Rows {
    let rows = numbers.chunk_by(|a, b| a + 1 == *b);
    rows.map(|row| row[0]..row[row.len() - 1] + 1).collect()
}
