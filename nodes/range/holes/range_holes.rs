//! Finds and fills the cells of a region that have no measured point.

use maquette_base::linear::laplace::solve;
use maquette_image::{Connectivity, label};
use maquette_node::{Error, Progress};
use maquette_value::{Mask, RangeImage};
use nalgebra::Point3;

use super::shadows::{MAX_SHADOW_CELLS, shadows};
use crate::grid::joins::{JUMP, longest_edge};

/// Returns the cells of `region` that have a point or will get one. With `fill`, a component of invalid cells gets points if it is
/// surrounded by cells of the region. An invalid cell also gets a point if it is in a small shadow (cells without a point that the scan
/// surrounds).
pub(crate) fn usable_cells(region: &Mask, range: &RangeImage, fill: bool) -> Mask {
    let (width, height) = (region.width(), region.height());
    fn mask(pixels: Vec<u8>, width: usize, height: usize) -> Mask {
        Mask::new(width, height, pixels).expect("one entry per cell")
    }
    fn valid(cell: usize, range: &RangeImage) -> bool {
        range.point(cell).is_some()
    }
    let inside = |cell: usize| region.pixels()[cell] == 1;
    let invalid = (0..width * height).map(|cell| u8::from(inside(cell) && !valid(cell, range)));
    let holes = label(&mask(invalid.collect(), width, height), Connectivity::Four);
    let mut closed: Vec<bool> =
        holes.statistics().iter().map(|hole| fill && !hole.touches_border).collect();
    for (cell, &hole) in holes.pixels().iter().enumerate().filter(|(_, hole)| **hole != 0) {
        let hole = &mut closed[hole as usize - 1];
        // A component of invalid cells that still counts as closed does not touch the border of the grid, so each of its cells has four
        // neighbors.
        *hole = *hole && [cell - width, cell - 1, cell + 1, cell + width].into_iter().all(inside);
    }
    let mut in_shadow = vec![false; width * height];
    let small = shadows(width, height, range.points())
        .into_iter()
        .filter(|it| it.len() <= MAX_SHADOW_CELLS);
    small.filter(|_| fill).flatten().for_each(|cell| in_shadow[cell as usize] = true);
    let usable = (0..width * height).map(|cell| match holes.pixels()[cell] {
        0 => inside(cell),
        hole => closed[hole as usize - 1] || in_shadow[cell],
    });
    mask(usable.map(u8::from).collect(), width, height)
}

/// Counts of pairs of adjacent cells along the border between a region and an area that the region surrounds.
#[derive(Clone, Default)]
struct PartBorder {
    /// The number of adjacent pairs of cells, one in the region and one in the surrounded area, whose points are close to each other.
    n_close: usize,
    /// The number of all adjacent pairs of cells, one in the region and one in the surrounded area, including pairs without points.
    n_neighbors: usize,
    /// True if the surrounded area has points.
    has_points: bool,
}

/// Adds to the region the areas that it surrounds if they are on its surface, that is, if most pairs of adjacent cells across the area's
/// border have points close to each other. Areas without a point are shadows on the surface, and are added.
pub(crate) fn with_enclosed(region: &Mask, range: &RangeImage) -> Mask {
    let (width, height) = (region.width(), region.height());
    let rest = region.pixels().iter().map(|&inside| 1 - inside).collect();
    let rest =
        label(&Mask::new(width, height, rest).expect("one entry per cell"), Connectivity::Four);
    let longest = longest_edge(range, JUMP);
    let mut borders = vec![PartBorder::default(); rest.statistics().len()];
    for (cell, &part) in rest.pixels().iter().enumerate().filter(|(_, part)| **part != 0) {
        let part = part as usize - 1;
        if rest.statistics()[part].touches_border {
            continue;
        }
        let border = &mut borders[part];
        let point = range.point(cell);
        border.has_points |= point.is_some();
        for other in [cell - width, cell - 1, cell + 1, cell + width] {
            if rest.pixels()[other] == 0 {
                let points = point.zip(range.point(other));
                border.n_close +=
                    usize::from(points.is_some_and(|(a, b)| (a - b).norm() <= longest));
                border.n_neighbors += 1;
            }
        }
    }
    let is_taken: Vec<bool> = (rest.statistics().iter().zip(borders))
        .map(|(part, border)| {
            !part.touches_border && (!border.has_points || 2 * border.n_close > border.n_neighbors)
        })
        .collect();
    let pixels = rest.pixels().iter().map(|&part| part == 0 || is_taken[part as usize - 1]);
    Mask::from_bools(width, height, pixels.collect::<Vec<bool>>()).expect("one entry per cell")
}

/// Computes the points that are NaN from the other points by Laplace's equation, coordinate by coordinate. `low` and `high`, both
/// inclusive, are the bounding box of `cells` in a grid of the given width.
///
/// Returns an error if the equation cannot be solved, which happens only for points that are extremely far away.
pub(crate) fn fill_points(
    [low, high]: [[usize; 2]; 2],
    width: usize,
    cells: &[u32],
    points: &mut [Point3<f64>],
    progress: &Progress<'_>,
) -> Result<(), Error> {
    let [columns, rows] = [0, 1].map(|axis| high[axis] + 1 - low[axis]);
    let indices: Vec<usize> = cells
        .iter()
        .map(|&cell| cell as usize)
        .map(|cell| (cell / width - low[1]) * columns + cell % width - low[0])
        .collect();
    let mut free = vec![0; columns * rows];
    for (&index, _) in indices.iter().zip(&*points).filter(|(_, point)| point.x.is_nan()) {
        free[index] = 1;
    }
    for axis in 0..3 {
        let mut values = vec![f64::NAN; columns * rows];
        for (&index, point) in indices.iter().zip(&*points) {
            values[index] = point[axis];
        }
        solve(columns, rows, &free, 0.0, &mut values, progress)?;
        for (&index, point) in indices.iter().zip(&mut *points) {
            point[axis] = values[index];
        }
    }
    Ok(())
}
