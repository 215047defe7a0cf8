//! Conversion of curves to other knot vectors: refinement, restriction, Bezier pieces, higher degrees.
//!
//! All conversions use the same theorem: a piece of degree p has a blossom `f(x_1, .., x_p)`, a function that is symmetric, and affine in
//! each argument. Control point j of any knot vector t is the blossom at `t_{j+1}, .., t_{j+p}` of a piece that the control point affects.
//! Ramshaw, "Blossoms are polar forms", Computer Aided Geometric Design 6 (1989). Evaluated bottom up, the blossom gives the Oslo
//! algorithm: Cohen, Lyche and Riesenfeld, "Discrete B-splines and subdivision techniques" (1980). For a single new knot it gives Boehm's
//! insertion.

use std::ops::{Add, Mul};

use super::basis::MAX_ORDER;
use super::{KnotVector, KnotVectorError};

/// A new knot vector for curves, with the matrix that converts the control points of the curves to this knot vector.
///
/// Each new control point is a weighted mean of old ones: the factors are not negative and their sum is 1. Control points of rational
/// curves are converted in homogeneous form (w x, w y, w z, w).
#[derive(Clone, Debug, PartialEq)]
pub struct KnotChange {
    knots: KnotVector,
    rows: Vec<Row>,
}

/// A row of the matrix: the factors of one new control point.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Row {
    /// The index of the old control point to which the first factor belongs.
    first: usize,
    /// The factors of the new control point. Only the first degree + 1 entries are used; the others are 0.
    factors: [f64; MAX_ORDER],
}

impl KnotChange {
    /// The new knot vector.
    pub fn knots(&self) -> &KnotVector {
        &self.knots
    }

    /// The old control points on which the new control point `control` depends, as pairs of index and positive factor.
    pub fn sources(&self, control: usize) -> impl Iterator<Item = (usize, f64)> {
        let row = &self.rows[control];
        let factors = row.factors.iter().enumerate().filter(|(_, factor)| **factor > 0.0);
        factors.map(|(k, &factor)| (row.first + k, factor))
    }

    /// Converts the control points of a curve.
    ///
    /// # Panics
    /// If there are fewer points than the old knots need.
    pub fn apply<T>(&self, points: &[T]) -> Vec<T>
    where
        T: Copy + Add<Output = T> + Mul<f64, Output = T>,
    {
        (0..self.rows.len())
            .map(|control| {
                let terms = self.sources(control).map(|(old, factor)| points[old] * factor);
                terms
                    .reduce(|sum, term| sum + term)
                    .expect("the factors of a control point sum to 1")
            })
            .collect()
    }
}

impl KnotVector {
    /// Inserts the knot `u` with the given number of repetitions, `times`.
    ///
    /// # Errors
    /// If `u` is not inside the domain, or its multiplicity would exceed the degree.
    pub fn insert(&self, u: f64, times: usize) -> Result<KnotChange, KnotVectorError> {
        // `MAX_ORDER` repetitions exceed every degree, so a longer list would only give the same error.
        self.refine(&vec![u; times.min(MAX_ORDER)])
    }

    /// Inserts all knots of the list, in any order.
    ///
    /// # Errors
    /// If a knot is not inside the domain, or its multiplicity would exceed the degree.
    pub fn refine(&self, more: &[f64]) -> Result<KnotChange, KnotVectorError> {
        let (start, end) = self.domain();
        if let Some(&u) = more.iter().find(|&&u| !(start < u && u < end)) {
            return Err(outside(u, (start, end)));
        }
        let mut knots = [self.knots(), more].concat();
        knots.sort_by(f64::total_cmp);
        let knots = Self::new(self.degree(), knots)?;
        let rows = (0..knots.n_control()).map(|j| self.row(&knots, j)).collect();
        Ok(KnotChange { knots, rows })
    }

    /// Restricts the curves to the part from `start` to `end`. The end knots are repeated degree + 1 times.
    ///
    /// # Errors
    /// If the part is not inside the domain, or is empty.
    pub fn restrict(&self, start: f64, end: f64) -> Result<KnotChange, KnotVectorError> {
        self.with_clamped_ends(start, end, self.degree(), |count| count)
    }

    /// Splits the curves at `u` into two parts.
    ///
    /// # Errors
    /// If `u` is not inside the domain.
    pub fn split(&self, u: f64) -> Result<[KnotChange; 2], KnotVectorError> {
        let (start, end) = self.domain();
        if !(start < u && u < end) {
            return Err(outside(u, (start, end)));
        }
        Ok([self.restrict(start, u)?, self.restrict(u, end)?])
    }

    /// Converts the curves to Bezier pieces: every inner knot is repeated degree times, so piece `k` has the control points `k degree ..=
    /// (k + 1) degree`.
    pub fn bezier(&self) -> KnotChange {
        let (start, end) = self.domain();
        self.with_clamped_ends(start, end, self.degree(), |_| self.degree())
            .expect("the pieces of a knot vector are one")
    }

