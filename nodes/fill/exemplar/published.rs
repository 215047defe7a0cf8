//! The published method of filling holes with parts of the input surface: the vertex density of the fill changes from level to level.

use maquette_node::Progress;
use maquette_value::TraceStep;

use super::completion::{
    Completion, CompletionInput, CompletionResult, Copies, MIN_EXEMPLARS, distances_to_missing,
    vertex_areas,
};
use super::hole::{Hole, SAMPLES};
use super::options::{ExemplarOptions, Update};
use super::orientations::Orientations;
use super::surface::Surface;
use super::{cells, gate};
use crate::triangles::density::RefineError;
use crate::triangles::filling::Filling;

/// Remeshes the fill to the given edge length, or to the edge length of the input mesh if that is larger.
pub(crate) type Density<'a> =
    dyn FnMut(&mut Filling, f64, &Progress<'_>) -> Result<(), RefineError> + 'a;

/// Moves the vertices of the fill to the positions given by their exemplars (patches of the input surface), and remeshes the fill on each
/// level.
///
/// Kawai, Sato and Yokoya (2008): edges are split and collapsed to the sample distance of each level, so that finer features of the initial
/// fill do not survive a coarse level. In addition to the publication, the result says which fills have smooth surroundings: the mean of
/// many exemplars leaves dimples there, although its energy is the lowest.
///
/// # Errors
/// Returns an error if there would be too many triangles, or if the evaluation is cancelled.
pub(crate) fn complete_as_published(
    filling: &mut Filling,
    density: &mut Density<'_>,
    options: &ExemplarOptions,
    given: &CompletionInput,
    progress: &Progress<'_>,
) -> Result<CompletionResult, RefineError> {
    let (data, kept) = (filling.n_data_vertices, filling.n_data_faces);
    let count = filling.points.len() - data;
    let mut completed = CompletionResult::new(count);
    let start = Surface::new(filling.points.len(), &filling.faces);
    let Some(hole) = Hole::new(&start, &filling.points, data) else { return Ok(completed) };
    let mut radii = hole.radii(options, None, &filling.points[..data]);
    let edge = hole.edge;
    let exact = ExemplarOptions { update: Update::Exact, ..options.clone() };
    let (mut level, mut done, mut has_converged) = (0, 0, true);
    while level < radii.len() {
        let levels = radii.len() as f64;
        let own = level as f64 / levels..(level + 1) as f64 / levels;
        progress.tick(own.start)?;
        let last = level + 1 == radii.len();
        let given_edge = options.edges.get(level).copied().filter(|&edge| edge > 0.0);
        let length = given_edge.unwrap_or(edge.max(radii[level] / SAMPLES));
        density(filling, if last { 0.0 } else { length }, progress)?;
        let Filling { points, faces, .. } = filling;
        let surface = Surface::new(points.len(), faces);
        let Some(hole) = Hole::new(&surface, points, data) else { break };
        let mut completion = Completion {
            surface: &surface,
            n_data_vertices: data,
            n_data_faces: kept,
            options,
            allowed: given.allowed.as_deref(),
            colors: Vec::new(),
            distances: distances_to_missing(
                &surface,
                points,
                data,
                (2.5 * radii[0]).max(hole.width),
            ),
            orientations: Orientations::new(options.rotations.unwrap_or(1), options.mirror),
            areas: vertex_areas(&surface, points, data, kept, options.update),
            smooth_holes: vec![false; hole.count()],
            hole,
            sharp: &[],
            guides: Vec::new(),
        };
        let size = completion.size(radii[level], level);
        let exemplars = completion.exemplars(&size, points, progress)?;
        if exemplars.len() < MIN_EXEMPLARS {
            let smaller = radii[0] / 2.0;
            let may = options.radii.is_empty() && smaller.is_finite();
            if level == 0 && radii.len() > 1 && may {
                radii = completion.hole.spaced_radii(smaller, radii.len());
            } else {
                level += 1;
            }
            continue;
        }
        let outcome = progress
            .part(own, |progress| completion.level(&size, &exemplars, points, level, progress))?;
        for (iteration, energy) in &outcome.improvements {
            let (max, rms) = (energy.max.sqrt(), energy.measure().sqrt());
            completed.trace.push(TraceStep { iteration: done + iteration, max, rms });
        }
        done += outcome.iterations + 1;
        // Who limits the iterations wants to see the result so far.
        has_converged &= options.iterations.is_none()
            || outcome.iterations < u64::from(options.max_iterations());
        completed.no_exemplar &= outcome.guides.is_empty();
        if last {
            let cells = cells::cells(&surface, points, data, &outcome, edge);
            completed.copies = Copies::empty(points.len() - data);
            completion.record_copies(&exemplars, &outcome, &cells, points, &mut completed.copies);
            completed.copies.set_exemplars(&outcome.guides, data);
            if has_converged {
                completion.options = &exact;
                let is_smooth = gate::find_smooth_holes(&completion, points, progress)?;
                let numbers = completion.hole.numbers.iter();
                completed.to_fair = numbers.map(|&number| is_smooth[number as usize]).collect();
            }
        }
        level += 1;
    }
    if completed.copies.exemplar.len() != filling.points.len() - data {
        completed.copies = Copies::empty(filling.points.len() - data);
    }
    Ok(completed)
}
