//! Changes the edge lengths of the triangulations that fill holes.

use maquette_node::{CancelledError, Progress};
use nalgebra::Point3;

use super::fairing::{Energy, fair};
use super::hole_fill::HoleFill;
use super::plates::fair_as_plate;
use super::sizes::Sizes;
use crate::border::rim::{OneRings, Rim};
use crate::triangles::density::{RefineError, refine};
use crate::triangles::filling::Filling;

/// The fills of some holes, as triangulations whose edges can be split and collapsed.
pub(crate) struct Remesh<'a> {
    pub(crate) one_rings: &'a OneRings,
    pub(crate) holes: &'a [Vec<u32>],
    pub(crate) fills: &'a mut [HoleFill],
    /// The final edge length in mm; if `None`, the edge length of the input mesh at the rim.
    pub(crate) edge: Option<f64>,
}

impl Remesh<'_> {
    /// Remeshes the fills to the edge length `min_length`, or to their final edge length if that is larger. The surfaces keep their shapes,
    /// but their vertices are renumbered.
    ///
    /// # Errors
    /// Returns an error if there would be too many triangles, or if the evaluation is cancelled.
    pub(crate) fn refine(
        &mut self,
        filling: &mut Filling,
        min_length: f64,
        progress: &Progress<'_>,
    ) -> Result<(), RefineError> {
        self.take_positions(filling);
        for (hole, fill) in self.holes.iter().zip(self.fills.iter_mut()) {
            let rim = Rim::new(filling, self.one_rings, hole);
            let sizes = Sizes::new(&rim, self.edge);
            refine(
                &mut fill.triangulation,
                |point| sizes.length_at(point).max(min_length),
                progress,
            )?;
        }
        filling.add_all(self.holes, self.fills);
        Ok(())
    }

    /// Returns the positions that the fills' vertices would have on membranes. Also copies their current positions into `fills`.
    ///
    /// # Errors
    /// Returns an error if the evaluation is cancelled.
    pub(crate) fn membranes(
        &mut self,
        filling: &mut Filling,
        progress: &Progress<'_>,
    ) -> Result<Vec<Point3<f64>>, CancelledError> {
        self.take_positions(filling);
        let mut positions = Vec::new();
        for (hole, fill) in self.holes.iter().zip(self.fills.iter()) {
            let rim = Rim::new(filling, self.one_rings, hole);
            let mut triangulation = fill.triangulation.clone();
            fair(&mut triangulation, &rim, Energy::Membrane, progress)?;
            let (_, kept) = triangulation.compact();
            positions.extend(
                kept[hole.len()..].iter().map(|&vertex| triangulation.points[vertex as usize]),
            );
        }
        Ok(positions)
    }

    /// Moves the fills for whose vertices `is_chosen` is true to thin plates. `is_chosen` has an
    /// entry for each vertex of the fills.
    ///
    /// # Errors
    /// Returns an error if the evaluation is cancelled.
    pub(crate) fn fair(
        &mut self,
        filling: &mut Filling,
        is_chosen: &[bool],
        progress: &Progress<'_>,
    ) -> Result<(), CancelledError> {
        self.take_positions(filling);
        let mut first = 0;
        for (hole, fill) in self.holes.iter().zip(self.fills.iter_mut()) {
            let rim = Rim::new(filling, self.one_rings, hole);
            let count = fill.triangulation.compact().1.len() - hole.len();
            if is_chosen.get(first) == Some(&true) && count > 0 {
                fair_as_plate(&mut fill.triangulation, &rim, progress)?;
            }
            first += count;
        }
        filling.add_all(self.holes, self.fills);
        Ok(())
    }

    /// Copies the current positions of the fills' vertices from `filling` into `fills`.
    pub(crate) fn take_positions(&mut self, filling: &Filling) {
        let mut positions = filling.points[filling.n_data_vertices..].iter();
        for (hole, fill) in self.holes.iter().zip(self.fills.iter_mut()) {
            let (_, kept) = fill.triangulation.compact();
            for (&vertex, position) in kept[hole.len()..].iter().zip(&mut positions) {
                fill.triangulation.points[vertex as usize] = *position;
            }
        }
    }
}
