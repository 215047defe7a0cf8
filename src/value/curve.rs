//! Curves: polylines and rational B-splines.

use nalgebra::Point3;
use thiserror::Error;

use super::hostile::clouds;
use super::{
    Axes, Column, DecodeError, Decoder, Encoder, FactValue, KnotVector, Layer, Lines, Meaning, On,
    Parts, PartsError, Summary, Value,
};

mod closest;
mod evaluate;

pub use closest::CurveFoot;

/// Why points do not make a curve.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CurveError {
    /// A point or weight is NaN or infinite.
    #[error("point {point} of the curve is not finite")]
    NotFinite {
        /// The offending point.
        point: usize,
    },
    /// Too few points.
    #[error("{count} points are too few for a curve: at least {least} are needed")]
    TooFew {
        /// Points given.
        count: usize,
        /// 2 for an open polyline, 3 for a closed one.
        least: usize,
    },
    /// Knots or weights for another number of points.
    #[error("the {what} are for {found} control points, the curve has {points}")]
    Count {
        /// `knots` or `weights`.
        what: &'static str,
        /// Control points that they are for.
        found: usize,
        /// Control points of the curve.
        points: usize,
    },
    /// A weight that is not positive.
    #[error("the weight of control point {point} is {weight}; weights of curves are positive")]
    Weight {
        /// The offending control point.
        point: usize,
        /// Its weight.
        weight: f64,
    },
}

/// A curve in space, lengths in mm: a polyline through its points, or a rational B-spline that its points control.
///
/// ```text
/// C(t) = sum_i w_i P_i N_i(t) / sum_i w_i N_i(t)
/// ```
///
/// The parameter of a polyline is its point's number, from 0, with straight pieces between; a closed one returns from its last
/// point to its first, which is not repeated. The parameter of a B-spline is that of its knots; it is closed if it ends where it
/// begins, which is a property of its points and not said apart.
///
/// Invariant, checked by [`Curve::polyline`] and [`Curve::rational`]: points finite, at least 2, or 3 in a closed polyline; as
/// many control points as the knots are for, each with a finite weight greater than 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    points: Column<Point3<f64>>,
    closed: bool,
    spline: Option<Spline>,
}

/// What makes a B-spline of control points.
#[derive(Clone, Debug, PartialEq)]
struct Spline {
    knots: KnotVector,
    weights: Column<f64>,
}

/// How near the ends of a B-spline are that count as one, as a share of the size of its control points: rounding.
const CLOSED: f64 = 1e-9;

impl Curve {
    /// A polyline; a closed one does not repeat its first point.
    ///
    /// # Errors
    /// If there are too few points or one is not finite.
    pub fn polyline(
        points: impl Into<Column<Point3<f64>>>,
        closed: bool,
    ) -> Result<Self, CurveError> {
        let points = points.into();
        let (count, least) = (points.len(), if closed { 3 } else { 2 });
        if count < least {
            return Err(CurveError::TooFew { count, least });
        }
        check_finite(&points)?;
        Ok(Self { points, closed, spline: None })
    }

    /// A rational B-spline; with all weights equal it is a plain one.
    ///
    /// # Errors
    /// If the knots or weights are for another number of points, a weight is not greater than 0, or a number is not finite.
    pub fn rational(
        points: impl Into<Column<Point3<f64>>>,
        weights: Vec<f64>,
        knots: KnotVector,
    ) -> Result<Self, CurveError> {
        let points = points.into();
        check_finite(&points)?;
        for (what, found) in [("knots", knots.n_control()), ("weights", weights.len())] {
            if found != points.len() {
                return Err(CurveError::Count { what, found, points: points.len() });
            }
        }
        for (point, &weight) in weights.iter().enumerate() {
            if !weight.is_finite() {
                return Err(CurveError::NotFinite { point });
            }
            if weight <= 0.0 {
                return Err(CurveError::Weight { point, weight });
            }
        }
        let spline = Some(Spline { knots, weights: weights.into() });
        let mut curve = Self { points, closed: false, spline };
        let (start, end) = curve.domain();
        let gap = (curve.point(start) - curve.point(end)).norm();
        curve.closed = gap <= CLOSED * curve.diagonal();
        Ok(curve)
    }

    /// The same curve with its points moved.
    ///
    /// # Errors
    /// If there are more or fewer points than before, or one is not finite.
    pub fn with_points(&self, points: Vec<Point3<f64>>) -> Result<Self, CurveError> {
        match &self.spline {
            None if points.len() == self.points.len() => Self::polyline(points, self.closed),
            None => {
                let (found, points) = (self.points.len(), points.len());
                Err(CurveError::Count { what: "points", found, points })
            }
            Some(spline) => Self::rational(points, spline.weights.to_vec(), spline.knots.clone()),
        }
    }

    /// The points of a polyline, the control points of a B-spline.
    pub fn points(&self) -> &Column<Point3<f64>> {
        &self.points
    }

    /// Whether it ends where it begins.
    pub fn is_closed(&self) -> bool {
        self.closed
    }

    /// The knots of a B-spline; none for a polyline.
    pub fn knots(&self) -> Option<&KnotVector> {
        self.spline.as_ref().map(|spline| &spline.knots)
    }

    /// The weights of a B-spline; none for a polyline.
    pub fn weights(&self) -> Option<&[f64]> {
        self.spline.as_ref().map(|spline| &*spline.weights)
    }

    /// First and last parameter.
    pub fn domain(&self) -> (f64, f64) {
        match &self.spline {
            Some(spline) => spline.knots.domain(),
            None if self.closed => (0.0, self.points.len() as f64),
            None => (0.0, (self.points.len() - 1) as f64),
        }
    }

