//! What the nodes that interpolate have in common: their parameters, how they find control points, and what they give.

use maquette::value::Trace;
use maquette::{Cancelled, Context, Progress};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::geometric::{FootPoint, Look, iterate};
use super::limit_matrix::LimitMatrix;

/// Which point of a curve or surface a given point is compared with.
///
/// The form with the nearest point is described in Japanese patent 4934789, filed on 2007-01-15; the default is the linear
/// progressive form.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Foot {
    /// The limit point of its own control point: a linear problem with one solution, where there is one.
    #[default]
    Vertex,
    /// The nearest one; on a subdivision surface the nearest on the faces at the vertex, reached downhill from its limit point, as
    /// another sheet of the surface may come nearer. The curve or surface then passes through the point, but not at its control
    /// point's own parameter. Where the iteration does not halve the largest distance in time, the points that are missed by most go on
    /// with `Vertex`.
    Closest,
}

/// Which way a control point moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Direction {
    /// From the foot to the given point.
    #[default]
    Residual,
    /// Along the normal at the foot, as far as the given point is away; from the foot to the point where there is no
    /// perpendicular, at ends, borders and creases, and where this does not converge.
    Normal,
}

/// How control points are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Solver {
    /// Conjugate gradients: fewest iterations. For `foot: Vertex` and `direction: Residual`.
    #[default]
    Pcg,
    /// The geometric iteration itself: for every foot and direction.
    Plain,
    /// One factorization, exact up to rounding. For `foot: Vertex` and `direction: Residual`.
    Direct,
}

/// Which distance must be within the tolerance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Norm {
    /// The largest one.
    #[default]
    Max,
    /// The root of the mean of the squares.
    Mean,
}

/// How control points are found whose curve or surface passes through given points.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Interpolation {
    /// Which point of the curve or surface each given point is compared with.
    #[serde(default)]
    pub foot: Foot,
    /// Which way a control point moves.
    #[serde(default)]
    pub direction: Direction,
    /// How control points are found.
    #[serde(default)]
    pub solver: Solver,
    /// Distance from the given points that is small enough, over the diagonal of their box.
    #[schemars(range(min = 1e-14, max = 1.0))]
    #[serde(default = "millionth")]
    pub tolerance: f64,
    /// Which distance that is.
    #[serde(default)]
    pub norm: Norm,
    /// Most iterations.
    #[schemars(range(max = 100_000))]
    #[serde(default = "two_hundred")]
    pub iterations: u32,
}

fn millionth() -> f64 {
    1e-6
}

fn two_hundred() -> u32 {
    200
}

impl Default for Interpolation {
    fn default() -> Self {
        Self {
            foot: Foot::default(),
            direction: Direction::default(),
            solver: Solver::default(),
            tolerance: millionth(),
            norm: Norm::default(),
            iterations: two_hundred(),
        }
    }
}

impl Interpolation {
    /// Whether the control points are the solution of linear equations.
    pub(super) fn is_linear(&self) -> bool {
        self.foot == Foot::Vertex && self.direction == Direction::Residual
    }

    /// # Errors
    /// If the solver is not for this foot and direction.
    pub(super) fn check(&self) -> Result<(), NotLinear> {
        match self.solver {
            Solver::Pcg | Solver::Direct if !self.is_linear() => {
                Err(NotLinear { solver: self.solver })
            }
            _ => Ok(()),
        }
    }

    /// The control points whose feet are `points`, by the iteration with these feet or from the equations of this matrix; none if
    /// these have no solution. `fixed` marks control points that stay, and which the matrix leaves out; it may be empty.
    ///
    /// # Errors
    /// If the evaluation is told to stop.
    pub(super) fn solve(
        &self,
        points: &[Point3<f64>],
        fixed: &[bool],
        progress: &Progress<'_>,
        feet: impl FnMut(&[Point3<f64>], Look<'_>) -> Vec<FootPoint>,
        matrix: impl FnOnce() -> LimitMatrix,
    ) -> Result<Option<Solution>, Cancelled> {
        match self.solver {
            Solver::Plain => iterate(points, self, fixed, progress, feet).map(Some),
            Solver::Pcg | Solver::Direct => matrix().solve(points, self, progress),
        }
    }
}

/// A solver of linear equations for what is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "solver {solver:?} solves linear equations, which only `foot: Vertex` with `direction: Residual` gives: take `solver: Plain`"
)]
pub struct NotLinear {
    /// The solver.
    pub solver: Solver,
}

/// The control points that were found, and how.
#[derive(Clone, Debug)]
pub(super) struct Found {
    pub(super) control: Vec<Point3<f64>>,
    pub(super) trace: Trace,
    pub(super) end: End,
}

/// How looking for control points ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum End {
    /// The distances are within the tolerance.
    Settled,
    /// They are not yet, or cannot be.
    Short,
    /// They grew, and were never small, or control points went too far.
    RanAway(RanAway),
}

impl End {
    /// That of distances which are within the tolerance, or are not.
    pub(super) fn new(settled: bool) -> Self {
        if settled { Self::Settled } else { Self::Short }
    }
}

/// An iteration that leads away from the points.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "the iteration runs away: at its best, after {iteration} iterations, it misses a point by {missed:.3e} mm or has control points farther \
     away than the points from each other; take more iterations, or `foot: Vertex` with `direction: Residual`"
)]
pub struct RanAway {
    /// The iteration that came nearest.
    pub iteration: u32,
    /// The distance then, in mm.
    pub missed: f64,
}

/// Control points, and whether the limits of any are nearer to the given points.
pub(super) struct Solution {
    pub(super) found: Found,
    /// Whether what is left of the distances is beyond the reach of the matrix.
    pub(super) unreachable: bool,
}

/// What passes through points: the control points of a mesh, a curve or a surface, and how they were found.
#[derive(Clone, Debug, PartialEq)]
pub struct Interpolated<T> {
    /// The mesh, curve or surface.
    pub shape: T,
    /// The distances before each iteration and at the end, in mm.
    pub trace: Trace,
    /// Whether the distances are within the tolerance.
    pub settled: bool,
}

impl Found {
    /// What `shape` makes of the control points.
    ///
    /// # Errors
    /// If the iteration ran away, and those of `shape`.
    pub(super) fn shaped<T, E: From<RanAway>>(
        self,
        shape: impl FnOnce(Vec<Point3<f64>>) -> Result<T, E>,
    ) -> Result<Interpolated<T>, E> {
        if let End::RanAway(error) = self.end {
            return Err(error.into());
        }
        let settled = self.end == End::Settled;
        Ok(Interpolated { shape: shape(self.control)?, trace: self.trace, settled })
    }
}

impl<T> Interpolated<T> {
    /// The outputs of a node, which warns if its curve or surface is too far from the points.
    pub(super) fn outputs(self, cx: &Context<'_>, what: &str) -> (T, Trace) {
        if !self.settled {
            let last = self.trace.steps().last();
            let (iterations, missed) = last.map_or((0, 0.0), |step| (step.iteration, step.max));
            cx.warn(format!(
                "the {what} is not within the tolerance after {iterations} iterations: it misses a point by {missed:.3e} mm"
            ));
        }
        (self.shape, self.trace)
    }
}
