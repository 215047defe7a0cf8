//! Where a few control points move, what they reach after all steps, computed from the control points alone.
//!
//! A new vertex depends on the faces around the place where it is born. So after all steps a control point reaches at most two faces of
//! the control mesh far: one in the first step, a half in the second, and so on. What is computed is the parts of these faces, the
//! *core*, and before the last step also those of the faces around them, the *halo*. At the rim of the halo points are wrong, because
//! what is outside is not there: at the rim itself after the first step, a half of a face far after the second, and so on; this does
//! not come as far as to the core.

use std::ops::Range;

use maquette::memory::{huge_vec, sparse_vec};
use maquette::parallel::*;
use maquette::value::Faces;
use maquette::{Cancelled, Progress};
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
    /// How many steps were taken.
    level: usize,
    /// After a step the places in the halo; elsewhere there are zeros.
    places: Option<Vec<Point3<f64>>>,
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
        Self { control, core, halo, level: 0, places: None }
    }

    /// Takes some steps.
    ///
    /// # Errors
    /// If the evaluation is told to stop.
    pub(crate) fn take(
        &mut self,
        steps: &[&Primal],
        progress: &Progress<'_>,
    ) -> Result<(), Cancelled> {
        for step in steps {
            progress.check()?;
            let in_faces = self.split(step);
            let made = computed(step, self.places(), &in_faces, &self.halo.vertices);
            let mut new: Vec<Point3<f64>> = sparse_vec(step.n_finer());
            let mut rest = &made[..];
            for row in &self.halo.vertices {
                let (places, behind) = rest.split_at(row.len());
                new[row.start as usize..row.end as usize].copy_from_slice(places);
                rest = behind;
            }
            let first = new.len() - in_faces.len();
            new[first..].copy_from_slice(&in_faces);
            self.places = Some(new);
            self.halo.add_middles(step, self.level);
            self.core.add_middles(step, self.level);
            self.level += 1;
        }
        Ok(())
    }

    /// Takes the last step, in the core alone: its vertices in rows, and their places one row after the other.
    pub(crate) fn end(mut self, last: &Primal) -> (Rows, Vec<Point3<f64>>) {
        let in_faces = self.split(last);
        let mut made = computed(last, self.places(), &in_faces, &self.core.vertices);
        for row in self.core.faces(last, self.level) {
            made.extend_from_slice(&in_faces[row.start as usize..row.end as usize]);
        }
        self.core.add_middles(last, self.level);
        (self.core.vertices, made)
    }

    /// The vertices of the core, in rows.
    pub(crate) fn core(&self) -> &Rows {
        &self.core.vertices
    }

    /// All places, of which those in the core and around it are there.
    pub(crate) fn places(&self) -> &[Point3<f64>] {
        self.places.as_deref().unwrap_or(self.control)
    }

    /// Adds the new vertices on edges to core and halo; those inside of faces.
    fn split(&mut self, step: &Primal) -> Vec<Point3<f64>> {
        let in_faces = middles(step, self.places(), &self.halo.faces(step, self.level));
        self.core.add_edges(step, self.level);
        self.halo.add_edges(step, self.level);
        in_faces
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
        let edge = |half: u32| mesh.halves.partition_point(|[owner, _]| *owner < half);
        let vertex = |half: u32| (mesh.vertices + edge(half)) as u32;
        let rows = Rows::from_iter(self.finer(level).map(|row| vertex(row.start)..vertex(row.end)));
        self.vertices.extend(rows);
    }

    /// Adds the new vertices inside of faces.
    fn add_middles(&mut self, step: &Primal, level: usize) {
        let first = (step.level.mesh.vertices + step.level.mesh.halves.len()) as u32;
        let rows = self.faces(step, level).into_iter();
        self.vertices.extend(rows.map(|row| first + row.start..first + row.end));
    }
}

/// The new vertices in these faces; those of the other faces are zeros.
fn middles(step: &Primal, old: &[Point3<f64>], faces: &Rows) -> Vec<Point3<f64>> {
    let count = if step.has_middles() { step.level.mesh.faces.len() } else { 0 };
    let mut middles = sparse_vec(count);
    for row in faces {
        let to = &mut middles[row.start as usize..row.end as usize];
        let to = to.par_iter_mut().enumerate().with_min_len(BLOCK);
        to.for_each(|(k, to)| *to = step.centroid(row.start + k as u32, old));
    }
    middles
}

/// The places of these new vertices, one row after the other.
fn computed(
    step: &Primal,
    old: &[Point3<f64>],
    in_faces: &[Point3<f64>],
    rows: &Rows,
) -> Vec<Point3<f64>> {
    let mut places = huge_vec(rows.iter().map(ExactSizeIterator::len).sum());
    let (mut rest, mut pieces) = (&mut places[..], Vec::new());
    for row in rows {
        let starts = row.clone().step_by(BLOCK);
        for piece in starts.map(|start| start..row.end.min(start + BLOCK as u32)) {
            let (to, behind) = rest.split_at_mut(piece.len());
            pieces.push((piece, to));
            rest = behind;
        }
    }
    pieces.into_par_iter().for_each(|(row, to)| step.write_row(row, old, in_faces, to));
    places
}

/// Core and halo.
fn surroundings(faces: &Faces, vertices: usize, moved: &[u32], wider: usize) -> [Part; 2] {
    let mut is_near = vec![false; vertices];
    moved.iter().for_each(|&vertex| is_near[vertex as usize] = true);
    let mut grow = || {
        let near =
            |face: &u32| faces.face(*face as usize).iter().any(|&vertex| is_near[vertex as usize]);
        let near = Vec::from_iter((0..faces.len() as u32).filter(near));
        let corners = near.iter().flat_map(|&face| faces.face(face as usize));
        corners.for_each(|&vertex| is_near[vertex as usize] = true);
        let corner = |face: u32| faces.first_corner(face as usize) as u32;
        let halves = in_rows(&near).into_iter().map(|row| corner(row.start)..corner(row.end));
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