    /// The diagonal of the box around all points.
    fn diagonal(&self) -> f64 {
        super::mesh::bounds(self.points.iter()).map_or(0.0, |(low, high)| (high - low).norm())
    }
}

fn check_finite(points: &[Point3<f64>]) -> Result<(), CurveError> {
    match points.iter().position(|point| !point.coords.iter().all(|x| x.is_finite())) {
        None => Ok(()),
        Some(point) => Err(CurveError::NotFinite { point }),
    }
}

impl Value for Curve {
    const NAME: &'static str = "Curve";

    fn encode(&self, to: &mut Encoder) {
        to.column(&self.points).plain(&u8::from(self.closed)).option(
            self.spline.as_ref(),
            |to, spline| {
                to.value(&spline.knots).column(&spline.weights);
            },
        );
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let points = from.column()?;
        let closed = from.plain::<u8>()? == 1;
        let spline =
            from.option(|from| Ok(Spline { knots: from.value()?, weights: from.column()? }))?;
        Ok(Self { points, closed, spline })
    }

    fn size(&self) -> usize {
        let spline = self.spline.as_ref();
        self.points.size() + spline.map_or(0, |spline| spline.knots.size() + spline.weights.size())
    }

    fn describe(&self) -> Summary {
        let kind = if self.spline.is_some() { "rational B-spline" } else { "polyline" };
        let mut summary = Summary::default()
            .with("kind", kind)
            .with("points", self.points.len())
            .with("closed", self.closed)
            .with("domain", format!("{:?}", self.domain()));
        if let Some(spline) = &self.spline {
            summary = summary.with("order", spline.knots.degree() + 1);
        }
        super::mesh::describe_bounds(summary, self.points.iter())
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.fact("points", self.points.len());
        parts.fact("closed", self.closed);
        parts.push("point", On::Point, Meaning::Position, 3, &self.points[..]);
        if let Some(spline) = &self.spline {
            spline.knots.push("knots", &mut parts);
            parts.push("weight", On::Point, Meaning::Number, 1, &spline.weights[..]);
        }
        parts
    }

    /// A B-spline if there are knots, with all weights 1 if there are none; else a polyline, open if the fact `closed` is not there.
    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let points = parts.need("point", 3)?.places()?;
        let weight = parts.column_of("weight", 1)?;
        if parts.column("knots").is_none() {
            if weight.is_some() {
                return Err(PartsError::Missing { part: "knots".into() });
            }
            let closed = parts.fact_of("closed") == Some(&FactValue::Flag(true));
            return Self::polyline(points, closed).map_err(PartsError::refused);
        }
        let knots = KnotVector::of(parts, "knots")?;
        let weights = weight
            .map_or_else(|| vec![1.0; points.len()], |part| part.items.numbers().into_owned());
        Self::rational(points, weights, knots).map_err(PartsError::refused)
    }

    /// As a chain of straight lines; a B-spline with that of its control points.
    fn show(&self) -> Vec<Layer> {
        /// Straight pieces for each control point of a B-spline.
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

    fn hostile() -> Vec<Self> {
        let polylines = [2, 3, 7].into_iter().flat_map(clouds).flat_map(|points| {
            [Self::polyline(points.clone(), false), Self::polyline(points, true)]
        });
        fn knots() -> Result<KnotVector, crate::KnotVectorError> {
            KnotVector::new(2, vec![0.0, 0.0, 0.0, 1e-300, 1.0, 1.0, 1.0])
        }
        let splines = clouds(4).into_iter().flat_map(|points| {
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
    fn points_that_make_no_curve_are_refused() {
        fn points(count: usize) -> Vec<Point3<f64>> {
            vec![Point3::origin(); count]
        }
        assert_eq!(
            Curve::polyline(points(1), false),
            Err(CurveError::TooFew { count: 1, least: 2 })
        );
        assert_eq!(
            Curve::polyline(points(2), true),
            Err(CurveError::TooFew { count: 2, least: 3 })
        );
        let nowhere = vec![Point3::origin(), Point3::new(f64::INFINITY, 0.0, 0.0)];
        assert_eq!(Curve::polyline(nowhere, false), Err(CurveError::NotFinite { point: 1 }));
        let knots = KnotVector::uniform(3, 3).unwrap();
        fn rational(count: usize, weights: &[f64], knots: &KnotVector) -> CurveError {
            Curve::rational(points(count), weights.to_vec(), knots.clone()).unwrap_err()
        }
        assert!(matches!(rational(4, &[1.0; 4], &knots), CurveError::Count { what: "knots", .. }));
        assert!(matches!(
            rational(3, &[1.0; 2], &knots),
            CurveError::Count { what: "weights", .. }
        ));
        assert!(matches!(rational(3, &[1., 0., 1.], &knots), CurveError::Weight { point: 1, .. }));
        assert!(matches!(
            rational(3, &[1., f64::NAN, 1.], &knots),
            CurveError::NotFinite { point: 1 }
        ));
    }

    #[test]
    fn a_spline_is_closed_if_it_ends_where_it_begins() {
        let knots = KnotVector::uniform(4, 3).unwrap();
        fn at(x: f64, y: f64) -> Point3<f64> {
            Point3::new(x, y, 0.0)
        }
        let ring = vec![at(0., 0.), at(1., 0.), at(1., 1.), at(0., 0.)];
        let arc = vec![at(0., 0.), at(1., 0.), at(1., 1.), at(0., 1.)];
        assert!(Curve::rational(ring, vec![1.0; 4], knots.clone()).unwrap().is_closed());
        assert!(!Curve::rational(arc, vec![1.0; 4], knots).unwrap().is_closed());
    }
}
