//! Decides which holes are filled with exemplars (patches of the input surface), and which keep their thin plate.
//!
//! A plate is enough where it loses nothing that the surface around the hole has. A hole gets exemplars for one of two reasons:
//! - Its surroundings have **relief** that the plate lacks: short waves, measured at the rim, where the nearest vertices count most.
//! - Exemplars predict the surface better than a plate does: around the hole, parts as wide as half of it are removed, and both ways of
//!   filling them are compared with what was there.

use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::*;
use nalgebra::Point3;

use super::compare::{Plane, Planes};
use super::completion::Completion;
use super::exemplars::{Exemplars, REACH};
use super::frame::{Frame, Orientation};
use super::heights::{SIDE, height_at};
use super::orientations::Orientations;
use super::relief::Relief;
use super::smoothness::{self, LatticePlate};
use super::surroundings::Surroundings;

/// Amplitude of relief that a plate may lack, in edge lengths of the input mesh.
const MAX_LOST_RELIEF: f64 = 0.04;

/// Maximum ratio of the exemplars' error to the plate's error at which exemplars are better.
const MAX_ERROR_RATIO: f64 = 0.7;

/// Error up to which a plate is good enough, in edge lengths of the input mesh.
const GOOD_ERROR: f64 = 0.05;

/// Radius of the patches in which parts are removed, divided by the width of the hole.
const PATCH_RADIUS: f64 = 0.8;

/// Maximum distance between the center of a removed part and the hole, divided by the width of the hole or the radius of the patches,
/// whichever is larger.
const MAX_DISTANCE: f64 = 1.5;

/// Maximum number of removed parts around a hole, and of exemplars that are compared with each.
const MAX_PARTS: usize = 32;
const MAX_CANDIDATES: usize = 16384;

/// The number of most similar exemplars whose mean predicts a removed part.
const BEST: usize = 4;

/// For each hole, returns true if its thin plate stays as it is.
///
/// # Errors
/// Returns an error if the evaluation is cancelled.
pub(super) fn find_smooth_holes(
    completion: &Completion<'_>,
    points: &[Point3<f64>],
    progress: &Progress<'_>,
) -> Result<Vec<bool>, CancelledError> {
    let hole = &completion.hole;
    let around = Surroundings::new(completion.surface, points, hole);
    let relief = Relief::new(completion.surface, points, hole, &around);
    let mut is_smooth = Vec::new();
    for (number, fill) in hole.fills(completion.n_data_vertices).iter().enumerate() {
        progress.check()?;
        // Creases that are extended across a hole are not a thin plate.
        let is_sharp = fill.iter().any(|&vertex| completion.is_sharp(vertex));
        let lost = relief.lost(completion.surface, points, &around, number, fill);
        let lacks_relief = lost > MAX_LOST_RELIEF * hole.edge;
        let is_kept = !is_sharp
            && !lacks_relief
            && !predicts_better(completion, points, &around, number, fill[0], progress)?;
        is_smooth.push(is_kept);
    }
    Ok(is_smooth)
}

/// Returns true if exemplars predict parts of the surface around a hole better than thin plates do. `vertex` is a vertex of its fill.
fn predicts_better(
    completion: &Completion<'_>,
    points: &[Point3<f64>],
    around: &Surroundings,
    number: usize,
    vertex: u32,
    progress: &Progress<'_>,
) -> Result<bool, CancelledError> {
    let hole = &completion.hole;
    let width = hole.widths[vertex as usize - completion.n_data_vertices];
    let radius = (PATCH_RADIUS * width).max(hole.smallest_radius());
    let size = completion.size(radius, usize::MAX);
    let max_distance = (MAX_DISTANCE * width).max(MAX_DISTANCE * radius);
    let mut near = around.vertices_within(number, max_distance);
    near.retain(|&vertex| REACH * radius < completion.distances[vertex as usize]);
    // More parts than needed: some vertices are too near to a border of the mesh.
    let every = near.len().div_ceil(2 * MAX_PARTS).max(1);
    let chosen: Vec<u32> = near.into_iter().step_by(every).collect();
    let parts = completion.exemplars_at(
        &size,
        points,
        |vertex| chosen.binary_search(&vertex).is_ok(),
        progress,
    )?;
    // Most surfaces are so smooth that no exemplars have to be compared.
    if smoothness::plate_error(&parts) <= GOOD_ERROR * hole.edge || parts.len() == 0 {
        return Ok(false);
    }
    let exemplars = completion.exemplars(&size, points, progress)?;
    let Some(plate) = LatticePlate::new(&parts.lattice) else { return Ok(false) };
    let annulus: Vec<usize> = (parts.lattice.nodes_within(1.0).into_iter())
        .filter(|node| !plate.missing.contains(node))
        .collect();
    let chosen: Vec<u32> =
        (0..parts.len() as u32).step_by(parts.len().div_ceil(MAX_PARTS)).collect();
    let errors: Vec<PredictionErrors> = chosen
        .into_par_iter()
        .map(|part| {
            if progress.check().is_err() {
                return PredictionErrors::default();
            }
            let heights = parts.heights(part);
            let frame = &parts.frames[part as usize];
            let removed = RemovedPart { frame, heights, annulus: &annulus };
            let best = removed.best_exemplars(&exemplars, &completion.orientations, REACH * radius);
            removed.prediction_errors(&exemplars, &best, &plate)
        })
        .collect();
    progress.check()?;
    let mut all = PredictionErrors::default();
    for own in errors {
        all.exemplars += own.exemplars;
        all.plate += own.plate;
        all.count += own.count;
    }
    let [exemplar, plate] =
        [all.exemplars, all.plate].map(|sum| (sum / all.count.max(1) as f64).sqrt());
    Ok(plate > GOOD_ERROR * hole.edge && exemplar < MAX_ERROR_RATIO * plate)
}

