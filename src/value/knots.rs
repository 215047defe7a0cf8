//! Where the polynomial pieces of a B-spline meet.

use thiserror::Error;

use super::{
    Column, DecodeError, Decoder, Encoder, Layer, Meaning, On, Parts, PartsError, Series, Summary,
    Value,
};

mod basis;
mod change;
mod generate;

pub(super) use basis::Basis;
pub use change::KnotChange;

/// Why a list of numbers is not a knot vector.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum KnotVectorError {
    /// A knot below its predecessor, or NaN, or infinite.
    #[error("knot {index} is {knot}: knots are finite and never decrease")]
    Decreasing {
        /// The offending knot.
        index: usize,
        /// Its value.
        knot: f64,
    },
    /// A degree out of range.
    #[error("degree {degree} is not from 1 to 9")]
    Degree {
        /// The degree.
        degree: usize,
    },
    /// Too few knots for one piece.
    #[error("{count} knots are too few for degree {degree}: at least {least} are needed")]
    TooFew {
        /// Knots given.
        count: usize,
        /// The degree.
        degree: usize,
        /// 2 (degree + 1).
        least: usize,
    },
    /// A knot repeated too often.
    #[error("knot {knot} is repeated {count} times; at most {most} are allowed there")]
    Multiplicity {
        /// The repeated knot.
        knot: f64,
        /// How often.
        count: usize,
        /// How often it may be: degree + 1 at an end, degree inside.
        most: usize,
    },
    /// A parameter that is not inside the domain.
    #[error("{u} is not inside the domain from {start} to {end}")]
    Outside {
        /// The parameter.
        u: f64,
        /// First parameter of the domain.
        start: f64,
        /// Last parameter of the domain.
        end: f64,
    },
    /// All pieces are empty.
    #[error("the domain from {start} to {end} is empty")]
    EmptyDomain {
        /// First knot of the domain.
        start: f64,
        /// Last knot of the domain.
        end: f64,
    },
}

/// Where the polynomial pieces of a B-spline meet. Order = degree + 1; a B-spline of n + 1 control points has n + degree + 2
/// knots.
///
/// Invariant, checked by [`KnotVector::new`]: degree from 1 to 9; at least 2 (degree + 1) knots, finite, never decreasing; a
/// knot repeated at most degree times inside the domain and degree + 1 times at its ends; the domain
/// `knots[degree]..=knots[len - degree - 1]` not empty.
#[derive(Clone, Debug, PartialEq)]
pub struct KnotVector {
    degree: usize,
    knots: Column<f64>,
}

impl KnotVector {
    /// A knot vector of this degree.
    ///
    /// # Errors
    /// See the invariant above.
    pub fn new(degree: usize, knots: Vec<f64>) -> Result<Self, KnotVectorError> {
        if !(1..=9).contains(&degree) {
            return Err(KnotVectorError::Degree { degree });
        }
        let least = 2 * (degree + 1);
        if knots.len() < least {
            return Err(KnotVectorError::TooFew { count: knots.len(), degree, least });
        }
        let mut before = f64::NEG_INFINITY;
        for (index, &knot) in knots.iter().enumerate() {
            if !knot.is_finite() || knot < before {
                return Err(KnotVectorError::Decreasing { index, knot });
            }
            before = knot;
        }
        let (start, end) = (knots[degree], knots[knots.len() - degree - 1]);
        if end <= start {
            return Err(KnotVectorError::EmptyDomain { start, end });
        }
        for run in knots.chunk_by(|a, b| a == b) {
            let inside = start < run[0] && run[0] < end;
            let most = if inside { degree } else { degree + 1 };
            if run.len() > most {
                return Err(KnotVectorError::Multiplicity { knot: run[0], count: run.len(), most });
            }
        }
        Ok(Self { degree, knots: knots.into() })
    }

    /// Degree of the pieces: order - 1.
    pub fn degree(&self) -> usize {
        self.degree
    }

    /// All knots.
    pub fn knots(&self) -> &[f64] {
        &self.knots
    }

    /// How many control points go with it.
    pub fn n_control(&self) -> usize {
        self.knots.len() - self.degree - 1
    }

    /// First and last parameter of the B-spline.
    pub fn domain(&self) -> (f64, f64) {
        (self.knots[self.degree], self.knots[self.knots.len() - self.degree - 1])
    }
}

impl KnotVector {
    /// Adds it to the parts of what has it, under this name.
    pub(super) fn push<'a>(&'a self, name: &'static str, to: &mut Parts<'a>) {
        to.fact(format!("degree of {name}"), self.degree);
        to.push(name, On::Entry, Meaning::Number, 1, &self.knots[..]);
    }

    /// The knots that stand among some parts under this name.
    ///
    /// # Errors
    /// If there are none, or they make no knot vector.
    pub(super) fn of(parts: &Parts<'_>, name: &str) -> Result<Self, PartsError> {
        let knots = parts.need(name, 1)?.items.numbers().into_owned();
        let degree = parts.count_of(&format!("degree of {name}"))?;
        Self::new(degree, knots).map_err(PartsError::refused)
    }
}

impl Value for KnotVector {
    const NAME: &'static str = "KnotVector";

    fn encode(&self, to: &mut Encoder) {
        to.counts(&[self.degree]).column(&self.knots);
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let [degree] = from.counts()?;
        Ok(Self { degree, knots: from.column()? })
    }

    fn size(&self) -> usize {
        self.knots.size()
    }

    fn describe(&self) -> Summary {
        Summary::default()
            .with("order", self.degree + 1)
            .with("control points", self.n_control())
            .with("knots", self.knots.to_vec())
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        self.push("knots", &mut parts);
        parts
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        Self::of(parts, "knots")
    }

    fn show(&self) -> Vec<Layer> {
        let at = (0..self.knots.len()).map(|k| k as f64).collect();
        let numbers = self.knots.to_vec();
        vec![Layer::Plot(vec![Series { name: "knots".into(), at, numbers }])]
    }

    fn hostile() -> Vec<Self> {
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
    fn numbers_that_are_no_knot_vector_are_refused() {
        fn refused(degree: usize, knots: &[f64]) -> KnotVectorError {
            KnotVector::new(degree, knots.to_vec()).unwrap_err()
        }
        assert!(matches!(refused(0, &[0., 1.]), KnotVectorError::Degree { .. }));
        assert!(matches!(refused(2, &[0., 0., 0., 1., 1.]), KnotVectorError::TooFew { .. }));
        assert!(matches!(
            refused(1, &[0., 0., 2., 1.]),
            KnotVectorError::Decreasing { index: 3, .. }
        ));
        assert!(matches!(
            refused(1, &[0., 0., f64::NAN, 1.]),
            KnotVectorError::Decreasing { index: 2, .. }
        ));
        assert!(matches!(refused(1, &[1., 1., 1., 1.]), KnotVectorError::EmptyDomain { .. }));
        // An end knot repeated four times at degree 2 divided by zero in other libraries.
        assert!(matches!(
            refused(2, &[0., 0., 0., 0., 1., 1., 1.]),
            KnotVectorError::Multiplicity { count: 4, most: 3, .. }
        ));
        assert!(matches!(
            refused(2, &[0., 0., 0., 1., 1., 1., 2., 2., 2.]),
            KnotVectorError::Multiplicity { count: 3, most: 2, .. }
        ));
    }

    #[test]
    fn a_knot_vector_knows_its_control_points_and_domain() {
        let knots = KnotVector::new(2, vec![0., 0., 0., 1., 2., 3., 3., 3.]).unwrap();
        assert_eq!((knots.n_control(), knots.domain()), (5, (0.0, 3.0)));
    }
}
