//! Foot points: the nearest points on a refined mesh to given points.

use maquette_base::linear::columns::Column;
use maquette_base::linear::residuals::Residuals;
use maquette_base::linear::stencils::Stencils;
use maquette_value::{Mesh, NearestPoint, TriangleTree};
use nalgebra::Point3;

use super::scan::Foot;

/// The number of refinement steps from the control mesh to the mesh to which distances are measured. The vertices of the refined mesh are
/// on the limit surface.
pub(super) const LEVELS: u32 = 2;

/// The nearest point of a surface to a given point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nearest {
    pub(super) distance_sq: f64,
    /// The face of the control mesh that contains the nearest point.
    pub(super) face: u32,
}

impl Nearest {
    /// Finds the face of the control mesh that contains a point of the refined mesh. Each of the `levels` refinement steps divides a face
    /// into four.
    pub(super) fn new(position: &NearestPoint, levels: u32) -> Self {
        Self { distance_sq: position.distance_sq, face: position.face >> (2 * levels) }
    }
}

/// The given points near the mesh, and their foot points (nearest points) on the refined mesh.
pub(super) struct Feet {
    pub(super) points: Vec<Column>,
    /// Each foot point as a weighted mean of three vertices of the refined mesh.
    pub(super) rows: Stencils,
    pub(super) missed: Residuals,
    /// For each given point the nearest point of the surface; `None` if the given point is too far from the surface.
    pub(super) nearest: Vec<Option<Nearest>>,
}

impl Feet {
    pub(super) fn new(fine: &Mesh, points: &[Point3<f64>], reach: f64) -> Self {
        let mut positions = TriangleTree::new(fine).nearest_to_all(points);
        positions.iter_mut().for_each(|position| {
            *position = position.filter(|position| position.distance_sq <= reach * reach);
        });
        let nearest = positions
            .iter()
            .map(|position| Some(Nearest::new(position.as_ref()?, LEVELS)))
            .collect();
        let near = points.iter().zip(positions);
        let near =
            near.filter_map(|(point, position)| Some((Column::from(point.coords), position?)));
        let (points, positions): (Vec<Column>, Vec<_>) = near.unzip();
        let corners = fine.faces().corners();
        let (rows, _) = Stencils::build(positions.len(), |_: &mut (), k, rows| {
            for (corner, share) in positions[k].corners.into_iter().zip(positions[k].barycentric) {
                rows.push(corners[corner as usize], share);
            }
            rows.end();
        });
        let missed = positions.iter().map(|position| position.distance_sq);
        let missed = missed.fold(Residuals::empty(), Residuals::with_distance_sq);
        Self { points, rows, missed, nearest }
    }

    /// Adds equations that move vertices of the refined mesh to their nearest points on the scan.
    pub(super) fn add_vertices(&mut self, feet: &[Foot]) {
        let weighted =
            feet.iter().map(|foot| Column::from(foot.position.coords * foot.weight.sqrt()));
        self.points.extend(weighted);
        let (rows, _) = Stencils::build(feet.len(), |_: &mut (), k, rows| {
            rows.push(feet[k].vertex, feet[k].weight.sqrt());
            rows.end();
        });
        self.rows = self.rows.stack(&rows, 1.0);
    }
}
