//! Replaces some points of a range image.

use std::ops::Range;

use nalgebra::Point3;

use super::{RangeImage, without_half_points};

impl RangeImage {
    /// Replaces the points in some rows of cells. `points` holds the points of all these rows, one row after the other. A point that is not
    /// finite makes its cell invalid. Only the blocks of the column around these rows are hashed again.
    ///
    /// # Panics
    /// If a row is out of bounds, rows overlap or are not in ascending order, or `points` has the wrong length.
    #[must_use]
    pub fn with_moved(&self, rows: &[Range<u32>], mut points: Vec<Point3<f64>>) -> Self {
        without_half_points(&mut points);
        Self { points: self.points.with_rows(rows, &points), seam: None, ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hash_of;

    #[test]
    fn a_grid_with_moved_cells_equals_a_new_grid() {
        let range = RangeImage::new(3, 1, vec![Point3::new(0., 0., 5.); 3]).unwrap();
        let range = range.with_filled(vec![0, 0, 1]).unwrap();
        let points = vec![Point3::new(0., 0., 6.), Point3::new(0., f64::INFINITY, 6.)];
        let moved = range.with_moved(&[0..1, 2..3], points.clone());
        assert_eq!((moved.point(0), moved.point(2)), (Some(points[0]), None));
        let all = vec![points[0], range.points()[1], points[1]];
        assert_eq!(hash_of(&moved), hash_of(&range.with_points(all).unwrap()));
    }
}
