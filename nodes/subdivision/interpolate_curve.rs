//! Finds the control points of a smooth curve through given points.

use maquette_node::{Context, Error, FieldError, In, Node, Progress, bail};
use maquette_value::{Curve, Trace};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::curve_basis::CurveBasis;
use super::solve::control_curve::ControlCurve;
use super::solve::control_points::control_points;
use super::solve::geometric::{FootPoint, FootSearch, Perpendicular};
use super::solve::interpolation::{Foot, Interpolation};
use super::solve::limit_matrix::LimitMatrix;
use super::solve::solution::InterpolationResult;

/// Finds the control points of a smooth curve through given points.
///
/// The control points of `Chaikin` and `Cubic` are a polyline: refine it with `SubdivideCurve`. `BSpline` gives a complete B-spline with
/// knots and weights of 1. An open curve begins and ends at its first and last point.
///
/// The form with `foot: Closest` is described in Japanese patent 4934789, filed on 2007-01-15; the default is the linear
/// progressive form.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct InterpolateCurve {
    /// Polyline whose points are interpolated, open or closed.
    pub curve: In<Curve>,
    /// Kind of curve.
    pub scheme: CurveBasis,
    /// Options of the solver.
    #[serde(flatten)]
    pub how: Interpolation,
}

impl Node for InterpolateCurve {
    type Outputs = (Curve, Trace);
    const OUTPUTS: [&'static str; 2] = ["curve", "trace"];

    fn check(&self) -> Result<(), FieldError> {
        self.how.check_fields()
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let curve = cx.get(&self.curve);
        let found = interpolate_curve(curve, self.scheme, &self.how, cx.progress())?;
        Ok(found.outputs(cx, "curve"))
    }
}

/// Computes the control points of a curve through the points of a polyline.
///
/// Maekawa, Matsumoto and Namiki, "Interpolation by geometric algorithm", Computer-Aided Design 39 (2007), for B-splines; their iteration
/// is also used for limit curves of subdivisions. With `foot: Vertex` the distance of a given point is measured to the curve point at the
/// parameter that was assigned to the given point.
///
/// # Errors
/// If the curve is not a polyline, has too few points for the degree or coincident points, if the solver does not support the foot and
/// direction, or the evaluation is cancelled.
pub fn interpolate_curve(
    curve: &Curve,
    basis: CurveBasis,
    options: &Interpolation,
    progress: &Progress<'_>,
) -> Result<InterpolationResult<Curve>, Error> {
    if curve.knots().is_some() {
        bail!("the curve is a B-spline; only the points of a polyline are interpolated");
    }
    options.check()?;
    let points = curve.points();
    if let CurveBasis::BSpline(degree) = basis
        && !curve.is_closed()
        && points.len() <= degree
    {
        bail!(
            "`BSpline({degree})` needs at least {} points, the open polyline has {}; add points, or use `BSpline({})`",
            degree + 1,
            points.len(),
            points.len() - 1
        );
    }
    let family = ControlCurve::new(basis, points, curve.is_closed())?;
    let mut feet = Feet::new(&family, points, options.foot);
    // Within a knot span, each coordinate of the curve has at most as many extrema as the degree of the curve.
    let pieces = 4 * basis.degree();
    let solution = control_points(
        points,
        options,
        &[],
        progress,
        |control, look: FootSearch<'_>| feet.find(control, &look),
        |control| Some(family.curve(control).ok()?.sample(pieces)),
        || matrix(&family, basis, points.len(), curve.is_closed()),
    )?;
    let found = solution.ok_or_else(|| undetermined(points))?.outcome;
    found.try_map(points, |control| match basis {
        CurveBasis::BSpline(_) => family.curve(&control),
        _ => curve.with_points(control),
    })
}

/// Returns the error of points that do not determine a curve. It names two neighbors at one place, if there are any.
fn undetermined(points: &[Point3<f64>]) -> Error {
    let pair = points.windows(2).position(|pair| pair[0] == pair[1]);
    let cause = pair.map_or(String::new(), |index| {
        format!(": points {index} and {}, counted from 0, are in one place; remove one", index + 1)
    });
    Error::new(format!("the points do not determine the curve{cause}"))
}

/// Creates the linear equations that determine the control points. Each end point of an open curve is a separate block of equations; these
/// blocks come first.
fn matrix(family: &ControlCurve, basis: CurveBasis, count: usize, closed: bool) -> LimitMatrix {
    let all = 0..count as u32;
    let blocks = match closed {
        true => vec![all.collect()],
        false => vec![vec![0, all.end - 1], (1..all.end - 1).collect()],
    };
    let is_symmetric = closed || !matches!(basis, CurveBasis::BSpline(_));
    let scale = is_symmetric.then(|| vec![1.0; count]);
    LimitMatrix { rows: family.collocation(), blocks, scale }
}

/// Finds the foot points of the given points: the nearest points on the current curve, which changes in each iteration.
struct Feet<'a> {
    family: &'a ControlCurve,
    pub(super) points: &'a [Point3<f64>],
    foot: Foot,
    /// The curve parameters of the foot points in the previous iteration.
    parameters: Vec<f64>,
}

impl<'a> Feet<'a> {
    fn new(family: &'a ControlCurve, points: &'a [Point3<f64>], foot: Foot) -> Self {
        Self { family, points, foot, parameters: family.parameters().to_vec() }
    }

    fn find(&mut self, control: &[Point3<f64>], look: &FootSearch<'_>) -> Vec<FootPoint> {
        // A curve with overflowed coordinates has no foot points; the iteration records infinite distances and ends.
        let Ok(curve) = self.family.curve(control) else {
            return vec![FootPoint::nowhere(); self.points.len()];
        };
        let (start, end) = curve.domain();
        let own = self.family.parameters().iter().zip(look.own);
        let feet = self.points.iter().zip(&mut self.parameters).zip(own);
        let feet = feet.map(|((&to, t), (&own, &is_own))| {
            if is_own {
                *t = own;
                let point = curve.derivatives(own, 0)[0].into();
                return FootPoint { point, perpendicular: Perpendicular::Nowhere };
            }
            match self.foot {
                Foot::Vertex => {}
                Foot::Closest if look.whole => *t = curve.closest(to).t,
                Foot::Closest => *t = curve.closest_from(to, *t).t,
            }
            let derivatives = curve.derivatives(*t, 1);
            let inside = curve.is_closed() || start < *t && *t < end;
            let tangent = derivatives[1].try_normalize(0.0).filter(|_| inside);
            let perpendicular = tangent.map_or(Perpendicular::Nowhere, Perpendicular::To);
            FootPoint { point: derivatives[0].into(), perpendicular }
        });
        feet.collect()
    }
}

#[cfg(test)]
mod tests;