    /// Raises the degree by one. The end knots are repeated accordingly.
    ///
    /// If f is the blossom of a piece, the blossom of the higher degree is a mean over all i: the mean of f at all arguments except the
    /// i-th one. Ramshaw (1989), section 6.
    ///
    /// # Errors
    /// If the degree is already 9.
    pub fn elevate(&self) -> Result<KnotChange, KnotVectorError> {
        let (start, end) = self.domain();
        let degree = self.degree() + 1;
        let raised = self.with_clamped_ends(start, end, degree, |count| count + 1)?;
        let rows = (0..raised.knots.n_control())
            .map(|j: usize| {
                let arguments = &raised.knots.knots()[j + 1..=j + degree];
                let mut sum = Row { first: 0, factors: [0.0; MAX_ORDER] };
                for left_out in 0..degree {
                    let others = (0..degree).filter(|&k| k != left_out).map(|k| arguments[k]);
                    let Row { first, factors } = self.blossom(raised.knots.knots()[j], others);
                    sum.first = first;
                    sum.factors
                        .iter_mut()
                        .zip(factors)
                        .for_each(|(sum, x)| *sum += x / degree as f64);
                }
                sum
            })
            .collect();
        Ok(KnotChange { rows, ..raised })
    }

    /// Knots of degree `degree` from `start` to `end`. `repeat` maps the multiplicity of an inner knot of `self` to its multiplicity in the
    /// result.
    fn with_clamped_ends(
        &self,
        start: f64,
        end: f64,
        degree: usize,
        repeat: impl Fn(usize) -> usize,
    ) -> Result<KnotChange, KnotVectorError> {
        let (low, high) = self.domain();
        if let Some(&u) = [start, end].iter().find(|&&u| !(low <= u && u <= high)) {
            return Err(outside(u, (low, high)));
        }
        let mut knots = vec![start; degree + 1];
        for run in self.knots().chunk_by(|a, b| a == b) {
            if start < run[0] && run[0] < end {
                knots.extend(vec![run[0]; repeat(run.len())]);
            }
        }
        knots.extend(vec![end; degree + 1]);
        let knots = Self::new(degree, knots)?;
        let same = degree == self.degree();
        let rows = (0..knots.n_control()).filter(|_| same).map(|j| self.row(&knots, j)).collect();
        Ok(KnotChange { knots, rows })
    }

    /// The factors of control point `j` of the knot vector `to`. Both knot vectors have the same degree, and `to` is a refinement or
    /// restriction of `self`.
    fn row(&self, to: &Self, j: usize) -> Row {
        let arguments = &to.knots()[j + 1..=j + self.degree()];
        self.blossom(to.knots()[j], arguments.iter().copied())
    }

    /// The blossom of the piece that contains `start`, at `degree` ascending arguments; `start` is the knot before these arguments.
    ///
    /// The recurrence is that of the basis functions, with another argument in each round. The arguments ascend and begin in the span of
    /// the knot before the first one, so every term is a discrete B-spline or 0. Nothing is subtracted, so no digits cancel, however
    /// unequal the spans are. In a span before the domain the first B-splines of a round do not exist; in a span after the domain the last
    /// ones do not. They are skipped, because no control point depends on them.
    fn blossom(&self, start: f64, arguments: impl Iterator<Item = f64>) -> Row {
        let (knots, degree) = (self.knots(), self.degree());
        let last = knots.partition_point(|&knot| knot < knots[knots.len() - 1]) - 1;
        let span = (knots.partition_point(|&knot| knot <= start) - 1).min(last);
        let (missing, exist) = (degree.saturating_sub(span), knots.len() - 1 - span);
        let mut factors = [0.0; MAX_ORDER];
        factors[0] = 1.0;
        for (round, x) in (1_usize..).zip(arguments) {
            let mut saved = 0.0;
            for r in round.saturating_sub(span + 1)..round.min(exist) {
                let (from, to) = (knots[span + 1 + r - round], knots[span + 1 + r]);
                let fraction = factors[r] / (to - from);
                factors[r] = saved + (to - x).max(0.0) * fraction;
                saved = (x - from).max(0.0) * fraction;
            }
            factors[round] = saved;
        }
        factors[..missing].fill(0.0);
        factors[exist.min(MAX_ORDER)..].fill(0.0);
        factors[..=degree].rotate_left(missing);
        let sum: f64 = factors.iter().sum();
        Row { first: span.saturating_sub(degree), factors: factors.map(|factor| factor / sum) }
    }
}

