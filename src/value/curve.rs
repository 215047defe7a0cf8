//! Curves: polylines and rational B-splines.

use nalgebra::Point3;
use thiserror::Error;

use super::content::{Content, content_of_fields};
use super::edge_cases::point_sets;
use super::mesh::{describe_bounds, diagonal};
use super::{
    Axes, Column, ElementKind, FactValue, KnotVector, Layer, Lines, Meaning, Parts, PartsError,
    Summary, Value,
};

mod closest;
mod evaluate;

pub use closest::CurveFoot;

/// Error of building a curve.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CurveError {
    /// There are too few points.
    #[error("{count} points are too few for a curve: at least {min} are needed")]
    TooFew {
        /// The number of points that were given.
        count: usize,
        /// The minimum: 2 for an open polyline, 3 for a closed one.
        min: usize,
    },
    /// Any other violation of the invariant of [`Curve`]; contains the message.
    #[error("{0}")]
    Invalid(String),
}

/// A curve in space, lengths in mm: a polyline through points, or a rational B-spline with control points.
///
/// ```text
/// C(t) = sum_i w_i P_i N_i(t) / sum_i w_i N_i(t)
/// ```
///
/// The parameter of a polyline is the index of its point, from 0; between points it runs along straight segments. A closed polyline returns
/// from its last point to its first, which is not repeated. The parameter of a B-spline is that of its knots. A B-spline is closed if it
/// ends where it begins; this follows from its points and is not stored.
///
/// Invariant, checked by [`Curve::polyline`] and [`Curve::rational`]: all points are finite. A polyline has at least 2 points, a closed one
/// at least 3. A B-spline has as many control points as its knots need, each with a finite weight greater than 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    points: Column<Point3<f64>>,
    closed: bool,
    spline: Option<Spline>,
}

/// The knots and weights of a B-spline.
#[derive(Clone, Debug, PartialEq)]
struct Spline {
    knots: KnotVector,
    weights: Column<f64>,
}

impl Content for Spline {
    content_of_fields! { knots weights }
}

/// The maximum gap between the two ends of a closed B-spline, as a fraction of the diagonal of the control points' bounding box. It allows
/// for rounding.
const CLOSED: f64 = 1e-9;

impl Curve {
    /// Builds a polyline. A closed polyline does not repeat its first point.
    ///
    /// # Errors
    /// If there are too few points, or one is not finite.
    pub fn polyline(
        points: impl Into<Column<Point3<f64>>>,
        closed: bool,
    ) -> Result<Self, CurveError> {
        let points = points.into();
        let (count, min) = (points.len(), if closed { 3 } else { 2 });
        if count < min {
            return Err(CurveError::TooFew { count, min });
        }
        check_finite(&points)?;
        Ok(Self { points, closed, spline: None })
    }

    /// Builds a rational B-spline. If all weights are equal, it is non-rational.
    ///
    /// # Errors
    /// If the number of knots or weights does not match the points, a weight is not greater than 0, or a number is not finite.
    pub fn rational(
        points: impl Into<Column<Point3<f64>>>,
        weights: Vec<f64>,
        knots: KnotVector,
    ) -> Result<Self, CurveError> {
        let points = points.into();
        check_finite(&points)?;
        for (what, found) in [("knots", knots.n_control()), ("weights", weights.len())] {
            if found != points.len() {
                return Err(wrong_count(what, found, points.len()));
            }
        }
        for (point, &weight) in weights.iter().enumerate() {
            if !weight.is_finite() {
                return Err(not_finite(point));
            }
            if weight <= 0.0 {
                return Err(CurveError::Invalid(format!(
                    "the weight of control point {point} is {weight}; weights of curves are positive"
                )));
            }
        }
        let spline = Some(Spline { knots, weights: weights.into() });
        let mut curve = Self { points, closed: false, spline };
        let (start, end) = curve.domain();
        let gap = (curve.point(start) - curve.point(end)).norm();
        curve.closed = gap <= CLOSED * diagonal(&curve.points);
        Ok(curve)
    }

