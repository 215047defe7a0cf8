//! Finds the control points of what passes through points.

use maquette_node::{Cancelled, Progress};
use nalgebra::Point3;

use super::geometric::{FootPoint, Look, iterate};
use super::interpolation::{Interpolation, Solver};
use super::limit_matrix::LimitMatrix;
use super::solution::Solution;

/// The control points whose feet are `points`, by the iteration with these feet or from the equations of this matrix; none if
/// these have no solution. `sample` gives points all over what some control points make. `fixed` marks control points that stay, and which the
/// matrix leaves out; it may be empty.
///
/// # Errors
/// If the evaluation is told to stop.
pub(crate) fn control_points(
    points: &[Point3<f64>],
    how: &Interpolation,
    fixed: &[bool],
    progress: &Progress<'_>,
    feet: impl FnMut(&[Point3<f64>], Look<'_>) -> Vec<FootPoint>,
    sample: impl Fn(&[Point3<f64>]) -> Option<Vec<Point3<f64>>>,
    matrix: impl FnOnce() -> LimitMatrix,
) -> Result<Option<Solution>, Cancelled> {
    match how.solver {
        Solver::Plain => iterate(points, how, fixed, progress, feet, sample).map(Some),
        Solver::Pcg | Solver::Direct => matrix().solve(points, how, progress),
    }
}
