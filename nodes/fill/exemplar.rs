//! Completes a surface with shapes that are found elsewhere on it.
//!
//! Kawai, Sato and Yokoya, "Surface completion by minimizing energy based on similarity of shape" (2008): the missing part moves
//! until each patch of it is as like as possible to some patch of the data, on levels from coarse to fine. The vertices themselves
//! stay as dense as the data: on coarse levels some of them move, far enough apart, and the others follow as a thin plate.
//!
//! [`Update::Exact`] goes beyond the publication where that made filled surfaces better on every one of many cases:
//! - An exemplar is laid against a patch by the best small shift and tilt, not by the frames alone, which one rough triangle turns.
//! - The normal of a frame is the mean over a part of the patch.
//! - A thin plate at the start counts as an estimate of its own, as good as thin plates are where the data are known: a vertex
//!   moves to the mean of both, weighed by their certainty. Where no exemplar fits, the plate stays.
//! - Last, each vertex gets the fine detail of its exemplar, made as rough as the data around the hole: the mean of many patches is
//!   smoother than each of them, and the best match of a smooth patch is a smooth one. Then edges bend as often and as much as there.

use maquette::value::TraceStep;
use maquette::{Cancelled, Progress};
use nalgebra::{Point3, Vector3};

use super::filling::Filling;
use detail::Detail;
use exemplars::{Exemplars, REACH, Source};
use hole::{Hole, SAMPLES};
use level::{Guide, Level, Outcome, Whole};
use patches::Scale;
use search::Turns;
use surface::{NONE, Surface};
use tints::Color;

mod bends;
mod cells;
mod compare;
mod descriptor;
mod detail;
mod exemplars;
mod frame;
mod heights;
mod hole;
mod kd_tree;
mod level;
mod lists;
mod options;
mod patches;
mod published;
mod roughness;
mod search;
mod smoothness;
mod sources;
mod spread;
mod surface;
#[cfg(test)]
mod tests;
mod tints;
mod votes;

pub use options::{ExemplarOptions, Falloff, Shown, Start, Update};
pub(super) use published::complete_as_published;
pub(super) use sources::Sources;
use votes::Votes;

/// What is known beside shapes.
#[derive(Default)]
pub(super) struct Given {
    /// Marks the data vertices around which exemplars may be; all, if left out.
    pub(super) allowed: Option<Vec<bool>>,
    /// The colors of all vertices in CIE L*a*b*, those of the filled ones as the rim lets expect them.
    pub(super) colors: Option<Vec<[f64; 3]>>,
    /// Marks the filled vertices of holes over which creases of the data go on at the start; none, if left out.
    pub(super) sharp: Vec<bool>,
}

/// How a completion went.
pub(super) struct Completed {
    /// The iterations that were better than all before them on their level: `rms` is the root of the energy, `max` the root of the
    /// largest mean square of a patch's distances, both in mm. They compare within a level alone.
    pub(super) trace: Vec<TraceStep>,
    pub(super) copies: Copies,
    /// Whether no part of the data can be an exemplar; the start is left as it is then.
    pub(super) no_exemplar: bool,
}

/// What a completion copies from where.
pub(super) struct Copies {
    /// The data vertex that each filled vertex copies; [`u32::MAX`] if none.
    pub(super) exemplar: Vec<u32>,
    /// What else has a say about each filled vertex.
    pub(super) votes: Votes,
    /// Which part of a picture belongs on each filled face.
    pub(super) sources: Sources,
}

impl Copies {
    /// Nothing, for so many filled vertices.
    pub(super) fn none(count: usize) -> Self {
        let (votes, sources) = (Votes::none(count), Sources::none());
        Self { exemplar: vec![NONE; count], votes, sources }
    }

    /// Names the data vertex that each filled vertex copies, which are those from `data` on.
    fn name(&mut self, guides: &[Guide], data: usize) {
        for guide in guides {
            let copied = self.exemplar.get_mut((guide.vertex as usize).wrapping_sub(data));
            if let Some(copied) = copied {
                *copied = guide.from();
            }
        }
    }
}

/// The part of a patch's radius within which normals are averaged for its frame. Less lets a single rough triangle turn the frame,
/// more makes frames of curved places late.
const HOOD: f64 = 0.4;

/// With fewer exemplars a level says nothing.
const FEWEST: usize = 32;

/// Samples along a patch's radius, at most: some 200 in all, whatever distance is wished.
const MOST_SAMPLES: f64 = 8.0;

/// Samples are chosen among vertices if they are to be so many edges apart.
const SPARSE: f64 = 1.3;

/// The same where the publication is followed, in which all vertices move. With less, few vertices of a hole some 7 edges across move
/// on the coarsest level; with more, coarse levels of larger holes compare more samples.
const SPARSE_PUBLISHED: f64 = 2.0;

/// Moves the filled vertices of `filling`, which is triangulated as finely as its data and has the positions of the start, to where
/// exemplars say.
///
/// # Errors
/// If the evaluation is told to stop.
pub(super) fn complete(
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
        let share = |level: usize| level as f64 / radii.len() as f64;
        let own = share(level)..share(level + 1);
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
    let length = |color: &[f64; 3]| color.map(|channel| channel * size / 100.0);
    given.colors.iter().flatten().map(length).collect()
}

/// How far each data vertex is from the nearest missing one; infinite if farther than `most`.
fn distances(surface: &Surface<'_>, points: &[Point3<f64>], data: usize, most: f64) -> Vec<f64> {
    let nearest = surface.nearest(points, data as u32..points.len() as u32, most);
    let distance = |vertex: usize| match nearest[vertex] {
        NONE => f64::INFINITY,
        missing => (points[vertex] - points[missing as usize]).norm(),
    };
    (0..data).map(distance).collect()
}

