//! Knot vectors of B-splines.

use thiserror::Error;

use super::content::content_of_fields;
use super::{Column, ElementKind, Layer, Meaning, Parts, PartsError, Series, Summary, Value};

mod basis;
mod change;
mod generate;

pub(super) use basis::Basis;
pub use change::KnotChange;

/// Error of building or changing a knot vector.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum KnotVectorError {
    /// The degree is out of range.
    #[error("degree {degree} is not from 1 to 9")]
    Degree {
        /// The rejected degree. Degrees from 1 to 9 are allowed.
        degree: usize,
    },
    /// There are too few knots for one piece.
    #[error("{count} knots are too few for degree {degree}: at least {min} are needed")]
    TooFew {
        /// The number of knots that were given.
        count: usize,
        /// The degree of the B-spline.
        degree: usize,
        /// The minimum number of knots: 2 (degree + 1).
        min: usize,
    },
    /// There are fewer control points than the order.
    #[error(
        "{points} control points are too few for a B-spline of degree {degree}: expected at least {}; add points, or lower the degree",
        degree + 1
    )]
    TooFewPoints {
        /// The number of control points.
        points: usize,
        /// The degree of the B-spline.
        degree: usize,
    },
    /// Any other violation of the invariant of [`KnotVector`]; contains the message.
    #[error("{0}")]
    Invalid(String),
}

/// The knot vector of a B-spline: the parameters at which its polynomial pieces meet. Order = degree + 1; a B-spline of n + 1 control
/// points has n + degree + 2 knots.
///
/// Invariant, checked by [`KnotVector::new`]: the degree is from 1 to 9. There are at least 2 (degree + 1) knots, which are finite and
/// never decrease. A knot is repeated at most degree times inside the domain, and at most degree + 1 times at an end of the domain. The
/// domain `knots[degree]..=knots[len - degree - 1]` is not empty.
#[derive(Clone, Debug, PartialEq)]
pub struct KnotVector {
    degree: usize,
    knots: Column<f64>,
}

impl KnotVector {
    /// Builds a knot vector of the given degree with the given knots.
    ///
    /// # Errors
    /// If the invariant is violated.
    pub fn new(degree: usize, knots: Vec<f64>) -> Result<Self, KnotVectorError> {
        if !(1..=9).contains(&degree) {
            return Err(KnotVectorError::Degree { degree });
        }
        let min = 2 * (degree + 1);
        if knots.len() < min {
            return Err(KnotVectorError::TooFew { count: knots.len(), degree, min });
        }
        let mut before = f64::NEG_INFINITY;
        for (index, &knot) in knots.iter().enumerate() {
            if !knot.is_finite() || knot < before {
                let why = format!("knot {index} is {knot}: knots are finite and never decrease");
                return Err(KnotVectorError::Invalid(why));
            }
            before = knot;
        }
        let (start, end) = (knots[degree], knots[knots.len() - degree - 1]);
        if end <= start {
            let why = format!("the domain from {start} to {end} is empty");
            return Err(KnotVectorError::Invalid(why));
        }
        for run in knots.chunk_by(|a, b| a == b) {
            let inside = start < run[0] && run[0] < end;
            let max = if inside { degree } else { degree + 1 };
            if run.len() > max {
                let (knot, count) = (run[0], run.len());
                return Err(KnotVectorError::Invalid(format!(
                    "knot {knot} is repeated {count} times; at most {max} are allowed there"
                )));
            }
        }
        Ok(Self { degree, knots: knots.into() })
    }

    /// The degree of the polynomial pieces, which is the order - 1.
    pub fn degree(&self) -> usize {
        self.degree
    }

    /// All knots in ascending order, each as often as it is repeated.
    pub fn knots(&self) -> &[f64] {
        &self.knots
    }

    /// The number of control points of a B-spline with these knots.
    pub fn n_control(&self) -> usize {
        self.knots.len() - self.degree - 1
    }

