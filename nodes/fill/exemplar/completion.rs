//! What a completion starts from, works with and gives.

use maquette_node::{Cancelled, Progress};
use maquette_value::TraceStep;
use nalgebra::{Point3, Vector3};

use super::detail::Detail;
use super::exemplars::{Exemplars, REACH, Source};
use super::hole::{Hole, SAMPLES};
use super::level::{CompletionLevel, Guide, Outcome, Shared};
use super::options::{ExemplarOptions, Shown, Start, Update};
use super::patches::Scale;
use super::sources::Sources;
use super::surface::{NONE, Surface};
use super::tints::Color;
use super::turns::Turns;
use super::votes::Votes;
use super::{bends, smoothness};

/// What a completion is given beside the mesh.
#[derive(Default)]
pub(crate) struct Given {
    /// Marks the data vertices around which exemplars may be; all, if left out.
    pub(crate) allowed: Option<Vec<bool>>,
    /// The colors of all vertices in CIE L*a*b*; those of filled vertices are estimated from the rim.
    pub(crate) colors: Option<Vec<[f64; 3]>>,
    /// Marks the filled vertices of holes across which the start extends creases of the data; none, if empty.
    pub(crate) sharp: Vec<bool>,
}

/// How a completion went.
pub(crate) struct Completed {
    /// The iterations that were better than all before them on their level: `rms` is the root of the energy, `max` the root of the
    /// largest mean square of a patch's distances, both in mm. They compare within a level alone.
    pub(crate) trace: Vec<TraceStep>,
    pub(crate) copies: Copies,
    /// Whether no part of the data can be an exemplar; the start is left as it is then.
    pub(crate) no_exemplar: bool,
}

/// What a completion copies from where.
pub(crate) struct Copies {
    /// The data vertex that each filled vertex copies; [`u32::MAX`] if none.
    pub(crate) exemplar: Vec<u32>,
    /// The data vertices whose attributes are averaged for each filled vertex.
    pub(crate) votes: Votes,
    /// Which part of a picture belongs on each filled face.
    pub(crate) sources: Sources,
}

impl Copies {
    /// Nothing, for so many filled vertices.
    pub(crate) fn none(count: usize) -> Self {
        let (votes, sources) = (Votes::none(count), Sources::none());
        Self { exemplar: vec![NONE; count], votes, sources }
    }

    /// Names the data vertex that each filled vertex copies, which are those from `data` on.
    pub(super) fn name(&mut self, guides: &[Guide], data: usize) {
        for guide in guides {
            let copied = self.exemplar.get_mut((guide.vertex as usize).wrapping_sub(data));
            if let Some(copied) = copied {
                *copied = guide.from();
            }
        }
    }
}

/// The radius within which normals are averaged for a patch's frame, in radii of the patch. With less, a single rough triangle turns the
/// frame; with more, frames lag behind the surface where it curves.
pub(crate) const NORMAL_RADIUS: f64 = 0.4;

/// With fewer exemplars a level is left out.
pub(crate) const FEWEST: usize = 32;

/// Samples along a patch's radius, at most: some 200 in all, whatever distance is wished.
pub(crate) const MOST_SAMPLES: f64 = 8.0;

/// Samples are chosen among vertices if they are to be so many edges apart.
pub(crate) const SPARSE: f64 = 1.3;

/// The same where the publication is followed, in which all vertices move. With less, few vertices of a hole some 7 edges across move
/// on the coarsest level; with more, coarse levels of larger holes compare more samples.
pub(crate) const SPARSE_PUBLISHED: f64 = 2.0;

/// How far each data vertex is from the nearest missing one; infinite if farther than `most`.
pub(crate) fn distances(
    surface: &Surface<'_>,
    points: &[Point3<f64>],
    data: usize,
    most: f64,
) -> Vec<f64> {
    let nearest = surface.nearest(points, data as u32..points.len() as u32, most);
    (0..data)
        .map(|vertex: usize| match nearest[vertex] {
            NONE => f64::INFINITY,
            missing => (points[vertex] - points[missing as usize]).norm(),
        })
        .collect()
}

/// Twice the sum of the area vectors of the faces around each vertex. As published, the start does not count for the normals of the data:
/// it may be a cone.
pub(crate) fn areas(
    surface: &Surface<'_>,
    points: &[Point3<f64>],
    data: usize,
    kept: usize,
    update: Update,
) -> Vec<Vector3<f64>> {
    (0..points.len() as u32)
        .map(|vertex: u32| match update {
            Update::Published if (vertex as usize) < data => {
                surface.area_before(points, vertex, kept as u32)
            }
            Update::Exact | Update::Published => surface.area(points, vertex),
        })
        .collect()
}

