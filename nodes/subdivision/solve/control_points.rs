//! Computes the control points of an interpolating mesh, curve or surface.

use maquette_node::{CancelledError, Progress};
use nalgebra::Point3;

use super::geometric::{FootPoint, FootSearch, iterate};
use super::interpolation::{Interpolation, Solver};
use super::limit_matrix::LimitMatrix;
use super::solution::Solution;

/// Computes the control points whose curve or surface passes through `points`: by the geometric iteration, which finds foot points by
/// `feet`, or by solving the equations `matrix`. Returns `None` if the equations have no solution. `sample` returns points on the curve or
/// surface with given control points. `fixed`, which may be empty, marks control points that do not move; the matrix does not contain them.
///
/// # Errors
/// If the evaluation is cancelled.
pub(crate) fn control_points(
    points: &[Point3<f64>],
    options: &Interpolation,
    fixed: &[bool],
    progress: &Progress<'_>,
    feet: impl FnMut(&[Point3<f64>], FootSearch<'_>) -> Vec<FootPoint>,
    sample: impl Fn(&[Point3<f64>]) -> Option<Vec<Point3<f64>>>,
    matrix: impl FnOnce() -> LimitMatrix,
) -> Result<Option<Solution>, CancelledError> {
    match options.solver {
        Solver::Plain => iterate(points, options, fixed, progress, feet, sample).map(Some),
        Solver::Pcg | Solver::Direct => matrix().solve(points, options, progress),
    }
}
