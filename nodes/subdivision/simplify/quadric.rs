//! Quadrics: functions of a position that return the sum of its weighted squared distances from planes.
//!
//! Positions are relative to a point near the surface. Garland and Heckbert, "Surface simplification using quadric error metrics" (1997).

use std::ops::{Add, AddAssign};

use nalgebra::{Matrix3, Vector3};

/// The function `E(x) = x^T A x - 2 b . x + c`, which is the sum of `weight (n . x - d)^2` over some planes `n . x = d`.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Quadric {
    a: Matrix3<f64>,
    b: Vector3<f64>,
    c: f64,
}

/// The maximum ratio of the trace of a quadric's matrix to its pivots, if the minimum is meaningful. If the ratio is greater, all planes
/// nearly contain a common line.
const MAX_CONDITION: f64 = 1e8;

/// A computed value of a quadric below this fraction of the sum of its terms is only a rounding error: a few units in the last place.
const ROUNDING: f64 = 1e-15;

impl Quadric {
    /// Returns the weighted squared distance from a plane as a function of the position. The plane contains `point` and has the unit normal
    /// `normal`.
    pub(crate) fn plane(normal: Vector3<f64>, point: Vector3<f64>, weight: f64) -> Self {
        let distance = normal.dot(&point);
        Self {
            a: normal * normal.transpose() * weight,
            b: normal * (distance * weight),
            c: distance * distance * weight,
        }
    }

    /// Returns the function `weight * (slope . x + offset)^2` of the position `x`.
    pub(crate) fn linear(slope: Vector3<f64>, offset: f64, weight: f64) -> Self {
        Self {
            a: slope * slope.transpose() * weight,
            b: slope * (-offset * weight),
            c: offset * offset * weight,
        }
    }

    /// Evaluates the error at the position `x`. Returns 0 if the error is not greater than its own rounding error.
    pub(crate) fn evaluate(&self, x: Vector3<f64>) -> f64 {
        let square = x.dot(&(self.a * x)) + self.c;
        let error = square - 2.0 * self.b.dot(&x);
        if error < ROUNDING * square { 0.0 } else { error }
    }

    /// Returns the position of the minimum; `None` if the planes do not determine one.
    pub(crate) fn minimum(&self) -> Option<Vector3<f64>> {
        let [[xx, xy, xz], [_, yy, yz], [_, _, zz]] = self.a.data.0;
        // Gaussian elimination of a symmetric matrix. Its pivots are about as small as the smallest eigenvalue.
        let smallest = (xx + yy + zz) / MAX_CONDITION;
        let [of_y, of_z] = [xy / xx, xz / xx];
        let second = yy - of_y * xy;
        let mixed = yz - of_y * xz;
        let third = zz - of_z * xz - mixed / second * mixed;
        if !(smallest < xx && smallest < second && smallest < third) {
            return None;
        }
        let y = self.b.y - of_y * self.b.x;
        let z = (self.b.z - of_z * self.b.x - mixed / second * y) / third;
        let y = (y - mixed * z) / second;
        let x = (self.b.x - xy * y - xz * z) / xx;
        let position = Vector3::new(x, y, z);
        position.iter().all(|x| x.is_finite()).then_some(position)
    }
}

impl Add for Quadric {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { a: self.a + other.a, b: self.b + other.b, c: self.c + other.c }
    }
}

impl AddAssign for Quadric {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_planes_meet_where_the_error_is_zero() {
        let at = Vector3::new(1.0, -2.0, 3.0);
        let planes = [Vector3::x(), Vector3::y(), Vector3::new(0.6, 0.0, 0.8)];
        let quadric =
            planes.map(|normal| Quadric::plane(normal, at, 2.0)).into_iter().reduce(Add::add);
        let quadric = quadric.unwrap();
        assert!((quadric.minimum().unwrap() - at).norm() < 1e-12);
        assert!(quadric.evaluate(at) < 1e-12);
        assert!((quadric.evaluate(at + Vector3::y() * 0.5) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn planes_that_share_a_line_have_no_lowest_place() {
        let quadric = Quadric::plane(Vector3::x(), Vector3::zeros(), 1.0)
            + Quadric::plane(Vector3::y(), Vector3::zeros(), 1.0);
        assert!(quadric.minimum().is_none());
        assert_eq!(quadric.evaluate(Vector3::z() * 7.0), 0.0);
    }
}
