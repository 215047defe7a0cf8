//! The curvature of a surface at a point, from its derivatives or from points around.

use maquette_value::Rgb;
use nalgebra::{Matrix2, Point3, Vector3, Vector5};

/// How a surface bends at a point.
///
/// The normal points outward, and what bends away from it is positive: a sphere of radius r has `k1 = k2 = 1 / r`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bending {
    /// The product of the principal curvatures, in 1/mm^2.
    pub gaussian: f64,
    /// Their mean, in 1/mm.
    pub mean: f64,
    /// The larger and the smaller principal curvature, in 1/mm.
    pub principal: [f64; 2],
    /// Unit tangents in which the surface bends so; any at right angles where both are equal.
    pub directions: [Vector3<f64>; 2],
}

impl Bending {
    /// The same directions with the curvatures that angles tell.
    pub(super) fn replaced(self, angles: super::AngleBending) -> Self {
        let (gaussian, mean) = (angles.gaussian, angles.mean);
        let spread = (mean * mean - gaussian).max(0.0).sqrt();
        Self { gaussian, mean, principal: [mean + spread, mean - spread], ..self }
    }

    /// From the derivatives of a parametrization of any kind; none if the tangents do not span a plane.
    ///
    /// The second fundamental form in an orthonormal frame of tangents, whose eigenvalues are the principal curvatures: do Carmo,
    /// *Differential Geometry of Curves and Surfaces* (1976), section 3.3; with the sign of an outward normal.
    pub(super) fn of_derivatives(
        [u, v]: [Vector3<f64>; 2],
        [uu, uv, vv]: [Vector3<f64>; 3],
    ) -> Option<Self> {
        let normal = u.cross(&v).try_normalize(0.0)?;
        let first = u.try_normalize(0.0)?;
        let second = normal.cross(&first);
        let tangents = Matrix2::new(u.dot(&first), v.dot(&first), u.dot(&second), v.dot(&second));
        let inverse = tangents.try_inverse()?;
        let form =
            -Matrix2::new(uu.dot(&normal), uv.dot(&normal), uv.dot(&normal), vv.dot(&normal));
        let form = inverse.transpose() * form * inverse;
        Self::of_form(form, [first, second])
    }

    /// From the second fundamental form in a frame of orthonormal tangents.
    fn of_form(form: Matrix2<f64>, [first, second]: [Vector3<f64>; 2]) -> Option<Self> {
        if !form.iter().all(|x| x.is_finite()) {
            return None;
        }
        let across = (form.m12 + form.m21) / 2.0;
        let mean = (form.m11 + form.m22) / 2.0;
        let half = (form.m11 - form.m22) / 2.0;
        let spread = (half * half + across * across).sqrt();
        // The longer one of two vectors along the first direction.
        let [x, y] = if half >= 0.0 { [half + spread, across] } else { [across, spread - half] };
        let along = first * x + second * y;
        let along = along.try_normalize(0.0).unwrap_or(first);
        Some(Self {
            gaussian: form.m11 * form.m22 - across * across,
            mean,
            principal: [mean + spread, mean - spread],
            directions: [along, first.cross(&second).cross(&along)],
        })
    }

    /// From points around one, by the quadratic height field over the plane at right angles to `normal` that is nearest to them by
    /// squares; it need not pass through the middle one's tangent plane. None for fewer than 5 points or those on one line.
    ///
    /// Petitjean, "A survey of methods for recovering quadrics in triangle meshes" (2002), section 3.
    pub(super) fn of_points(
        middle: Point3<f64>,
        normal: Vector3<f64>,
        around: &[Point3<f64>],
    ) -> Option<Self> {
        let normal = normal.try_normalize(0.0)?;
        let axis = Vector3::ith(normal.iamin(), 1.0);
        let first = normal.cross(&axis).try_normalize(0.0)?;
        let second = normal.cross(&first);
        let size = around.iter().map(|point| (point - middle).norm()).fold(0.0, f64::max);
        if around.len() < 5 || size <= 0.0 {
            return None;
        }
        // In units of the neighborhood, so that all columns are of one size.
        let local = |point: &Point3<f64>| {
            let to = (point - middle) / size;
            [to.dot(&first), to.dot(&second), to.dot(&normal)]
        };
        let sums = around
            .iter()
            .map(|point| {
                let [x, y, z] = local(point);
                let terms = Vector5::new(x * x, x * y, y * y, x, y);
                (terms * terms.transpose(), terms * z)
            })
            .reduce(|a, b| (a.0 + b.0, a.1 + b.1));
        let (normal_rows, heights) = sums?;
        let cholesky = normal_rows.cholesky()?;
        // The eigenvalues' product is at most the least one times the fourth power of the greatest, and that at most their sum: mostly it
        // tells already that the least is large enough.
        let sum = normal_rows.trace();
        let is_determined = cholesky.determinant() > 1e-9 * (sum * sum * sum * sum * sum) || {
            let sizes = normal_rows.symmetric_eigenvalues();
            sizes.min() > 1e-10 * sizes.max()
        };
        let fit = is_determined.then(|| cholesky.solve(&heights))?;
        let [a, b, c, d, e] = [0, 1, 2, 3, 4].map(|k| fit[k]);
        let tangents = [first + normal * d, second + normal * e];
        let seconds = [2.0 * a, b, 2.0 * c].map(|bend| normal * (bend / size));
        Self::of_derivatives(tangents, seconds)
    }
}

