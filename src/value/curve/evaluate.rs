//! Points and derivatives of a curve, and its approximation by a polyline.

use nalgebra::{Point3, Vector3, Vector4};

use super::{Curve, Spline};
use crate::mesh::diagonal;

/// The maximum distance of the approximating polyline from the curve, as a fraction of the diagonal of the control points' bounding box. At
/// 1/1000 the distance is invisible in a picture of 1000 pixels.
const CHORD: f64 = 1e-3;

/// The maximum number of segments per span that [`Curve::choose_pieces`] chooses. A curve that needs more segments cannot be approximated
/// by any reasonable number of them.
const MAX_PIECES: usize = 256;

/// The segment of a polyline that contains a parameter.
pub(super) struct Segment {
    pub(super) start: Point3<f64>,
    /// The vector from the start of the segment to its end.
    pub(super) vector: Vector3<f64>,
    /// The fraction of the segment that is before the parameter, from 0 to 1.
    pub(super) fraction: f64,
}

impl Curve {
    /// The point of the curve at the parameter `t`. A parameter outside of the domain is clamped to the nearest end; NaN means the start.
    pub fn point(&self, t: f64) -> Point3<f64> {
        match &self.spline {
            Some(spline) => {
                let sum = self.homogeneous(spline, t, 0);
                (sum.xyz() / sum.w).into()
            }
            None => {
                let Segment { start, vector, fraction } = self.segment(t);
                start + vector * fraction
            }
        }
    }

    /// The derivatives by `t` up to `order`; the first entry is the point itself. At a corner of a polyline and at a knot, the derivatives
    /// are those of the piece that begins there.
    ///
    /// Piegl and Tiller, *The NURBS Book*, 2nd ed. (1997), eq. 4.8: with the homogeneous curve `(A, w)`,
    /// `C^(k) = (A^(k) - sum_i binomial(k, i) w^(i) C^(k - i)) / w`.
    pub fn derivatives(&self, t: f64, order: usize) -> Vec<Vector3<f64>> {
        let Some(spline) = &self.spline else {
            let Segment { start, vector, fraction } = self.segment(t);
            let mut derivatives = vec![Vector3::zeros(); order + 1];
            derivatives[0] = (start + vector * fraction).coords;
            if let Some(first) = derivatives.get_mut(1) {
                *first = vector;
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

    /// The points of a polyline along the curve. The first point of a closed curve is not repeated. A polyline returns its own points. A
    /// B-spline is evaluated at the ends of `pieces` equal parts of each span that is not empty. If `pieces` is 0, the number is chosen so
    /// that the chords stay within 1/1000 of the diagonal of the control points' bounding box.
    pub fn sample(&self, pieces: usize) -> Vec<Point3<f64>> {
        let Some(spline) = &self.spline else { return self.points.to_vec() };
        let pieces = if pieces == 0 { self.choose_pieces(spline) } else { pieces };
        let mut points = Vec::new();
        for (_, [low, high]) in spline.knots.spans() {
            points.extend(
                (0..pieces).map(|k| self.point(low + (high - low) * (k as f64 / pieces as f64))),
            );
        }
        if !self.closed {
            points.push(self.point(self.domain().1));
        }
        points
    }

    /// The number of segments per span that keeps the chords within the tolerance `CHORD` of the curve. The number is doubled until the
    /// middle of each segment is near enough to its chord.
    fn choose_pieces(&self, spline: &Spline) -> usize {
        let allowed = CHORD * diagonal(&self.points);
        let mut pieces = 1;
        while pieces < MAX_PIECES && !self.has_chords_within(spline, pieces, allowed) {
            pieces *= 2;
        }
        pieces
    }

    /// Returns true if, with `pieces` segments per span, the middle of each segment is within the distance `allowed` of its chord.
    fn has_chords_within(&self, spline: &Spline, pieces: usize, allowed: f64) -> bool {
        spline.knots.spans().all(|(_, [low, high])| {
            (0..pieces).all(|k| {
                let [start, middle, end] = [2 * k, 2 * k + 1, 2 * k + 2]
                    .map(|k| self.point(low + (high - low) * (k as f64 / (2 * pieces) as f64)));
                distance(middle, start, end) <= allowed
            })
        })
    }

    /// The segment of a polyline that contains `t`.
    pub(super) fn segment(&self, t: f64) -> Segment {
        let (first, last) = self.domain();
        let t = t.max(first).min(last);
        let index = (t as usize).min(last as usize - 1);
        let next = if index + 1 == self.points.len() { 0 } else { index + 1 };
        let start = self.points[index];
        Segment { start, vector: self.points[next] - start, fraction: t - index as f64 }
    }

    /// The derivative of order `order` of `sum_i N_i (w_i P_i, w_i)`.
    fn homogeneous(&self, spline: &Spline, t: f64, order: usize) -> Vector4<f64> {
        let basis = spline.knots.basis_derivative(t, order);
        let terms = basis.values[..=spline.knots.degree()].iter().zip(basis.first..);
        terms.fold(Vector4::zeros(), |sum, (&value, control)| {
            let weight = spline.weights[control];
            sum + (self.points[control].coords * weight).push(weight) * value
        })
    }
}

/// The distance of a point from a line segment.
fn distance(point: Point3<f64>, start: Point3<f64>, end: Point3<f64>) -> f64 {
    let (along, to) = (end - start, point - start);
    let fraction = (to.dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
    // If the segment has length 0, the fraction is NaN. Use the start of the segment then.
    (to - along * if fraction.is_nan() { 0.0 } else { fraction }).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::KnotVector;

    fn point_xy(x: f64, y: f64) -> Point3<f64> {
        Point3::new(x, y, 0.0)
    }

    /// The unit circle as a curve of nine control points on a square.
    fn circle() -> Curve {
        let s = 0.5f64.sqrt();
        let square = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)];
        let points = square.map(|(x, y)| point_xy(f64::from(x), f64::from(y))).to_vec();
        let weights = (0..9).map(|k| if k % 2 == 0 { 1.0 } else { s }).collect();
        Curve::rational(points, weights, KnotVector::cylinder()).unwrap()
    }

    #[test]
    fn a_polyline_is_straight_between_its_points() {
        let points = vec![point_xy(0., 0.), point_xy(2., 0.), point_xy(2., 2.)];
        let open = Curve::polyline(points.clone(), false).unwrap();
        assert_eq!(open.domain(), (0.0, 2.0));
        assert_eq!(
            [0.5, 1.5, 2.0, 9.0].map(|t| open.point(t)),
            [point_xy(1., 0.), point_xy(2., 1.), point_xy(2., 2.), point_xy(2., 2.)]
        );
        assert_eq!(open.point(f64::NAN), point_xy(0., 0.));
        assert_eq!(open.derivatives(1.0, 2)[1..], [Vector3::new(0., 2., 0.), Vector3::zeros()]);
        let closed = Curve::polyline(points, true).unwrap();
        assert_eq!([closed.point(2.5), closed.point(3.0)], [point_xy(1., 1.), point_xy(0., 0.)]);
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
        let curve = Curve::rational(vec![point_xy(1., 1.); 3], vec![1.0; 3], knots).unwrap();
        assert_eq!(curve.sample(0), [point_xy(1., 1.)]);
    }
}
