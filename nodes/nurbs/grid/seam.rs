//! How far a surface misses the scan at the border of its region.

use maquette_value::Region;
use nalgebra::Point3;

/// The seam that a blend leaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seam {
    /// How far a cell of the region next to a cell outside was moved, at most; in mm.
    pub step: f64,
    /// Median distance of neighboring cells outside of the region; in mm. Infinite if there are none.
    pub spacing: f64,
}

/// A step of so many spacings shows in a picture: less is lost in the scan's own roughness.
const VISIBLE: f64 = 3.0;

impl Seam {
    /// Whether the step is more than three spacings.
    pub fn is_visible(&self) -> bool {
        self.step > VISIBLE * self.spacing
    }
}

/// The seam between `points`, which were changed inside the region only, and the points `before`; NaN where a cell has none.
pub(crate) fn seam(region: &Region, before: &[Point3<f64>], points: &[Point3<f64>]) -> Seam {
    let (width, height) = (region.width(), region.height());
    let inside = region.grid();
    fn valid(cell: usize, before: &[Point3<f64>]) -> bool {
        !before[cell].x.is_nan()
    }
    let mut step = 0.0f64;
    for &cell in region.cells() {
        let cell = cell as usize;
        let (row, column) = (cell / width, cell % width);
        let near = [
            (row > 0).then(|| cell - width),
            (column > 0).then(|| cell - 1),
            (column + 1 < width).then_some(cell + 1),
            (row + 1 < height).then_some(cell + width),
        ];
        let at_border =
            near.into_iter().flatten().any(|near| inside[near] == 0 && valid(near, before));
        if at_border && valid(cell, before) {
            step = step.max((points[cell] - before[cell]).norm());
        }
    }
    fn outside(cell: usize, inside: &[u8], before: &[Point3<f64>]) -> bool {
        inside[cell] == 0 && valid(cell, before)
    }
    let mut spacings: Vec<f64> = (0..inside.len())
        .filter(|cell| {
            (cell + 1) % width != 0
                && outside(*cell, &inside, before)
                && outside(cell + 1, &inside, before)
        })
        .map(|cell| (before[cell + 1] - before[cell]).norm())
        .collect();
    let down = (width..inside.len())
        .filter(|&cell| outside(cell, &inside, before) && outside(cell - width, &inside, before));
    spacings.extend(down.map(|cell| (before[cell] - before[cell - width]).norm()));
    let middle = spacings.len() / 2;
    let spacing = match spacings.is_empty() {
        true => f64::INFINITY,
        false => *spacings.select_nth_unstable_by(middle, f64::total_cmp).1,
    };
    Seam { step, spacing }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control_net::tests::{range, region};

    #[test]
    fn only_cells_at_the_border_make_a_seam() {
        let range = range(9, 8, |_, _| 5.0);
        let square = region(&range, |x, y| (2..7).contains(&x) && (2..7).contains(&y));
        let before = range.points();
        fn moved(at: usize, by: f64, square: &Region, before: &[Point3<f64>]) -> Seam {
            let mut points = before.to_vec();
            points[at].z += by;
            seam(square, before, &points)
        }
        assert_eq!(moved(4 * 9 + 4, 50.0, &square, before), Seam { step: 0.0, spacing: 1.0 });
        assert_eq!(moved(2 * 9 + 4, 2.0, &square, before), Seam { step: 2.0, spacing: 1.0 });
        assert!(
            !moved(2 * 9 + 4, 2.9, &square, before).is_visible()
                && moved(2 * 9 + 4, 3.1, &square, before).is_visible()
        );
        let whole = region(&range, |_, _| true);
        assert_eq!(seam(&whole, before, before), Seam { step: 0.0, spacing: f64::INFINITY });
    }
}
