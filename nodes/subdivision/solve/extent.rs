//! How far points are from each other.

use nalgebra::Point3;

/// Whether a control point is farther from its point than the points are from each other.
pub(crate) fn is_far(control: &[Point3<f64>], points: &[Point3<f64>]) -> bool {
    let size = diagonal(points);
    control.iter().zip(points).any(|(control, point)| (control - point).norm() > size)
}

/// The diagonal of the box around some points.
pub(crate) fn diagonal(points: &[Point3<f64>]) -> f64 {
    let Some(first) = points.first() else { return 0.0 };
    let (low, high) =
        points.iter().fold((*first, *first), |(low, high), p| (low.inf(p), high.sup(p)));
    (high - low).norm()
}
