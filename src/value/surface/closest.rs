//! The point of a surface next to a given one.

use nalgebra::{Matrix2, Point3, Vector2, Vector3};

use super::{Derivatives, KnotVector, Surface};

/// The point of a surface next to a given one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foot {
    /// Its first parameter.
    pub u: f64,
    /// Its second parameter.
    pub v: f64,
    /// The point.
    pub point: Point3<f64>,
    /// Its distance from the given one.
    pub distance: f64,
}

/// Where the iteration stops: the step as a share of the domain, the cosine of the angle between the spoke and a tangent.
/// Rounding leaves some 1e-16 of either.
const PRECISION: f64 = 1e-12;

/// Most steps: Newton's method needs some five, and gradient steps near a degenerate point a few dozen.
const MOST_STEPS: usize = 60;

/// Most halvings of one step: what is left then is rounding.
const MOST_HALVINGS: usize = 40;

impl Surface {
    /// The point of the surface that is nearest to `to`.
    ///
    /// Every piece lies in the box of its control points, so that pieces whose box is farther away than a point already found
    /// are left out; in the others the best of (2 p + 1) x (2 q + 1) samples starts [`closest_from`](Self::closest_from). Of
    /// equally near points any may be found, always the same.
    pub fn closest(&self, to: Point3<f64>) -> Foot {
        let (p, q) = (self.u.degree(), self.v.degree());
        fn spans(knots: &KnotVector) -> Vec<usize> {
            (knots.degree()..knots.n_control())
                .filter(|span| knots.knots()[*span] < knots.knots()[span + 1])
                .collect()
        }
        let (us, vs) = (spans(&self.u), spans(&self.v));
        let mut pieces: Vec<(f64, usize, usize)> = Vec::with_capacity(us.len() * vs.len());
        for &u in &us {
            pieces.extend(vs.iter().map(|&v| (self.distance_from_box(to, u, v), u, v)));
        }
        pieces.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut best: Option<Foot> = None;
        for (least, u, v) in pieces {
            if best.is_some_and(|best| best.distance <= least) {
                break;
            }
            fn inside(knots: &KnotVector, span: usize, count: usize) -> Vec<f64> {
                let (low, high) = (knots.knots()[span], knots.knots()[span + 1]);
                (0..count)
                    .map(|k| low + (high - low) * (k as f64 / (count - 1) as f64))
                    .collect::<Vec<f64>>()
            }
            let (at_u, at_v) = (inside(&self.u, u, 2 * p + 1), inside(&self.v, v, 2 * q + 1));
            let samples = at_u.iter().flat_map(|&u| at_v.iter().map(move |&v| [u, v]));
            let distances = samples.map(|[u, v]| ((self.point(u, v) - to).norm(), [u, v]));
            let Some((_, start)) = distances.min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
            let foot = self.closest_from(to, start);
            if best.is_none_or(|best| foot.distance < best.distance) {
                best = Some(foot);
            }
        }
        best.unwrap_or_else(|| self.closest_from(to, [self.u.domain().0, self.v.domain().0]))
    }

    /// The point next to `to` that is reached downhill from the parameters `start`, for instance those of a neighbor.
    ///
    /// Newton's method for `(S - x) . S_u = (S - x) . S_v = 0` on the domain: Piegl and Tiller, *The NURBS Book*, 2nd ed. (1997),
    /// eqs. 6.4 to 6.7. Without a curvature that goes up from the foot it takes the step of Gauss and Newton; steps that do not
    /// come nearer are halved.
    pub fn closest_from(&self, to: Point3<f64>, [u, v]: [f64; 2]) -> Foot {
        let domain = [self.u.domain(), self.v.domain()];
        let clamp =
            |at: Vector2<f64>| Vector2::from_fn(|k, _| at[k].max(domain[k].0).min(domain[k].1));
        let size = Vector2::from_fn(|k, _| domain[k].1 - domain[k].0);
        let mut at = clamp(Vector2::new(u, v));
        let mut here = self.derivatives(at.x, at.y);
        for _ in 0..MOST_STEPS {
            let Some(step) = step(&here, to, at, domain) else { break };
            let before = (here.point - to).norm();
            let mut share = 1.0;
            let mut next = None;
            for _ in 0..MOST_HALVINGS {
                let trial = clamp(at + step * share);
                let there = self.derivatives(trial.x, trial.y);
                if (there.point - to).norm() < before {
                    next = Some((trial, there));
                    break;
                }
                share /= 2.0;
            }
            let Some((trial, there)) = next else { break };
            let moved = (trial - at).component_div(&size).amax();
            (at, here) = (trial, there);
            if moved < PRECISION {
                break;
            }
        }
        let point = self.point(at.x, at.y);
        Foot { u: at.x, v: at.y, point, distance: (point - to).norm() }
    }

    /// A lower bound of the distance of a piece: that of the box around its control points.
    fn distance_from_box(&self, to: Point3<f64>, span_u: usize, span_v: usize) -> f64 {
        let (p, q) = (self.u.degree(), self.v.degree());
        let columns = self.net.columns();
        let mut low = Vector3::repeat(f64::INFINITY);
        let mut high = Vector3::repeat(f64::NEG_INFINITY);
        for row in span_u - p..=span_u {
            for point in &self.net.points()[row * columns + span_v - q..=row * columns + span_v] {
                low = low.inf(&point.coords);
                high = high.sup(&point.coords);
            }
        }
        let beyond = (low - to.coords).sup(&(to.coords - high)).sup(&Vector3::zeros());
        beyond.norm()
    }
}

