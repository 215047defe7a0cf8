//! A point of a limit surface.

use nalgebra::{Point3, Vector3};

/// A point of a limit surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LimitPoint {
    /// The place.
    pub point: Point3<f64>,
    /// The derivatives by `u` and `v`. At an irregular corner, where there are none, two tangents that turn in the same way.
    pub first: [Vector3<f64>; 2],
    /// The derivatives by `u` twice, by `u` and `v`, and by `v` twice; none at an irregular corner.
    pub second: Option<[Vector3<f64>; 3]>,
}
