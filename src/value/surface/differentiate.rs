//! Derivatives and normals of a surface.

use nalgebra::{Point3, Unit, Vector3};

use super::super::knots::Basis;
use super::evaluate::inward;
use super::{KnotVector, Surface};

/// A point of a surface and the derivatives of the surface at that point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Derivatives {
    /// The point S(u, v).
    pub point: Point3<f64>,
    /// The first derivative by u, dS/du.
    pub u: Vector3<f64>,
    /// The first derivative by v, dS/dv.
    pub v: Vector3<f64>,
    /// The second derivative by u, d²S/du².
    pub uu: Vector3<f64>,
    /// The mixed second derivative, d²S/du dv.
    pub uv: Vector3<f64>,
    /// The second derivative by v, d²S/dv².
    pub vv: Vector3<f64>,
}

/// The step inward from a parameter at which all weights are 0 to the point where derivatives are taken instead, as a fraction of the span.
/// The numerators of derivatives contain differences of nearly equal terms. A smaller step would lose the second derivatives to rounding,
/// and a larger step would be visible.
const INWARD_FOR_DERIVATIVES: f64 = 1e-4;

/// The minimum sine of the angle between two tangents that span a plane. It is far above rounding errors, and far below the angles of any
/// sampled shape.
pub(super) const MIN_SINE: f64 = 1e-12;

/// The maximum length of a tangent that is only a rounding error, as a fraction of the sum of the absolute terms from which the tangent is
/// computed. It is a hundred times the rounding error of such a sum, and far below the detail that a surface so far from the origin can
/// have.
pub(super) const NOISE: f64 = 1e-13;

/// The maximum length of a tangent along a pole, as a fraction of the size of the control points that affect it. Control points of a pole
/// that came from a file or an iteration differ by rounding errors in single precision or by a tolerance, and the tangents between them
/// have random directions.
pub(super) const POLE: f64 = 1e-6;

/// The step inward from a point without a normal to the point where the normal is taken instead, as a fraction of the domain. The step is
/// invisible in pictures, and large enough for the tangents to be exact to 12 digits.
const INWARD_FOR_NORMALS: f64 = 1e-4;

impl Surface {
    /// The point at (u, v) and its first and second derivatives.
    ///
    /// With A = (w S, w): `S_u = (A_u - w_u S) / w`, `S_uu = (A_uu - 2 w_u S_u - w_uu S) / w`, `S_uv = (A_uv - w_u S_v - w_v S_u - w_uv S)
    /// / w`; Piegl and Tiller, *The NURBS Book*, 2nd ed. (1997), eq. 4.20. Where all weights are 0, the derivatives are taken further
    /// inward, by 1e-4 of the span.
    pub fn derivatives(&self, u: f64, v: f64) -> Derivatives {
        let mut by_u = derivatives_of_basis(&self.u, u);
        let mut by_v = derivatives_of_basis(&self.v, v);
        if self.contract(&by_u[0], &by_v[0]).w <= 0.0 {
            let step = INWARD_FOR_DERIVATIVES;
            by_u = derivatives_of_basis(&self.u, inward(&self.u, u, step));
            by_v = derivatives_of_basis(&self.v, inward(&self.v, v, step));
        }
        let sum = |k: usize, l: usize| {
            let sum = self.contract(&by_u[k], &by_v[l]);
            (sum.xyz(), sum.w)
        };
        let (a, w) = sum(0, 0);
        let point = a / w;
        let ((a_u, w_u), (a_v, w_v)) = (sum(1, 0), sum(0, 1));
        let (u, v) = ((a_u - point * w_u) / w, (a_v - point * w_v) / w);
        let ((a_uu, w_uu), (a_uv, w_uv), (a_vv, w_vv)) = (sum(2, 0), sum(1, 1), sum(0, 2));
        Derivatives {
            point: point.into(),
            u,
            v,
            uu: (a_uu - u * (2.0 * w_u) - point * w_uu) / w,
            uv: (a_uv - v * w_u - u * w_v - point * w_uv) / w,
            vv: (a_vv - v * (2.0 * w_v) - point * w_vv) / w,
        }
    }

