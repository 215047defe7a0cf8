//! Fitting of the control points of a mesh with given faces.

use maquette_node::{Error, Progress, bail};
use maquette_value::{Mesh, MeshError, Trace, TraceStep};
use nalgebra::Point3;

use super::equations::System;
use super::feet::{Feet, LEVELS, Nearest};
use super::folds::{crossings, folds, vertices_around};
use super::scan::Scan;
use super::stiffness::Stiffness;
use crate::limit::composed::ComposedLimit;

/// The control mesh of a surface that was fitted to points, and the quality of the fit.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedSubdivision {
    /// The fitted control mesh.
    pub mesh: Mesh,
    /// The distances of the points from the surface before each iteration and at the end, in mm.
    pub trace: Trace,
    /// The number of points that are ignored in the last iteration because they are too far from the surface.
    pub left_out: usize,
    /// The first of these points.
    pub first_left_out: Option<Point3<f64>>,
    /// The faces of the control mesh at which the surface folds over, ascending.
    pub folds: Vec<u32>,
}

/// The maximum number of times that the surface becomes stiffer where it folds.
const STIFFENINGS: u32 = 8;

/// The maximum factor by which the largest distance grows when control points return to their start because the surface folds.
const MAX_LOSS: f64 = 1.5;

/// The fit ends with the first iteration that reduces the mean distance by less than this fraction.
pub(super) const MIN_GAIN: f64 = 1e-3;

/// Computes the control mesh of a Loop surface that minimizes the squared distances from the points. The control mesh has the faces of
/// `mesh`.
///
/// Hoppe, DeRose, Duchamp, Halstead, Jin, McDonald, Schweitzer and Stuetzle, "Piecewise smooth surface reconstruction" (1994), section 4,
/// for a fixed topology. Two steps alternate: finding the nearest point of the surface to each given point, and solving for the control
/// points by least squares with the positions of the nearest points on the surface fixed. Distances are measured to the mesh of limit
/// points after two refinement steps. The distance of each control point from the mean of its neighbors (on creases: of its two neighbors
/// on the crease) has as its weight `smoothing` times the number of points per control point. Along the surface (on creases: along the
/// crease) this distance is compared with that in `mesh` and not with 0, because the mean of the neighbors of long thin triangles is far
/// away in their plane.
///
/// Where the surface folds or runs through itself at the end, but that of `mesh` does not, the weight increases step by step, and the whole
/// distance is compared with that in `mesh`, so that the surface approaches the shape of the start. Control points around folds that remain
/// return to their positions in `mesh`, unless the largest distance grows by more than half.
///
/// # Errors
/// If a face is not a triangle, the mesh is not manifold, no point is near the mesh, or the evaluation is cancelled.
pub fn fit_subdivision(
    mesh: &Mesh,
    points: &[Point3<f64>],
    smoothing: f64,
    iterations: u32,
    progress: &Progress<'_>,
) -> Result<FittedSubdivision, Error> {
    let mut fit = Fit { points, scan: None, smoothing, iterations, steps: Vec::new() };
    let (mesh, nearest) = fit.fit_control_points(mesh, progress)?;
    let surface = ComposedLimit::new(&mesh, LEVELS)?.surface(mesh.positions())?;
    Ok(FittedSubdivision { folds: folds(&surface, LEVELS), ..fit.end(mesh, &nearest) })
}

/// The options and the state of the iteration.
pub(super) struct Fit<'a> {
    pub(super) points: &'a [Point3<f64>],
    /// The scanned surface; `None` if only points are given. With a scan, the fitted surface must be near the scan everywhere, and must not
    /// fold.
    pub(super) scan: Option<&'a Scan<'a>>,
    pub(super) smoothing: f64,
    pub(super) iterations: u32,
    pub(super) steps: Vec<TraceStep>,
}