/// Twice the sum of the area vectors of the faces around each vertex. As published, the start has no say in the normals of the data: it
/// may be a cone.
fn areas(
    surface: &Surface<'_>,
    points: &[Point3<f64>],
    data: usize,
    kept: usize,
    update: Update,
) -> Vec<Vector3<f64>> {
    let area = |vertex: u32| match update {
        Update::Published if (vertex as usize) < data => {
            surface.area_before(points, vertex, kept as u32)
        }
        Update::Exact | Update::Published => surface.area(points, vertex),
    };
    (0..points.len() as u32).map(area).collect()
}

/// What a completion works with on all levels.
struct Completion<'a> {
    surface: &'a Surface<'a>,
    data: usize,
    kept: usize,
    options: &'a ExemplarOptions,
    allowed: Option<&'a [bool]>,
    /// Of all vertices; none if they do not count.
    colors: Vec<Color>,
    hole: Hole,
    /// Marks the filled vertices whose start is sharp; none, if empty.
    sharp: &'a [bool],
    distances: Vec<f64>,
    turns: Turns,
    /// Twice the sum of the area vectors of the faces around each vertex.
    areas: Vec<Vector3<f64>>,
    /// The matches of the level before.
    guides: Vec<Guide>,
}

/// The lengths of a level.
struct Size {
    radius: f64,
    /// The distance between samples.
    sample: f64,
    hood: f64,
    sparse: bool,
}

impl Completion<'_> {
    fn is_published(&self) -> bool {
        self.options.update == Update::Published
    }

    fn size(&self, radius: f64, level: usize) -> Size {
        let edge = self.hole.edge;
        let given = self.options.edges.get(level).copied().filter(|&edge| edge > 0.0);
        let sample = given.unwrap_or(edge.max(radius / SAMPLES)).max(radius / MOST_SAMPLES);
        let (hood, sparse) = match self.options.update {
            Update::Exact => (HOOD * radius, SPARSE),
            Update::Published => (0.0, SPARSE_PUBLISHED),
        };
        Size { radius, sample, hood, sparse: sample > sparse * edge }
    }

    fn exemplars(
        &self,
        size: &Size,
        points: &[Point3<f64>],
        progress: &Progress<'_>,
    ) -> Result<Exemplars, Cancelled> {
        let published = self.is_published();
        let source = Source {
            surface: self.surface,
            points,
            areas: &self.areas,
            colors: &self.colors,
            data: self.data,
            kept: self.kept,
            up: self.options.up.into(),
            radius: size.radius,
            hood: size.hood,
            apart: if size.sparse { 0.5 * size.sample } else { 0.0 },
            cut: published,
        };
        let reach = if published { size.radius } else { REACH * size.radius };
        let may = |vertex: u32| {
            let open = self.allowed.is_none_or(|allowed| allowed[vertex as usize]);
            open && reach < self.distances[vertex as usize]
                && !self.surface.around(vertex).is_empty()
        };
        Exemplars::new(&source, may, progress)
    }

    fn level(
        &mut self,
        size: &Size,
        exemplars: &Exemplars,
        points: &mut [Point3<f64>],
        number: usize,
        progress: &Progress<'_>,
    ) -> Result<Outcome, Cancelled> {
        let whole = Whole {
            surface: self.surface,
            colors: &self.colors,
            data: self.data,
            options: self.options,
            turns: &self.turns,
            hole: &self.hole,
            sharp: self.sharp,
            distances: &self.distances,
        };
        let knows = self.options.start == Start::ThinPlate && !self.is_published();
        let doubt = if knows { smoothness::plate_error(exemplars) } else { f64::INFINITY };
        let spacing = if size.sparse { 0.85 * size.sample } else { 0.0 };
        let moving = if self.is_published() { 0.0 } else { spacing };
        let scale = Scale { radius: size.radius, spacing, moving, hood: size.hood };
        let number = number as u64;
        let level = Level { whole: &whole, scale, number, edge: size.sample, doubt, exemplars };
        level.run(points, &mut self.areas, &self.guides, progress)
    }

    /// Notes what of attributes and pictures is copied from where.
    fn copy(
        &self,
        exemplars: &Exemplars,
        outcome: &Outcome,
        cells: &[u32],
        points: &[Point3<f64>],
        copies: &mut Copies,
    ) {
        let (surface, turns) = (self.surface, &self.turns);
        copies.votes = Votes::new(outcome, exemplars, turns, surface, points, self.data);
        if self.options.texture == Shown::Copied {
            copies.sources =
                Sources::new(outcome, exemplars, turns, surface, points, self.kept, cells);
        }
    }

    /// Adds what the mean of many exemplars has lost, unless they fit exactly, not all vertices move, or the publication is followed.
    fn add_detail(
        &self,
        size: &Size,
        exemplars: &Exemplars,
        outcome: &Outcome,
        cells: &[u32],
        points: &mut [Point3<f64>],
        progress: &Progress<'_>,
    ) -> Result<(), Cancelled> {
        if self.options.most_iterations() == 0
            || outcome.is_exact(size.radius)
            || self.is_published()
            || outcome.patches.movable < cells.len()
        {
            return Ok(());
        }
        let around = |vertex: u32| self.distances[vertex as usize] <= self.hole.width;
        let around = (0..self.data as u32).filter(|&vertex| around(vertex)).collect();
        let (surface, turns, radius) = (self.surface, &self.turns, size.radius);
        let sharp = self.sharp;
        Detail { surface, exemplars, outcome, turns, cells, sharp, radius }.add(points, around);
        let normals = &outcome.normals[..cells.len()];
        bends::bend_alike(surface, points, normals, &self.hole, sharp, progress)
    }
}
