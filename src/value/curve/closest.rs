//! The point of a curve next to a given one.

use nalgebra::{Point3, Vector3};

use super::Curve;

/// The point of a curve next to a given one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurveFoot {
    /// Its parameter.
    pub t: f64,
    /// The point.
    pub point: Point3<f64>,
    /// Its distance from the given one.
    pub distance: f64,
}

/// Where the iteration stops: the step as a share of the domain, the cosine of the angle between the spoke and the tangent.
/// Rounding leaves some 1e-16 of either.
const PRECISION: f64 = 1e-12;

/// Most steps: Newton's method needs some five, and gradient steps near a degenerate point a few dozen.
const MOST_STEPS: usize = 60;

/// Most halvings of one step: what is left then is rounding.
const MOST_HALVINGS: usize = 40;

impl Curve {
    /// The point of the curve that is nearest to `to`.
    ///
    /// Pieces whose control points' box is farther away than a point already found are left out; in the others the best of
    /// 2 p + 1 samples starts [`closest_from`](Self::closest_from). Of equally near points any may be found, always the same.
    pub fn closest(&self, to: Point3<f64>) -> CurveFoot {
        let Some(spline) = &self.spline else { return self.closest_piece(to) };
        let degree = spline.knots.degree();
        let mut pieces: Vec<(f64, usize)> = (degree..spline.knots.n_control())
            .filter(|&span| spline.knots.knots()[span] < spline.knots.knots()[span + 1])
            .map(|span| (self.distance_from_box(to, &(span - degree..span + 1)), span))
            .collect();
        pieces.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut best: Option<CurveFoot> = None;
        for (least, span) in pieces {
            if best.is_some_and(|best| best.distance <= least) {
                break;
            }
            let (low, high) = (spline.knots.knots()[span], spline.knots.knots()[span + 1]);
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

    /// The point next to `to` that is reached downhill from the parameter `t`, for instance that of a neighbor. The search of a
    /// closed curve runs on over its ends.
    ///
    /// Newton's method for `(C - x) . C' = 0`: Piegl and Tiller, *The NURBS Book*, 2nd ed. (1997), eq. 6.2. Without a curvature
    /// that goes up from the foot it takes the step of Gauss and Newton; steps that do not come nearer are halved. On a polyline
    /// it is the point of the nearest piece.
    pub fn closest_from(&self, to: Point3<f64>, t: f64) -> CurveFoot {
        if self.spline.is_none() {
            return self.closest_piece(to);
        }
        let (start, end) = self.domain();
        let mut t = self.within(t);
        for _ in 0..MOST_STEPS {
            let Some(mut step) = self.step(t, to) else { break };
            let before = self.distance(t, to);
            let halved = (0..MOST_HALVINGS).find_map(|_| {
                let next = self.within(t + step);
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

    /// The next step downhill; none at a foot. At an end beyond which it would go on there is none, unless the curve is closed.
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

    /// The parameter in the domain: the nearest end, or on a closed curve what is left after whole rounds.
    fn within(&self, t: f64) -> f64 {
        let (start, end) = self.domain();
        let inside = t.max(start).min(end);
        if !self.closed || t == inside {
            return inside;
        }
        let round = end - start;
        let share = (t - start) / round;
        // NaN and steps out of all bounds end where other parameters do.
        if share.is_finite() { start + (share - share.floor()) * round } else { inside }
    }

    fn distance(&self, t: f64, to: Point3<f64>) -> f64 {
        (self.point(t) - to).norm()
    }

    /// The foot on the nearest piece of a polyline.
    fn closest_piece(&self, to: Point3<f64>) -> CurveFoot {
        let (start, end) = self.domain();
        let (mut t, mut least) = (start, f64::INFINITY);
        for piece in 0..end as usize {
            let (from, along, _) = self.piece(piece as f64);
            let share = ((to - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            // A piece of no length gives NaN.
            let share = if share.is_nan() { 0.0 } else { share };
            let distance_sq = (to - (from + along * share)).norm_squared();
            if distance_sq < least {
                (t, least) = (piece as f64 + share, distance_sq);
            }
        }
        let point = self.point(t);
        CurveFoot { t, point, distance: (to - point).norm() }
    }

    /// A lower bound of the distance of a piece: that of the box around its control points.
    fn distance_from_box(&self, to: Point3<f64>, controls: &std::ops::Range<usize>) -> f64 {
        let mut low = Vector3::repeat(f64::INFINITY);
        let mut high = Vector3::repeat(f64::NEG_INFINITY);
        for point in &self.points[controls.clone()] {
            low = low.inf(&point.coords);
            high = high.sup(&point.coords);
        }
        (low - to.coords).sup(&(to.coords - high)).sup(&Vector3::zeros()).norm()
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
        let points: Vec<_> = wave().points()[..8].iter().copied().collect();
        let knots = KnotVector::uniform(8, 4).unwrap();
        check(&Curve::rational(points.clone(), vec![1.0; 8], knots).unwrap());
        check(&Curve::polyline(points.clone(), false).unwrap());
        check(&Curve::polyline(points, true).unwrap());
    }

    #[test]
    fn the_search_of_a_closed_curve_runs_on_over_its_ends() {
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