impl Fit<'_> {
    /// Fits the control points. Also returns for each point that is near the surface the nearest point of the surface.
    pub(super) fn fit_control_points(
        &mut self,
        mesh: &Mesh,
        progress: &Progress<'_>,
    ) -> Result<(Mesh, Vec<Option<Nearest>>), Error> {
        let surface = ComposedLimit::new(mesh, LEVELS)?;
        // With a scan, the faces change, too, and even spacing is wanted.
        let mut stiffness = match self.scan {
            None => Stiffness::tangential(mesh),
            Some(_) => Stiffness::even(mesh),
        };
        let mut equations = stiffness.equations();
        let (mut last, mut stiffenings, mut settled) = (self.iterations, 0, f64::INFINITY);
        let reach = 2.0 * mean_edge(mesh);
        let (start, mut mesh) = (mesh, mesh.clone());
        let (mut before, mut best) = (f64::INFINITY, None);
        let mut known = KnownDefects::default();
        for iteration in 0.. {
            match self.scan {
                None => progress.tick((f64::from(iteration) / f64::from(last.max(1))).min(1.0))?,
                Some(_) => progress.check()?,
            }
            let fine = surface.surface(mesh.positions())?;
            let mut feet = Feet::new(&fine, self.points, reach);
            if feet.points.is_empty() {
                bail!(
                    "none of the {} points is within {reach:.3e} mm, two edges, of the mesh; check the positions and units of both",
                    self.points.len()
                );
            }
            let [max, rms] = feet.missed.distances();
            let has_settled = before - rms < MIN_GAIN * before;
            before = rms;
            let step = TraceStep { iteration: self.steps.len() as u64, max, rms };
            self.steps.push(step);
            if has_settled || iteration >= last {
                if self.scan.is_some() || self.iterations == 0 {
                    return Ok((mesh, feet.nearest));
                }
                let defects = known.other_defects(&surface, start, &fine, progress)?;
                settled = settled.min(MAX_LOSS * max);
                let candidate = Candidate::new(mesh.clone(), feet.nearest.clone(), &defects, step);
                let mut chosen = best_candidate(best.take(), candidate, settled);
                if !defects.is_empty() && stiffenings == STIFFENINGS {
                    let returned = return_to_start(&surface, start, &mesh, &mut known, progress)?;
                    let fine = surface.surface(returned.positions())?;
                    let feet = Feet::new(&fine, self.points, reach);
                    let [max, rms] = feet.missed.distances();
                    let defects = known.other_defects(&surface, start, &fine, progress)?;
                    let step = TraceStep { iteration: step.iteration + 1, max, rms };
                    let candidate = Candidate::new(returned, feet.nearest, &defects, step);
                    chosen = best_candidate(Some(chosen), candidate, settled);
                }
                if defects.is_empty() || stiffenings == STIFFENINGS {
                    let last = self.steps.len() as u64;
                    if chosen.step.iteration + 1 != last {
                        self.steps.push(TraceStep { iteration: last, ..chosen.step });
                    }
                    return Ok((chosen.mesh, chosen.nearest));
                }
                best = Some(chosen);
                (last, before) = (iteration + 1, f64::INFINITY);
                stiffenings += 1;
                stiffness.increase(start, &defects.faces());
                equations = stiffness.equations();
            }
            let share = feet.points.len() as f64 / mesh.positions().len() as f64;
            if let Some(scan) = self.scan {
                feet.add_vertices(&scan.feet(&fine));
            }
            let weight = self.smoothing * share;
            let (rows, targets) = &equations;
            let system = System::new(&surface, &feet, rows, targets, weight);
            let found = system.solve(mesh.positions(), progress)?;
            mesh = match self.scan {
                None => mesh.with_positions(found)?,
                Some(_) => move_without_folding(&surface, &mesh, found)?,
            };
        }
        unreachable!("the last iteration returns")
    }

    pub(super) fn end(self, mesh: Mesh, nearest: &[Option<Nearest>]) -> FittedSubdivision {
        let left_out = nearest.iter().filter(|nearest| nearest.is_none()).count();
        let first_left_out = nearest.iter().position(Option::is_none).map(|k| self.points[k]);
        let trace = Trace::new(self.steps).expect("iterations are counted up");
        FittedSubdivision { mesh, trace, left_out, first_left_out, folds: Vec::new() }
    }
}

/// The sorted control faces with defects of a surface.
struct Defects {
    folds: Vec<u32>,
    crossings: Vec<u32>,
}

/// The defects of the surface of the start.
#[derive(Default)]
struct KnownDefects {
    /// True for the vertices of control faces with defects. `None` until the first defect of another surface is found.
    is_near: Option<Vec<bool>>,
}

