//! Fills holes with parts of the input surface, for `Update::Exact`, which improves the published method.

use maquette_node::{CancelledError, Progress};
use maquette_value::TraceStep;

use super::completion::{
    Completion, CompletionInput, CompletionResult, MIN_EXEMPLARS, distances_to_missing,
    vertex_areas,
};
use super::hole::Hole;
use super::options::{ExemplarOptions, Start};
use super::orientations::Orientations;
use super::rotations::suitable_rotations;
use super::surface::Surface;
use super::tints::Color;
use super::wavelength::wavelength;
use super::{cells, gate};
use crate::triangles::filling::Filling;

/// Moves the vertices of the fill to the positions given by their exemplars (patches of the input surface). The fill must be as dense as
/// the input mesh, and its vertices must have the positions of the initial fill.
///
/// # Errors
/// Returns an error if the evaluation is cancelled.
pub(crate) fn complete(
    filling: &mut Filling,
    options: &ExemplarOptions,
    given: &CompletionInput,
    progress: &Progress<'_>,
) -> Result<CompletionResult, CancelledError> {
    let Filling { points, faces, n_data_vertices: data, n_data_faces: kept } = filling;
    let (data, count) = (*data, points.len());
    let surface = Surface::new(count, faces);
    let mut completed = CompletionResult::new(count - data);
    let Some(hole) = Hole::new(&surface, points, data) else { return Ok(completed) };
    let wavelength = wavelength(&surface, points, data, &hole);
    let mut radii = hole.radii(options, wavelength, &points[..data]);
    let still = ExemplarOptions { iterations: Some(0), ..options.clone() };
    let mut completion = Completion {
        surface: &surface,
        n_data_vertices: data,
        n_data_faces: *kept,
        options,
        allowed: given.allowed.as_deref(),
        colors: lengths(given, options.color * hole.edge),
        distances: distances_to_missing(&surface, points, data, (2.5 * radii[0]).max(hole.width)),
        orientations: Orientations::new(options.rotations.unwrap_or(1), options.mirror),
        areas: vertex_areas(&surface, points, data, *kept, options.update),
        smooth_holes: vec![false; hole.count()],
        hole,
        sharp: &given.sharp,
        guides: Vec::new(),
    };
    // Who chooses radii, exemplars or another start wants shapes to be copied.
    let is_gated = options.start == Start::ThinPlate && options.radii.is_empty();
    if is_gated && given.allowed.is_none() {
        completion.smooth_holes = gate::find_smooth_holes(&completion, points, progress)?;
    }
    let plate = points[data..].to_vec();
    if completion.smooth_holes.iter().all(|&is_smooth| is_smooth) {
        if !given.copies_attributes {
            completed.no_exemplar = false;
            return Ok(completed);
        }
        completion.options = &still;
    }
    let (mut level, mut done, mut is_rotation_known) = (0, 0, false);
    while level < radii.len() {
        let levels = radii.len() as f64;
        let own = level as f64 / levels..(level + 1) as f64 / levels;
        progress.tick(own.start)?;
        let size = completion.size(radii[level], level);
        let exemplars = completion.exemplars(&size, points, progress)?;
        let smaller = radii[0] / 2.0;
        if exemplars.len() < MIN_EXEMPLARS {
            let chosen = options.radii.is_empty() && smaller.is_finite();
            let retry = level == 0 && radii.len() > 1 && chosen;
            if retry {
                radii = completion.hole.spaced_radii(smaller, radii.len());
            } else {
                level += 1;
            }
            continue;
        }
        if options.rotations.is_none() && !is_rotation_known {
            let rotations = suitable_rotations(&exemplars, size.radius);
            completion.orientations = Orientations::new(rotations, options.mirror);
            is_rotation_known = true;
        }
        let last = level + 1 == radii.len();
        let outcome = progress
            .part(own, |progress| completion.level(&size, &exemplars, points, level, progress))?;
        for (iteration, energy) in &outcome.improvements {
            let (max, rms) = (energy.max.sqrt(), energy.measure().sqrt());
            completed.trace.push(TraceStep { iteration: done + iteration, max, rms });
        }
        done += outcome.iterations + 1;
        completed.no_exemplar &= outcome.guides.is_empty();
        if last {
            let edge = completion.hole.edge;
            let cells = cells::cells(&surface, points, data, &outcome, edge);
            completion.add_detail(&size, &exemplars, &outcome, &cells, points, progress)?;
            completion.record_copies(&exemplars, &outcome, &cells, points, &mut completed.copies);
        }
        completion.guides = outcome.guides;
        level += 1;
    }
    for (missing, number) in completion.hole.numbers.iter().enumerate() {
        if completion.smooth_holes[*number as usize] {
            points[data + missing] = plate[missing];
        }
    }
    completed.copies.set_exemplars(&completion.guides, data);
    Ok(completed)
}

/// Returns the colors scaled to lengths, so that they can be compared with distances: the difference between black and white is `size`.
fn lengths(given: &CompletionInput, size: f64) -> Vec<Color> {
    given.colors.iter().flatten().map(|color| color.map(|channel| channel * size / 100.0)).collect()
}
