//! The control points of a fitted surface, one direction after the other, and how far it misses the points.

use maquette_base::parameters::{even, parameters};
use maquette_node::{Cancelled, Progress};
use maquette_value as value;
use maquette_value::parallel::*;
use maquette_value::{Along, KnotVector, Surface, Trace, TraceStep};
use nalgebra::{Point3, Vector3};

use super::fit_line::{FittedLine, LineFit, Missed};
use crate::fit_error::FitError;
use crate::fit_method::FitMethod;
use crate::fit_parameters::FitParameters;

/// The fit along one direction.
pub(crate) struct Direction {
    pub(crate) fit: LineFit,
    parameters: Vec<f64>,
}

impl Direction {
    pub(crate) fn new(
        net: &value::ControlNet,
        along: Along,
        order: [usize; 2],
        counts: [usize; 2],
        method: FitMethod,
        kind: FitParameters,
    ) -> Result<Self, FitError> {
        let (points, order, count) = match along {
            Along::U => (net.rows(), order[0], counts[0]),
            Along::V => (net.columns(), order[1], counts[1]),
        };
        let control = if count == 0 { points } else { count };
        if points < control || control < order || control < 2 {
            return Err(FitError::Count { along, control, points, order });
        }
        let parameters = match kind {
            FitParameters::Uniform => even(points),
            FitParameters::Chord => parameters(net, along, |distance| distance),
            FitParameters::Centripetal => parameters(net, along, f64::sqrt),
        };
        let degree = order.saturating_sub(1);
        let knots = if control == points {
            KnotVector::averaged(&parameters, degree)?
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
        Ok(Self { fit: fit.ok_or(FitError::Singular { along })?, parameters })
    }

    /// The net coordinate on the fitted surface of one among the points.
    pub(crate) fn coordinate(&self, a: f64) -> f64 {
        let last = self.parameters.len() - 1;
        let before = (a.max(0.0) as usize).min(last);
        let next = self.parameters[(before + 1).min(last)];
        let share = (a - before as f64).clamp(0.0, 1.0);
        let u = self.parameters[before] + (next - self.parameters[before]) * share;
        self.fit.knots().net_coordinate(u)
    }
}

/// The control points for some points.
pub(crate) struct FittedNet {
    /// Row by row.
    pub(crate) points: Vec<Point3<f64>>,
    /// How far they are from settled.
    pub(crate) unsettled: f64,
    /// What the points were missed by before each round along u, then along v, as the largest distance and the root of the mean
    /// square.
    pub(crate) rounds: Vec<[f64; 2]>,
}

/// The control points for some points of the size of `net`, row by row.
pub(crate) fn fit_points(
    points: &[Point3<f64>],
    net: &value::ControlNet,
    u: &Direction,
    v: &Direction,
    progress: &Progress<'_>,
) -> Result<FittedNet, Cancelled> {
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

/// The residuals of lines of `length` points before each round, over all lines. A line that has converged keeps its last residual.
fn missed_before_rounds(lines: &[FittedLine], length: usize) -> Vec<[f64; 2]> {
    let count = lines.iter().map(|line| line.rounds.len()).max().unwrap_or(0);
    (0..count)
        .map(|round: usize| {
            let missed =
                lines.iter().filter_map(|line| line.rounds.get(round).or(line.rounds.last()));
            distances(missed.copied().fold(Missed::default(), Missed::and), lines.len() * length)
        })
        .collect()
}

/// The largest distance and the root of the mean square over so many points.
fn distances(missed: Missed, count: usize) -> [f64; 2] {
    [missed.max, (missed.sum_sq / count as f64).sqrt()]
}

/// The distances before each round, and at last those of the points from the surface.
pub(crate) fn trace(
    rounds: Vec<[f64; 2]>,
    net: &value::ControlNet,
    surface: &Surface,
    u: &Direction,
    v: &Direction,
) -> Result<Trace, FitError> {
    let met = surface.grid(&u.parameters, &v.parameters);
    let missed = net.points().iter().zip(met).map(|(point, met)| Missed::by(&(point - met)));
    let end = distances(missed.fold(Missed::default(), Missed::and), net.points().len());
    let steps = (0..).zip(rounds.into_iter().chain([end]));
    Ok(Trace::new(
        steps
            .map(|(iteration, [max, rms]): (u64, [f64; 2])| TraceStep { iteration, max, rms })
            .collect(),
    )?)
}
