//! A point of a limit surface.

use nalgebra::{Point3, Vector3};

/// A point of a limit surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LimitPoint {
    /// The position of the point.
    pub point: Point3<f64>,
    /// The first derivatives with respect to `u` and `v`. At an irregular corner the derivatives do not exist; there, `first` has two
    /// tangents with the same orientation.
    pub first: [Vector3<f64>; 2],
    /// The second derivatives with respect to `uu`, `uv` and `vv`; `None` at an irregular corner.
    pub second: Option<[Vector3<f64>; 3]>,
}
