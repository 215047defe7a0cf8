//! Fitting of the control points of a mesh with given faces.

use maquette_base::linear::columns::Column;
use maquette_base::linear::stencils::Stencils;
use maquette_node::{Error, Progress, bail};
use maquette_value::{Mesh, MeshError, Trace, TraceStep};
use nalgebra::Point3;

use super::equations::System;
use super::feet::{Feet, LEVELS, Nearest};
use super::folds::folds;
use super::scan::Scan;
use crate::limit::composed::{ComposedLimit, laplacian};

/// The control mesh of a surface that was fitted to points, and the quality of the fit.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedSubdivision {
    /// The fitted control mesh.
    pub mesh: Mesh,
    /// The distances of the points from the surface before each iteration and at the end, in mm.
    pub trace: Trace,
    /// The number of points that are ignored in the last iteration because they are too far from the surface.
    pub left_out: usize,
    /// The faces of the control mesh at which the surface folds over, ascending.
    pub folds: Vec<u32>,
}

/// The number of iterations, after the surface has folded, in which it must not fold.
const GUARDED_ROUNDS: u32 = 4;

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
/// If the surface folds at the end, control points around the folds return to their positions in `mesh`, and a few more iterations follow
/// in which control points do not move where the surface would fold.
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
        let stiffness = laplacian(mesh);
        // With a scan, the faces change, too, and even spacing is wanted.
        let targets = match self.scan {
            None => tangential_laplacian(mesh, &stiffness),
            Some(_) => vec![[0.0; 3]; stiffness.len()],
        };
        // The guard hinders the fit, so it acts only from the round in which the surface has folded.
        let (mut is_guarded, mut last) = (self.scan.is_some(), self.iterations);
        let reach = 2.0 * mean_edge(mesh);
        let (start, mut mesh) = (mesh, mesh.clone());
        let mut before = f64::INFINITY;
        for iteration in 0.. {
            match self.scan {
                None => progress.tick((f64::from(iteration) / f64::from(last.max(1))).min(1.0))?,
                Some(_) => progress.check()?,
            }
            let fine = surface.surface(mesh.positions())?;
            let mut feet = Feet::new(&fine, self.points, reach);
            if feet.points.is_empty() {
                bail!(
                    "none of the {} points is near the mesh; check the positions and units of both",
                    self.points.len()
                );
            }
            let [max, rms] = feet.missed.distances();
            let has_settled = before - rms < MIN_GAIN * before;
            before = rms;
            self.steps.push(TraceStep { iteration: self.steps.len() as u64, max, rms });
            if has_settled || iteration == last {
                if is_guarded || self.iterations == 0 || folds(&fine, LEVELS).is_empty() {
                    return Ok((mesh, feet.nearest));
                }
                (is_guarded, last, before) = (true, iteration + GUARDED_ROUNDS, f64::INFINITY);
                mesh = move_without_folding(&surface, start, mesh.positions().to_vec())?;
                continue;
            }
            let share = feet.points.len() as f64 / mesh.positions().len() as f64;
            if let Some(scan) = self.scan {
                feet.add_vertices(&scan.feet(&fine));
            }
            let weight = self.smoothing * share;
            let system = System::new(&surface, &feet, &stiffness, &targets, weight);
            let found = system.solve(mesh.positions(), progress)?;
            mesh = match is_guarded {
                false => mesh.with_positions(found)?,
                true => move_without_folding(&surface, &mesh, found)?,
            };
        }
        unreachable!("the last iteration returns")
    }

    pub(super) fn end(self, mesh: Mesh, nearest: &[Option<Nearest>]) -> FittedSubdivision {
        let left_out = nearest.iter().filter(|nearest| nearest.is_none()).count();
        let trace = Trace::new(self.steps).expect("iterations are counted up");
        FittedSubdivision { mesh, trace, left_out, folds: Vec::new() }
    }
}

/// Returns for each vertex the part of its Laplacian vector that is tangential to the mesh: perpendicular to the normal, or along the
/// crease or border. `laplacian` has a row of three entries for a vertex on a crease or border.
fn tangential_laplacian(mesh: &Mesh, laplacian: &Stencils) -> Vec<Column> {
    let (positions, normals) = (mesh.positions(), mesh.vertex_normals());
    let targets = (0..laplacian.len()).map(|vertex| {
        let vector = laplacian.apply_row(vertex, positions).coords;
        let (indices, _) = laplacian.row(vertex);
        let tangential =
            match indices.iter().filter(|&&k| k as usize != vertex).collect::<Vec<_>>()[..] {
                [&a, &b] => {
                    let along = positions[b as usize] - positions[a as usize];
                    along.try_normalize(0.0).map_or(vector, |along| along * along.dot(&vector))
                }
                _ => vector - normals[vertex] * normals[vertex].dot(&vector),
            };
        tangential.into()
    });
    targets.collect()
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
        let mut is_near = vec![false; positions.len()];
        let corners = after.iter().flat_map(|&face| mesh.faces().face(face as usize));
        corners.for_each(|&vertex| is_near[vertex as usize] = true);
        let mut has_changed = false;
        for face in mesh.faces().iter().filter(|face| face.iter().any(|&v| is_near[v as usize])) {
            for &vertex in face {
                let old = mesh.positions()[vertex as usize];
                let position = std::mem::replace(&mut positions[vertex as usize], old);
                has_changed |= position != old;
            }
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
