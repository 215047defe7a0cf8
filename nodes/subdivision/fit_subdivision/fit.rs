//! A control mesh with given faces whose surface is near to points.

use maquette_node::Progress;
use maquette_value::{Mesh, MeshError, Trace, TraceStep};
use nalgebra::Point3;

use super::equations::System;
use super::feet::{Feet, LEVELS, Nearest};
use super::fit_subdivision_error::FitSubdivisionError;
use super::folds::folds;
use super::scan::Scan;
use crate::limit::composed::{Composed, laplacian};

/// A fitted control mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedSubdivision {
    /// The control mesh.
    pub mesh: Mesh,
    /// The points' distances from the surface before each iteration and at the end, in mm.
    pub trace: Trace,
    /// How many points were left out at the end.
    pub left_out: usize,
}

/// The iteration ends when it takes less than this share of the mean distance away.
pub(super) const LEAST_GAIN: f64 = 1e-3;

/// The control mesh of Loop's scheme, with the faces of `mesh`, whose surface is nearest to the points by squares.
///
/// Hoppe, DeRose, Duchamp, Halstead, Jin, McDonald, Schweitzer and Stuetzle, "Piecewise smooth surface reconstruction" (1994), section
/// 4, for a fixed topology: nearest places on the surface, then least squares for the control points with these places held, in turn.
/// The surface is measured as the mesh of its limit points after two steps. `smoothing` times the number of points per control point
/// weighs how far control points are from the mean of their neighbors, on creases of their two neighbors there.
///
/// # Errors
/// If a face is no triangle, the mesh is not manifold, no point is near it, or the evaluation is told to stop.
pub fn fit_subdivision(
    mesh: &Mesh,
    points: &[Point3<f64>],
    smoothing: f64,
    iterations: u32,
    progress: &Progress<'_>,
) -> Result<FittedSubdivision, FitSubdivisionError> {
    let mut fit = Fit { points, scan: None, smoothing, iterations, steps: Vec::new() };
    let (mesh, nearest) = fit.settled(mesh, progress)?;
    Ok(fit.end(mesh, &nearest))
}

/// The iteration.
pub(super) struct Fit<'a> {
    pub(super) points: &'a [Point3<f64>],
    /// What lies between the points, if that counts: the surface is to be near it everywhere, and must not begin to fold.
    pub(super) scan: Option<&'a Scan<'a>>,
    pub(super) smoothing: f64,
    pub(super) iterations: u32,
    pub(super) steps: Vec<TraceStep>,
}

impl Fit<'_> {
    /// The mesh with its control points where its surface is nearest to the points, and for each point its nearest place, if it is near.
    pub(super) fn settled(
        &mut self,
        mesh: &Mesh,
        progress: &Progress<'_>,
    ) -> Result<(Mesh, Vec<Option<Nearest>>), FitSubdivisionError> {
        let surface = Composed::new(mesh, LEVELS)?;
        let stiffness = laplacian(mesh);
        let reach = 2.0 * mean_edge(mesh);
        let mut mesh = mesh.clone();
        let mut before = f64::INFINITY;
        for iteration in 0..=self.iterations {
            match self.scan {
                None => progress.tick(f64::from(iteration) / f64::from(self.iterations.max(1)))?,
                Some(_) => progress.check()?,
            }
            let fine = surface.surface(mesh.positions())?;
            let mut feet = Feet::new(&fine, self.points, reach);
            if feet.points.is_empty() {
                return Err(FitSubdivisionError::Apart { count: self.points.len() });
            }
            let [max, rms] = feet.missed.distances();
            let has_settled = before - rms < LEAST_GAIN * before;
            before = rms;
            self.steps.push(TraceStep { iteration: self.steps.len() as u64, max, rms });
            if has_settled || iteration == self.iterations {
                return Ok((mesh, feet.nearest));
            }
            let share = feet.points.len() as f64 / mesh.positions().len() as f64;
            if let Some(scan) = self.scan {
                feet.hold(&scan.feet(&fine));
            }
            let system = System::new(&surface, &feet, &stiffness, self.smoothing * share);
            let found = system.solve(mesh.positions(), progress)?;
            mesh = match self.scan {
                None => mesh.with_positions(found)?,
                Some(_) => unfolded(&surface, &mesh, found)?,
            };
        }
        unreachable!("the last iteration returns")
    }

    pub(super) fn end(self, mesh: Mesh, nearest: &[Option<Nearest>]) -> FittedSubdivision {
        let left_out = nearest.iter().filter(|nearest| nearest.is_none()).count();
        let trace = Trace::new(self.steps).expect("iterations are counted up");
        FittedSubdivision { mesh, trace, left_out }
    }
}

/// The mesh with its control points in new places, but for those around new folds, which stay.
fn unfolded(
    surface: &Composed,
    mesh: &Mesh,
    mut places: Vec<Point3<f64>>,
) -> Result<Mesh, MeshError> {
    let before = folds(&surface.surface(mesh.positions())?, LEVELS);
    loop {
        let mut after = folds(&surface.surface(&places)?, LEVELS);
        after.retain(|face| before.binary_search(face).is_err());
        let mut is_near = vec![false; places.len()];
        let corners = after.iter().flat_map(|&face| mesh.faces().face(face as usize));
        corners.for_each(|&vertex| is_near[vertex as usize] = true);
        let mut has_changed = false;
        for face in mesh.faces().iter().filter(|face| face.iter().any(|&v| is_near[v as usize])) {
            for &vertex in face {
                let old = mesh.positions()[vertex as usize];
                let place = std::mem::replace(&mut places[vertex as usize], old);
                has_changed |= place != old;
            }
        }
        if !has_changed {
            return mesh.with_positions(places);
        }
    }
}

fn mean_edge(mesh: &Mesh) -> f64 {
    let edges = mesh.edges().vertices;
    fn place(vertex: u32, mesh: &Mesh) -> Point3<f64> {
        mesh.positions()[vertex as usize]
    }
    let lengths = edges.iter().map(|&[a, b]| (place(a, mesh) - place(b, mesh)).norm());
    lengths.sum::<f64>() / edges.len().max(1) as f64
}
