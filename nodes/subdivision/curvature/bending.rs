//! The curvature of a surface at a point, from its derivatives or from neighboring points.

use maquette_value::Rgb;
use nalgebra::{Matrix2, Point3, Vector3, Vector5};

/// The curvature of a surface at a point.
///
/// The normal points outward, and curvature away from the normal is positive: a sphere of radius r has `k1 = k2 = 1 / r`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bending {
    /// The product of the principal curvatures, in 1/mm^2.
    pub gaussian: f64,
    /// The mean of the principal curvatures, in 1/mm.
    pub mean: f64,
    /// The larger and the smaller principal curvature, in 1/mm.
    pub principal: [f64; 2],
    /// The principal directions as unit tangents; an arbitrary orthogonal pair if both curvatures are equal.
    pub directions: [Vector3<f64>; 2],
}

impl Bending {
    /// Returns the curvature values of `angles` with the principal directions of `self`.
    pub(super) fn replace_curvatures(self, angles: super::AngleBending) -> Self {
        let (gaussian, mean) = (angles.gaussian, angles.mean);
        let spread = (mean * mean - gaussian).max(0.0).sqrt();
        Self { gaussian, mean, principal: [mean + spread, mean - spread], ..self }
    }

    /// Returns the mean of some curvatures, weighted by the numbers beside them, with the directions of the one with the largest weight;
    /// `None` if there are none.
    pub(super) fn mean(parts: &[(Self, f64)]) -> Option<Self> {
        let (main, _) = parts.iter().copied().reduce(|a, b| if a.1 < b.1 { b } else { a })?;
        let gaussian = parts.iter().map(|(bending, weight)| bending.gaussian * weight).sum();
        let mean = parts.iter().map(|(bending, weight)| bending.mean * weight).sum();
        Some(main.replace_curvatures(super::AngleBending { gaussian, mean, area: 0.0 }))
    }

    /// Computes the curvature from the derivatives of any parametrization. Returns `None` if the tangents do not span a plane.
    ///
    /// The principal curvatures are the eigenvalues of the second fundamental form in an orthonormal frame of tangents: do Carmo,
    /// *Differential Geometry of Curves and Surfaces* (1976), section 3.3. The sign is that for an outward normal: a sphere has positive
    /// curvatures.
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

    /// Computes the curvature from the second fundamental form, given in a frame of two orthonormal tangents. Returns `None` if an entry of
    /// the form is not finite.
    fn of_form(form: Matrix2<f64>, [first, second]: [Vector3<f64>; 2]) -> Option<Self> {
        if !form.iter().all(|x| x.is_finite()) {
            return None;
        }
        let across = (form.m12 + form.m21) / 2.0;
        let mean = (form.m11 + form.m22) / 2.0;
        let half = (form.m11 - form.m22) / 2.0;
        let spread = (half * half + across * across).sqrt();
        // The first principal direction can be computed by two formulas. The longer of the two resulting vectors is more accurate.
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

    /// Computes the curvature from neighboring points: fits a quadratic height field over the plane perpendicular to `normal` by least
    /// squares. The tangent plane of the height field at `middle` may be tilted. Returns `None` for fewer than 5 points or points on a
    /// line.
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
        let sums = around
            .iter()
            .map(|point| {
                // Coordinates are divided by the size of the neighborhood, which gives all columns of the least-squares matrix a similar
                // magnitude.
                let to = (point - middle) / size;
                let [x, y, z] = [to.dot(&first), to.dot(&second), to.dot(&normal)];
                let terms = Vector5::new(x * x, x * y, y * y, x, y);
                (terms * terms.transpose(), terms * z)
            })
            .reduce(|a, b| (a.0 + b.0, a.1 + b.1));
        let (normal_rows, heights) = sums?;
        let cholesky = normal_rows.cholesky()?;
        // The determinant of the normal equations is the product of their five eigenvalues. So the determinant is at most the smallest
        // eigenvalue times the fourth power of the greatest one, and the greatest eigenvalue is at most the sum of all. In most cases this
        // bound already shows that the smallest eigenvalue is large enough.
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

/// Maps a number from -1 (blue) through 0 (light gray) to 1 (red) to a color. The color map is perceptually uniform.
///
/// The colors for -1, 0 and 1 are those of Moreland, "Diverging color maps for scientific visualization" (2009); between them colors are
/// interpolated linearly.
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
    fn a_torus_has_the_curvature_of_its_formula() {
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
    fn points_of_a_paraboloid_have_its_curvature_for_any_assumed_normal() {
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
    fn the_ramp_is_blue_gray_and_red() {
        assert_eq!([ramp(-2.0), ramp(0.0), ramp(1.0)], [[59, 76, 192], [221; 3], [180, 4, 38]]);
        assert_eq!(ramp(f64::NAN), [221; 3]);
    }
}
