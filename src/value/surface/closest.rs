//! The point of a surface closest to a given point.

use nalgebra::{Matrix2, Point3, Vector2, Vector3};

use super::{Derivatives, Surface};
use crate::mesh::distance_from_box;

/// The point of a surface closest to a given point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foot {
    /// The parameter u of the closest point.
    pub u: f64,
    /// The parameter v of the closest point.
    pub v: f64,
    /// The closest point on the surface.
    pub point: Point3<f64>,
    /// The distance from the given point to the closest point.
    pub distance: f64,
}

/// The tolerance at which the iteration stops. It applies to the step, as a fraction of the domain, and to the cosine of the angle between
/// a tangent and the vector to the given point. Rounding leaves about 1e-16 in each.
const PRECISION: f64 = 1e-12;

/// The maximum number of steps. Newton's method needs about five; gradient steps near a degenerate point need a few dozen.
const MAX_STEPS: usize = 60;

/// The maximum number of times that one step is halved. After that many halvings only rounding remains.
const MAX_HALVINGS: usize = 40;

impl Surface {
    /// The point of the surface that is closest to `to`.
    ///
    /// Every piece is inside the bounding box of its control points, so a piece is skipped if its box is farther away than the closest
    /// point found so far. In every other piece the best of (2 p + 1) x (2 q + 1) samples (p and q are the degrees) starts
    /// [`closest_from`](Self::closest_from). If several points are equally close, any of them may be returned, but always the same one.
    pub fn closest(&self, to: Point3<f64>) -> Foot {
        let (p, q, columns) = (self.u.degree(), self.v.degree(), self.net.columns());
        let mut pieces: Vec<(f64, [[f64; 2]; 2])> = Vec::new();
        for (u, ends_u) in self.u.spans() {
            pieces.extend(self.v.spans().map(|(v, ends_v)| {
                let rows =
                    (u - p..=u).flat_map(|row| &self.net.points()[row * columns..][v - q..=v]);
                (distance_from_box(to, rows), [ends_u, ends_v])
            }));
        }
        pieces.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut best: Option<Foot> = None;
        for (min_distance, [ends_u, ends_v]) in pieces {
            if best.is_some_and(|best| best.distance <= min_distance) {
                break;
            }
            fn samples([low, high]: [f64; 2], count: usize) -> Vec<f64> {
                (0..count).map(|k| low + (high - low) * (k as f64 / (count - 1) as f64)).collect()
            }
            let (at_u, at_v) = (samples(ends_u, 2 * p + 1), samples(ends_v, 2 * q + 1));
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

    /// The point closest to `to` that a local search finds. The search starts at the parameters `start`, for instance those found for a
    /// neighboring point.
    ///
    /// Newton's method solves `(S - x) . S_u = (S - x) . S_v = 0` on the domain: Piegl and Tiller, *The NURBS Book*, 2nd ed. (1997), eqs.
    /// 6.4 to 6.7. If the Hessian of the squared distance is not positive definite, the Gauss-Newton step is used instead. A step that does
    /// not reduce the distance is halved.
    pub fn closest_from(&self, to: Point3<f64>, [u, v]: [f64; 2]) -> Foot {
        let domain = [self.u.domain(), self.v.domain()];
        let clamp =
            |at: Vector2<f64>| Vector2::from_fn(|k, _| at[k].max(domain[k].0).min(domain[k].1));
        let size = Vector2::from_fn(|k, _| domain[k].1 - domain[k].0);
        let mut at = clamp(Vector2::new(u, v));
        let mut here = self.derivatives(at.x, at.y);
        for _ in 0..MAX_STEPS {
            let Some(step) = step(&here, to, at, domain) else { break };
            let before = (here.point - to).norm();
            let mut fraction = 1.0;
            let mut next = None;
            for _ in 0..MAX_HALVINGS {
                let trial = clamp(at + step * fraction);
                let there = self.derivatives(trial.x, trial.y);
                if (there.point - to).norm() < before {
                    next = Some((trial, there));
                    break;
                }
                fraction /= 2.0;
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
}

/// The next step of the search. `None` at a closest point. A parameter does not change if it is at an end of its domain and the step would
/// cross that end.
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
    // At a pole one tangent is zero, so only the parameter of the other tangent changes.
    down(first + second, &free, slope).or_else(|| down(first, &free, slope)).or_else(|| {
        let step = Vector2::from_fn(|k, _| {
            if free[k] && first[(k, k)] > 0.0 { -slope[k] / first[(k, k)] } else { 0.0 }
        });
        step.iter().all(|x| x.is_finite()).then_some(step)
    })
}

#[cfg(test)]
mod tests {
    use super::super::super::{ControlNet, KnotVector};
    use super::super::evaluate::tests::{samples, surface};
    use super::*;

    /// A point near the test surface.
    fn test_point(k: usize) -> Point3<f64> {
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
            for to in (0..40).map(test_point) {
                let foot = surface.closest(to);
                let sampled = grid.iter().map(|point| (point - to).norm());
                let sampled = sampled.fold(f64::INFINITY, f64::min);
                assert!(foot.distance <= sampled + 1e-12, "{to}: {} {sampled}", foot.distance);
                assert_eq!(foot.point, surface.point(foot.u, foot.v));
            }
        }
    }

    #[test]
    fn an_inner_closest_point_is_perpendicular() {
        let surface = surface([4, 4]);
        let mut inside = 0;
        for to in (0..40).map(test_point) {
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
    fn a_point_of_the_surface_is_its_own_closest_point() {
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
