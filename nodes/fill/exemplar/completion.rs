//! The inputs, the state and the results of filling holes with parts of the input surface.

use maquette_node::{CancelledError, Progress};
use maquette_value::TraceStep;
use nalgebra::{Point3, Vector3};

use super::detail::Detail;
use super::exemplars::{Exemplars, REACH, Source};
use super::hole::{Hole, SAMPLES};
use super::level::{CompletionContext, CompletionLevel, Guide, Outcome};
use super::options::{ExemplarOptions, Start, TextureSource, Update};
use super::orientations::Orientations;
use super::patches::Scale;
use super::sources::Sources;
use super::surface::{NONE, Surface};
use super::surroundings::Surroundings;
use super::tints::Color;
use super::votes::Votes;
use super::{dihedral_angles, smoothness};

/// The inputs of a completion (filling holes by copying) in addition to the mesh.
#[derive(Default)]
pub(crate) struct CompletionInput {
    /// For each input vertex, whether the surface around it may be copied; `None` allows all.
    pub(crate) allowed: Option<Vec<bool>>,
    /// The colors of all vertices in CIE L*a*b*; the colors of the fill's vertices are estimated from the rims of the holes.
    pub(crate) colors: Option<Vec<[f64; 3]>>,
    /// For each vertex of the fill, whether creases are extended across its hole in the initial fill; empty if they are across no hole.
    pub(crate) sharp: Vec<bool>,
    /// True if the mesh has attributes that are copied with the shapes.
    pub(crate) copies_attributes: bool,
}

/// The result of a completion (filling holes by copying).
pub(crate) struct CompletionResult {
    /// The iterations that were better than all earlier ones on the same level. `rms` is the square root of the measure by which iterates
    /// are compared, the energy and with `Update::Published` the bends at the seam, `max` the square root of the largest mean squared
    /// distance of a patch, both in mm. Values are comparable only within a level.
    pub(crate) trace: Vec<TraceStep>,
    pub(crate) copies: Copies,
    /// True if no part of the input surface is fit for copying; then the initial fill is returned unchanged.
    pub(crate) no_exemplar: bool,
    /// For each vertex of the fill, true if the surroundings of its hole are smooth and its position, the mean of many exemplars, should be
    /// faired; empty if nothing should. Only with [`Update::Published`], and not if a level ended at a maximum number of iterations given
    /// by the user.
    pub(crate) to_fair: Vec<bool>,
}

impl CompletionResult {
    /// Returns the result for a fill with `count` vertices before any exemplar is searched.
    pub(super) fn new(count: usize) -> Self {
        let copies = Copies::empty(count);
        Self { trace: Vec::new(), copies, no_exemplar: true, to_fair: Vec::new() }
    }
}

/// The positions on the input mesh from which a completion copies attributes and textures.
pub(crate) struct Copies {
    /// For each vertex of the fill, the input vertex that it copies; [`u32::MAX`] if none.
    pub(crate) exemplar: Vec<u32>,
    /// The input vertices whose attributes are averaged for each vertex of the fill.
    pub(crate) votes: Votes,
    /// For each face of the fill, the part of the texture that it shows.
    pub(crate) sources: Sources,
}

impl Copies {
    /// Returns the copies of a fill with `count` vertices that copy nothing.
    pub(crate) fn empty(count: usize) -> Self {
        let (votes, sources) = (Votes::empty(count), Sources::empty());
        Self { exemplar: vec![NONE; count], votes, sources }
    }

    /// Sets the input vertex that each vertex of the fill copies. The vertices of the fill have the indices from `data` on.
    pub(super) fn set_exemplars(&mut self, guides: &[Guide], data: usize) {
        for guide in guides {
            let copied = self.exemplar.get_mut((guide.vertex as usize).wrapping_sub(data));
            if let Some(copied) = copied {
                *copied = guide.exemplar_vertex();
            }
        }
    }
}

