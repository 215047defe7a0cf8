//! The size of a set of points, and the distance of a curve or surface from them.

use nalgebra::Point3;

/// Describes a curve or surface that leaves the neighborhood of its points: its distance from them, and the size of the neighborhood.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stray {
    /// The largest distance of a sampled curve or surface point from the bounding box of the points, in mm; infinite if samples overflow.
    pub(crate) distance: f64,
    /// The diagonal of the points' bounding box, in mm.
    pub(crate) diagonal: f64,
}

/// Checks that the curve or surface with the control points `control` stays near `points`: no sample may be farther from their bounding box
/// than the diagonal of the box. Returns `None` if the check succeeds. `sample` returns points of the curve or surface, or `None` on
/// overflow.
///
/// The distance of the control points alone is not a criterion. If data alternate between high and low, the control points of a cubic curve
/// alternate three times as much, those of a bicubic surface nine times, and more at a border. The curve or surface nevertheless stays near
/// the data. Conversely, a curve or surface is inside the convex hull of its control points, so it need not be sampled if the control
/// points are near the data.
pub(crate) fn stray(
    control: &[Point3<f64>],
    points: &[Point3<f64>],
    sample: impl FnOnce(&[Point3<f64>]) -> Option<Vec<Point3<f64>>>,
) -> Option<Stray> {
    let (low, high) = bounds(points)?;
    let diagonal = (high - low).norm();
    fn is_near(distance: f64, diagonal: f64) -> bool {
        distance <= diagonal
    }
    if control
        .iter()
        .zip(points)
        .all(|(control, point)| is_near((control - point).norm(), diagonal))
    {
        return None;
    }
    let samples = sample(control);
    let distance = samples.map_or(f64::INFINITY, |samples| {
        samples
            .iter()
            .map(|sample| {
                let distance = (sample - sample.sup(&low).inf(&high)).norm();
                if distance.is_finite() { distance } else { f64::INFINITY }
            })
            .fold(0.0, f64::max)
    });
    (!is_near(distance, diagonal)).then_some(Stray { distance, diagonal })
}

/// Returns the maximum distance from the points, in mm, for a tolerance relative to their diagonal. The distance is not below the rounding
/// errors of an evaluation: 16 units in the last place of the sum of the diagonal and the largest coordinate.
pub(crate) fn absolute_tolerance(tolerance: f64, points: &[Point3<f64>]) -> f64 {
    let diagonal = diagonal(points);
    let largest = points.iter().map(|point| point.coords.amax()).fold(0.0, f64::max);
    (tolerance * diagonal).max(16.0 * f64::EPSILON * (diagonal + largest))
}

/// Returns the largest distance of a control point from the bounding box of the given points, relative to the diagonal of the box; 0 if the
/// box is a single point.
pub(crate) fn relative_reach(control: &[Point3<f64>], points: &[Point3<f64>]) -> f64 {
    let Some((low, high)) = bounds(points).filter(|(low, high)| low != high) else { return 0.0 };
    let distances = control.iter().map(|control| (control - control.sup(&low).inf(&high)).norm());
    distances.fold(0.0, f64::max) / (high - low).norm()
}

/// Returns the diagonal of the bounding box of some points.
pub(crate) fn diagonal(points: &[Point3<f64>]) -> f64 {
    bounds(points).map_or(0.0, |(low, high)| (high - low).norm())
}

/// Returns the lowest and the highest corner of the bounding box of some points; `None` if there are no points.
fn bounds(points: &[Point3<f64>]) -> Option<(Point3<f64>, Point3<f64>)> {
    let first = points.first()?;
    Some(points.iter().fold((*first, *first), |(low, high), p| (low.inf(p), high.sup(p))))
}

#[cfg(test)]
mod tests {
    use super::*;

    const POINTS: [Point3<f64>; 2] = [Point3::new(0.0, 0.0, 0.0), Point3::new(3.0, 4.0, 0.0)];

    #[test]
    fn the_stray_distance_depends_on_samples_and_not_on_control_points() {
        let far = [Point3::new(0.0, 0.0, 90.0), Point3::new(3.0, 4.0, -90.0)];
        fn check_distance(z: f64, far: &[Point3<f64>; 2]) -> Option<Stray> {
            stray(far, &POINTS, |_| Some(vec![Point3::new(1.0, 1.0, z)]))
        }
        assert_eq!(check_distance(5.0, &far), None);
        assert_eq!(check_distance(6.0, &far), Some(Stray { distance: 6.0, diagonal: 5.0 }));
        for overflow in [
            check_distance(f64::NAN, &far),
            check_distance(f64::INFINITY, &far),
            stray(&far, &POINTS, |_| None),
        ] {
            assert_eq!(overflow, Some(Stray { distance: f64::INFINITY, diagonal: 5.0 }));
        }
        let near = stray(&POINTS, &POINTS, |_| panic!("near control points need no samples"));
        assert_eq!(near, None);
    }
}