/// What a completion works with on all levels.
pub(crate) struct Completion<'a> {
    pub(super) surface: &'a Surface<'a>,
    pub(super) data: usize,
    pub(super) kept: usize,
    pub(super) options: &'a ExemplarOptions,
    pub(super) allowed: Option<&'a [bool]>,
    /// Of all vertices; none if they do not count.
    pub(super) colors: Vec<Color>,
    pub(super) hole: Hole,
    /// Marks the filled vertices whose start is sharp; none, if empty.
    pub(super) sharp: &'a [bool],
    pub(super) distances: Vec<f64>,
    pub(super) turns: Turns,
    /// Twice the sum of the area vectors of the faces around each vertex.
    pub(super) areas: Vec<Vector3<f64>>,
    /// The matches of the level before.
    pub(super) guides: Vec<Guide>,
}

/// The lengths of a level.
pub(crate) struct Size {
    pub(super) radius: f64,
    /// The distance between samples.
    sample: f64,
    normal_radius: f64,
    sparse: bool,
}

impl Completion<'_> {
    fn is_published(&self) -> bool {
        self.options.update == Update::Published
    }

    pub(super) fn size(&self, radius: f64, level: usize) -> Size {
        let edge = self.hole.edge;
        let given = self.options.edges.get(level).copied().filter(|&edge| edge > 0.0);
        let sample = given.unwrap_or(edge.max(radius / SAMPLES)).max(radius / MOST_SAMPLES);
        let (normal_radius, sparse) = match self.options.update {
            Update::Exact => (NORMAL_RADIUS * radius, SPARSE),
            Update::Published => (0.0, SPARSE_PUBLISHED),
        };
        Size { radius, sample, normal_radius, sparse: sample > sparse * edge }
    }

    pub(super) fn exemplars(
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
            normal_radius: size.normal_radius,
            apart: if size.sparse { 0.5 * size.sample } else { 0.0 },
            cut: published,
        };
        let reach = if published { size.radius } else { REACH * size.radius };
        Exemplars::new(
            &source,
            |vertex: u32| {
                let open = self.allowed.is_none_or(|allowed| allowed[vertex as usize]);
                open && reach < self.distances[vertex as usize]
                    && !self.surface.around(vertex).is_empty()
            },
            progress,
        )
    }

    pub(super) fn level(
        &mut self,
        size: &Size,
        exemplars: &Exemplars,
        points: &mut [Point3<f64>],
        number: usize,
        progress: &Progress<'_>,
    ) -> Result<Outcome, Cancelled> {
        let shared = Shared {
            surface: self.surface,
            colors: &self.colors,
            data: self.data,
            options: self.options,
            turns: &self.turns,
            hole: &self.hole,
            sharp: self.sharp,
            distances: &self.distances,
        };
        let is_estimate = self.options.start == Start::ThinPlate && !self.is_published();
        let plate_error =
            if is_estimate { smoothness::plate_error(exemplars) } else { f64::INFINITY };
        let spacing = if size.sparse { 0.85 * size.sample } else { 0.0 };
        let moving = if self.is_published() { 0.0 } else { spacing };
        let scale =
            Scale { radius: size.radius, spacing, moving, normal_radius: size.normal_radius };
        let number = number as u64;
        let level = CompletionLevel {
            shared: &shared,
            scale,
            number,
            edge: size.sample,
            plate_error,
            exemplars,
        };
        level.run(points, &mut self.areas, &self.guides, progress)
    }

    /// Notes what of attributes and pictures is copied from where.
    pub(super) fn copy(
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
    pub(super) fn add_detail(
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
        fn around(vertex: u32, distances: &[f64], hole_width: f64) -> bool {
            distances[vertex as usize] <= hole_width
        }
        let around = (0..self.data as u32)
            .filter(|&vertex| around(vertex, &self.distances, self.hole.width))
            .collect();
        let (surface, turns, radius) = (self.surface, &self.turns, size.radius);
        let sharp = self.sharp;
        Detail { surface, exemplars, outcome, turns, cells, sharp, radius }.add(points, around);
        let normals = &outcome.normals[..cells.len()];
        bends::bend_alike(surface, points, normals, &self.hole, sharp, progress)
    }
}
