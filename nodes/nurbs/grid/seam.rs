//! The step between a surface and the scan at the border of a region.

use maquette_value::Region;
use nalgebra::Point3;

/// The step that a blend leaves between the redesigned surface and the scan at the border of the region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seam {
    /// The largest displacement in mm of a cell of the region that is next to an outside cell.
    pub step: f64,
    /// The median distance in mm between the points of neighboring cells outside of the region; infinite if there are no such cells.
    pub spacing: f64,
}

/// Minimum visible step, in units of the cell spacing; the roughness of the scan hides smaller steps.
const MIN_VISIBLE_STEP: f64 = 3.0;

impl Seam {
    /// Returns true if the step is greater than `MIN_VISIBLE_STEP` (three) times the spacing of the cells, so that it can be seen.
    pub fn is_visible(&self) -> bool {
        self.step > MIN_VISIBLE_STEP * self.spacing
    }
}

/// Measures the seam that a blend leaves at the border of `region`. `before` and `points` are the points of all cells before and after the
/// blend, which differ only inside the region. The point of an invalid cell is NaN.
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
    fn is_outside(cell: usize, inside: &[u8], before: &[Point3<f64>]) -> bool {
        inside[cell] == 0 && valid(cell, before)
    }
    let mut spacings: Vec<f64> = (0..inside.len())
        .filter(|cell| {
            (cell + 1) % width != 0
                && is_outside(*cell, &inside, before)
                && is_outside(cell + 1, &inside, before)
        })
        .map(|cell| (before[cell + 1] - before[cell]).norm())
        .collect();
    let down = (width..inside.len()).filter(|&cell| {
        is_outside(cell, &inside, before) && is_outside(cell - width, &inside, before)
    });
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
        fn seam_after(at: usize, by: f64, square: &Region, before: &[Point3<f64>]) -> Seam {
            let mut points = before.to_vec();
            points[at].z += by;
            seam(square, before, &points)
        }
        assert_eq!(seam_after(4 * 9 + 4, 50.0, &square, before), Seam { step: 0.0, spacing: 1.0 });
        assert_eq!(seam_after(2 * 9 + 4, 2.0, &square, before), Seam { step: 2.0, spacing: 1.0 });
        assert!(
            !seam_after(2 * 9 + 4, 2.9, &square, before).is_visible()
                && seam_after(2 * 9 + 4, 3.1, &square, before).is_visible()
        );
        let whole = region(&range, |_, _| true);
        assert_eq!(seam(&whole, before, before), Seam { step: 0.0, spacing: f64::INFINITY });
    }
}
