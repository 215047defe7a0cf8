//! A mesh that was made of others vertex by vertex, after some of their vertices have moved.
//!
//! `Transform` and `Merge` ask `Mesh::moved_since` for the vertices that have moved, which compares only blocks whose hashes differ. The
//! result shares faces and attributes with the last result, so that a mirror or a merge takes a fifteenth of the time.

use std::ops::Range;

use maquette_value::parallel::*;
use maquette_value::{Attribute, Mesh, Moved};

use super::motion::Motion;

/// A mesh that another one was made of.
pub(super) struct Part<'a> {
    pub(super) before: &'a Mesh,
    pub(super) now: &'a Mesh,
    /// How its vertices were moved, if they were.
    pub(super) motion: Option<Motion>,
}

/// What was made of the vertices of all parts, one part after the other, with those that are elsewhere now, and their normals; picture and
/// frame stay. None if more of a part is another, or a place is not finite, or more than this share of all vertices has moved.
pub(super) fn followed(made: &Mesh, parts: &[Part<'_>], most: f64) -> Option<Mesh> {
    let moved = parts.iter().map(|part| part.now.moved_since(part.before));
    let moved: Vec<Moved> = moved.collect::<Option<_>>()?;
    let count: usize = moved.iter().flat_map(|moved| &moved.vertices).map(Range::len).sum();
    if most * (made.positions().len() as f64) < count as f64 {
        return None;
    }
    let each = || parts.iter().zip(&moved);
    let rows = |rows: fn(&Moved) -> &[Range<u32>]| {
        let first = parts.iter().scan(0, |end, part| {
            let first = *end;
            *end += part.now.positions().len() as u32;
            Some(first)
        });
        first
            .zip(&moved)
            .flat_map(|(first, moved)| {
                rows(moved).iter().map(move |row: &Range<u32>| first + row.start..first + row.end)
            })
            .collect::<Vec<_>>()
    };
    let places = each().flat_map(|(part, moved)| {
        let (given, motion) = (part.now.positions(), part.motion);
        mapped(&moved.vertices, |vertex: usize| {
            motion.map_or(given[vertex], |by| by.apply(given[vertex]))
        })
    });
    let places = Vec::from_iter(places);
    let mut mesh = made.with_moved(&rows(|moved| &moved.vertices), &places).ok()?;
    if let Some(normals) = made.corner().get("normal") {
        mesh = mesh.with_corner("normal", normals.clone()).ok()?;
    }
    let Some(normals) = made.vertex().vectors("normal") else { return Some(mesh) };
    let turned = each().map(|(part, moved)| {
        let given = part.now.vertex().vectors("normal")?;
        Some(match part.motion {
            None => mapped(&moved.normals, |vertex| given[vertex]),
            Some(motion) => {
                let turn = motion.normals()?;
                mapped(&moved.normals, |vertex| turn(&given[vertex]))
            }
        })
    });
    let turned = turned.collect::<Option<Vec<_>>>()?.concat();
    let normals = normals.with_rows(&rows(|moved| &moved.normals), &turned);
    mesh.with_vertex("normal", Attribute::Vector(normals)).ok()
}

/// What `f` makes of each of some vertices.
fn mapped<T: Send>(rows: &[Range<u32>], f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let vertices: Vec<_> = rows.iter().cloned().flatten().collect();
    vertices.par_iter().with_min_len(4096).map(|&vertex| f(vertex as usize)).collect()
}
