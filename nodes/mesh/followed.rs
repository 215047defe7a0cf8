//! Updates a mesh that consists of the vertices of other meshes, after some vertices of those meshes have moved.
//!
//! `Transform` and `Merge` get the moved vertices from `Mesh::moved_since`, which compares only blocks whose hashes differ. The updated
//! mesh shares faces and attributes with the last result, so an update takes a fifteenth of the time of a new computation.

use std::ops::Range;

use maquette_value::parallel::*;
use maquette_value::{Attribute, Mesh, MovedRows};

use super::motion::Motion;

/// An input of a merge or a transform: a mesh in its last and in its current state.
pub(super) struct Part<'a> {
    pub(super) before: &'a Mesh,
    pub(super) now: &'a Mesh,
    /// The motion that the merge or transform applies to the mesh's vertices; `None` if they stay.
    pub(super) motion: Option<Motion>,
}

/// Updates `made`, in which the vertices of all parts are concatenated: gives the vertices that have moved in a part their new positions
/// and normals. Texture and frame stay. Returns `None` if anything except positions has changed in a part, a position is not finite, or
/// more than the fraction `most` of all vertices has moved.
pub(super) fn move_vertices(made: &Mesh, parts: &[Part<'_>], most: f64) -> Option<Mesh> {
    let moved = parts.iter().map(|part| part.now.moved_since(part.before));
    let moved: Vec<MovedRows> = moved.collect::<Option<_>>()?;
    let count: usize = moved.iter().flat_map(|moved| &moved.vertices).map(Range::len).sum();
    if most * (made.positions().len() as f64) < count as f64 {
        return None;
    }
    let each = parts.iter().zip(&moved);
    /// Returns the vertices of all parts that have moved, as ranges of vertex indices in the joined mesh. `rows` selects positions or
    /// normals.
    fn joined_rows(
        parts: &[Part<'_>],
        moved: &[MovedRows],
        rows: fn(&MovedRows) -> &[Range<u32>],
    ) -> Vec<Range<u32>> {
        let first = parts.iter().scan(0, |end, part| {
            let first = *end;
            *end += part.now.positions().len() as u32;
            Some(first)
        });
        first
            .zip(moved)
            .flat_map(|(first, moved)| {
                rows(moved).iter().map(move |row: &Range<u32>| first + row.start..first + row.end)
            })
            .collect()
    }
    let places = each.clone().flat_map(|(part, moved)| {
        let (given, motion) = (part.now.positions(), part.motion);
        map_rows(&moved.vertices, |vertex: usize| {
            motion.map_or(given[vertex], |by| by.apply(given[vertex]))
        })
    });
    let places = Vec::from_iter(places);
    let mut mesh =
        made.with_moved(&joined_rows(parts, &moved, |moved| &moved.vertices), &places).ok()?;
    if let Some(normals) = made.corner().get("normal") {
        mesh = mesh.with_corner("normal", normals.clone()).ok()?;
    }
    let Some(normals) = made.vertex().vectors("normal") else { return Some(mesh) };
    let turned = each.map(|(part, moved)| {
        let given = part.now.vertex().vectors("normal")?;
        Some(match part.motion {
            None => map_rows(&moved.normals, |vertex| given[vertex]),
            Some(motion) => {
                let turn = motion.normals()?;
                map_rows(&moved.normals, |vertex| turn(&given[vertex]))
            }
        })
    });
    let turned = turned.collect::<Option<Vec<_>>>()?.concat();
    let normals = normals.with_rows(&joined_rows(parts, &moved, |moved| &moved.normals), &turned);
    mesh.with_vertex("normal", Attribute::Vector(normals)).ok()
}

/// Returns the results of `f` for the vertices in the index ranges `rows`, in order.
fn map_rows<T: Send>(rows: &[Range<u32>], f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let vertices: Vec<_> = rows.iter().cloned().flatten().collect();
    vertices.par_iter().with_min_len(4096).map(|&vertex| f(vertex as usize)).collect()
}
