//! Fits a subdivision surface to scattered points.

use maquette::value::{self, Mesh, MeshError, RangeImage, Trace, TraceStep, TriangleTree};
use maquette::{Cancelled, Context, Error, In, Node, Progress};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::SubdivideError;
use super::columns::{self, Column};
use super::composed::{Composed, laplacian};
use super::geometric::Missed;
use super::stencils::Stencils;
use crate::cholesky::Cholesky;

/// Moves the control points of a Loop subdivision surface until it is as near as possible to given points.
///
/// The control mesh keeps its faces: start with `Simplify` of a dense mesh of the points. Its creases and borders stay sharp, so that
/// the surface is smooth piece by piece. Points whose nearest place is farther away than two edges of the control mesh are left out:
/// they belong to parts that the mesh does not have.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct FitSubdivision {
    /// The control mesh to start with: triangles.
    pub mesh: In<Mesh>,
    /// What the surface is to be near: points, the cells of a range image, or the vertices of a mesh.
    pub points: In<Scattered>,
    /// Weight of smoothness beside nearness: more for noisy points.
    #[schemars(range(min = 0.0, max = 1000.0))]
    #[serde(default = "thousandth")]
    pub smoothing: f64,
    /// How often the nearest places are looked for anew.
    #[schemars(range(max = 1000))]
    #[serde(default = "six")]
    pub iterations: u32,
}

fn thousandth() -> f64 {
    1e-3
}

fn six() -> u32 {
    6
}

maquette::union! {
    /// Points in space.
    pub enum Scattered {
        Points(value::Points),
        RangeImage(RangeImage),
        Mesh(Mesh),
    }
}

/// Why no surface was fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitSubdivisionError {
    /// No points near the mesh.
    #[error("none of the {count} points is near the mesh: are both in the same place and unit?")]
    Apart {
        /// Number of points.
        count: usize,
    },
    /// A mesh that Loop's scheme cannot refine.
    #[error(transparent)]
    Subdivide(#[from] SubdivideError),
    /// Places out of all bounds.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl Node for FitSubdivision {
    type Outputs = (Mesh, Trace);
    const OUTPUTS: [&'static str; 2] = ["mesh", "trace"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let points = match cx.get(&self.points) {
            Scattered::Points(points) => points.positions().to_vec(),
            Scattered::Mesh(mesh) => mesh.positions().to_vec(),
            Scattered::RangeImage(range) => {
                (0..range.points().len()).filter_map(|cell| range.point(cell)).collect()
            }
        };
        let Self { smoothing, iterations, .. } = *self;
        let fitted =
            fit_subdivision(cx.get(&self.mesh), &points, smoothing, iterations, cx.progress())?;
        if 0 < fitted.left_out {
            let (count, all) = (fitted.left_out, points.len());
            cx.warn(format!("{count} of {all} points are far from the mesh and were left out"));
        }
        Ok((fitted.mesh, fitted.trace))
    }
}

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

/// Steps of subdivision after which the surface is measured; its limit is met at the vertices of that mesh.
const LEVELS: u32 = 2;

/// The iteration ends when it takes less than this share of the mean distance away.
const LEAST_GAIN: f64 = 1e-3;

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
    let surface = Composed::new(mesh, LEVELS)?;
    let stiffness = laplacian(mesh);
    let reach = 2.0 * mean_edge(mesh);
    let mut mesh = mesh.clone();
    let mut steps: Vec<TraceStep> = Vec::new();
    for iteration in 0..=u64::from(iterations) {
        progress.tick(iteration as f64 / f64::from(iterations.max(1)))?;
        let feet = Feet::new(&surface.surface(mesh.positions())?, points, reach);
        if feet.points.is_empty() {
            return Err(FitSubdivisionError::Apart { count: points.len() });
        }
        let [max, rms] = feet.missed.distances();
        let settled = steps.last().is_some_and(|last| last.rms - rms < LEAST_GAIN * last.rms);
        steps.push(TraceStep { iteration, max, rms });
        if settled || iteration == u64::from(iterations) {
            let left_out = points.len() - feet.points.len();
            let trace = Trace::new(steps).expect("iterations are counted up");
            return Ok(FittedSubdivision { mesh, trace, left_out });
        }
        let share = feet.points.len() as f64 / mesh.positions().len() as f64;
        let weight = smoothing * share;
        let system = System::new(&surface, &feet, &stiffness, weight);
        mesh = mesh.with_positions(system.solve(mesh.positions(), progress)?)?;
    }
    unreachable!("the last iteration returns")
}