    /// The unit normal at (u, v), on the side of `S_u x S_v`. If the two tangents do not span a plane (at a collapsed edge, or a pole whose
    /// control points differ by up to a millionth of the size of the nearby ones), the normal is taken further inward, by 1e-4 of the
    /// domain: first along the longer tangent, then along the other one, then along both. `None` if none of these points has a normal
    /// either.
    ///
    /// If the net came from a capture, its rows run down and its columns run to the right. Then the side of the normal is the side of the
    /// sensor.
    pub fn normal(&self, u: f64, v: f64) -> Option<Unit<Vector3<f64>>> {
        let here = self.derivatives(u, v);
        let slopes = [self.u.basis_derivative(u, 1), self.v.basis_derivative(v, 1)];
        let error = libm::hypot(NOISE * here.point.coords.norm(), POLE * self.extent(&slopes));
        let [noise_u, noise_v] = slopes.map(|slopes| steepness(&slopes) * error);
        let both = noise_u < here.u.norm() && noise_v < here.v.norm();
        if let Some(normal) = both.then(|| normal(here.u, here.v)).flatten() {
            return Some(normal);
        }
        fn further(knots: &KnotVector, at: f64) -> f64 {
            let (start, end) = knots.domain();
            let step = INWARD_FOR_NORMALS * (end - start);
            if at < start + (end - start) / 2.0 { at.max(start) + step } else { at.min(end) - step }
        }
        let (in_u, in_v) = (further(&self.u, u), further(&self.v, v));
        let mut candidates = [(in_u, v), (u, in_v), (in_u, in_v)];
        if here.u.norm() < here.v.norm() {
            candidates.swap(0, 1);
        }
        candidates.into_iter().find_map(|(u, v)| {
            let there = self.derivatives(u, v);
            normal(there.u, there.v)
        })
    }

    /// The largest distance of the control points that affect a point of the surface, from the first of them.
    fn extent(&self, [along_u, along_v]: &[Basis; 2]) -> f64 {
        let columns = self.net.columns();
        let points = self.net.points();
        let first = points[along_u.first * columns + along_v.first];
        let rows = (along_u.first..=along_u.first + self.u.degree())
            .map(|row| &points[row * columns + along_v.first..][..=self.v.degree()]);
        rows.flatten().map(|point| (point - first).norm()).fold(0.0, f64::max)
    }
}

/// The basis functions at a parameter and their first and second derivatives.
fn derivatives_of_basis(knots: &KnotVector, at: f64) -> [Basis; 3] {
    [0, 1, 2].map(|k| knots.basis_derivative(at, k))
}

/// The maximum size that a derivative can have for control points of size 1: the sum of the absolute values of the basis functions.
pub(super) fn steepness(slopes: &Basis) -> f64 {
    slopes.values.iter().map(|slope| slope.abs()).sum()
}

fn normal(u: Vector3<f64>, v: Vector3<f64>) -> Option<Unit<Vector3<f64>>> {
    // The tangents are normalized first, so that the threshold is an angle, independent of scale.
    let (u, v) = (u.try_normalize(0.0)?, v.try_normalize(0.0)?);
    Unit::try_new(u.cross(&v), MIN_SINE)
}

#[cfg(test)]
mod tests {
    use super::super::super::ControlNet;
    use super::super::evaluate::tests::{net, surface};
    use super::*;

    #[test]
    fn derivatives_are_the_slopes_of_points() {
        let surface = surface([4, 5]);
        let h = 1e-5;
        for (u, v) in [(0.3, 0.7), (1.6, 2.2), (3.3, 4.6), (4.7, 0.2)] {
            let at = surface.derivatives(u, v);
            assert!((at.point - surface.point(u, v)).norm() <= 1e-14);
            fn slope(f: &dyn Fn(f64) -> Vector3<f64>, h: f64) -> Vector3<f64> {
                (f(h) - f(-h)) / (2.0 * h)
            }
            fn assert_near(a: Vector3<f64>, b: Vector3<f64>) {
                assert!((a - b).norm() <= 1e-6, "{a} {b}");
            }
            assert_near(at.u, slope(&|d| surface.point(u + d, v).coords, h));
            assert_near(at.v, slope(&|d| surface.point(u, v + d).coords, h));
            assert_near(at.uu, slope(&|d| surface.derivatives(u + d, v).u, h));
            assert_near(at.uv, slope(&|d| surface.derivatives(u, v + d).u, h));
            assert_near(at.vv, slope(&|d| surface.derivatives(u, v + d).v, h));
        }
    }

