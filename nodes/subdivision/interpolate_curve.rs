//! Finds the control points of a smooth curve through given points.

use maquette_node::{Cancelled, Context, Error, FieldError, In, Node, Progress};
use maquette_value::{Curve, CurveError, KnotVectorError, Trace};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::curve_basis::CurveBasis;
use super::solve::control_curve::ControlCurve;
use super::solve::control_points::control_points;
use super::solve::geometric::{FootPoint, Look, Perpendicular};
use super::solve::interpolation::{Foot, Interpolation, NotLinear};
use super::solve::limit_matrix::LimitMatrix;
use super::solve::solution::{Diverged, Interpolated};

/// Finds the control points of a smooth curve through given points.
///
/// The control points of `Chaikin` and `Cubic` are a polyline: refine it with `SubdivideCurve`. Those of `BSpline` come with knots
/// and weights of 1, as a curve that is ready. An open curve begins and ends at its first and last point.
///
/// The form with `foot: Closest` is described in Japanese patent 4934789, filed on 2007-01-15; the default is the linear
/// progressive form.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct InterpolateCurve {
    /// The points to meet: a polyline, open or closed.
    pub curve: In<Curve>,
    /// The kind of curve.
    pub scheme: CurveBasis,
    /// How control points are found.
    #[serde(flatten)]
    pub how: Interpolation,
}

/// Why there is no curve through some points.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InterpolateCurveError {
    /// A B-spline, whose control points are not points to meet.
    #[error("the curve is a B-spline; only the points of a polyline are interpolated")]
    Spline,
    /// A solver for other feet or directions.
    #[error(transparent)]
    NotLinear(#[from] NotLinear),
    /// Too few points for the degree, or points in one place.
    #[error(transparent)]
    Knots(#[from] KnotVectorError),
    /// Equations without one solution.
    #[error("the points do not determine the curve: some lie in one place")]
    Singular,
    /// Control points out of all bounds.
    #[error("the iteration diverged: {0}")]
    Curve(#[from] CurveError),
    /// The iteration leads away from the points.
    #[error(transparent)]
    Diverged(#[from] Diverged),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
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

/// The control points of a curve through the points of a polyline.
///
/// Maekawa, Matsumoto and Namiki, "Interpolation by geometric algorithm", Computer-Aided Design 39 (2007), for B-splines; the same
/// iteration on the limit curves of subdivisions. With `foot: Vertex` the distances are those at the points' own parameters.
///
/// # Errors
/// If the curve is no polyline, has too few points for the degree or points in one place, if the solver is not for this foot and
/// direction, or the evaluation is told to stop.
pub fn interpolate_curve(
    curve: &Curve,
    basis: CurveBasis,
    how: &Interpolation,
    progress: &Progress<'_>,
) -> Result<Interpolated<Curve>, InterpolateCurveError> {
    if curve.knots().is_some() {
        return Err(InterpolateCurveError::Spline);
    }
    how.check()?;
    let points = curve.points();
    let family = ControlCurve::new(basis, points, curve.is_closed())?;
    let mut feet = Feet::new(&family, points, how.foot);
    // A span has no more extremes than its degree.
    let pieces = 4 * basis.degree();
    let solution = control_points(
        points,
        how,
        &[],
        progress,
        |control, look: Look<'_>| feet.of(control, &look),
        |control| Some(family.curve(control).ok()?.sample(pieces)),
        || matrix(&family, basis, points.len(), curve.is_closed()),
    )?;
    let found = solution.ok_or(InterpolateCurveError::Singular)?.found;
    found.shaped(|control| match basis {
        CurveBasis::BSpline(_) => Ok(family.curve(&control)?),
        _ => Ok(curve.with_points(control)?),
    })
}

/// The equations of the control points: the ends of an open curve first.
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

/// The feet of points on the curves of an iteration.
struct Feet<'a> {
    family: &'a ControlCurve,
    pub(super) points: &'a [Point3<f64>],
    foot: Foot,
    /// The parameters of the last feet.
    parameters: Vec<f64>,
}

impl<'a> Feet<'a> {
    fn new(family: &'a ControlCurve, points: &'a [Point3<f64>], foot: Foot) -> Self {
        Self { family, points, foot, parameters: family.parameters().to_vec() }
    }

    fn of(&mut self, control: &[Point3<f64>], look: &Look<'_>) -> Vec<FootPoint> {
        // A curve whose numbers overflowed has no feet; the iteration notes infinite distances and ends.
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
