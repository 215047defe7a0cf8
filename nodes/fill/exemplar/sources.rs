//! Which part of a picture on the data belongs on each filled face.

use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::exemplars::Exemplars;
use super::level::Outcome;
use super::surface::{NONE, Surface};
use super::turns::Turns;

/// For each filled face the one of the data that it copies, and where its corners are there: how much each corner of that one weighs, less
/// than nothing where they lie beside it. None for a face that copies nothing.
#[derive(Debug)]
pub(crate) struct Sources(Vec<Option<(u32, [[f64; 3]; 3])>>);

impl Sources {
    /// Nothing is copied.
    pub(super) fn none() -> Self {
        Self(Vec::new())
    }

    /// Of the faces from `kept` on. `cells` names the patch whose exemplar each missing vertex copies.
    pub(super) fn new(
        outcome: &Outcome,
        exemplars: &Exemplars,
        turns: &Turns,
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
            let places = corners
                .map(|vertex: u32| exemplars.place(found, turns, frame, points[vertex as usize]));
            let middle =
                Point3::from(places.iter().map(|place| place.coords / 3.0).sum::<Vector3<f64>>());
            let from = exemplars.vertices[found.exemplar as usize];
            let vertex = surface.descend(points, from, &middle, data as u32);
            let around = surface.around(vertex).iter().filter(|&&face| (face as usize) < kept);
            fn ends(
                face: u32,
                points: &[Point3<f64>],
                surface_faces: &[[u32; 3]],
            ) -> [Point3<f64>; 3] {
                surface_faces[face as usize].map(|end| points[end as usize])
            }
            // The one in which the middle lies, or nearly does.
            fn depth(
                face: u32,
                middle: Point3<f64>,
                points: &[Point3<f64>],
                surface_faces: &[[u32; 3]],
            ) -> Option<(f64, u32)> {
                let shares = shares(&middle, ends(face, points, surface_faces))?;
                Some((shares.into_iter().fold(f64::INFINITY, f64::min), face))
            }
            let deepest = around.filter_map(|&face| depth(face, middle, points, surface.faces));
            let (_, face) = deepest.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))?;
            let [a, b, c] = places.map(|place| shares(&place, ends(face, points, surface.faces)));
            Some((face, [a?, b?, c?]))
        };
        let faces = surface.faces[kept..].par_iter().with_min_len(256);
        Self(faces.map(source).collect())
    }

    /// Of a filled face, counted from the first one.
    pub(crate) fn of(&self, filled: usize) -> Option<(u32, [[f64; 3]; 3])> {
        self.0.get(filled).copied().flatten()
    }
}

/// The cell that most corners of a face have, the first of equals.
fn cell_of(cells: [u32; 3]) -> Option<u32> {
    fn times(cell: u32, cells: [u32; 3]) -> usize {
        cells.iter().filter(|&&other| other == cell).count()
    }
    let known = cells.into_iter().filter(|&cell| cell != NONE);
    known.reduce(|best, cell| if times(cell, cells) > times(best, cells) { cell } else { best })
}

/// How much each corner of a triangle weighs at the place in its plane that is nearest to a point; none if it has no area.
fn shares(point: &Point3<f64>, [a, b, c]: [Point3<f64>; 3]) -> Option<[f64; 3]> {
    let normal = (b - a).cross(&(c - a));
    let size = normal.norm_squared();
    let share =
        |from: Point3<f64>, to: Point3<f64>| (to - from).cross(&(point - from)).dot(&normal) / size;
    (size > 0.0).then(|| [share(b, c), share(c, a), share(a, b)])
}
