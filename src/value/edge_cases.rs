//! Building blocks of edge cases, values at the limits of what their types allow: see [`Value::edge_cases`](super::Value::edge_cases).

use nalgebra::Point3;

/// Picture sizes for which loops often have bugs: no pixel, one pixel, one row, one column.
pub(super) const SIZES: [[usize; 2]; 5] = [[0, 0], [1, 1], [7, 1], [1, 7], [3, 0]];

/// Pictures of all [`SIZES`], each with equal pixels.
pub(super) fn uniform_pictures<T, P: Clone, E>(
    pixels: &[P],
    new: impl Fn(usize, usize, Vec<P>) -> Result<T, E>,
) -> Vec<T> {
    let cases = SIZES.into_iter().flat_map(|size| pixels.iter().map(move |pixel| (size, pixel)));
    cases.flat_map(|([w, h], pixel)| new(w, h, vec![pixel.clone(); w * h])).collect()
}

/// Sets of points: coincident, collinear, enormous, tiny, behind the sensor, at the sensor's position, and missing points.
pub(super) fn point_sets(count: usize) -> Vec<Vec<Point3<f64>>> {
    fn points(point: fn(f64) -> Point3<f64>, count: usize) -> Vec<Point3<f64>> {
        (0..count).map(|k| point(k as f64)).collect()
    }
    vec![
        points(|_| Point3::new(1.0, 2.0, 3.0), count),
        points(|k| Point3::new(k, 0.0, 100.0), count),
        points(|k| Point3::new(1e300 * (k - 1.0), 1e300, 1e300), count),
        points(|k| Point3::new(k, k * k, -5.0), count),
        points(|_| Point3::origin(), count),
        points(|k| Point3::new(k * 1e-300, 1e-300, 1e-300), count),
        points(|_| Point3::new(f64::NAN, 0.0, 0.0), count),
        points(
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
