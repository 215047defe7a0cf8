//! The origin of the coordinates in which scans are registered.

use maquette_scan::Scan;
use maquette_value::bounds;
use nalgebra::{Isometry3, Point3, Translation3, Vector3};

/// The origin of local coordinates, for scans in the coordinates of a map or a building.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LocalOrigin(Vector3<f64>);

/// Scans nearer to the origin than this many diagonals of their bounding box keep their coordinates.
const NEAR: f64 = 1000.0;

impl LocalOrigin {
    /// Returns the center of a scan that is far from the origin, and otherwise the origin itself. Differences of coordinates from such a
    /// center are exact, because the numbers differ by a small fraction.
    pub(super) fn new(scan: &Scan) -> Self {
        let points = scan.positions().iter().filter(|point| !point.x.is_nan());
        let (low, high) = bounds(points).unwrap_or_default();
        let center = nalgebra::center(&low, &high).coords;
        let is_far = center.norm() > NEAR * (high - low).norm() && center.norm().is_finite();
        Self(if is_far { center } else { Vector3::zeros() })
    }

    pub(super) fn localize(self, point: &Point3<f64>) -> Point3<f64> {
        point - self.0
    }

    pub(super) fn distance(self, point: &Point3<f64>) -> f64 {
        (point.coords - self.0).norm()
    }

    /// Converts a motion of points to the same motion in local coordinates.
    pub(super) fn localize_motion(self, motion: &Isometry3<f64>) -> Isometry3<f64> {
        Translation3::from(-self.0) * motion * Translation3::from(self.0)
    }

    /// Converts a motion in local coordinates to the motion of the points themselves.
    pub(super) fn globalize_motion(self, motion: &Isometry3<f64>) -> Isometry3<f64> {
        Translation3::from(self.0) * motion * Translation3::from(-self.0)
    }
}