    /// Replaces the points.
    ///
    /// # Errors
    /// If the number of points differs from that of the curve, or a point is not finite.
    pub fn with_points(&self, points: Vec<Point3<f64>>) -> Result<Self, CurveError> {
        match &self.spline {
            None if points.len() == self.points.len() => Self::polyline(points, self.closed),
            None => Err(wrong_count("points", self.points.len(), points.len())),
            Some(spline) => Self::rational(points, spline.weights.to_vec(), spline.knots.clone()),
        }
    }

    /// The points of a polyline, or the control points of a B-spline.
    pub fn points(&self) -> &Column<Point3<f64>> {
        &self.points
    }

    /// Returns true if the curve ends where it begins.
    pub fn is_closed(&self) -> bool {
        self.closed
    }

    /// The knots of a B-spline; `None` for a polyline.
    pub fn knots(&self) -> Option<&KnotVector> {
        self.spline.as_ref().map(|spline| &spline.knots)
    }

    /// The weights of a B-spline; `None` for a polyline.
    pub fn weights(&self) -> Option<&[f64]> {
        self.spline.as_ref().map(|spline| &*spline.weights)
    }

    /// The first and the last parameter.
    pub fn domain(&self) -> (f64, f64) {
        match &self.spline {
            Some(spline) => spline.knots.domain(),
            None if self.closed => (0.0, self.points.len() as f64),
            None => (0.0, (self.points.len() - 1) as f64),
        }
    }
}

fn check_finite(points: &[Point3<f64>]) -> Result<(), CurveError> {
    super::first_not_finite(points).map_or(Ok(()), |point| Err(not_finite(point)))
}

fn not_finite(point: usize) -> CurveError {
    CurveError::Invalid(format!("point {point} of the curve is not finite"))
}

fn wrong_count(what: &str, found: usize, points: usize) -> CurveError {
    CurveError::Invalid(format!(
        "the {what} are for {found} control points, the curve has {points}"
    ))
}

impl Value for Curve {
    const NAME: &'static str = "Curve";

    content_of_fields! { points closed spline }

    fn describe(&self) -> Summary {
        let kind = if self.spline.is_some() { "rational B-spline" } else { "polyline" };
        let mut summary = Summary::default()
            .with_fact("kind", kind)
            .with_fact("points", self.points.len())
            .with_fact("closed", self.closed)
            .with_fact("domain", format!("{:?}", self.domain()));
        if let Some(spline) = &self.spline {
            summary = summary.with_fact("order", spline.knots.degree() + 1);
        }
        describe_bounds(summary, self.points.iter())
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.fact("points", self.points.len());
        parts.fact("closed", self.closed);
        parts.push("point", ElementKind::Point, Meaning::Position, 3, &self.points[..]);
        if let Some(spline) = &self.spline {
            spline.knots.push("knots", &mut parts);
            parts.push("weight", ElementKind::Point, Meaning::Number, 1, &spline.weights[..]);
        }
        parts
    }

