//! The point of a curve closest to a given point.

use nalgebra::Point3;

use super::Curve;
use super::evaluate::Segment;
use crate::mesh::distance_from_box;

/// The point of a curve closest to a given point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurveFoot {
    /// The parameter of the closest point.
    pub t: f64,
    /// The closest point on the curve.
    pub point: Point3<f64>,
    /// The distance from the given point to the closest point.
    pub distance: f64,
}

/// The tolerance at which the iteration stops. It applies to the step, as a fraction of the domain, and to the cosine of the angle between
/// the tangent and the vector to the given point. Rounding leaves about 1e-16 in each.
const PRECISION: f64 = 1e-12;

/// The maximum number of steps. Newton's method needs about five; gradient steps near a degenerate point need a few dozen.
const MAX_STEPS: usize = 60;

/// The maximum number of times that one step is halved. After that many halvings only rounding remains.
const MAX_HALVINGS: usize = 40;

impl Curve {
    /// The point of the curve that is closest to `to`.
    ///
    /// A piece is skipped if the bounding box of its control points is farther away than the closest point found so far. In every other
    /// piece the best of 2 p + 1 samples (p is the degree) starts [`closest_from`](Self::closest_from). If several points are equally
    /// close, any of them may be returned, but always the same one.
    pub fn closest(&self, to: Point3<f64>) -> CurveFoot {
        let Some(spline) = &self.spline else { return self.closest_piece(to) };
        let degree = spline.knots.degree();
        let mut pieces: Vec<(f64, [f64; 2])> = spline
            .knots
            .spans()
            .map(|(span, ends)| {
                let controls = self.points[span - degree..=span].iter();
                (distance_from_box(to, controls), ends)
            })
            .collect();
        pieces.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut best: Option<CurveFoot> = None;
        for (min_distance, [low, high]) in pieces {
            if best.is_some_and(|best| best.distance <= min_distance) {
                break;
            }
            let samples = (0..=2 * degree)
                .map(|k| low + (high - low) * (k as f64 / (2 * degree) as f64))
                .map(|t| (self.distance(t, to), t));
            let Some((_, start)) = samples.min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
            let foot = self.closest_from(to, start);
            if best.is_none_or(|best| foot.distance < best.distance) {
                best = Some(foot);
            }
        }
        best.unwrap_or_else(|| self.closest_from(to, self.domain().0))
    }

    /// The point closest to `to` that a local search finds. The search starts at the parameter `t`, for instance the parameter found for a
    /// neighboring point. On a closed curve the search continues across the ends.
    ///
    /// Newton's method solves `(C - x) . C' = 0`: Piegl and Tiller, *The NURBS Book*, 2nd ed. (1997), eq. 6.2. If the second derivative of
    /// the squared distance is not positive, the Gauss-Newton step is used instead. A step that does not reduce the distance is halved. On
    /// a polyline the result is the point of the closest segment.
    pub fn closest_from(&self, to: Point3<f64>, t: f64) -> CurveFoot {
        if self.spline.is_none() {
            return self.closest_piece(to);
        }
        let (start, end) = self.domain();
        let mut t = self.wrap_into_domain(t);
        for _ in 0..MAX_STEPS {
            let Some(mut step) = self.step(t, to) else { break };
            let before = self.distance(t, to);
            let halved = (0..MAX_HALVINGS).find_map(|_| {
                let next = self.wrap_into_domain(t + step);
                step /= 2.0;
                (self.distance(next, to) < before).then_some(next)
            });
            let Some(next) = halved else { break };
            let moved = (next - t).abs() / (end - start);
            t = next;
            if moved < PRECISION {
                break;
            }
        }
        let point = self.point(t);
        CurveFoot { t, point, distance: (point - to).norm() }
    }

    /// The next step of the search. `None` at a closest point, and at an end of an open curve if the step would cross that end.
    fn step(&self, t: f64, to: Point3<f64>) -> Option<f64> {
        let derivatives = self.derivatives(t, 2);
        let [here, first, second] = [derivatives[0], derivatives[1], derivatives[2]];
        let spoke = here - to.coords;
        let slope = spoke.dot(&first);
        let (start, end) = self.domain();
        let ends = !self.closed && (t <= start && slope > 0.0 || end <= t && slope < 0.0);
        if ends || slope.abs() <= PRECISION * spoke.norm() * first.norm() {
            return None;
        }
        let speed_sq = first.norm_squared();
        let curving = speed_sq + spoke.dot(&second);
        let step = -slope / if curving > 0.0 { curving } else { speed_sq };
        step.is_finite().then_some(step)
    }