/// Radius within which normals are averaged for a patch's frame, in patch radii. With a smaller radius, one rough triangle rotates the
/// frame. With a larger one, frames do not follow the curvature of the surface.
pub(crate) const NORMAL_RADIUS: f64 = 0.4;

/// Minimum number of exemplars (patches of the input surface to copy from); a level with fewer is skipped.
pub(crate) const MIN_EXEMPLARS: usize = 32;

/// Maximum number of samples along a patch's radius: 8 give about 200 samples per patch. A sample distance that would give more samples is
/// enlarged.
pub(crate) const MAX_SAMPLES: f64 = 8.0;

/// Multiple of the edge length above which the sample distance makes a level sparse: then only some of the vertices are samples.
pub(crate) const SPARSE: f64 = 1.3;

/// Replaces [`SPARSE`] for the method [`Update::Published`], which should move all vertices. With a smaller value, only few vertices of a
/// hole about 7 edges wide would move on the coarsest level. With a larger value, the coarse levels of wider holes would compare more
/// samples.
pub(crate) const SPARSE_PUBLISHED: f64 = 2.0;

/// Returns, for each input vertex, the distance to the nearest vertex of the fill; infinite if it exceeds `max_distance`.
pub(crate) fn distances_to_missing(
    surface: &Surface<'_>,
    points: &[Point3<f64>],
    data: usize,
    max_distance: f64,
) -> Vec<f64> {
    let nearest = surface.nearest(points, data as u32..points.len() as u32, max_distance);
    (0..data)
        .map(|vertex: usize| match nearest[vertex] {
            NONE => f64::INFINITY,
            missing => (points[vertex] - points[missing as usize]).norm(),
        })
        .collect()
}

/// Returns, for each vertex, twice the sum of the area vectors of its faces. With [`Update::Published`], faces of the fill do not
/// contribute to input vertices, since the initial fill may be a cone.
pub(crate) fn vertex_areas(
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

/// The state of a completion (filling holes by copying) that all levels share.
pub(crate) struct Completion<'a> {
    pub(super) surface: &'a Surface<'a>,
    pub(super) n_data_vertices: usize,
    pub(super) n_data_faces: usize,
    pub(super) options: &'a ExemplarOptions,
    pub(super) allowed: Option<&'a [bool]>,
    /// The colors of all vertices of the filled mesh; empty if colors are not compared.
    pub(super) colors: Vec<Color>,
    pub(super) hole: Hole,
    /// For each vertex of the fill, whether creases are extended across its hole in the initial fill; empty if they are across no hole.
    pub(super) sharp: &'a [bool],
    /// For each hole, true if its initial fill is kept, because the surface around it is as smooth.
    pub(super) smooth_holes: Vec<bool>,
    pub(super) distances: Vec<f64>,
    pub(super) orientations: Orientations,
    /// Twice the sum of the area vectors of the faces around each vertex.
    pub(super) areas: Vec<Vector3<f64>>,
    /// The matches found on the previous, coarser level.
    pub(super) guides: Vec<Guide>,
}

/// The lengths used on one level of a completion, from coarse to fine.
pub(crate) struct LevelSize {
    pub(super) radius: f64,
    /// The distance between the samples of a patch.
    sample: f64,
    normal_radius: f64,
    sparse: bool,
}

