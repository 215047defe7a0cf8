//! The control points of a fitted surface, one direction after the other, and its residuals.

use maquette_base::parameters::{coincident_line, parameters, uniform_parameters};
use maquette_node::{CancelledError, Error, Progress, bail};
use maquette_value as value;
use maquette_value::parallel::*;
use maquette_value::{KnotVector, ParameterDirection, Surface, Trace, TraceStep};
use nalgebra::{Point3, Vector3};

use super::fit_line::{FittedLine, LineFit, Residual};
use crate::fit_method::FitMethod;
use crate::fit_parameters::FitParameters;

/// The fit of a surface along one parameter direction, u or v.
pub(crate) struct Direction {
    pub(crate) fit: LineFit,
    parameters: Vec<f64>,
}

impl Direction {
    pub(crate) fn new(
        net: &value::ControlNet,
        along: ParameterDirection,
        order: [usize; 2],
        counts: [usize; 2],
        method: FitMethod,
        kind: FitParameters,
    ) -> Result<Self, Error> {
        let (points, order, count) = match along {
            ParameterDirection::U => (net.rows(), order[0], counts[0]),
            ParameterDirection::V => (net.columns(), order[1], counts[1]),
        };
        let control = if count == 0 { points } else { count };
        if points < control || control < order || control < 2 {
            bail!(
                "{control} control points along {along:?} do not fit: there are {points} points, and order {order} needs {order} of both"
            );
        }
        let parameters = match kind {
            FitParameters::Uniform => uniform_parameters(points),
            FitParameters::Chord => parameters(net, along, |distance| distance),
            FitParameters::Centripetal => parameters(net, along, f64::sqrt),
        };
        let degree = order.saturating_sub(1);
        let knots = if control == points {
            KnotVector::from_parameters(&parameters, degree)?
        } else {
            KnotVector::approximating(&parameters, control, degree)?
        };
        let fit = match method {
            FitMethod::Lspia { iterations, tolerance, .. } => {
                Some(LineFit::progressive(knots, &parameters, iterations, tolerance))
            }
            _ if control == points => LineFit::interpolate(knots, &parameters),
            _ => LineFit::least_squares(knots, &parameters),
        };
        Ok(Self {
            fit: fit.ok_or_else(|| {
                let lines = match along {
                    ParameterDirection::U => "rows",
                    ParameterDirection::V => "columns",
                };
                let cause = coincident_line(&parameters).map(|second| {
                    let first = second - 1;
                    format!(": {lines} {first} and {second} of the net, counted from 0, are in one place; remove one of them")
                });
                let cause = cause.unwrap_or_else(|| "; lower `order`".to_owned());
                Error::new(format!(
                    "the points along {along:?} do not determine the surface{cause}, or use `method: LeastSquares` with fewer {lines}"
                ))
            })?,
            parameters,
        })
    }

    /// Converts a position among the points (a row or column number, which may be fractional) to the net coordinate on the fitted surface.
    pub(crate) fn coordinate(&self, a: f64) -> f64 {
        let last = self.parameters.len() - 1;
        let before = (a.max(0.0) as usize).min(last);
        let next = self.parameters[(before + 1).min(last)];
        let share = (a - before as f64).clamp(0.0, 1.0);
        let u = self.parameters[before] + (next - self.parameters[before]) * share;
        self.fit.knots().net_coordinate(u)
    }
}

/// The control points of a surface fitted to some points.
pub(crate) struct FittedNet {
    /// The control points, row by row.
    pub(crate) points: Vec<Point3<f64>>,
    /// The largest step of a control point in the last round of an iteration that did not converge, in mm; 0 if all iterations converged.
    pub(crate) unsettled: f64,
    /// The largest distance and the root mean square of the distances before each round: first the rounds along u, then those along v.
    pub(crate) rounds: Vec<[f64; 2]>,
}

/// Fits a surface to `points` and returns its control points. The list has as many points as the net of the surface, row by row.
pub(crate) fn fit_points(
    points: &[Point3<f64>],
    net: &value::ControlNet,
    u: &Direction,
    v: &Direction,
    progress: &Progress<'_>,
) -> Result<FittedNet, CancelledError> {
    let [rows, columns] = [net.rows(), net.columns()];
    let down = (0..columns).into_par_iter().map(|column| {
        let line: Vec<Vector3<f64>> =
            (0..rows).map(|row| points[row * columns + column].coords).collect();
        u.fit.fit(&line, progress)
    });
    let down = down.collect::<Result<Vec<_>, _>>()?;
    let across = (0..u.fit.knots().n_control()).into_par_iter().map(|row| {
        let line: Vec<Vector3<f64>> = down.iter().map(|line| line.control[row]).collect();
        v.fit.fit(&line, progress)
    });
    let across = across.collect::<Result<Vec<_>, _>>()?;
    let unsettled = down.iter().chain(&across).map(|line| line.unsettled).fold(0.0, f64::max);
    let mut rounds = missed_before_rounds(&down, rows);
    rounds.extend(missed_before_rounds(&across, columns));
    let points = across.into_iter().flat_map(|line| line.control).map(Point3::from).collect();
    Ok(FittedNet { points, unsettled, rounds })
}

/// Returns the largest distance and the root mean square before each round, over all lines, which have `length` points each. A line that
/// has converged earlier counts with its last residual.
fn missed_before_rounds(lines: &[FittedLine], length: usize) -> Vec<[f64; 2]> {
    let count = lines.iter().map(|line| line.rounds.len()).max().unwrap_or(0);
    (0..count)
        .map(|round: usize| {
            let missed =
                lines.iter().filter_map(|line| line.rounds.get(round).or(line.rounds.last()));
            distances(
                missed.copied().fold(Residual::default(), Residual::merge),
                lines.len() * length,
            )
        })
        .collect()
}

/// Returns the largest distance and the root mean square distance over `count` points.
fn distances(missed: Residual, count: usize) -> [f64; 2] {
    [missed.max, (missed.sum_sq / count as f64).sqrt()]
}

/// Returns the trace of a fit: the distances in `rounds`, followed by those of the net's points from the fitted surface.
pub(crate) fn trace(
    rounds: Vec<[f64; 2]>,
    net: &value::ControlNet,
    surface: &Surface,
    u: &Direction,
    v: &Direction,
) -> Result<Trace, Error> {
    let met = surface.grid(&u.parameters, &v.parameters);
    let missed =
        net.points().iter().zip(met).map(|(point, met)| Residual::of_distance(&(point - met)));
    let end = distances(missed.fold(Residual::default(), Residual::merge), net.points().len());
    let steps = (0..).zip(rounds.into_iter().chain([end]));
    Ok(Trace::new(
        steps
            .map(|(iteration, [max, rms]): (u64, [f64; 2])| TraceStep { iteration, max, rms })
            .collect(),
    )?)
}
