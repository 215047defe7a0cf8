//! The completion as it is published: the density of what is filled changes with the levels.

use maquette_node::Progress;
use maquette_value::TraceStep;

use super::cells;
use super::completion::{Completed, Completion, Copies, FEWEST, Given, areas, distances};
use super::hole::{Hole, SAMPLES};
use super::options::ExemplarOptions;
use super::surface::Surface;
use super::turns::Turns;
use crate::triangles::density::Stop;
use crate::triangles::filling::Filling;

/// Gives what is filled edges of at least this length, or those of the data where these are longer.
pub(crate) type Density<'a> = dyn FnMut(&mut Filling, f64, &Progress<'_>) -> Result<(), Stop> + 'a;

/// Moves the filled vertices of `filling` to where their exemplars have them, and remeshes them to the density of each level.
///
/// Kawai, Sato and Yokoya (2008), edges are split and collapsed towards the distance between samples of each level, so that
/// nothing of the start that is finer survives a coarse level.
///
/// # Errors
/// If there would be too many triangles, or the evaluation is told to stop.
pub(crate) fn complete_as_published(
    filling: &mut Filling,
    density: &mut Density<'_>,
    options: &ExemplarOptions,
    given: &Given,
    progress: &Progress<'_>,
) -> Result<Completed, Stop> {
    let (data, kept) = (filling.data, filling.kept);
    let count = filling.points.len() - data;
    let mut completed = Completed { trace: vec![], copies: Copies::none(count), no_exemplar: true };
    let start = Surface::new(filling.points.len(), &filling.faces);
    let Some(hole) = Hole::new(&start, &filling.points, data) else { return Ok(completed) };
    let mut radii = hole.radii(options, &filling.points[..data]);
    let edge = hole.edge;
    let (mut level, mut done) = (0, 0);
    while level < radii.len() {
        fn share(level: usize, radii: &[f64]) -> f64 {
            level as f64 / radii.len() as f64
        }
        let own = share(level, &radii)..share(level + 1, &radii);
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
            data,
            kept,
            options,
            allowed: given.allowed.as_deref(),
            colors: Vec::new(),
            distances: distances(&surface, points, data, (2.5 * radii[0]).max(hole.width)),
            turns: Turns::new(options.rotations, options.mirror),
            areas: areas(&surface, points, data, kept, options.update),
            hole,
            sharp: &[],
            guides: Vec::new(),
        };
        let size = completion.size(radii[level], level);
        let exemplars = completion.exemplars(&size, points, progress)?;
        if exemplars.len() < FEWEST {
            let smaller = radii[0] / 2.0;
            let may = options.radii.is_empty() && smaller.is_finite();
            if level == 0 && radii.len() > 1 && may {
                radii = completion.hole.spaced(smaller, radii.len());
            } else {
                level += 1;
            }
            continue;
        }
        let outcome = progress
            .part(own, |progress| completion.level(&size, &exemplars, points, level, progress))?;
        for (iteration, energy) in &outcome.kept {
            let (max, rms) = (energy.most.sqrt(), energy.mean.sqrt());
            completed.trace.push(TraceStep { iteration: done + iteration, max, rms });
        }
        done += outcome.iterations + 1;
        completed.no_exemplar &= outcome.guides.is_empty();
        if last {
            let cells = cells::cells(&surface, points, data, &outcome, edge);
            completed.copies = Copies::none(points.len() - data);
            completion.copy(&exemplars, &outcome, &cells, points, &mut completed.copies);
            completed.copies.name(&outcome.guides, data);
        }
        level += 1;
    }
    if completed.copies.exemplar.len() != filling.points.len() - data {
        completed.copies = Copies::none(filling.points.len() - data);
    }
    Ok(completed)
}