    /// Maps a parameter into the domain: on an open curve to the nearest end, on a closed curve by removing whole periods.
    fn wrap_into_domain(&self, t: f64) -> f64 {
        let (start, end) = self.domain();
        let inside = t.max(start).min(end);
        if !self.closed || t == inside {
            return inside;
        }
        let round = end - start;
        let fraction = (t - start) / round;
        // For a NaN or infinite parameter the number of periods is undefined, so the clamped parameter is used.
        if fraction.is_finite() { start + (fraction - fraction.floor()) * round } else { inside }
    }

    fn distance(&self, t: f64, to: Point3<f64>) -> f64 {
        (self.point(t) - to).norm()
    }

    /// The point of a polyline that is closest to `to`.
    fn closest_piece(&self, to: Point3<f64>) -> CurveFoot {
        let (first, last) = self.domain();
        let (mut t, mut min_distance_sq) = (first, f64::INFINITY);
        for piece in 0..last as usize {
            let Segment { start, vector, .. } = self.segment(piece as f64);
            let fraction = ((to - start).dot(&vector) / vector.norm_squared()).clamp(0.0, 1.0);
            // A segment of length 0 gives NaN. Use its start then.
            let fraction = if fraction.is_nan() { 0.0 } else { fraction };
            let distance_sq = (to - (start + vector * fraction)).norm_squared();
            if distance_sq < min_distance_sq {
                (t, min_distance_sq) = (piece as f64 + fraction, distance_sq);
            }
        }
        let point = self.point(t);
        CurveFoot { t, point, distance: (to - point).norm() }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::KnotVector;
    use super::*;

    /// A closed wave of ten control points around the origin.
    fn wave() -> Curve {
        fn control(k: usize) -> Point3<f64> {
            let angle = k as f64 * std::f64::consts::TAU / 10.0;
            let radius = if k.is_multiple_of(2) { 3.0 } else { 1.5 };
            Point3::new(
                radius * libm::cos(angle),
                radius * libm::sin(angle),
                libm::sin(2.0 * angle),
            )
        }
        let points: Vec<_> = (0..13).map(|k| control(k % 10)).collect();
        Curve::rational(points, vec![1.0; 13], KnotVector::periodic(13, 4).unwrap()).unwrap()
    }

    fn check(curve: &Curve) {
        let (start, end) = curve.domain();
        for k in 0..60 {
            let k = f64::from(k);
            let to = Point3::new(
                4.0 * libm::sin(1.3 * k),
                4.0 * libm::sin(2.1 * k + 1.0),
                libm::sin(0.7 * k),
            );
            let foot = curve.closest(to);
            assert_eq!(foot.point, curve.point(foot.t));
            let samples = (0..=2000).map(|j| start + (end - start) * f64::from(j) / 2000.0);
            let sampled =
                samples.map(|t| (curve.point(t) - to).norm()).fold(f64::INFINITY, f64::min);
            assert!(foot.distance <= sampled + 1e-12, "{to}: {} {sampled}", foot.distance);
            let tangent = curve.derivatives(foot.t, 1)[1];
            let inside = curve.is_closed() || start < foot.t && foot.t < end;
            if inside && curve.knots().is_some() {
                assert!((to - foot.point).dot(&tangent).abs() <= 1e-7 * tangent.norm());
            }
        }
    }

    #[test]
    fn the_closest_point_is_nearer_than_all_samples_and_at_right_angles() {
        check(&wave());
        let points: Vec<_> = wave().points()[..8].to_vec();
        let knots = KnotVector::uniform(8, 4).unwrap();
        check(&Curve::rational(points.clone(), vec![1.0; 8], knots).unwrap());
        check(&Curve::polyline(points.clone(), false).unwrap());
        check(&Curve::polyline(points, true).unwrap());
    }

    #[test]
    fn the_search_on_a_closed_curve_crosses_its_ends() {
        let wave = wave();
        let (start, end) = wave.domain();
        let to = wave.point(start + 0.2) * 1.1;
        let from_the_end = wave.closest_from(to, end - 0.1);
        assert!((from_the_end.t - wave.closest(to).t).abs() <= 1e-9, "{from_the_end:?}");
    }

    #[test]
    fn a_curve_of_one_point_has_a_closest_point_too() {
        let knots = KnotVector::uniform(3, 3).unwrap();
        let curve = Curve::rational(vec![Point3::origin(); 3], vec![1.0; 3], knots).unwrap();
        assert_eq!(curve.closest(Point3::new(3.0, 0.0, 4.0)).distance, 5.0);
    }
}
