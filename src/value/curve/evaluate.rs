//! Points and derivatives of a curve, and the polyline that stands for it.

use nalgebra::{Point3, Vector3, Vector4};

use super::{Curve, Spline};

/// Largest distance of a chosen polyline from its curve, as a share of the diagonal of the control points' box: not to be seen
/// on a picture of 1000 pixels.
const CHORD: f64 = 1e-3;

/// Most pieces that are chosen in one span. More come from curves that no chosen number would follow.
const MOST: usize = 256;

impl Curve {
    /// The point at `t`. A parameter outside of the domain counts as the nearest end, NaN as the start.
    pub fn point(&self, t: f64) -> Point3<f64> {
        match &self.spline {
            Some(spline) => {
                let sum = self.homogeneous(spline, t, 0);
                (sum.xyz() / sum.w).into()
            }
            None => {
                let (start, along, share) = self.piece(t);
                start + along * share
            }
        }
    }

    /// The derivatives by `t` up to `order`, the point itself first. At a corner of a polyline and at a knot they are those of the
    /// piece that begins there.
    ///
    /// Piegl and Tiller, *The NURBS Book*, 2nd ed. (1997), eq. 4.8: with the homogeneous curve `(A, w)`,
    /// `C^(k) = (A^(k) - sum_i binomial(k, i) w^(i) C^(k - i)) / w`.
    pub fn derivatives(&self, t: f64, order: usize) -> Vec<Vector3<f64>> {
        let Some(spline) = &self.spline else {
            let (start, along, share) = self.piece(t);
            let mut derivatives = vec![Vector3::zeros(); order + 1];
            derivatives[0] = (start + along * share).coords;
            if let Some(first) = derivatives.get_mut(1) {
                *first = along;
            }
            return derivatives;
        };
        let sums: Vec<_> = (0..=order).map(|k| self.homogeneous(spline, t, k)).collect();
        let mut derivatives: Vec<Vector3<f64>> = Vec::with_capacity(order + 1);
        for k in 0..=order {
            let mut sum = sums[k].xyz();
            let mut binomial = 1.0;
            for i in 1..=k {
                binomial *= (k + 1 - i) as f64 / i as f64;
                sum -= derivatives[k - i] * (binomial * sums[i].w);
            }
            derivatives.push(sum / sums[0].w);
        }
        derivatives
    }

    /// The points of a polyline along the curve; a closed curve's first point is not repeated. A polyline gives its own points,
    /// a B-spline those at the ends of `pieces` equal parts of each span that is not empty; with 0 their number is chosen so
    /// that chords stay within 1/1000 of the diagonal of the control points' box.
    pub fn sample(&self, pieces: usize) -> Vec<Point3<f64>> {
        let Some(spline) = &self.spline else { return self.points.to_vec() };
        let pieces = if pieces == 0 { self.chosen(spline) } else { pieces };
        let mut points = Vec::new();
        for (low, high) in spans(spline) {
            fn at(k: usize, low: f64, high: f64, pieces: usize) -> f64 {
                low + (high - low) * (k as f64 / pieces as f64)
            }
            points.extend((0..pieces).map(|k| self.point(at(k, low, high, pieces))));
        }
        if !self.closed {
            points.push(self.point(self.domain().1));
        }
        points
    }

    /// How many pieces per span keep the chords within the tolerance: doubled until the middle of each does.
    fn chosen(&self, spline: &Spline) -> usize {
        let allowed = CHORD * self.diagonal();
        let fits = |pieces: usize| {
            spans(spline).all(|(low, high)| {
                let at =
                    |k: usize| self.point(low + (high - low) * (k as f64 / (2 * pieces) as f64));
                (0..pieces).all(|k| distance(at(2 * k + 1), at(2 * k), at(2 * k + 2)) <= allowed)
            })
        };
        let mut pieces = 1;
        while pieces < MOST && !fits(pieces) {
            pieces *= 2;
        }
        pieces
    }

    /// The piece of a polyline that holds `t`: its start, the way to its end, and the share of it up to `t`.
    pub(super) fn piece(&self, t: f64) -> (Point3<f64>, Vector3<f64>, f64) {
        let (start, end) = self.domain();
        let t = t.max(start).min(end);
        let index = (t as usize).min(end as usize - 1);
        let next = if index + 1 == self.points.len() { 0 } else { index + 1 };
        (self.points[index], self.points[next] - self.points[index], t - index as f64)
    }

