//! The completion with the improvements over the publication.

use maquette_node::{Cancelled, Progress};
use maquette_value::TraceStep;

use super::cells;
use super::completion::{Completed, Completion, Copies, FEWEST, Given, areas, distances};
use super::hole::Hole;
use super::options::ExemplarOptions;
use super::surface::Surface;
use super::tints::Color;
use super::turns::Turns;
use crate::triangles::filling::Filling;

/// Moves the filled vertices of `filling`, which is triangulated as finely as its data and has the positions of the start, to where
/// their exemplars have them.
///
/// # Errors
/// If the evaluation is told to stop.
pub(crate) fn complete(
    filling: &mut Filling,
    options: &ExemplarOptions,
    given: &Given,
    progress: &Progress<'_>,
) -> Result<Completed, Cancelled> {
    let Filling { points, faces, data, kept } = filling;
    let (data, count) = (*data, points.len());
    let surface = Surface::new(count, faces);
    let mut completed =
        Completed { trace: vec![], copies: Copies::none(count - data), no_exemplar: true };
    let Some(hole) = Hole::new(&surface, points, data) else { return Ok(completed) };
    let mut radii = hole.radii(options, &points[..data]);
    let mut completion = Completion {
        surface: &surface,
        data,
        kept: *kept,
        options,
        allowed: given.allowed.as_deref(),
        colors: lengths(given, options.color * hole.edge),
        distances: distances(&surface, points, data, (2.5 * radii[0]).max(hole.width)),
        turns: Turns::new(options.rotations, options.mirror),
        areas: areas(&surface, points, data, *kept, options.update),
        hole,
        sharp: &given.sharp,
        guides: Vec::new(),
    };
    let (mut level, mut done) = (0, 0);
    while level < radii.len() {
        fn share(level: usize, radii: &[f64]) -> f64 {
            level as f64 / radii.len() as f64
        }
        let own = share(level, &radii)..share(level + 1, &radii);
        progress.tick(own.start)?;
        let size = completion.size(radii[level], level);
        let exemplars = completion.exemplars(&size, points, progress)?;
        let smaller = radii[0] / 2.0;
        if exemplars.len() < FEWEST {
            let chosen = options.radii.is_empty() && smaller.is_finite();
            let retry = level == 0 && radii.len() > 1 && chosen;
            if retry {
                radii = completion.hole.spaced(smaller, radii.len());
            } else {
                level += 1;
            }
            continue;
        }
        let last = level + 1 == radii.len();
        let outcome = progress
            .part(own, |progress| completion.level(&size, &exemplars, points, level, progress))?;
        for (iteration, energy) in &outcome.kept {
            let (max, rms) = (energy.most.sqrt(), energy.mean.sqrt());
            completed.trace.push(TraceStep { iteration: done + iteration, max, rms });
        }
        done += outcome.iterations + 1;
        completed.no_exemplar &= outcome.guides.is_empty();
        if last {
            let edge = completion.hole.edge;
            let cells = cells::cells(&surface, points, data, &outcome, edge);
            completion.add_detail(&size, &exemplars, &outcome, &cells, points, progress)?;
            completion.copy(&exemplars, &outcome, &cells, points, &mut completed.copies);
        }
        completion.guides = outcome.guides;
        level += 1;
    }
    completed.copies.name(&completion.guides, data);
    Ok(completed)
}

/// The colors, as lengths that count as much as distances: `size` for the difference of black and white.
fn lengths(given: &Given, size: f64) -> Vec<Color> {
    given.colors.iter().flatten().map(|color| color.map(|channel| channel * size / 100.0)).collect()
}