impl KnownDefects {
    /// Finds the defects of the surface `fine`, except near those of the surface of the start.
    fn other_defects(
        &mut self,
        surface: &ComposedLimit,
        start: &Mesh,
        fine: &Mesh,
        progress: &Progress<'_>,
    ) -> Result<Defects, Error> {
        let mut found = Defects::of(fine, progress)?;
        if found.is_empty() {
            return Ok(found);
        }
        if self.is_near.is_none() {
            let known = Defects::of(&surface.surface(start.positions())?, progress)?;
            let mut is_near = vec![false; start.positions().len()];
            for face in known.faces() {
                for &vertex in start.faces().face(face as usize) {
                    is_near[vertex as usize] = true;
                }
            }
            self.is_near = Some(is_near);
        }
        let is_near = self.is_near.as_deref().unwrap_or_default();
        for faces in [&mut found.folds, &mut found.crossings] {
            faces.retain(|&face| {
                !start.faces().face(face as usize).iter().any(|&vertex| is_near[vertex as usize])
            });
        }
        Ok(found)
    }
}

impl Defects {
    fn of(fine: &Mesh, progress: &Progress<'_>) -> Result<Self, Error> {
        Ok(Self { folds: folds(fine, LEVELS), crossings: crossings(fine, LEVELS, progress)? })
    }

    fn is_empty(&self) -> bool {
        self.folds.is_empty() && self.crossings.is_empty()
    }

    fn faces(&self) -> Vec<u32> {
        [&self.folds[..], &self.crossings].concat()
    }
}

/// A possible result of the fit.
struct Candidate {
    mesh: Mesh,
    nearest: Vec<Option<Nearest>>,
    step: TraceStep,
    folds: usize,
    crossings: usize,
}

impl Candidate {
    fn new(mesh: Mesh, nearest: Vec<Option<Nearest>>, defects: &Defects, step: TraceStep) -> Self {
        let (folds, crossings) = (defects.folds.len(), defects.crossings.len());
        Self { mesh, nearest, step, folds, crossings }
    }
}

/// Returns the better one of two results. Crossing faces are the worst fault, distances greater than `limit` the next one, then folds.
fn best_candidate(best: Option<Candidate>, other: Candidate, limit: f64) -> Candidate {
    fn faults(candidate: &Candidate, limit: f64) -> (usize, bool, usize) {
        (candidate.crossings, candidate.step.max > limit, candidate.folds)
    }
    match best {
        Some(best) if faults(&best, limit) <= faults(&other, limit) => best,
        _ => other,
    }
}

/// Moves the control points around faces at which the surface folds or runs through itself back to their positions in `start`, until no
/// such faces are left that `start` does not have.
fn return_to_start(
    surface: &ComposedLimit,
    start: &Mesh,
    mesh: &Mesh,
    known: &mut KnownDefects,
    progress: &Progress<'_>,
) -> Result<Mesh, Error> {
    let mut positions = mesh.positions().to_vec();
    loop {
        let fine = surface.surface(&positions)?;
        let defects = known.other_defects(surface, start, &fine, progress)?.faces();
        let mut has_changed = false;
        for vertex in vertices_around(start, &defects) {
            let old = start.positions()[vertex as usize];
            let position = std::mem::replace(&mut positions[vertex as usize], old);
            has_changed |= position != old;
        }
        if !has_changed {
            return Ok(mesh.with_positions(positions)?);
        }
    }
}

/// Moves the control points to `positions`, except for control points around folds that the move would cause.
fn move_without_folding(
    surface: &ComposedLimit,
    mesh: &Mesh,
    mut positions: Vec<Point3<f64>>,
) -> Result<Mesh, MeshError> {
    let before = folds(&surface.surface(mesh.positions())?, LEVELS);
    loop {
        let mut after = folds(&surface.surface(&positions)?, LEVELS);
        after.retain(|face| before.binary_search(face).is_err());
        let mut has_changed = false;
        for vertex in vertices_around(mesh, &after) {
            let old = mesh.positions()[vertex as usize];
            let position = std::mem::replace(&mut positions[vertex as usize], old);
            has_changed |= position != old;
        }
        if !has_changed {
            return mesh.with_positions(positions);
        }
    }
}

fn mean_edge(mesh: &Mesh) -> f64 {
    let edges = mesh.edges().vertices;
    fn position(vertex: u32, mesh: &Mesh) -> Point3<f64> {
        mesh.positions()[vertex as usize]
    }
    let lengths = edges.iter().map(|&[a, b]| (position(a, mesh) - position(b, mesh)).norm());
    lengths.sum::<f64>() / edges.len().max(1) as f64
}
