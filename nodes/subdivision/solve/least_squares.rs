//! Least-squares solution of any linear equations. Among all solutions it finds the one with the smallest change from a given start.
//!
//! Uses conjugate gradients on the normal equations `A^T A x = A^T s`, where `s` is the right side, without forming the matrix `A^T A`:
//! Hestenes and Stiefel, "Methods of conjugate gradients for solving linear systems" (1952), section 10. The matrix `A` may be unsymmetric,
//! have fewer rows than columns, or be singular.

use maquette_base::linear::columns::{self, Column};
use maquette_base::linear::stencils::Stencils;
use maquette_node::{CancelledError, Progress};
use nalgebra::Point3;

use super::extent::absolute_tolerance;
use super::interpolation::Interpolation;
use super::record::Record;
use super::solution::{End, Outcome, Solution};

/// A gradient below this fraction of the residual consists only of rounding errors: the remaining residual is not in the range of the
/// matrix.
const LEVEL: f64 = 1e-10;

/// Computes the least-squares solution of the equations `rows` with the right side `points`; of several solutions the nearest to `start`.
/// Unknowns marked in `fixed`, which may be empty, do not change, and their rows are ignored.
///
/// # Errors
/// If the evaluation is cancelled.
pub(crate) fn least_squares(
    rows: &Stencils,
    start: &[Point3<f64>],
    points: &[Point3<f64>],
    fixed: &[bool],
    options: &Interpolation,
    progress: &Progress<'_>,
) -> Result<Solution, CancelledError> {
    let transposed = rows.transpose(start.len());
    let ones = vec![1.0; start.len().max(points.len())];
    fn size_sq(a: &[Column], ones: &[f64]) -> [f64; 3] {
        columns::dot(a, a, &ones[..a.len()])
    }
    fn hold(column: &mut [Column], fixed: &[bool]) {
        let held = column.iter_mut().zip(fixed).filter(|(_, fixed)| **fixed);
        held.for_each(|(entry, _)| *entry = [0.0; 3]);
    }
    fn max_and_rms(residual: &[Column]) -> [f64; 2] {
        columns::residual_lengths(residual).distances()
    }
    let mut record = Record::new(options.norm, absolute_tolerance(options.tolerance, points));
    let mut unknown: Vec<Column> = start.iter().map(|point| point.coords.into()).collect();
    let mut residual: Vec<Column> = points.iter().map(|point| point.coords.into()).collect();
    columns::add(&mut residual, &rows.apply(&unknown), [-1.0; 3]);
    hold(&mut residual, fixed);
    fn slope(residual: &[Column], transposed: &Stencils, fixed: &[bool]) -> Vec<[f64; 3]> {
        let mut slope = transposed.apply(residual);
        hold(&mut slope, fixed);
        slope
    }
    let mut way = slope(&residual, &transposed, fixed);
    let mut steep = size_sq(&way, &ones);
    let mut settled = record.record(max_and_rms(&residual));
    let mut unreachable = false;
    for _ in 0..options.iterations {
        if settled {
            break;
        }
        progress.check()?;
        let left = size_sq(&residual, &ones);
        let moves = [0, 1, 2].map(|k| steep[k] > LEVEL * LEVEL * left[k]);
        if !moves.contains(&true) {
            unreachable = true;
            break;
        }
        let mut bent = rows.apply(&way);
        hold(&mut bent, fixed);
        let length = size_sq(&bent, &ones);
        let step = [0, 1, 2].map(|k| if moves[k] { steep[k] / length[k] } else { 0.0 });
        columns::add(&mut unknown, &way, step);
        columns::add(&mut residual, &bent, step.map(|step| -step));
        settled = record.record(max_and_rms(&residual));
        let next = slope(&residual, &transposed, fixed);
        let after = size_sq(&next, &ones);
        let ratio = [0, 1, 2].map(|k| if moves[k] { after[k] / steep[k] } else { 0.0 });
        columns::follow(&mut way, &next, ratio);
        steep = after;
    }
    let control = unknown.into_iter().map(Point3::from).collect();
    let outcome = Outcome { control, trace: record.into_trace(), end: End::new(settled) };
    Ok(Solution { outcome, unreachable })
}