/// The color of a number from -1 (blue) over 0 (light gray) to 1 (red): equal steps of the number look equal.
///
/// The ends and the middle of Moreland, "Diverging color maps for scientific visualization" (2009), straight in between.
pub(super) fn ramp(number: f64) -> Rgb {
    const MIDDLE: [f64; 3] = [221.0, 221.0, 221.0];
    let end = if number < 0.0 { [59.0, 76.0, 192.0] } else { [180.0, 4.0, 38.0] };
    let share = if number.is_nan() { 0.0 } else { number.abs().min(1.0) };
    [0, 1, 2].map(|k| (MIDDLE[k] + (end[k] - MIDDLE[k]) * share + 0.5) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_torus_bends_as_its_formula_says() {
        let (big, small) = (2.0, 0.7);
        for k in 0..40 {
            let (u, v) = (0.7 * f64::from(k), 0.3 * f64::from(k));
            let (cu, su, cv, sv) = (libm::cos(u), libm::sin(u), libm::cos(v), libm::sin(v));
            let radius = big + small * cv;
            let tangents = [
                Vector3::new(-radius * su, radius * cu, 0.0),
                Vector3::new(-small * sv * cu, -small * sv * su, small * cv),
            ];
            let seconds = [
                Vector3::new(-radius * cu, -radius * su, 0.0),
                Vector3::new(small * sv * su, -small * sv * cu, 0.0),
                Vector3::new(-small * cv * cu, -small * cv * su, -small * sv),
            ];
            let bending = Bending::of_derivatives(tangents, seconds).unwrap();
            let around = cv / radius;
            assert!((bending.principal[0] - 1.0 / small).abs() < 1e-12);
            assert!((bending.principal[1] - around).abs() < 1e-12);
            assert!((bending.gaussian - around / small).abs() < 1e-12);
            assert!((bending.mean - (around + 1.0 / small) / 2.0).abs() < 1e-12);
            let along = tangents[1].normalize();
            assert!((bending.directions[0].dot(&along).abs() - 1.0).abs() < 1e-12);
            assert!(bending.directions[1].dot(&along).abs() < 1e-12);
        }
    }

    #[test]
    fn points_of_a_paraboloid_have_its_curvature_whatever_the_normal_that_is_assumed() {
        fn height(x: f64, y: f64) -> f64 {
            -0.5 * x * x - 1.5 * y * y
        }
        let around: Vec<Point3<f64>> = (0..12)
            .map(|k| 0.5 * f64::from(k))
            .map(|t| [0.1 * libm::cos(t), 0.1 * libm::sin(3.0 * t)])
            .map(|[x, y]| Point3::new(x, y, height(x, y)))
            .collect();
        let bending = Bending::of_points(Point3::origin(), Vector3::z(), &around).unwrap();
        assert!((bending.principal[0] - 3.0).abs() < 1e-9, "{bending:?}");
        assert!((bending.principal[1] - 1.0).abs() < 1e-9);
        assert!((bending.directions[0].y.abs() - 1.0).abs() < 1e-9);
        let tilted = Vector3::new(0.1, 0.0, 1.0);
        let tilted = Bending::of_points(Point3::origin(), tilted, &around).unwrap();
        assert!((tilted.principal[0] - 3.0).abs() < 0.1, "{tilted:?}");
        assert!(Bending::of_points(Point3::origin(), Vector3::z(), &around[..4]).is_none());
    }

    #[test]
    fn the_ramp_goes_from_blue_over_gray_to_red() {
        assert_eq!([ramp(-2.0), ramp(0.0), ramp(1.0)], [[59, 76, 192], [221; 3], [180, 4, 38]]);
        assert_eq!(ramp(f64::NAN), [221; 3]);
    }
}
