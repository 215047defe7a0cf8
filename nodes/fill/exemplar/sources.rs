//! The part of the texture that each face of the fill shows.

use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::exemplars::Exemplars;
use super::level::Outcome;
use super::orientations::Orientations;
use super::surface::{NONE, Surface};

/// For each face of the fill, the input face that it copies, and the barycentric coordinates of its corners in the input face. Some
/// coordinates of a corner outside the input face are negative. `None` for a face that copies nothing.
#[derive(Debug)]
pub(crate) struct Sources(Vec<Option<(u32, [[f64; 3]; 3])>>);

impl Sources {
    /// Returns the sources of a fill whose faces copy nothing.
    pub(super) fn empty() -> Self {
        Self(Vec::new())
    }

    /// Finds the sources of the faces with the indices from `kept` on. `cells` has, for each vertex of the fill, the index of the patch
    /// whose exemplar the vertex copies.
    pub(super) fn new(
        outcome: &Outcome,
        exemplars: &Exemplars,
        orientations: &Orientations,
        surface: &Surface<'_>,
        points: &[Point3<f64>],
        kept: usize,
        cells: &[u32],
    ) -> Self {
        let data = points.len() - cells.len();
        let source = |corners: &[u32; 3]| {
            let cell = cell_of(corners.map(|vertex| match (vertex as usize).checked_sub(data) {
                Some(missing) => cells[missing],
                None => NONE,
            }))? as usize;
            let found = &outcome.matches[cell];
            let frame = &outcome.frames[cell];
            let positions = corners.map(|vertex: u32| {
                exemplars.map_point(found, orientations, frame, points[vertex as usize])
            });
            let middle = Point3::from(
                positions.iter().map(|position| position.coords / 3.0).sum::<Vector3<f64>>(),
            );
            let from = exemplars.vertices[found.exemplar as usize];
            let vertex = surface.walk_to_nearest(points, from, &middle, data as u32);
            let around =
                surface.faces_around(vertex).iter().filter(|&&face| (face as usize) < kept);
            // Find the input face that contains the center of the fill's face, or that comes nearest to containing it.
            let depths = around.filter_map(|&face| {
                let weights = barycentric_weights(&middle, surface.corners(points, face))?;
                Some((weights.into_iter().fold(f64::INFINITY, f64::min), face))
            });
            let (_, face) = depths.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))?;
            let [a, b, c] = positions
                .map(|position| barycentric_weights(&position, surface.corners(points, face)));
            Some((face, [a?, b?, c?]))
        };
        let faces = surface.faces[kept..].par_iter().with_min_len(256);
        Self(faces.map(source).collect())
    }

    /// Returns the source of a face, given by its index among the faces of the fill.
    pub(crate) fn get(&self, filled: usize) -> Option<(u32, [[f64; 3]; 3])> {
        self.0.get(filled).copied().flatten()
    }
}

/// Returns the most frequent cell among the corners of a face; if several are equally frequent, the first of them. `None` if the most
/// frequent cell is [`NONE`].
fn cell_of(cells: [u32; 3]) -> Option<u32> {
    fn times(cell: u32, cells: [u32; 3]) -> usize {
        cells.iter().filter(|&&other| other == cell).count()
    }
    let known = cells.into_iter().filter(|&cell| cell != NONE);
    known.reduce(|best, cell| if times(cell, cells) > times(best, cells) { cell } else { best })
}

/// Returns the barycentric coordinates of the projection of a point to a triangle's plane; `None` if the triangle has no area.
fn barycentric_weights(point: &Point3<f64>, [a, b, c]: [Point3<f64>; 3]) -> Option<[f64; 3]> {
    let normal = (b - a).cross(&(c - a));
    let size = normal.norm_squared();
    let weights = [(b, c), (c, a), (a, b)]
        .map(|(from, to)| (to - from).cross(&(point - from)).dot(&normal) / size);
    (size > 0.0).then_some(weights)
}
