//! Linear equations of any shape: as nearly solved as they can be, with the least change from a given start.
//!
//! Conjugate gradients on the normal equations `A^T A x = A^T s`, which are never made: Hestenes and Stiefel, "Methods of conjugate
//! gradients for solving linear systems" (1952), section 10. The matrix may be square and not symmetric, have fewer rows than
//! columns, or take some directions to zero.

use maquette_base::linear::columns::{self, Column};
use maquette_base::linear::stencils::Stencils;
use maquette_node::{Cancelled, Progress};
use nalgebra::Point3;

use super::extent::diagonal;
use super::interpolation::Interpolation;
use super::record::Record;
use super::solution::{End, Found, Solution};

/// A slope that is so much smaller than the residual is rounding: what is left is beyond the reach of the matrix.
const LEVEL: f64 = 1e-10;

/// The unknowns nearest to `start` for which the rows give `points`, or come as near as they can. Unknowns that `fixed` marks stay,
/// and their rows have no say; it may be empty.
///
/// # Errors
/// If the evaluation is told to stop.
pub(crate) fn least_squares(
    rows: &Stencils,
    start: &[Point3<f64>],
    points: &[Point3<f64>],
    fixed: &[bool],
    how: &Interpolation,
    progress: &Progress<'_>,
) -> Result<Solution, Cancelled> {
    let transposed = rows.transposed(start.len());
    let ones = vec![1.0; start.len().max(points.len())];
    fn size_sq(a: &[Column], ones: &[f64]) -> [f64; 3] {
        columns::dot(a, a, &ones[..a.len()])
    }
    fn hold(column: &mut [Column], fixed: &[bool]) {
        let held = column.iter_mut().zip(fixed).filter(|(_, fixed)| **fixed);
        held.for_each(|(entry, _)| *entry = [0.0; 3]);
    }
    fn missed(residual: &[Column]) -> [f64; 2] {
        columns::missed(residual).distances()
    }
    let mut record = Record::new(how.norm, how.tolerance * diagonal(points));
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
    let mut settled = record.note(missed(&residual));
    let mut unreachable = false;
    for _ in 0..how.iterations {
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
        settled = record.note(missed(&residual));
        let next = slope(&residual, &transposed, fixed);
        let after = size_sq(&next, &ones);
        let ratio = [0, 1, 2].map(|k| if moves[k] { after[k] / steep[k] } else { 0.0 });
        columns::follow(&mut way, &next, ratio);
        steep = after;
    }
    let control = unknown.into_iter().map(Point3::from).collect();
    let found = Found { control, trace: record.into_trace(), end: End::new(settled) };
    Ok(Solution { found, unreachable })
}
