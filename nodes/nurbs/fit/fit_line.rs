//! B-spline curves through or near points with given parameters: one direction of a fitted surface.

use maquette_base::linear::banded::{BandedMatrix, Factors};
use maquette_node::{CancelledError, Progress};
use maquette_value::KnotVector;
use nalgebra::Vector3;

/// A prepared fit of B-spline curves to lines (rows or columns) of points. All lines have the same parameters.
pub(crate) struct LineFit {
    knots: KnotVector,
    /// For the parameter of each point, the index of the first nonzero basis function, and the values of all nonzero basis functions.
    rows: Vec<(usize, Vec<f64>)>,
    solver: Solver,
}

/// A method that computes control points.
enum Solver {
    /// Interpolation with as many control points as points: the factored collocation matrix.
    Interpolate(Factors),
    /// Least squares with fewer control points: the factored normal equations of all control points except the ends.
    LeastSquares(Factors),
    /// Progressive iteration, with at most `iterations` rounds, until no control point moves farther than `tolerance` (in mm).
    Progressive { iterations: usize, tolerance: f64 },
}

/// The control points of one line.
pub(crate) struct FittedLine {
    pub(crate) control: Vec<Vector3<f64>>,
    /// Largest step of a control point in the last round of an iteration that did not converge, in mm; 0 if the iteration converged.
    pub(crate) unsettled: f64,
    /// The residuals of the points before each round of an iteration.
    pub(crate) rounds: Vec<Residual>,
}

/// The residuals of some points, in mm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Residual {
    /// The largest distance of a point from the curve or surface.
    pub(crate) max: f64,
    /// The sum of the squared distances of the points from the curve or surface, in mm^2.
    pub(crate) sum_sq: f64,
}

impl Residual {
    /// The residual of a single point, given the vector from the curve or surface to the point.
    pub(crate) fn of_distance(distance: &Vector3<f64>) -> Self {
        Self { max: distance.norm(), sum_sq: distance.norm_squared() }
    }

    /// Combines the residuals of two sets of points.
    pub(crate) fn merge(self, other: Self) -> Self {
        Self { max: self.max.max(other.max), sum_sq: self.sum_sq + other.sum_sq }
    }
}

impl LineFit {
    /// Prepares curves through all points. Returns `None` if the knots are unsuitable for the parameters.
    ///
    /// Piegl and Tiller, *The NURBS Book*, 2nd ed. (1997), section 9.2.1.
    pub(crate) fn interpolate(knots: KnotVector, parameters: &[f64]) -> Option<Self> {
        let rows = rows(&knots, parameters);
        let mut matrix = BandedMatrix::new(rows.len(), knots.degree());
        for (k, (first, values)) in rows.iter().enumerate() {
            for (column, &value) in (*first..).zip(values).filter(|(_, value)| **value != 0.0) {
                // The Schoenberg-Whitney condition: each parameter must be in the support of the basis function with the same index.
                if column.abs_diff(k) > knots.degree() {
                    return None;
                }
                matrix.add(k, column, value);
            }
        }
        Some(Self { solver: Solver::Interpolate(matrix.factor()?), knots, rows })
    }

    /// Prepares curves that begin and end at the first and the last point and approximate the others by least squares. Returns `None` if
    /// the knots are unsuitable for the parameters.
    ///
    /// Piegl and Tiller (1997), section 9.4.1, eqs. 9.63 to 9.67.
    pub(crate) fn least_squares(knots: KnotVector, parameters: &[f64]) -> Option<Self> {
        let rows = rows(&knots, parameters);
        let inner = knots.n_control() - 2;
        let mut matrix = BandedMatrix::new(inner, knots.degree().min(inner.saturating_sub(1)));
        for (first, values) in &rows[1..rows.len() - 1] {
            let terms = (*first..).zip(values).filter(|(k, _)| 1 <= *k && *k <= inner);
            for (a, x) in terms.clone() {
                terms.clone().for_each(|(b, y)| matrix.add(a - 1, b - 1, x * y));
            }
        }
        Some(Self { solver: Solver::LeastSquares(matrix.factor()?), knots, rows })
    }