impl Completion<'_> {
    fn is_published(&self) -> bool {
        self.options.update == Update::Published
    }

    pub(super) fn size(&self, radius: f64, level: usize) -> LevelSize {
        let edge = self.hole.edge;
        let given = self.options.edges.get(level).copied().filter(|&edge| edge > 0.0);
        let sample = given.unwrap_or(edge.max(radius / SAMPLES)).max(radius / MAX_SAMPLES);
        let (normal_radius, sparse) = match self.options.update {
            Update::Exact => (NORMAL_RADIUS * radius, SPARSE),
            Update::Published => (0.0, SPARSE_PUBLISHED),
        };
        LevelSize { radius, sample, normal_radius, sparse: sample > sparse * edge }
    }

    pub(super) fn exemplars(
        &self,
        size: &LevelSize,
        points: &[Point3<f64>],
        progress: &Progress<'_>,
    ) -> Result<Exemplars, CancelledError> {
        let reach = if self.is_published() { size.radius } else { REACH * size.radius };
        let is_open = |vertex: u32| {
            let open = self.allowed.is_none_or(|allowed| allowed[vertex as usize]);
            open && reach < self.distances[vertex as usize]
                && !self.surface.faces_around(vertex).is_empty()
        };
        self.exemplars_at(size, points, is_open, progress)
    }

    /// Returns the exemplars around the input vertices for which `is_allowed` is true.
    pub(super) fn exemplars_at(
        &self,
        size: &LevelSize,
        points: &[Point3<f64>],
        is_allowed: impl Fn(u32) -> bool + Sync,
        progress: &Progress<'_>,
    ) -> Result<Exemplars, CancelledError> {
        let source = Source {
            surface: self.surface,
            points,
            areas: &self.areas,
            colors: &self.colors,
            n_data_vertices: self.n_data_vertices,
            n_data_faces: self.n_data_faces,
            up: self.options.up.into(),
            radius: size.radius,
            normal_radius: size.normal_radius,
            spacing: if size.sparse { 0.5 * size.sample } else { 0.0 },
            is_published: self.is_published(),
        };
        Exemplars::new(&source, is_allowed, progress)
    }

    /// Returns true if creases are extended across the hole that contains a vertex of the fill.
    pub(super) fn is_sharp(&self, vertex: u32) -> bool {
        self.sharp.get(vertex as usize - self.n_data_vertices) == Some(&true)
    }

    pub(super) fn level(
        &mut self,
        size: &LevelSize,
        exemplars: &Exemplars,
        points: &mut [Point3<f64>],
        number: usize,
        progress: &Progress<'_>,
    ) -> Result<Outcome, CancelledError> {
        let shared = CompletionContext {
            surface: self.surface,
            colors: &self.colors,
            n_data_vertices: self.n_data_vertices,
            options: self.options,
            orientations: &self.orientations,
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

    /// Records the input positions from which attributes and textures are copied.
    pub(super) fn record_copies(
        &self,
        exemplars: &Exemplars,
        outcome: &Outcome,
        cells: &[u32],
        points: &[Point3<f64>],
        copies: &mut Copies,
    ) {
        let (surface, orientations) = (self.surface, &self.orientations);
        copies.votes =
            Votes::new(outcome, exemplars, orientations, surface, points, self.n_data_vertices);
        if self.options.texture == TextureSource::Copied {
            copies.sources = Sources::new(
                outcome,
                exemplars,
                orientations,
                surface,
                points,
                self.n_data_faces,
                cells,
            );
        }
    }

    /// Adds the detail lost by averaging exemplars (patches of the input surface). Does nothing if the exemplars fit exactly, if some
    /// vertices of the fill are not samples, or with `Update::Published`.
    pub(super) fn add_detail(
        &self,
        size: &LevelSize,
        exemplars: &Exemplars,
        outcome: &Outcome,
        cells: &[u32],
        points: &mut [Point3<f64>],
        progress: &Progress<'_>,
    ) -> Result<(), CancelledError> {
        if self.options.max_iterations() == 0
            || outcome.is_exact(size.radius)
            || self.is_published()
            || outcome.patches.movable < cells.len()
        {
            return Ok(());
        }
        let (surface, orientations, radius) = (self.surface, &self.orientations, size.radius);
        let (hole, sharp) = (&self.hole, self.sharp);
        let around = Surroundings::new(surface, points, hole);
        let detail = Detail {
            surface,
            exemplars,
            outcome,
            orientations,
            cells,
            sharp,
            radius,
            hole,
            around: &around,
            smooth_holes: &self.smooth_holes,
        };
        detail.add(points);
        let normals = &outcome.normals[..cells.len()];
        dihedral_angles::match_dihedral_angles(
            surface, points, normals, hole, &around, sharp, progress,
        )
    }
}
