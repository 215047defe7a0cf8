//! Building blocks of hostile values, which are at the edge of what their types allow: see [`Value::hostile`](super::Value::hostile).

use nalgebra::Point3;

/// Sizes that loops forget: nothing, one pixel, one row, one column.
pub(super) const SIZES: [[usize; 2]; 5] = [[0, 0], [1, 1], [7, 1], [1, 7], [3, 0]];

/// Points that coincide, lie on a line, are enormous, lie behind the sensor or in it, or are missing.
pub(super) fn clouds(count: usize) -> Vec<Vec<Point3<f64>>> {
    fn of(point: fn(f64) -> Point3<f64>, count: usize) -> Vec<Point3<f64>> {
        (0..count).map(|k| point(k as f64)).collect()
    }
    vec![
        of(|_| Point3::new(1.0, 2.0, 3.0), count),
        of(|k| Point3::new(k, 0.0, 100.0), count),
        of(|k| Point3::new(1e300 * (k - 1.0), 1e300, 1e300), count),
        of(|k| Point3::new(k, k * k, -5.0), count),
        of(|_| Point3::origin(), count),
        of(|k| Point3::new(k * 1e-300, 1e-300, 1e-300), count),
        of(|_| Point3::new(f64::NAN, 0.0, 0.0), count),
        of(
            |k| {
                if k % 2.0 == 0.0 {
                    Point3::new(k, 1.0, 50.0)
                } else {
                    Point3::new(f64::NAN, 0.0, 0.0)
                }
            },
            count,
        ),
    ]
}