    /// Prepares the curves of [`least_squares`](Self::least_squares) or [`interpolate`](Self::interpolate), but computed by progressive
    /// iteration. The iteration runs until no control point moves farther than `tolerance`, at most for the given number of rounds.
    pub(crate) fn progressive(
        knots: KnotVector,
        parameters: &[f64],
        iterations: usize,
        tolerance: f64,
    ) -> Self {
        let rows = rows(&knots, parameters);
        Self { solver: Solver::Progressive { iterations, tolerance }, knots, rows }
    }

    pub(crate) fn knots(&self) -> &KnotVector {
        &self.knots
    }

    /// Returns the control points of one line, given a point for each parameter.
    ///
    /// # Errors
    /// Returns an error if the evaluation is cancelled.
    pub(crate) fn fit(
        &self,
        points: &[Vector3<f64>],
        progress: &Progress<'_>,
    ) -> Result<FittedLine, CancelledError> {
        fn direct_solution(control: Vec<Vector3<f64>>) -> FittedLine {
            FittedLine { control, unsettled: 0.0, rounds: Vec::new() }
        }
        Ok(match &self.solver {
            Solver::Interpolate(factors) => {
                let mut control = points.to_vec();
                factors.solve(&mut control);
                direct_solution(control)
            }
            Solver::LeastSquares(factors) => direct_solution(self.approximate(factors, points)),
            &Solver::Progressive { iterations, tolerance } => {
                let mut control = self.start(points);
                let mut steps = Steps::new(&self.rows, self.knots.n_control());
                let mut unsettled = f64::INFINITY;
                let mut rounds = Vec::new();
                for _ in 0..iterations {
                    progress.check()?;
                    let round = steps.round(&self.rows, points, &mut control, 1.0);
                    rounds.push(round.missed);
                    unsettled = round.control;
                    if unsettled <= tolerance {
                        unsettled = 0.0;
                        break;
                    }
                }
                FittedLine { control, unsettled, rounds }
            }
        })
    }

    fn approximate(&self, factors: &Factors, points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let last = self.knots.n_control() - 1;
        let ends = [points[0], points[points.len() - 1]];
        let mut right = vec![Vector3::zeros(); last - 1];
        for ((first, values), point) in self.rows.iter().zip(points).skip(1).take(points.len() - 2)
        {
            let mut rest = *point;
            for (k, &value) in (*first..).zip(values) {
                match k {
                    0 => rest -= ends[0] * value,
                    k if k == last => rest -= ends[1] * value,
                    _ => {}
                }
            }
            for (k, &value) in (*first..).zip(values).filter(|(k, _)| 1 <= *k && *k < last) {
                right[k - 1] += rest * value;
            }
        }
        factors.solve(&mut right);
        right.insert(0, ends[0]);
        right.push(ends[1]);
        right
    }

    /// Returns the initial control points of an iteration: points at even steps along the list, interpolated between its entries. If there
    /// are as many control points as points, these are the points themselves.
    fn start(&self, points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let count = self.knots.n_control();
        let last = points.len() - 1;
        (0..count)
            .map(|k: usize| {
                let index = (k * last) as f64 / (count - 1) as f64;
                let before = (index as usize).min(last);
                let next = points[(before + 1).min(last)];
                points[before] + (next - points[before]) * (index - before as f64)
            })
            .collect()
    }
}

fn rows(knots: &KnotVector, parameters: &[f64]) -> Vec<(usize, Vec<f64>)> {
    parameters.iter().map(|&u| knots.basis(u)).collect()
}

/// Progressive iteration: every round moves each control point by the residuals of the points that the control point influences.
///
/// With as many control points as points, a control point moves by the residual of the point with its index: Lin, Bao and Wang, "Totally
/// positive bases and progressive iteration approximation" (2005). With fewer control points, a control point moves by the mean residual
/// weighted by the control point's basis function, and the ends are fixed at the first and the last point: Deng and Lin, "Progressive and
/// iterative approximation for least squares B-spline curve and surface fitting" (2014).
struct Steps {
    /// The sum of each basis function over all points; empty if there are as many control points as points.
    sums: Vec<f64>,
    missed: Vec<Vector3<f64>>,
    moves: Vec<Vector3<f64>>,
}

/// The result of one round.
struct Round {
    /// The residuals of the points before the round.
    missed: Residual,
    /// The largest step of a control point in the round, in mm.
    control: f64,
}