/// The next step downhill; none at a foot. A parameter at an end of its domain, beyond which it would go on, stays.
fn step(
    here: &Derivatives,
    to: Point3<f64>,
    at: Vector2<f64>,
    domain: [(f64, f64); 2],
) -> Option<Vector2<f64>> {
    let spoke = here.point - to;
    let tangents = [here.u, here.v];
    let slope = Vector2::new(spoke.dot(&here.u), spoke.dot(&here.v));
    let free = [0, 1].map(|k| {
        let (start, end) = domain[k];
        !(at[k] <= start && slope[k] > 0.0 || at[k] >= end && slope[k] < 0.0)
    });
    fn flat(
        k: usize,
        slope: Vector2<f64>,
        spoke: Vector3<f64>,
        tangents: &[Vector3<f64>; 2],
    ) -> bool {
        slope[k].abs() <= PRECISION * spoke.norm() * tangents[k].norm()
    }
    if (0..2).all(|k| !free[k] || flat(k, slope, spoke, &tangents)) {
        return None;
    }
    let first = Matrix2::new(
        here.u.norm_squared(),
        here.u.dot(&here.v),
        here.u.dot(&here.v),
        here.v.norm_squared(),
    );
    let second = Matrix2::new(
        spoke.dot(&here.uu),
        spoke.dot(&here.uv),
        spoke.dot(&here.uv),
        spoke.dot(&here.vv),
    );
    fn down(matrix: Matrix2<f64>, free: &[bool; 2], slope: Vector2<f64>) -> Option<Vector2<f64>> {
        let matrix = match *free {
            [true, true] => matrix,
            _ => Matrix2::new(matrix.m11, 0.0, 0.0, matrix.m22),
        };
        let positive = matrix.m11 > 0.0 && matrix.m22 > 0.0 && matrix.determinant() > 0.0;
        let step = matrix.try_inverse().filter(|_| positive)? * -slope;
        let step = Vector2::from_fn(|k, _| if free[k] { step[k] } else { 0.0 });
        step.iter().all(|x| x.is_finite()).then_some(step)
    }
    // At a pole one tangent is zero: then only the other parameter moves.
    down(first + second, &free, slope).or_else(|| down(first, &free, slope)).or_else(|| {
        fn share(k: usize, free: &[bool; 2], slope: Vector2<f64>, first: &Matrix2<f64>) -> f64 {
            if free[k] { -slope[k] / first[(k, k)] } else { 0.0 }
        }
        let step = Vector2::from_fn(|k, _| {
            if first[(k, k)] > 0.0 { share(k, &free, slope, &first) } else { 0.0 }
        });
        step.iter().all(|x| x.is_finite()).then_some(step)
    })
}

#[cfg(test)]
mod tests {
    use super::super::super::ControlNet;
    use super::super::evaluate::tests::{samples, surface};
    use super::*;

    /// A place around the test surface.
    fn place(k: usize) -> Point3<f64> {
        let k = k as f64;
        fn wave(step: f64, k: f64) -> f64 {
            libm::sin(step * k + step)
        }
        Point3::new(4.0 + 6.0 * wave(1.3, k), 3.5 + 6.0 * wave(2.1, k), 3.0 * wave(0.7, k))
    }

    #[test]
    fn the_closest_point_is_nearer_than_all_samples() {
        for orders in [[3, 3], [4, 3], [2, 4]] {
            let surface = surface(orders);
            let (us, vs) = (samples(surface.u(), 120), samples(surface.v(), 120));
            let grid = surface.grid(&us, &vs);
            for to in (0..40).map(place) {
                let foot = surface.closest(to);
                let sampled = grid.iter().map(|point| (point - to).norm());
                let sampled = sampled.fold(f64::INFINITY, f64::min);
                assert!(foot.distance <= sampled + 1e-12, "{to}: {} {sampled}", foot.distance);
                assert_eq!(foot.point, surface.point(foot.u, foot.v));
            }
        }
    }

    #[test]
    fn a_foot_inside_is_at_right_angles() {
        let surface = surface([4, 4]);
        let mut inside = 0;
        for to in (0..40).map(place) {
            let foot = surface.closest(to);
            let at = surface.derivatives(foot.u, foot.v);
            let spoke = (to - foot.point).normalize();
            for (knots, at, tangent) in [(surface.u(), foot.u, at.u), (surface.v(), foot.v, at.v)] {
                let (start, end) = knots.domain();
                if start < at && at < end {
                    assert!(spoke.dot(&tangent.normalize()).abs() <= 1e-7);
                    inside += 1;
                }
            }
        }
        assert!(inside > 20, "{inside}");
    }

    #[test]
    fn a_point_of_the_surface_is_its_own_foot() {
        let surface = surface([3, 4]);
        for (u, v) in [(0.0, 0.0), (1.3, 2.9), (3.0, 3.0), (6.0, 1.0)] {
            assert!(surface.closest(surface.point(u, v)).distance <= 1e-9);
        }
    }

    #[test]
    fn a_collapsed_surface_has_a_closest_point_too() {
        let line = KnotVector::uniform(3, 3).unwrap();
        let net = ControlNet::new(3, 3, vec![Point3::new(1.0, 0.0, 0.0); 9]).unwrap();
        let surface = Surface::new(net, line.clone(), line).unwrap();
        assert_eq!(surface.closest(Point3::new(3.0, 0.0, 0.0)).distance, 2.0);
    }
}