    /// The derivative of that order of `sum_i N_i (w_i P_i, w_i)`.
    fn homogeneous(&self, spline: &Spline, t: f64, order: usize) -> Vector4<f64> {
        let basis = spline.knots.basis_derivative(t, order);
        let terms = basis.values[..=spline.knots.degree()].iter().zip(basis.first..);
        terms.fold(Vector4::zeros(), |sum, (&value, control)| {
            let weight = spline.weights[control];
            sum + (self.points[control].coords * weight).push(weight) * value
        })
    }
}

/// The ends of the spans that are not empty.
fn spans(spline: &Spline) -> impl Iterator<Item = (f64, f64)> {
    let knots = &spline.knots;
    let domain = &knots.knots()[knots.degree()..=knots.n_control()];
    domain.windows(2).filter(|span| span[0] < span[1]).map(|span| (span[0], span[1]))
}

/// How far a point is from a piece of a line.
fn distance(point: Point3<f64>, start: Point3<f64>, end: Point3<f64>) -> f64 {
    let (along, to) = (end - start, point - start);
    let share = (to.dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
    // A piece of no length gives NaN.
    (to - along * if share.is_nan() { 0.0 } else { share }).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::KnotVector;

    fn at(x: f64, y: f64) -> Point3<f64> {
        Point3::new(x, y, 0.0)
    }

    /// The unit circle of nine control points on a square.
    fn circle() -> Curve {
        let s = 0.5f64.sqrt();
        let square = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)];
        let points = square.map(|(x, y)| at(f64::from(x), f64::from(y))).to_vec();
        let weights = (0..9).map(|k| if k % 2 == 0 { 1.0 } else { s }).collect();
        Curve::rational(points, weights, KnotVector::cylinder()).unwrap()
    }

    #[test]
    fn a_polyline_is_straight_between_its_points() {
        let points = vec![at(0., 0.), at(2., 0.), at(2., 2.)];
        let open = Curve::polyline(points.clone(), false).unwrap();
        assert_eq!(open.domain(), (0.0, 2.0));
        assert_eq!(
            [0.5, 1.5, 2.0, 9.0].map(|t| open.point(t)),
            [at(1., 0.), at(2., 1.), at(2., 2.), at(2., 2.)]
        );
        assert_eq!(open.point(f64::NAN), at(0., 0.));
        assert_eq!(open.derivatives(1.0, 2)[1..], [Vector3::new(0., 2., 0.), Vector3::zeros()]);
        let closed = Curve::polyline(points, true).unwrap();
        assert_eq!([closed.point(2.5), closed.point(3.0)], [at(1., 1.), at(0., 0.)]);
    }

    #[test]
    fn the_circle_is_round_and_closed() {
        let circle = circle();
        assert!(circle.is_closed());
        for k in 0..=100 {
            let t = 0.04 * f64::from(k);
            let [point, first, second] = circle.derivatives(t, 2).try_into().unwrap();
            assert!((point.norm() - 1.0).abs() < 1e-14);
            assert!(point.dot(&first).abs() < 1e-13);
            // The curvature of the unit circle is 1.
            let speed = first.norm();
            let curvature = first.cross(&second).norm() / (speed * speed * speed);
            assert!((curvature - 1.0).abs() < 1e-12, "{curvature}");
        }
    }

    #[test]
    fn derivatives_are_the_limits_of_differences() {
        let curve = circle();
        let h = 1e-5;
        for t in [0.3, 1.7, 3.2] {
            let [_, first, second, third] = curve.derivatives(t, 3).try_into().unwrap();
            fn difference(k: usize, curve: &Curve, t: f64, h: f64) -> Vector3<f64> {
                (curve.derivatives(t + h, k)[k] - curve.derivatives(t - h, k)[k]) / (2.0 * h)
            }
            for (exact, k) in [first, second, third].into_iter().zip(0..) {
                assert!((exact - difference(k, &curve, t, h)).norm() < 1e-7, "{t} {k}");
            }
        }
    }

    #[test]
    fn a_sampled_circle_stays_within_a_thousandth_and_does_not_repeat_its_start() {
        let points = circle().sample(0);
        assert!(points.len() < 100);
        for (start, end) in points.iter().zip(points.iter().cycle().skip(1)) {
            let middle = nalgebra::center(start, end);
            assert!(1.0 - middle.coords.norm() <= 1e-3 * 8f64.sqrt());
        }
        assert_eq!(circle().sample(1).len(), 4);
    }

    #[test]
    fn a_curve_of_one_point_has_samples() {
        let knots = KnotVector::uniform(3, 3).unwrap();
        let curve = Curve::rational(vec![at(1., 1.); 3], vec![1.0; 3], knots).unwrap();
        assert_eq!(curve.sample(0), [at(1., 1.)]);
    }
}