fn mean_edge(mesh: &Mesh) -> f64 {
    let edges = mesh.edges().vertices;
    let place = |vertex: u32| mesh.positions()[vertex as usize];
    let lengths = edges.iter().map(|&[a, b]| (place(a) - place(b)).norm());
    lengths.sum::<f64>() / edges.len().max(1) as f64
}

/// The points that count, and their nearest places on a fine mesh.
struct Feet {
    points: Vec<Column>,
    /// Each place as the mean of three vertices.
    rows: Stencils,
    missed: Missed,
}

impl Feet {
    fn new(fine: &Mesh, points: &[Point3<f64>], reach: f64) -> Self {
        let places = TriangleTree::new(fine).nearest_to_all(points);
        let near = points.iter().zip(places).filter_map(|(point, place)| {
            let place = place.filter(|place| place.distance_sq <= reach * reach)?;
            Some((Column::from(point.coords), place))
        });
        let (points, places): (Vec<Column>, Vec<_>) = near.unzip();
        let corners = fine.faces().corners();
        let (rows, _) = Stencils::build(places.len(), |_: &mut (), k, rows| {
            for (corner, share) in places[k].corners(fine).into_iter().zip(places[k].shares) {
                rows.push(corners[corner], share);
            }
            rows.end();
        });
        let missed = places.iter().map(|place| place.distance_sq);
        let missed = missed.fold(Missed::none(), Missed::and_by);
        Self { points, rows, missed }
    }
}

/// The equations `A P = X` of the feet of points and `weight^(1/2) L P = 0` below them, which least squares meet as nearly as possible.
struct System {
    rows: Stencils,
    transposed: Stencils,
    right: Vec<Column>,
}

/// The residual that is left of the one at the start where the equations are solved step by step: far below what the next nearest
/// places change.
const PRECISION: f64 = 1e-6;

/// Most steps.
const MOST_STEPS: usize = 500;

impl System {
    fn new(surface: &Composed, feet: &Feet, stiffness: &Stencils, weight: f64) -> Self {
        let rows = feet.rows.times(&surface.rows).above(stiffness, weight.sqrt());
        let mut right = feet.points.clone();
        right.resize(rows.len(), [0.0; 3]);
        Self { transposed: rows.transposed(stiffness.len()), rows, right }
    }

    /// The control points: by factors, or where these do not determine them all, with the least change from those that are known.
    fn solve(
        &self,
        start: &[Point3<f64>],
        progress: &Progress<'_>,
    ) -> Result<Vec<Point3<f64>>, Cancelled> {
        progress.check()?;
        let Some(factors) = Cholesky::new(&self.rows.squared_with(&self.transposed)) else {
            return self.conjugate_gradients(start, progress);
        };
        let mut control = self.transposed.apply(&self.right);
        factors.solve(&mut control);
        Ok(control.into_iter().map(Point3::from).collect())
    }

    fn conjugate_gradients(
        &self,
        start: &[Point3<f64>],
        progress: &Progress<'_>,
    ) -> Result<Vec<Point3<f64>>, Cancelled> {
        let mut control: Vec<Column> = start.iter().map(|point| point.coords.into()).collect();
        let ones = vec![1.0; control.len()];
        let mut residual = self.transposed.apply(&self.right);
        columns::add(&mut residual, &self.apply(&control), [-1.0; 3]);
        let mut way = residual.clone();
        let mut energy = columns::dot(&residual, &residual, &ones);
        let enough = energy.map(|energy| energy * PRECISION * PRECISION);
        for _ in 0..MOST_STEPS {
            let moves = [0, 1, 2].map(|k| energy[k] > enough[k]);
            if !moves.contains(&true) {
                break;
            }
            progress.check()?;
            let bent = self.apply(&way);
            let curving = columns::dot(&bent, &way, &ones);
            let step = [0, 1, 2].map(|k| match moves[k] && curving[k] > 0.0 {
                true => energy[k] / curving[k],
                false => 0.0,
            });
            columns::add(&mut control, &way, step);
            columns::add(&mut residual, &bent, step.map(|step| -step));
            let after = columns::dot(&residual, &residual, &ones);
            let ratio = [0, 1, 2].map(|k| if moves[k] { after[k] / energy[k] } else { 0.0 });
            columns::follow(&mut way, &residual, ratio);
            energy = after;
        }
        Ok(control.into_iter().map(Point3::from).collect())
    }

    /// The matrix of the normal equations times a column.
    fn apply(&self, x: &[Column]) -> Vec<Column> {
        self.transposed.apply(&self.rows.apply(x))
    }
}

#[cfg(test)]
mod tests;