    /// The spans of the domain that are not empty, in order: the index of the first knot of each, and the two knots.
    pub(super) fn spans(&self) -> impl Iterator<Item = (usize, [f64; 2])> {
        let spans = self.knots.array_windows::<2>().enumerate().take(self.n_control());
        spans.skip(self.degree).filter(|(_, [start, end])| start < end).map(|(k, span)| (k, *span))
    }

    /// The first and last parameter of the B-spline.
    pub fn domain(&self) -> (f64, f64) {
        (self.knots[self.degree], self.knots[self.knots.len() - self.degree - 1])
    }
}

impl KnotVector {
    /// Adds the knot vector to the parts of a value, under this name.
    pub(super) fn push<'a>(&'a self, name: &'static str, to: &mut Parts<'a>) {
        to.fact(format!("degree of {name}"), self.degree);
        to.push(name, ElementKind::Entry, Meaning::Number, 1, &self.knots[..]);
    }

    /// Reads a knot vector from the part with this name.
    ///
    /// # Errors
    /// If there is no such part, or its numbers are not a knot vector.
    pub(super) fn from_named_parts(parts: &Parts<'_>, name: &str) -> Result<Self, PartsError> {
        let knots = parts.require(name, 1)?.items.numbers().into_owned();
        let degree = parts.count_of(&format!("degree of {name}"))?;
        Self::new(degree, knots).map_err(PartsError::from_error)
    }
}

impl Value for KnotVector {
    const NAME: &'static str = "KnotVector";

    content_of_fields! { degree knots }

    fn describe(&self) -> Summary {
        Summary::default()
            .with_fact("order", self.degree + 1)
            .with_fact("control points", self.n_control())
            .with_fact("knots", self.knots.to_vec())
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        self.push("knots", &mut parts);
        parts
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        Self::from_named_parts(parts, "knots")
    }

    fn show(&self) -> Vec<Layer> {
        let at = (0..self.knots.len()).map(|k| k as f64).collect();
        let numbers = self.knots.to_vec();
        vec![Layer::Plot(vec![Series { name: "knots".into(), at, numbers }])]
    }

    fn edge_cases() -> Vec<Self> {
        let knots = [
            Self::new(1, vec![0.0, 0.0, 1.0, 1.0]),
            Self::new(2, vec![-1e300, -1e300, 0.0, 1e300, 1e300, 1e300]),
            Self::new(1, vec![0.0, 0.0, 1e-300, 1e-300]),
            Self::new(9, (0..20).map(f64::from).collect()),
        ];
        knots.into_iter().flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_knot_vectors_are_refused() {
        fn error_of(degree: usize, knots: &[f64]) -> KnotVectorError {
            KnotVector::new(degree, knots.to_vec()).unwrap_err()
        }
        assert!(matches!(error_of(0, &[0., 1.]), KnotVectorError::Degree { .. }));
        assert!(matches!(error_of(2, &[0., 0., 0., 1., 1.]), KnotVectorError::TooFew { .. }));
        fn check(degree: usize, knots: &[f64], expected: &str) {
            assert_eq!(error_of(degree, knots).to_string(), expected);
        }
        check(1, &[0., 0., 2., 1.], "knot 3 is 1: knots are finite and never decrease");
        check(1, &[0., 0., f64::NAN, 1.], "knot 2 is NaN: knots are finite and never decrease");
        check(1, &[1., 1., 1., 1.], "the domain from 1 to 1 is empty");
        // An end knot that is repeated four times at degree 2 caused a division by zero in other libraries.
        let repeated = "knot 0 is repeated 4 times; at most 3 are allowed there";
        check(2, &[0., 0., 0., 0., 1., 1., 1.], repeated);
        let repeated = "knot 1 is repeated 3 times; at most 2 are allowed there";
        check(2, &[0., 0., 0., 1., 1., 1., 2., 2., 2.], repeated);
    }

    #[test]
    fn a_knot_vector_knows_its_control_points_and_domain() {
        let knots = KnotVector::new(2, vec![0., 0., 0., 1., 2., 3., 3., 3.]).unwrap();
        assert_eq!((knots.n_control(), knots.domain()), (5, (0.0, 3.0)));
    }
}
