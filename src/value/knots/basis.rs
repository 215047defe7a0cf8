//! The basis functions of a knot vector, their derivatives, and the parameters at which the basis functions reproduce a line.
//!
//! Source: Piegl and Tiller, *The NURBS Book*, 2nd ed. (1997), chapter 2, including the names `left`, `right` and `saved`. Every function
//! accepts any number: a parameter outside of the domain is clamped to the nearest end, and NaN means the start.

use super::KnotVector;

/// The maximum number of basis functions in one span: one more than the maximum degree.
pub(crate) const MAX_ORDER: usize = 10;

/// The basis functions that can be nonzero at one parameter, or their derivatives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Basis {
    /// The index of the control point that belongs to the first basis function.
    pub(crate) first: usize,
    /// The values. The first degree + 1 entries are used, the others are 0.
    pub(crate) values: [f64; MAX_ORDER],
}

impl KnotVector {
    /// The index `s` of the span that contains `u`: `knots[s] <= u < knots[s + 1]`. At the end of the domain it is the last span that is
    /// not empty. `u` is clamped to the domain; NaN means the start of the domain.
    ///
    /// The NURBS Book, algorithm A2.1.
    pub fn span(&self, u: f64) -> usize {
        let u = self.clamp(u);
        let knots = self.knots();
        let (first, last) = (self.degree(), self.n_control() - 1);
        let mut span = first + knots[first + 1..=last].partition_point(|&knot| knot <= u);
        // At the end of the domain, the span found so far can be empty. Go back to the last span that is not empty.
        while knots[span + 1] <= knots[span] {
            span -= 1;
        }
        span
    }

    /// The degree + 1 basis functions that can be nonzero at `u`, and the index of the control point that belongs to the first of them. The
    /// values are not negative and their sum is 1. `u` is clamped to the domain; NaN means the start of the domain.
    ///
    /// Evaluates the Cox-de Boor recurrence bottom up: The NURBS Book, algorithm A2.2.
    pub fn basis(&self, u: f64) -> (usize, Vec<f64>) {
        let basis = self.basis_derivative(u, 0);
        (basis.first, basis.values[..=self.degree()].to_vec())
    }

    /// The Greville abscissae: for each control point the mean of the degree inner knots of its basis function. A B-spline whose control
    /// points are an affine function of these abscissae equals that function.
    pub fn greville(&self) -> Vec<f64> {
        (0..self.n_control()).map(|control| self.greville_at(control)).collect()
    }

    /// The parameter of a net coordinate `a`, which is a real number from 0 to the index of the last control point. The parameter is the
    /// root `u` of `sum_i i N_i(u) = a`. If control points are evenly spaced on a line, evenly spaced net coordinates give evenly spaced
    /// points of the curve, including the ends. The abscissae of [`greville`](Self::greville) do not achieve this near a clamped end.
    ///
    /// If the coordinate is outside of the range of the sum, the result is the nearest end of the domain; for NaN it is the start. The sum
    /// never decreases. Newton's method starts at the Greville abscissa, and a step that leaves the bracket is replaced by bisection, so
    /// the iteration always converges.
    pub fn parameter(&self, a: f64) -> f64 {
        let (mut low, mut high) = self.domain();
        let above_start = a > self.coordinate(low, 0);
        if !above_start {
            return low;
        }
        if self.coordinate(high, 0) <= a {
            return high;
        }
        let precision = (high - low) * 1e-16;
        let control = (a as usize).min(self.n_control() - 2);
        let (before, after) = (self.greville_at(control), self.greville_at(control + 1));
        let mut u = self.clamp(before + (a - control as f64) * (after - before));
        // Bisection alone would need fewer steps than a number has bits, so the limit matters only if knots overflow.
        for _ in 0..128 {
            let excess = self.coordinate(u, 0) - a;
            if excess == 0.0 {
                break;
            }
            if excess < 0.0 {
                low = u;
            } else {
                high = u;
            }
            let newton = u - excess / self.coordinate(u, 1);
            let inside = low < newton && newton < high;
            let next = if inside { newton } else { low + (high - low) / 2.0 };
            let step = (next - u).abs();
            u = next;
            if step <= precision {
                break;
            }
        }
        u
    }

    /// The net coordinate of a parameter: `sum_i i N_i(u)`, the inverse of [`parameter`](Self::parameter).
    pub fn net_coordinate(&self, u: f64) -> f64 {
        self.coordinate(u, 0)
    }

    /// The `order`-th derivative of `sum_i i N_i` at `u`.
    fn coordinate(&self, u: f64, order: usize) -> f64 {
        let basis = self.basis_derivative(u, order);
        let terms = basis.values[..=self.degree()].iter().enumerate();
        terms.map(|(k, value)| (basis.first + k) as f64 * value).sum()
    }

    fn greville_at(&self, control: usize) -> f64 {
        let inner = &self.knots()[control + 1..=control + self.degree()];
        inner.iter().sum::<f64>() / self.degree() as f64
    }

    fn clamp(&self, u: f64) -> f64 {
        let (start, end) = self.domain();
        u.max(start).min(end)
    }

    /// The `order`-th derivatives of the basis functions at `u`. Derivatives of an order above the degree are 0. At a knot, the derivatives
    /// are those in the span that [`span`](Self::span) finds.
    ///
    /// The NURBS Book, eq. 2.7, applied to the basis functions of lower degree.
    pub(crate) fn basis_derivative(&self, u: f64, order: usize) -> Basis {
        let u = self.clamp(u);
        let (span, degree) = (self.span(u), self.degree());
        let first = span - degree;
        if degree < order {
            return Basis { first, values: [0.0; MAX_ORDER] };
        }
        let mut values = self.basis_of_degree(span, u, degree - order);
        for d in degree - order + 1..=degree {
            values = self.differentiate(span, d, &values);
        }
        Basis { first, values }
    }

