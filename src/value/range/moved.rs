//! A range image of which some cells have moved.

use std::ops::Range;

use nalgebra::Point3;

use super::{RangeImage, without_half_points};

impl RangeImage {
    /// The same grid with other points in some rows of its cells: those of all rows, one row after the other. As anywhere, a point that is
    /// not finite makes its cell invalid. Only what is around these rows is hashed again.
    ///
    /// # Panics
    /// If there are no such rows, they are not in order and apart from each other, or have more or fewer cells.
    #[must_use]
    pub fn with_moved(&self, rows: &[Range<u32>], mut points: Vec<Point3<f64>>) -> Self {
        without_half_points(&mut points);
        Self { points: self.points.with_rows(rows, &points), ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hash_of;

    #[test]
    fn moved_cells_are_as_they_would_be_in_a_new_grid() {
        let range = RangeImage::new(3, 1, vec![Point3::new(0., 0., 5.); 3]).unwrap();
        let range = range.with_filled(vec![0, 0, 1]).unwrap();
        let points = vec![Point3::new(0., 0., 6.), Point3::new(0., f64::INFINITY, 6.)];
        let moved = range.with_moved(&[0..1, 2..3], points.clone());
        assert_eq!((moved.point(0), moved.point(2)), (Some(points[0]), None));
        let all = vec![points[0], range.points()[1], points[1]];
        assert_eq!(hash_of(&moved), hash_of(&range.with_points(all).unwrap()));
    }
}