    #[test]
    fn a_pole_far_from_the_origin_has_a_normal_too() {
        // The control points at the pole are equal, but rounding leaves a tangent of about 1e-14.
        let net = net(4, 9, |radius, k| {
            let angle = 2.0 * std::f64::consts::PI * k / 8.0;
            let [x, y] = [radius * libm::cos(angle), radius * libm::sin(angle)];
            Point3::new(21.3 + x, 19.7 + y, 700.1)
        });
        let weights = (0..36).map(|k| 0.3 + 0.1 * (k % 9) as f64).collect();
        let net = net.with_weights(weights).unwrap();
        let [u, v] = [4, 9].map(|count| KnotVector::uniform(count, 3).unwrap());
        let disk = Surface::new(net, u, v).unwrap();
        let vs: Vec<f64> = (0..=50).map(|k| 7.0 * f64::from(k) / 50.0).collect();
        let (_, normals) = disk.normal_grid(&[0.0], &vs);
        for (v, normal) in vs.iter().zip(normals) {
            assert!(normal.z > 0.999, "{v}: {normal}");
            assert!(disk.normal(0.0, *v).unwrap().z > 0.999, "{v}");
        }
    }

    /// The control points of a pole that came from a file or an iteration are not quite one point.
    #[test]
    fn poles_that_are_not_quite_one_point_have_outward_normals() {
        for error in [0.0, 1e-15, 1e-9, 1e-7, 1e-6] {
            let ball = net(7, 13, |row, k| {
                let (polar, turn) =
                    (std::f64::consts::PI * row / 6.0, std::f64::consts::TAU * k / 12.0);
                let radius = 10.0 * libm::sin(polar);
                let at = Vector3::new(radius * libm::cos(turn), radius * libm::sin(turn), 0.0);
                let at = at + Vector3::z() * (10.0 * libm::cos(polar));
                let noise = [3.1, 5.3, 7.7].map(|f| libm::sin(1e3 * f * (1.0 + row * f + k)));
                Point3::from(at + Vector3::from(noise) * error)
            });
            let [u, v] = [7, 13].map(|count| KnotVector::uniform(count, 4).unwrap());
            let ball = Surface::new(ball, u, v).unwrap();
            let us = [0.0, 1e-9, 1.0, 3.0, 4.0 - 1e-9, 4.0];
            let vs: Vec<f64> = (0..=40).map(|k| f64::from(k) / 4.0).collect();
            let (points, normals) = ball.normal_grid(&us, &vs);
            for (point, normal) in points.iter().zip(normals) {
                let cosine = normal.dot(&point.coords.normalize());
                assert!(cosine > 0.95, "{error}: {cosine} at {point}");
            }
        }
    }

    #[test]
    fn a_pole_has_a_normal() {
        // A cone, for which all points in the first row of the net are equal.
        let net = net(3, 5, |radius, k| {
            let angle = std::f64::consts::PI * k / 4.0;
            Point3::new(radius * libm::cos(angle), radius * libm::sin(angle), radius)
        });
        let [u, v] = [3, 5].map(|count| KnotVector::uniform(count, 3).unwrap());
        let cone = Surface::new(net, u, v).unwrap();
        let (pole, near) = (cone.normal(0.0, 1.5).unwrap(), cone.normal(1e-3, 1.5).unwrap());
        assert!(pole.dot(&near) > 1.0 - 1e-9);
        let point = ControlNet::new(2, 2, vec![Point3::origin(); 4]).unwrap();
        let line = KnotVector::uniform(2, 2).unwrap();
        assert_eq!(Surface::new(point, line.clone(), line).unwrap().normal(0.0, 0.0), None);
    }
}