    /// Builds a curve from parts. With knots it is a B-spline, whose weights are 1 if there are none. Without knots it is a polyline, which
    /// is open if the fact `closed` is missing.
    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let points = parts.require("point", 3)?.to_points()?;
        let weight = parts.column_of("weight", 1)?;
        if parts.column("knots").is_none() {
            if weight.is_some() {
                return Err(PartsError::missing("knots"));
            }
            let closed = parts.fact_of("closed") == Some(&FactValue::Flag(true));
            return Self::polyline(points, closed).map_err(PartsError::from_error);
        }
        let knots = KnotVector::from_named_parts(parts, "knots")?;
        let weights = weight
            .map_or_else(|| vec![1.0; points.len()], |part| part.items.numbers().into_owned());
        Self::rational(points, weights, knots).map_err(PartsError::from_error)
    }

    /// Draws the curve as straight lines. For a B-spline, also draws its control polygon.
    fn show(&self) -> Vec<Layer> {
        /// The number of segments per control point of a B-spline.
        const PIECES: usize = 16;
        let count = self.points.len() as u32;
        let ends = (self.spline.is_none() && self.closed).then_some(0);
        let chain: Vec<_> = (0..count).chain(ends).collect();
        fn layer(points: Column<Point3<f64>>, chain: Vec<u32>) -> Layer {
            Layer::Lines(Lines { points, chains: vec![chain], axes: Axes::Upright })
        }
        let control = layer(self.points.clone(), chain);
        if self.spline.is_none() {
            return vec![control];
        }
        let ((start, end), pieces) = (self.domain(), PIECES * self.points.len());
        let curve = layer(
            (0..=pieces)
                .map(|k: usize| {
                    let t = k as f64 / pieces as f64;
                    self.point(start * (1.0 - t) + end * t)
                })
                .collect(),
            (0..=pieces as u32).collect(),
        );
        vec![curve, control]
    }

    fn edge_cases() -> Vec<Self> {
        let polylines = [2, 3, 7].into_iter().flat_map(point_sets).flat_map(|points| {
            [Self::polyline(points.clone(), false), Self::polyline(points, true)]
        });
        fn knots() -> Result<KnotVector, crate::KnotVectorError> {
            KnotVector::new(2, vec![0.0, 0.0, 0.0, 1e-300, 1.0, 1.0, 1.0])
        }
        let splines = point_sets(4).into_iter().flat_map(|points| {
            [vec![1.0; 4], vec![1e-300, 1.0, 1e300, 1.0]]
                .map(|weights| Self::rational(points.clone(), weights, knots().ok()?).ok())
        });
        polylines.map(Result::ok).chain(splines).flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_curves_are_refused() {
        fn points(count: usize) -> Vec<Point3<f64>> {
            vec![Point3::origin(); count]
        }
        assert_eq!(Curve::polyline(points(1), false), Err(CurveError::TooFew { count: 1, min: 2 }));
        assert_eq!(Curve::polyline(points(2), true), Err(CurveError::TooFew { count: 2, min: 3 }));
        let nowhere = vec![Point3::origin(), Point3::new(f64::INFINITY, 0.0, 0.0)];
        assert_eq!(Curve::polyline(nowhere, false), Err(not_finite(1)));
        let knots = KnotVector::uniform(3, 3).unwrap();
        fn rational(count: usize, weights: &[f64], knots: &KnotVector) -> CurveError {
            Curve::rational(points(count), weights.to_vec(), knots.clone()).unwrap_err()
        }
        assert_eq!(rational(4, &[1.0; 4], &knots), wrong_count("knots", 3, 4));
        assert_eq!(rational(3, &[1.0; 2], &knots), wrong_count("weights", 2, 3));
        let weight = "the weight of control point 1 is 0; weights of curves are positive";
        assert_eq!(rational(3, &[1., 0., 1.], &knots).to_string(), weight);
        assert_eq!(rational(3, &[1., f64::NAN, 1.], &knots), not_finite(1));
    }

    #[test]
    fn a_spline_is_closed_if_it_ends_where_it_begins() {
        let knots = KnotVector::uniform(4, 3).unwrap();
        fn point_xy(x: f64, y: f64) -> Point3<f64> {
            Point3::new(x, y, 0.0)
        }
        let ring = vec![point_xy(0., 0.), point_xy(1., 0.), point_xy(1., 1.), point_xy(0., 0.)];
        let arc = vec![point_xy(0., 0.), point_xy(1., 0.), point_xy(1., 1.), point_xy(0., 1.)];
        assert!(Curve::rational(ring, vec![1.0; 4], knots.clone()).unwrap().is_closed());
        assert!(!Curve::rational(arc, vec![1.0; 4], knots).unwrap().is_closed());
    }
}