    /// The basis functions of degree `d` that can be nonzero in a span that is not empty. No denominator is less than the length of the
    /// span.
    fn basis_of_degree(&self, span: usize, u: f64, d: usize) -> [f64; MAX_ORDER] {
        let knots = self.knots();
        let mut values = [0.0; MAX_ORDER];
        values[0] = 1.0;
        for j in 1..=d {
            let mut saved = 0.0;
            for r in 0..j {
                let right = knots[span + r + 1] - u;
                let left = u - knots[span + 1 + r - j];
                let fraction = values[r] / (right + left);
                values[r] = saved + right * fraction;
                saved = left * fraction;
            }
            values[j] = saved;
        }
        values
    }

    /// Computes the next derivative for degree `d` from the basis functions of degree `d - 1`, or from a derivative of them: `N'_i = d (N_i
    /// / (t_{i+d} - t_i) - N_{i+1} / (t_{i+d+1} - t_{i+1}))`.
    fn differentiate(&self, span: usize, d: usize, lower: &[f64; MAX_ORDER]) -> [f64; MAX_ORDER] {
        let knots = self.knots();
        let mut values = [0.0; MAX_ORDER];
        for (j, lower) in lower[..d].iter().enumerate() {
            let quotient = d as f64 * lower / (knots[span + j + 1] - knots[span + 1 + j - d]);
            values[j] -= quotient;
            values[j + 1] += quotient;
        }
        values
    }
}

#[cfg(test)]
pub(super) mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Random knots with repetitions, for B-splines of any degree.
    pub(crate) fn any_knots() -> impl Strategy<Value = KnotVector> {
        let steps = prop::collection::vec(prop_oneof![Just(0.0), 0.01..3.0f64], 4..20);
        (1usize..=9, steps, any::<bool>()).prop_filter_map(
            "no knots",
            |(degree, steps, clamped)| {
                let mut knots = vec![0.0; if clamped { degree + 1 } else { 1 }];
                for step in steps {
                    knots.push(knots.last().unwrap() + step);
                }
                let end = knots.last().unwrap() + 1.0;
                knots.extend(vec![end; if clamped { degree + 1 } else { 1 }]);
                KnotVector::new(degree, knots).ok()
            },
        )
    }

    proptest! {
        #[test]
        fn basis_functions_are_not_negative_and_sum_to_one(knots in any_knots(), fraction in 0.0..=1.0f64) {
            let (start, end) = knots.domain();
            for u in [start, start + fraction * (end - start), end] {
                let (first, values) = knots.basis(u);
                prop_assert!(first + values.len() <= knots.n_control());
                prop_assert!(values.iter().all(|&value| value >= 0.0), "{values:?}");
                prop_assert!((values.iter().sum::<f64>() - 1.0).abs() <= 1e-14, "{values:?}");
            }
        }

        #[test]
        fn the_span_at_every_knot_is_not_empty(knots in any_knots()) {
            for &u in knots.knots() {
                let span = knots.span(u);
                prop_assert!(knots.knots()[span] < knots.knots()[span + 1]);
            }
        }

        #[test]
        fn a_parameter_has_its_net_coordinate(knots in any_knots(), fraction in 0.0..=1.0f64) {
            let (start, end) = knots.domain();
            let (low, high) = (knots.coordinate(start, 0), knots.coordinate(end, 0));
            let a = low + fraction * (high - low);
            let u = knots.parameter(a);
            prop_assert!((knots.coordinate(u, 0) - a).abs() <= 1e-12 * high, "{u}");
        }
    }

    #[test]
    fn the_last_control_point_is_the_end_of_a_clamped_curve() {
        let knots = KnotVector::new(2, vec![0., 0., 0., 1., 1., 2., 2., 2.]).unwrap();
        assert_eq!(knots.basis(2.0), (2, vec![0.0, 0.0, 1.0]));
        assert_eq!(knots.basis(9.0), knots.basis(2.0));
        assert_eq!(knots.basis(f64::NAN), (0, vec![1.0, 0.0, 0.0]));
    }

    #[test]
    fn derivatives_of_the_cubic_bernstein_polynomials_are_known() {
        let knots = KnotVector::new(3, vec![0., 0., 0., 0., 1., 1., 1., 1.]).unwrap();
        let rows = [0, 1, 2, 3, 4].map(|order| knots.basis_derivative(0.5, order));
        assert!(rows.iter().all(|row| row.first == 0));
        let rows = rows.map(|row| row.values[..4].to_vec());
        assert_eq!(rows[0], [0.125, 0.375, 0.375, 0.125]);
        assert_eq!(rows[1], [-0.75, -0.75, 0.75, 0.75]);
        assert_eq!(rows[2], [3.0, -3.0, -3.0, 3.0]);
        assert_eq!(rows[3], [-6.0, 18.0, -18.0, 6.0]);
        assert_eq!(rows[4], [0.0; 4]);
    }

    #[test]
    fn greville_abscissae_of_the_uniform_quadratic_start_at_half_steps() {
        let knots = KnotVector::uniform(5, 3).unwrap();
        assert_eq!(knots.greville(), [0.0, 0.5, 1.5, 2.5, 3.0]);
        // Far from the ends of the domain, the parameter of a control point equals its Greville abscissa.
        let long = KnotVector::uniform(12, 4).unwrap();
        assert!((long.parameter(5.0) - long.greville()[5]).abs() <= 1e-14);
        assert_eq!([long.parameter(-1.0), long.parameter(99.0)], [0.0, 9.0]);
        assert_eq!(long.parameter(f64::NAN), 0.0);
    }
}
