//! Where a few control points move, what they reach after all steps, computed from the control points alone.
//!
//! A new vertex depends on the faces around the place where it is born. So after all steps a control point reaches at most two faces of
//! the control mesh far: one in the first step, a half in the second, and so on. What is computed is the parts of these faces, the
//! *core*, and before the last step also those of the faces around them, the *halo*. At the rim of the halo points are wrong, because
//! what is outside is not there: at the rim itself after the first step, a half of a face far after the second, and so on; this does
//! not come as far as to the core.

use std::ops::Range;

use maquette::memory::sparse_vec;
use maquette::parallel::*;
use maquette::value::Faces;
use maquette::{Cancelled, Progress};
use nalgebra::Point3;

use super::primal::Primal;

/// Vertices with their places.
pub(crate) type Placed = Vec<(u32, Point3<f64>)>;

/// Vertices that one task computes: enough to outweigh the cost of giving them to a thread.
const BLOCK: usize = 1024;

/// Half-edges of the control mesh, in rows.
type Halves = Vec<Range<u32>>;

/// The vertices after the last step that may be elsewhere because these vertices of the `control` mesh have `moved`, with the bits that
/// the whole product gives them.
///
/// # Errors
/// If the evaluation is told to stop.
pub(crate) fn follow(
    steps: &[&Primal],
    control: &[Point3<f64>],
    moved: &[u32],
    progress: &Progress<'_>,
) -> Result<Placed, Cancelled> {
    let Some((last, before)) = steps.split_last() else {
        return Ok(moved.iter().map(|&vertex| (vertex, control[vertex as usize])).collect());
    };
    let [core, halo] = surroundings(&steps[0].level.mesh.faces, control.len(), moved);
    let mut places: Option<Vec<Point3<f64>>> = None;
    for (level, step) in before.iter().enumerate() {
        progress.check()?;
        let old = places.as_deref().unwrap_or(control);
        let mut new = sparse_vec(step.n_finer());
        let halo = finer(&halo, level);
        for (vertex, place) in reached(step, old, &mut new, [&halo; 2], moved) {
            new[vertex as usize] = place;
        }
        places = Some(new);
    }
    progress.check()?;
    let old = places.as_deref().unwrap_or(control);
    let mut new = sparse_vec(last.n_finer());
    let [core, halo] = [core, halo].map(|halves| finer(&halves, before.len()));
    Ok(reached(last, old, &mut new, [&core, &halo], moved))
}

/// The new vertices in and at the faces with the half-edges of `core`, and those at the control points that have `moved`, which may have
/// no face. Of `new`, what is inside of the faces of `halo` is written.
fn reached(
    step: &Primal,
    old: &[Point3<f64>],
    new: &mut [Point3<f64>],
    [core, halo]: [&Halves; 2],
    moved: &[u32],
) -> Placed {
    let mesh = &step.level.mesh;
    let placed = |vertices: &[u32], new: &[Point3<f64>]| -> Placed {
        let vertices = vertices.par_iter().with_min_len(BLOCK);
        vertices.map(|&vertex| (vertex, step.place(vertex, old, new))).collect()
    };
    let middle = |face: u32| step.middle(face).map(|[vertex, _]| vertex);
    let faces = |row: &Range<u32>| mesh.face_of(row.start)..=mesh.face_of(row.end - 1);
    let middles = Vec::from_iter(halo.iter().flat_map(faces).filter_map(middle));
    for (vertex, place) in placed(&middles, new) {
        new[vertex as usize] = place;
    }

    let mut is_known = vec![0_u64; new.len().div_ceil(64)];
    let mut is_new = |vertex: &u32| {
        let (word, bit) = (&mut is_known[*vertex as usize / 64], 1 << (vertex % 64));
        let is_new = *word & bit == 0;
        *word |= bit;
        is_new
    };
    let mut vertices = Vec::from_iter(moved.iter().copied().filter(&mut is_new));
    vertices.extend(core.iter().flat_map(faces).filter_map(middle));
    for half in core.iter().cloned().flatten() {
        let on_edge = mesh.vertices as u32 + mesh.edge_of[half as usize];
        vertices.extend([mesh.corners()[half as usize], on_edge].into_iter().filter(&mut is_new));
    }
    placed(&vertices, new)
}

/// The half-edges of core and halo.
fn surroundings(faces: &Faces, vertices: usize, moved: &[u32]) -> [Halves; 2] {
    let mut is_near = vec![false; vertices];
    moved.iter().for_each(|&vertex| is_near[vertex as usize] = true);
    let mut grow = || {
        let near = |face: &[u32]| face.iter().any(|&vertex| is_near[vertex as usize]);
        let near = Vec::from_iter((0..faces.len()).filter(|&face| near(faces.face(face))));
        let corners = near.iter().flat_map(|&face| faces.face(face));
        corners.for_each(|&vertex| is_near[vertex as usize] = true);
        near
    };
    grow();
    [grow(), grow()].map(|near| {
        let rows = near.chunk_by(|a, b| a + 1 == *b);
        let corner = |face: usize| faces.first_corner(face) as u32;
        rows.map(|row| corner(row[0])..corner(row[row.len() - 1] + 1)).collect()
    })
}

/// The half-edges of the parts of faces after so many steps: both schemes make four of each.
fn finer(halves: &Halves, steps: usize) -> Halves {
    halves.iter().map(|row| row.start << (2 * steps)..row.end << (2 * steps)).collect()
}
