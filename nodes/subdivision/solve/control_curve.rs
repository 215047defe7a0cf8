//! The curve that belongs to a polygon of control points, and the curve parameter of each control point.

use maquette_base::linear::stencils::Stencils;
use maquette_value::{Curve, CurveError, KnotVector, KnotVectorError};
use nalgebra::Point3;

use crate::curve_basis::CurveBasis;

/// The family of all curves with a fixed number of control points.
///
/// All curves of the family are B-splines with one knot vector. For a closed polygon, or a subdivision scheme, the B-spline has more
/// control points than the polygon. The additional points repeat points of a closed polygon, which closes the curve, or extend an open
/// polygon at both ends, which makes the curve begin and end at its end points.
pub(crate) struct ControlCurve {
    knots: KnotVector,
    /// The B-spline's control points as weighted sums of the polygon's points.
    extension: Stencils,
    /// The parameter of each point of the polygon.
    parameters: Vec<f64>,
}

impl ControlCurve {
    /// Creates the family of curves that have as many control points as `points` has points. The positions of `points` matter only for an
    /// open B-spline, whose knots depend on the distances of the points.
    ///
    /// The limit of a subdivided open polygon is the limit of a polygon whose end points are repeated (`Chaikin`) or mirrored (`Cubic`). An
    /// open B-spline has knots averaged from centripetal parameters: Lee, "Choosing nodes in parametric curve interpolation" (1989).
    ///
    /// # Errors
    /// If there are too few points for the degree of the curve.
    pub(crate) fn new(
        basis: CurveBasis,
        points: &[Point3<f64>],
        closed: bool,
    ) -> Result<Self, KnotVectorError> {
        let count = points.len();
        let degree = basis.degree();
        if closed {
            let knots = KnotVector::periodic(count + degree, degree + 1)?;
            let extended = extension_stencils(count + degree, |k, push| push(k % count, 1.0));
            // The parameter of a control point is the middle of its basis function. The first of these parameters are before the start of
            // the domain; they wrap around to the end of the domain.
            let (start, _) = knots.domain();
            let shift = (degree + 1) as f64 / 2.0 - degree as f64;
            let parameters = (0..count).map(|k| {
                let middle = k as f64 + shift;
                start + if middle < 0.0 { middle + count as f64 } else { middle }
            });
            let parameters = parameters.collect();
            return Ok(Self { knots, extension: extended, parameters });
        }
        let last = count - 1;
        match basis {
            CurveBasis::Chaikin | CurveBasis::Cubic => {
                let knots = KnotVector::periodic(count + 2, degree + 1)?;
                let mirrored = basis == CurveBasis::Cubic;
                let extended = extension_stencils(count + 2, |k, push| {
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
                // The parameter of a control point is the middle of its basis function, folded back at the ends of the domain.
                fn fold_index(k: usize, start: f64, mirrored: bool) -> f64 {
                    start + k as f64 + if mirrored { 0.0 } else { 0.5 }
                }
                Ok(Self {
                    knots,
                    extension: extended,
                    parameters: (0..count)
                        .map(|k: usize| match k {
                            0 => start,
                            _ if k == last => end,
                            _ => fold_index(k, start, mirrored),
                        })
                        .collect(),
                })
            }
            CurveBasis::BSpline(_) => {
                let parameters = centripetal(points);
                let knots = KnotVector::from_parameters(&parameters, degree)?;
                let extended = extension_stencils(count, |k, push| push(k, 1.0));
                Ok(Self { knots, extension: extended, parameters })
            }
        }
    }

    /// Returns the curve with the control points `control`.
    ///
    /// # Errors
    /// If a point is not finite.
    pub(crate) fn curve(&self, control: &[Point3<f64>]) -> Result<Curve, CurveError> {
        let points = self.extension.apply(control);
        let weights = vec![1.0; points.len()];
        Curve::rational(points, weights, self.knots.clone())
    }

    /// The parameter of each control point.
    pub(crate) fn parameters(&self) -> &[f64] {
        &self.parameters
    }

    /// Returns the collocation matrix: the curve points at `parameters` as weighted sums of the control points.
    pub(crate) fn collocation(&self) -> Stencils {
        let rows = Stencils::build(self.parameters.len(), |sums: &mut Vec<(u32, f64)>, k, rows| {
            let (first, values) = self.knots.basis(self.parameters[k]);
            sums.clear();
            for (row, value) in (first..).zip(values) {
                let (indices, weights) = self.extension.row(row);
                sums.extend(indices.iter().zip(weights).map(|(&k, &weight)| (k, weight * value)));
            }
            sums.sort_by_key(|(control, _)| *control);
            for terms in sums.chunk_by(|a, b| a.0 == b.0) {
                let sum: f64 = terms.iter().map(|(_, weight)| weight).sum();
                // At an end of the curve the weight of the mirrored control point cancels, up to rounding.
                if sum.abs() > 1e-15 {
                    rows.push(terms[0].0, sum);
                }
            }
            rows.end();
        });
        rows.0
    }
}

/// Builds a matrix with `count` rows. `write` receives a row's index and a function that it calls for each entry of this row.
fn extension_stencils(
    count: usize,
    write: impl Fn(usize, &mut dyn FnMut(usize, f64)) + Sync,
) -> Stencils {
    let rows = Stencils::build(count, |_: &mut (), k, rows| {
        write(k, &mut |control, weight| rows.push(control as u32, weight));
        rows.end();
    });
    rows.0
}

/// Computes centripetal parameters, beginning with 0. The difference of consecutive parameters is the square root of the distance of their
/// points.
fn centripetal(points: &[Point3<f64>]) -> Vec<f64> {
    let mut parameter = 0.0;
    let next = points.windows(2).map(|pair| {
        parameter += (pair[1] - pair[0]).norm().sqrt();
        parameter
    });
    [0.0].into_iter().chain(next.collect::<Vec<_>>()).collect()
}