impl Steps {
    fn new(rows: &[(usize, Vec<f64>)], n_control: usize) -> Self {
        let mut sums = Vec::new();
        if n_control < rows.len() {
            sums = vec![0.0; n_control];
            for (first, values) in rows {
                (*first..).zip(values).for_each(|(k, value)| sums[k] += value);
            }
        }
        let (missed, moves) =
            (vec![Vector3::zeros(); rows.len()], vec![Vector3::zeros(); n_control]);
        Self { sums, missed, moves }
    }

    /// Runs one round; the steps of the control points are multiplied by `factor`.
    fn round(
        &mut self,
        rows: &[(usize, Vec<f64>)],
        points: &[Vector3<f64>],
        control: &mut [Vector3<f64>],
        factor: f64,
    ) -> Round {
        for ((missed, point), (first, values)) in self.missed.iter_mut().zip(points).zip(rows) {
            let terms = control[*first..].iter().zip(values);
            *missed = point - terms.map(|(control, &value)| control * value).sum::<Vector3<f64>>();
        }
        if self.sums.is_empty() {
            self.moves.copy_from_slice(&self.missed);
        } else {
            self.moves.fill(Vector3::zeros());
            for (missed, (first, values)) in self.missed.iter().zip(rows) {
                for (k, &value) in (*first..).zip(values) {
                    self.moves[k] += missed * value;
                }
            }
            for (step, &sum) in self.moves.iter_mut().zip(&self.sums) {
                // A control point whose basis function is 0 at all points does not move.
                *step = if sum > 0.0 { *step / sum } else { Vector3::zeros() };
            }
            let last = self.moves.len() - 1;
            (self.moves[0], self.moves[last]) = (Vector3::zeros(), Vector3::zeros());
        }
        fn largest(all: &[Vector3<f64>]) -> f64 {
            all.iter().map(|x| x.norm()).fold(0.0, f64::max)
        }
        let missed = self
            .missed
            .iter()
            .map(Residual::of_distance)
            .fold(Residual::default(), Residual::merge);
        let round = Round { missed, control: factor * largest(&self.moves) };
        control.iter_mut().zip(&self.moves).for_each(|(control, step)| *control += step * factor);
        round
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the points of a figure of eight; their parameters are the angles.
    fn lemniscate() -> (Vec<f64>, Vec<Vector3<f64>>) {
        let pi = std::f64::consts::PI;
        let angles: Vec<f64> =
            (0..=10).map(|i| -pi / 2.0 + f64::from(i) * 2.0 * pi / 10.0).collect();
        let points = angles
            .iter()
            .map(|&t| Vector3::new(libm::cos(t), libm::sin(t) * libm::cos(t), 0.0))
            .collect();
        (angles, points)
    }

    fn helix() -> (Vec<f64>, Vec<Vector3<f64>>) {
        let angles: Vec<f64> =
            (0..=18).map(|i| f64::from(i) * std::f64::consts::PI / 3.0).collect();
        let points = angles
            .iter()
            .map(|&t| Vector3::new(5.0 * libm::cos(t), 5.0 * libm::sin(t), t))
            .collect();
        (angles, points)
    }

    /// Returns the largest distance of a point from the curve before each round, with steps multiplied by `factor`.
    fn trace((angles, points): (Vec<f64>, Vec<Vector3<f64>>), factor: f64) -> Vec<f64> {
        let knots = KnotVector::from_parameters(&angles, 3).unwrap();
        let rows = rows(&knots, &angles);
        let mut steps = Steps::new(&rows, knots.n_control());
        let mut control = points.clone();
        (0..=50).map(|_| steps.round(&rows, &points, &mut control, factor).missed.max).collect()
    }

    // The expected errors are the published ones; all printed digits must be equal.
    #[test]
    fn progressive_iteration_has_the_published_errors() {
        fn check(trace: Vec<f64>, published: &[(usize, &str)]) {
            for &(k, expected) in published {
                let expected: f64 = expected.parse().unwrap();
                assert_eq!(format!("{:.5e}", trace[k]), format!("{expected:.5e}"), "round {k}");
            }
        }
        check(
            trace(lemniscate(), 1.0),
            &[
                (0, "1.80322e-01"),
                (1, "7.60106e-02"),
                (2, "3.74101e-02"),
                (5, "1.26188e-02"),
                (10, "2.30600e-03"),
                (20, "7.78212e-05"),
                (30, "2.64605e-06"),
                (50, "3.06023e-09"),
            ],
        );
        check(
            trace(lemniscate(), 2.0 / (1.0 + 0.279554369)),
            &[
                (0, "1.80322e-01"),
                (1, "6.58704e-02"),
                (2, "2.09819e-02"),
                (5, "3.70432e-03"),
                (10, "1.76206e-04"),
                (20, "4.56456e-07"),
                (30, "1.19103e-09"),
            ],
        );
        check(
            trace(helix(), 1.0),
            &[
                (0, "1.77667e+00"),
                (1, "7.30589e-01"),
                (2, "3.67395e-01"),
                (5, "9.76607e-02"),
                (10, "1.66185e-02"),
                (20, "5.70404e-04"),
                (30, "2.03391e-05"),
                (50, "2.62516e-08"),
            ],
        );
        check(
            trace(helix(), 2.0 / (1.0 + 0.282776715)),
            &[
                (0, "1.77667e+00"),
                (1, "6.32259e-01"),
                (2, "1.82570e-01"),
                (5, "2.57692e-02"),
                (10, "1.33753e-03"),
                (20, "3.88687e-06"),
                (30, "1.15399e-08"),
            ],
        );
    }

    fn evaluate(fit: &LineFit, control: &[Vector3<f64>], u: f64) -> Vector3<f64> {
        let (first, values) = fit.knots().basis(u);
        control[first..].iter().zip(values).map(|(control, value)| control * value).sum()
    }

    #[test]
    fn an_interpolation_goes_through_its_points_and_iteration_ends_there() {
        let (angles, points) = helix();
        let knots = KnotVector::from_parameters(&angles, 3).unwrap();
        let direct = LineFit::interpolate(knots.clone(), &angles).unwrap();
        let control = direct.fit(&points, &Progress::silent()).unwrap().control;
        for (&angle, point) in angles.iter().zip(&points) {
            assert!((evaluate(&direct, &control, angle) - point).norm() <= 1e-13);
        }
        let settled = LineFit::progressive(knots.clone(), &angles, 200, 1e-11)
            .fit(&points, &Progress::silent())
            .unwrap();
        assert_eq!(settled.unsettled, 0.0);
        let apart = settled.control.iter().zip(&control).map(|(a, b)| (a - b).norm());
        assert!(apart.fold(0.0, f64::max) <= 1e-9);
        let stopped = LineFit::progressive(knots, &angles, 3, 1e-11)
            .fit(&points, &Progress::silent())
            .unwrap();
        assert!(stopped.unsettled > 0.1, "{}", stopped.unsettled);
    }

    #[test]
    fn least_squares_are_what_the_iteration_settles_at() {
        let parameters: Vec<f64> =
            (0..40).map(|k| f64::from(k * (k + 30)) / (39.0 * 69.0)).collect();
        let points: Vec<_> = parameters
            .iter()
            .map(|&u| Vector3::new(u, libm::sin(9.0 * u), libm::sin(300.0 * u)))
            .collect();
        let knots = KnotVector::approximating(&parameters, 9, 3).unwrap();
        let direct = LineFit::least_squares(knots.clone(), &parameters).unwrap();
        let control = direct.fit(&points, &Progress::silent()).unwrap().control;
        assert_eq!((control[0], control[8]), (points[0], points[39]));
        let settled = LineFit::progressive(knots, &parameters, 20_000, 1e-13)
            .fit(&points, &Progress::silent())
            .unwrap();
        let apart = settled.control.iter().zip(&control).map(|(a, b)| (a - b).norm());
        assert!(apart.fold(0.0, f64::max) <= 1e-8);
        // The result is optimal if moving any control point increases the sum of squared distances.
        fn sum_sq(
            control: &[Vector3<f64>],
            parameters: &[f64],
            points: &[Vector3<f64>],
            direct: &LineFit,
        ) -> f64 {
            let missed =
                parameters.iter().zip(points).map(|(&u, p)| evaluate(direct, control, u) - p);
            missed.map(|missed| missed.norm_squared()).sum()
        }
        for k in 1..8 {
            for step in [-1e-4, 1e-4] {
                let mut moved = control.clone();
                moved[k].z += step;
                assert!(
                    sum_sq(&moved, &parameters, &points, &direct)
                        > sum_sq(&control, &parameters, &points, &direct)
                );
            }
        }
    }
}
