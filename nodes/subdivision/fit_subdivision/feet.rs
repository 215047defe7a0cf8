//! Points and their nearest places on a fine mesh.

use maquette_base::linear::columns::Column;
use maquette_base::linear::missed::Missed;
use maquette_base::linear::stencils::Stencils;
use maquette_value::{Mesh, NearestPlace, TriangleTree};
use nalgebra::Point3;

use super::scan::Foot;

/// Steps of subdivision after which the surface is measured; its limit is met at the vertices of that mesh.
pub(super) const LEVELS: u32 = 2;

/// The place of a surface that is nearest to a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nearest {
    pub(super) distance_sq: f64,
    /// The face of the control mesh.
    pub(super) face: u32,
}

impl Nearest {
    /// A place after so many steps of subdivision: each cuts a face in four.
    pub(super) fn new(place: &NearestPlace, levels: u32) -> Self {
        Self { distance_sq: place.distance_sq, face: place.face >> (2 * levels) }
    }
}

/// The points that count, and their nearest places on a fine mesh.
pub(super) struct Feet {
    pub(super) points: Vec<Column>,
    /// Each place as the mean of three vertices.
    pub(super) rows: Stencils,
    pub(super) missed: Missed,
    /// For each point given.
    pub(super) nearest: Vec<Option<Nearest>>,
}

impl Feet {
    pub(super) fn new(fine: &Mesh, points: &[Point3<f64>], reach: f64) -> Self {
        let mut places = TriangleTree::new(fine).nearest_to_all(points);
        places
            .iter_mut()
            .for_each(|place| *place = place.filter(|place| place.distance_sq <= reach * reach));
        let nearest =
            places.iter().map(|place| Some(Nearest::new(place.as_ref()?, LEVELS))).collect();
        let near = points.iter().zip(places);
        let near = near.filter_map(|(point, place)| Some((Column::from(point.coords), place?)));
        let (points, places): (Vec<Column>, Vec<_>) = near.unzip();
        let corners = fine.faces().corners();
        let (rows, _) = Stencils::build(places.len(), |_: &mut (), k, rows| {
            for (corner, share) in places[k].corners.into_iter().zip(places[k].shares) {
                rows.push(corners[corner as usize], share);
            }
            rows.end();
        });
        let missed = places.iter().map(|place| place.distance_sq);
        let missed = missed.fold(Missed::none(), Missed::and_by);
        Self { points, rows, missed, nearest }
    }

    /// Adds vertices of the fine mesh, which are to be at their feet.
    pub(super) fn hold(&mut self, feet: &[Foot]) {
        let weighted = feet.iter().map(|foot| Column::from(foot.place.coords * foot.weight.sqrt()));
        self.points.extend(weighted);
        let (rows, _) = Stencils::build(feet.len(), |_: &mut (), k, rows| {
            rows.push(feet[k].vertex, feet[k].weight.sqrt());
            rows.end();
        });
        self.rows = self.rows.above(&rows, 1.0);
    }
}
