//! Solid angles of triangles.

use nalgebra::Point3;

/// Returns half of the solid angle of a triangle as seen from a point. It is positive if the back of the triangle faces the point. The sum
/// over all triangles of a closed mesh is 2 pi times the winding number of the point.
///
/// Van Oosterom and Strackee, "The solid angle of a plane triangle" (1983), equation 8.
pub fn half_solid_angle(corners: [Point3<f64>; 3], from: &Point3<f64>) -> f64 {
    let [a, b, c] = corners.map(|corner| corner - from);
    let lengths = [a.norm(), b.norm(), c.norm()];
    let denominator = lengths[0] * lengths[1] * lengths[2]
        + a.dot(&b) * lengths[2]
        + b.dot(&c) * lengths[0]
        + c.dot(&a) * lengths[1];
    libm::atan2(a.dot(&b.cross(&c)), denominator)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_octant_is_an_eighth_of_a_sphere() {
        let octant = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Point3::from);
        let half = half_solid_angle(octant, &Point3::origin());
        assert!((half - std::f64::consts::PI / 4.0).abs() < 1e-15);
        let [a, b, c] = octant;
        assert_eq!(half_solid_angle([b, a, c], &Point3::origin()), -half);
    }
}
