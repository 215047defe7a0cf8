//! Derivatives and normals of a surface.

use nalgebra::{Point3, Unit, Vector3};

use super::super::knots::Basis;
use super::evaluate::inward;
use super::{KnotVector, Surface};

/// A point of a surface and its derivatives there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Derivatives {
    /// The point S.
    pub point: Point3<f64>,
    /// dS/du.
    pub u: Vector3<f64>,
    /// dS/dv.
    pub v: Vector3<f64>,
    /// The second derivative by u.
    pub uu: Vector3<f64>,
    /// The mixed second derivative.
    pub uv: Vector3<f64>,
    /// The second derivative by v.
    pub vv: Vector3<f64>,
}

/// How far from a parameter at which all weights vanish derivatives are taken, as a share of the span. Their numerators cancel: a
/// smaller step would lose the second derivatives to rounding, a larger one would show.
const INWARD_FOR_DERIVATIVES: f64 = 1e-4;

/// Below this sine of the angle between the two tangents they do not span a plane: far above rounding, far below any sampled
/// shape.
pub(super) const LEAST_SINE: f64 = 1e-12;

/// A tangent below this share of the numbers that it is a sum of is what rounding left of zero: a hundred times that, and far below
/// what a surface at such a distance from the origin can show.
pub(super) const NOISE: f64 = 1e-13;

/// How far inward a normal is taken where there is none, as a share of the domain: small on every picture, large enough for the
/// tangents to be exact to 12 digits.
const INWARD_FOR_NORMALS: f64 = 1e-4;

impl Surface {
    /// The point at (u, v) and its first and second derivatives.
    ///
    /// With A = (w S, w): `S_u = (A_u - w_u S) / w`, `S_uu = (A_uu - 2 w_u S_u - w_uu S) / w`,
    /// `S_uv = (A_uv - w_u S_v - w_v S_u - w_uv S) / w`; Piegl and Tiller, *The
    /// NURBS Book*, 2nd ed. (1997), eq. 4.20. Where all weights vanish they are taken 1e-4 of the span further inward.
    pub fn derivatives(&self, u: f64, v: f64) -> Derivatives {
        fn bases(
            u: f64,
            v: f64,
            self_u: &KnotVector,
            self_v: &KnotVector,
        ) -> ([Basis; 3], [Basis; 3]) {
            fn by(knots: &KnotVector, at: f64) -> [Basis; 3] {
                [0, 1, 2].map(|k| knots.basis_derivative(at, k))
            }
            (by(self_u, u), by(self_v, v))
        }
        let (mut by_u, mut by_v) = bases(u, v, &self.u, &self.v);
        if self.contract(&by_u[0], &by_v[0]).w <= 0.0 {
            let step = INWARD_FOR_DERIVATIVES;
            (by_u, by_v) =
                bases(inward(&self.u, u, step), inward(&self.v, v, step), &self.u, &self.v);
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

    /// The unit normal at (u, v), on the side of `S_u x S_v`. Where the two tangents span no plane (a collapsed edge, a pole) it
    /// is taken 1e-4 of the domain further inward, first along the longer tangent, then along the other one, then along both;
    /// none if there is no normal there either.
    ///
    /// For a net from a capture, whose rows run down and whose columns run to the right, this is the side of the sensor.
    pub fn normal(&self, u: f64, v: f64) -> Option<Unit<Vector3<f64>>> {
        let here = self.derivatives(u, v);
        let size = here.point.coords.norm();
        let [noise_u, noise_v] = [(&self.u, u), (&self.v, v)]
            .map(|(knots, at)| NOISE * steepness(&knots.basis_derivative(at, 1)) * size);
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
        let mut places = [(in_u, v), (u, in_v), (in_u, in_v)];
        if here.u.norm() < here.v.norm() {
            places.swap(0, 1);
        }
        places.into_iter().find_map(|(u, v)| {
            let there = self.derivatives(u, v);
            normal(there.u, there.v)
        })
    }
}

/// How large a derivative can be for control points of size 1: the sum of its basis functions' sizes.
pub(super) fn steepness(slopes: &Basis) -> f64 {
    slopes.values.iter().map(|slope| slope.abs()).sum()
}

fn normal(u: Vector3<f64>, v: Vector3<f64>) -> Option<Unit<Vector3<f64>>> {
    // Unit vectors first, so that the test means an angle whatever the scale.
    let (u, v) = (u.try_normalize(0.0)?, v.try_normalize(0.0)?);
    Unit::try_new(u.cross(&v), LEAST_SINE)
}

#[cfg(test)]
mod tests {
    use super::super::super::ControlNet;
    use super::super::evaluate::tests::surface;
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
            let near =
                |a: Vector3<f64>, b: Vector3<f64>| assert!((a - b).norm() <= 1e-6, "{a} {b}");
            near(at.u, slope(&|d| surface.point(u + d, v).coords, h));
            near(at.v, slope(&|d| surface.point(u, v + d).coords, h));
            near(at.uu, slope(&|d| surface.derivatives(u + d, v).u, h));
            near(at.uv, slope(&|d| surface.derivatives(u, v + d).u, h));
            near(at.vv, slope(&|d| surface.derivatives(u, v + d).v, h));
        }
    }

    #[test]
    fn a_pole_far_from_the_origin_has_a_normal_too() {
        // The points of the pole are equal, but rounding leaves a tangent of some 1e-14.
        let net = ControlNet::new(
            4,
            9,
            (0..36)
                .map(|k: usize| {
                    let angle = 2.0 * std::f64::consts::PI * (k % 9) as f64 / 8.0;
                    let radius = (k / 9) as f64;
                    let [x, y] = [radius * libm::cos(angle), radius * libm::sin(angle)];
                    Point3::new(21.3 + x, 19.7 + y, 700.1)
                })
                .collect::<Vec<_>>(),
        )
        .unwrap();
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

    #[test]
    fn a_pole_has_a_normal() {
        // A cone: the first row of the net is one point.
        let net = ControlNet::new(
            3,
            5,
            (0..15)
                .map(|k: usize| {
                    let angle = std::f64::consts::PI * (k % 5) as f64 / 4.0;
                    let radius = (k / 5) as f64;
                    Point3::new(radius * libm::cos(angle), radius * libm::sin(angle), radius)
                })
                .collect::<Vec<_>>(),
        )
        .unwrap();
        let [u, v] = [3, 5].map(|count| KnotVector::uniform(count, 3).unwrap());
        let cone = Surface::new(net, u, v).unwrap();
        let (pole, near) = (cone.normal(0.0, 1.5).unwrap(), cone.normal(1e-3, 1.5).unwrap());
        assert!(pole.dot(&near) > 1.0 - 1e-9);
        let point = ControlNet::new(2, 2, vec![Point3::origin(); 4]).unwrap();
        let line = KnotVector::uniform(2, 2).unwrap();
        assert_eq!(Surface::new(point, line.clone(), line).unwrap().normal(0.0, 0.0), None);
    }
}
