//! How control points make a curve, and where on it each of them has its own parameter.

use maquette_base::linear::stencils::Stencils;
use maquette_value::{Curve, CurveError, KnotVector, KnotVectorError};
use nalgebra::Point3;

use crate::curve_basis::CurveBasis;

/// The curves of some number of control points.
///
/// All of them are B-splines on one knot vector. Those of a closed polygon, and of a subdivision, have more control points than the
/// polygon has: repeated at the ends, so that the curve closes, or put before and behind the ends, so that it begins and ends there.
pub(crate) struct ControlCurve {
    knots: KnotVector,
    /// The spline's control points in terms of the polygon's.
    extended: Stencils,
    /// The parameter of each control point of the polygon.
    parameters: Vec<f64>,
}

impl ControlCurve {
    /// The curves of control points beside these points; only the number of points matters, and for an open B-spline how far they
    /// are apart.
    ///
    /// A subdivided open polygon has the limit of one whose end points are repeated (`Chaikin`) or mirrored (`Cubic`). An open
    /// B-spline has knots by averaging over centripetal parameters: Lee, "Choosing nodes in parametric curve interpolation" (1989).
    ///
    /// # Errors
    /// If there are too few points for the degree.
    pub(crate) fn new(
        basis: CurveBasis,
        points: &[Point3<f64>],
        closed: bool,
    ) -> Result<Self, KnotVectorError> {
        let count = points.len();
        let degree = basis.degree();
        if closed {
            let knots = KnotVector::periodic(count + degree, degree + 1)?;
            let extended = extended(count + degree, |k, push| push(k % count, 1.0));
            // The middle of each basis function; the first ones lie before the domain, which they enter again at its end.
            let (start, _) = knots.domain();
            let shift = (degree + 1) as f64 / 2.0 - degree as f64;
            let parameters = (0..count).map(|k| {
                let middle = k as f64 + shift;
                start + if middle < 0.0 { middle + count as f64 } else { middle }
            });
            let parameters = parameters.collect();
            return Ok(Self { knots, extended, parameters });
        }
        let last = count - 1;
        match basis {
            CurveBasis::Chaikin | CurveBasis::Cubic => {
                let knots = KnotVector::periodic(count + 2, degree + 1)?;
                let mirrored = basis == CurveBasis::Cubic;
                let extended = extended(count + 2, |k, push| {
                    let (end, beside) = if k == 0 { (0, 1) } else { (last, last - 1) };
                    match k {
                        _ if 0 < k && k <= count => push(k - 1, 1.0),
                        _ if mirrored => {
                            push(end, 2.0);
                            push(beside, -1.0);
                        }
                        _ => push(end, 1.0),
                    }
                });
                let (start, end) = knots.domain();
                // Between the ends, the middle of each basis function.
                fn inside(k: usize, start: f64, mirrored: bool) -> f64 {
                    start + k as f64 + if mirrored { 0.0 } else { 0.5 }
                }
                Ok(Self {
                    knots,
                    extended,
                    parameters: (0..count)
                        .map(|k: usize| match k {
                            0 => start,
                            _ if k == last => end,
                            _ => inside(k, start, mirrored),
                        })
                        .collect(),
                })
            }
            CurveBasis::BSpline(_) => {
                let parameters = centripetal(points);
                let knots = KnotVector::averaged(&parameters, degree)?;
                let extended = extended(count, |k, push| push(k, 1.0));
                Ok(Self { knots, extended, parameters })
            }
        }
    }

    /// The curve of some control points.
    ///
    /// # Errors
    /// If a point is not finite.
    pub(crate) fn curve(&self, control: &[Point3<f64>]) -> Result<Curve, CurveError> {
        let points = self.extended.apply(control);
        let weights = vec![1.0; points.len()];
        Curve::rational(points, weights, self.knots.clone())
    }

    /// The parameter of each control point.
    pub(crate) fn parameters(&self) -> &[f64] {
        &self.parameters
    }

    /// The points at these parameters in terms of the control points.
    pub(crate) fn collocation(&self) -> Stencils {
        let rows = Stencils::build(self.parameters.len(), |sums: &mut Vec<(u32, f64)>, k, rows| {
            let (first, values) = self.knots.basis(self.parameters[k]);
            sums.clear();
            for (row, value) in (first..).zip(values) {
                let (indices, weights) = self.extended.row(row);
                sums.extend(indices.iter().zip(weights).map(|(&k, &weight)| (k, weight * value)));
            }
            sums.sort_by_key(|(control, _)| *control);
            for terms in sums.chunk_by(|a, b| a.0 == b.0) {
                let sum: f64 = terms.iter().map(|(_, weight)| weight).sum();
                // The mirrored control point cancels at the end but for rounding.
                if sum.abs() > 1e-15 {
                    rows.push(terms[0].0, sum);
                }
            }
            rows.end();
        });
        rows.0
    }
}

/// So many control points, each of which `write` gives in terms of others.
fn extended(count: usize, write: impl Fn(usize, &mut dyn FnMut(usize, f64)) + Sync) -> Stencils {
    let rows = Stencils::build(count, |_: &mut (), k, rows| {
        write(k, &mut |control, weight| rows.push(control as u32, weight));
        rows.end();
    });
    rows.0
}

/// Parameters from 0 on, as far apart as the square roots of the points' distances.
fn centripetal(points: &[Point3<f64>]) -> Vec<f64> {
    let mut parameter = 0.0;
    let next = points.windows(2).map(|pair| {
        parameter += (pair[1] - pair[0]).norm().sqrt();
        parameter
    });
    [0.0].into_iter().chain(next.collect::<Vec<_>>()).collect()
}