/// The sums of squared errors with which exemplars and thin plates predict removed parts, over `count` positions.
#[derive(Clone, Copy, Default)]
struct PredictionErrors {
    exemplars: f64,
    plate: f64,
    count: usize,
}

/// A part of the surface around a hole whose center is treated as removed.
struct RemovedPart<'a> {
    frame: &'a Frame,
    heights: &'a [f32],
    /// The nodes of the lattice around the removed center.
    annulus: &'a [usize],
}

/// An exemplar aligned with the surroundings of a removed part.
struct AlignedExemplar {
    exemplar: u32,
    orientation: Orientation,
    /// The height, and the slopes along columns and rows, by which the exemplar is moved.
    plane: Plane,
    error: f64,
}

/// Returns the column and row of a node, relative to the center of the lattice.
fn position(node: usize) -> [f64; 2] {
    let half = (SIDE / 2) as f64;
    [(node % SIDE) as f64 - half, (node / SIDE) as f64 - half]
}

impl RemovedPart<'_> {
    /// Compares the removed center with the mean of the exemplars that are most similar to its surroundings, and with a thin plate.
    fn prediction_errors(
        &self,
        exemplars: &Exemplars,
        best: &[AlignedExemplar],
        plate: &LatticePlate,
    ) -> PredictionErrors {
        let mut errors = PredictionErrors::default();
        if best.len() < BEST {
            return errors;
        }
        for (&node, off) in plate.missing.iter().zip(plate.residuals(self.heights)) {
            let all = best.iter().map(|aligned| self.residual(exemplars, aligned, node));
            let mean = all.sum::<f64>() / best.len() as f64;
            if off.is_finite() && mean.is_finite() {
                errors.exemplars += mean * mean;
                errors.plate += off * off;
                errors.count += 1;
            }
        }
        errors
    }

    /// Returns the height of the removed surface over an exemplar at a node.
    fn residual(&self, exemplars: &Exemplars, aligned: &AlignedExemplar, node: usize) -> f64 {
        let [x, y] = position(node);
        let [a, b, c] = aligned.plane;
        let at = aligned.orientation.apply([x, y]);
        let height = height_at(exemplars.heights(aligned.exemplar), at);
        f64::from(self.heights[node]) - height - a - b * x - c * y
    }

    /// Returns the exemplars that are most similar to the surroundings, the most similar first. Exemplars nearer than `min_distance` show
    /// the removed part itself and do not count.
    fn best_exemplars(
        &self,
        exemplars: &Exemplars,
        orientations: &Orientations,
        min_distance: f64,
    ) -> Vec<AlignedExemplar> {
        let every = exemplars.len().div_ceil(MAX_CANDIDATES).max(1);
        let mut best: Vec<AlignedExemplar> = Vec::new();
        for orientation in orientations.range_for(self.frame) {
            let orientation = *orientations.get(orientation as u8);
            let back = orientation.inverse();
            // Rotate the removed part instead of each exemplar.
            let target: Vec<(usize, [f64; 2], f64)> = (self.annulus.iter())
                .map(|&node| {
                    (node, position(node), height_at(self.heights, back.apply(position(node))))
                })
                .filter(|(.., height)| height.is_finite())
                .collect();
            let planes = Planes::from_points(target.iter().map(|(_, position, _)| position));
            for exemplar in (0..exemplars.len()).step_by(every) {
                let distance = (exemplars.frames[exemplar].origin - self.frame.origin).norm();
                if distance < min_distance {
                    continue;
                }
                let heights = exemplars.heights(exemplar as u32);
                let (mut moments, mut squares) = ([0.0; 3], 0.0);
                for &(node, [x, y], height) in &target {
                    let off = height - f64::from(heights[node]);
                    squares += off * off;
                    moments = [moments[0] + off, moments[1] + off * x, moments[2] + off * y];
                }
                let error = squares - planes.gain(moments);
                if error.is_finite() && (best.len() < BEST || error < best[BEST - 1].error) {
                    let [a, b, c] = planes.solve(moments);
                    let [b, c] = back.apply([b, c]);
                    let exemplar = exemplar as u32;
                    let at = best.partition_point(|other| other.error <= error);
                    best.insert(
                        at,
                        AlignedExemplar { exemplar, orientation, plane: [a, b, c], error },
                    );
                    best.truncate(BEST);
                }
            }
        }
        best
    }
}