fn outside(u: f64, (start, end): (f64, f64)) -> KnotVectorError {
    KnotVectorError::Invalid(format!("{u} is not inside the domain from {start} to {end}"))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::basis::tests::any_knots;
    use super::*;

    fn value(knots: &KnotVector, points: &[f64], u: f64, order: usize) -> f64 {
        let basis = knots.basis_derivative(u, order);
        let near = points[basis.first..].iter().zip(&basis.values[..=knots.degree()]);
        near.map(|(point, factor)| point * factor).sum()
    }

    fn points(knots: &KnotVector) -> Vec<f64> {
        (0..knots.n_control()).map(|k| libm::sin(1.7 * k as f64)).collect()
    }

    /// Checks that the changed curve has the values of the original curve and, except at knots, the same slopes.
    fn check_same_curve(knots: &KnotVector, change: &KnotChange) -> Result<(), TestCaseError> {
        let before = points(knots);
        let after = change.apply(&before);
        let (start, end) = change.knots().domain();
        for k in 0..=200 {
            let u = start + (end - start) * f64::from(k) / 200.0;
            // At a discontinuity the value of either side is valid, because the changed knots may round `u` to the other side.
            let at_knot = knots.knots().iter().any(|knot| (knot - u).abs() <= 1e-9);
            let [old, new] = [0, 1].map(|order| {
                [value(knots, &before, u, order), value(change.knots(), &after, u, order)]
            });
            prop_assert!((old[0] - old[1]).abs() <= 1e-12, "{u}: {} {}", old[0], old[1]);
            let scale = 1.0 + new[0].abs();
            prop_assert!(at_knot || (new[0] - new[1]).abs() <= 1e-8 * scale, "{u}: {new:?}");
        }
        Ok(())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn inserted_knots_change_no_curve(knots in any_knots(), fraction in 0.01..0.99f64, times in 1usize..=9) {
            let (start, end) = knots.domain();
            let u = start + fraction * (end - start);
            match knots.insert(u, times) {
                Ok(change) => {
                    prop_assert_eq!(change.knots().n_control(), knots.n_control() + times);
                    check_same_curve(&knots, &change)?;
                }
                Err(error) => {
                    let repeated = error.to_string().contains("is repeated");
                    prop_assert!(repeated, "{error}");
                }
            }
            // Inserts a knot where one exists already.
            let inner = knots.knots().iter().find(|&&knot| start < knot && knot < end);
            if let Some(Ok(change)) = inner.map(|&u| knots.insert(u, 1)) {
                check_same_curve(&knots, &change)?;
            }
            let many: Vec<f64> = (1..20).map(|k| start + (end - start) * f64::from(k) / 20.37).collect();
            check_same_curve(&knots, &knots.refine(&many).unwrap())?;
        }

        #[test]
        fn parts_and_bezier_pieces_are_the_curve(knots in any_knots(), fraction in 0.01..0.99f64) {
            let (start, end) = knots.domain();
            let [before, after] = knots.split(start + fraction * (end - start)).unwrap();
            check_same_curve(&knots, &before)?;
            check_same_curve(&knots, &after)?;
            prop_assert_eq!(before.knots().domain().1, after.knots().domain().0);
            check_same_curve(&knots, &knots.bezier())?;
        }

        #[test]
        fn elevation_changes_no_curve(knots in any_knots()) {
            match knots.elevate() {
                Ok(change) => {
                    prop_assert_eq!(change.knots().degree(), knots.degree() + 1);
                    check_same_curve(&knots, &change)?;
                }
                Err(_) => prop_assert_eq!(knots.degree(), 9),
            }
        }
    }

    #[test]
    fn inserting_the_middle_of_a_bezier_curve_is_de_casteljau() {
        let knots = KnotVector::uniform(3, 3).unwrap();
        let change = knots.insert(0.5, 2).unwrap();
        assert_eq!(change.knots().knots(), [0., 0., 0., 0.5, 0.5, 1., 1., 1.]);
        assert_eq!(change.apply(&[0.0, 8.0, 4.0]), [0.0, 4.0, 5.0, 6.0, 4.0]);
        assert_eq!(knots.elevate().unwrap().apply(&[0.0, 3.0, 3.0]), [0.0, 2.0, 3.0, 3.0]);
    }

    #[test]
    fn knots_outside_of_the_domain_are_refused() {
        let knots = KnotVector::uniform(5, 3).unwrap();
        for u in [-1.0, 0.0, 3.0, 9.0, f64::NAN] {
            let error = outside(u, (0.0, 3.0));
            assert_eq!(knots.insert(u, 1), Err(error.clone()));
            assert_eq!(knots.split(u), Err(error));
        }
        for (u, times) in [(1.0, 2), (0.5, 3)] {
            let error = knots.insert(u, times).unwrap_err().to_string();
            assert!(error.contains("is repeated 3 times; at most 2"), "{error}");
        }
        assert!(knots.restrict(1.0, 1.0).is_err() && knots.restrict(1.0, 4.0).is_err());
    }
}
