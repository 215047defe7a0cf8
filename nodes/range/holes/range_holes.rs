//! Cells of a region for which the scanner has no point.

use maquette_base::linear::laplace::{Unsolved, solve};
use maquette_image::{Connectivity, label};
use maquette_node::Progress;
use maquette_value::{Mask, RangeImage};
use nalgebra::Point3;

use super::shadows::{LARGEST_SHADOW, shadows};
use crate::grid::joins::{JUMP, longest_edge};

/// The cells of `region` that have a point, or will have one: with `fill` the invalid ones whose part lies wholly inside, or in a shadow
/// that the scan surrounds.
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
        // A hole that is still closed does not touch the rim, so that each of its cells has four neighbors.
        *hole = *hole && [cell - width, cell - 1, cell + 1, cell + width].into_iter().all(inside);
    }
    let mut in_shadow = vec![false; width * height];
    let small =
        shadows(width, height, range.points()).into_iter().filter(|it| it.len() <= LARGEST_SHADOW);
    small.filter(|_| fill).flatten().for_each(|cell| in_shadow[cell as usize] = true);
    let usable = |cell: usize| match holes.pixels()[cell] {
        0 => inside(cell),
        hole => closed[hole as usize - 1] || in_shadow[cell],
    };
    mask((0..width * height).map(|cell| u8::from(usable(cell))).collect(), width, height)
}

/// The region with those parts of the rest that it surrounds and that lie on its surface: along most of their rim, neighbors on both sides
/// are near each other. Parts without a point are shadows on it.
pub(crate) fn with_enclosed(region: &Mask, range: &RangeImage) -> Mask {
    let (width, height) = (region.width(), region.height());
    let rest = region.pixels().iter().map(|&inside| 1 - inside).collect();
    let rest =
        label(&Mask::new(width, height, rest).expect("one entry per cell"), Connectivity::Four);
    let longest = longest_edge(range, JUMP);
    // Of each part: neighbors in the region that are near, all of them, and whether it has points.
    let mut rims = vec![(0_usize, 0_usize, false); rest.statistics().len()];
    for (cell, &part) in rest.pixels().iter().enumerate().filter(|(_, part)| **part != 0) {
        let part = part as usize - 1;
        if rest.statistics()[part].touches_border {
            continue;
        }
        let (near, all, has_points) = &mut rims[part];
        let here = range.point(cell);
        *has_points |= here.is_some();
        for other in [cell - width, cell - 1, cell + 1, cell + width] {
            if rest.pixels()[other] == 0 {
                let there = here.zip(range.point(other));
                *near += usize::from(there.is_some_and(|(a, b)| (a - b).norm() <= longest));
                *all += 1;
            }
        }
    }
    let is_taken: Vec<bool> = (rest.statistics().iter().zip(rims))
        .map(|(part, (near, all, has_points))| {
            !part.touches_border && (!has_points || 2 * near > all)
        })
        .collect();
    let taken = rest.pixels().iter().map(|&part| part == 0 || is_taken[part as usize - 1]);
    Mask::from_bools(width, height, taken.collect::<Vec<bool>>()).expect("one entry per cell")
}

/// Computes the points that are NaN from the others, inside the box (both corners included) that holds all `cells` of a grid of
/// this width: Laplace's equation, coordinate by coordinate.
///
/// # Errors
/// If the equation is not solved, which points of a sane size never cause.
pub(crate) fn fill_points(
    [low, high]: [[usize; 2]; 2],
    width: usize,
    cells: &[u32],
    points: &mut [Point3<f64>],
    progress: &Progress<'_>,
) -> Result<(), Unsolved> {
    let [columns, rows] = [0, 1].map(|axis| high[axis] + 1 - low[axis]);
    let place =
        |cell: u32| (cell as usize / width - low[1]) * columns + cell as usize % width - low[0];
    let mut free = vec![0; columns * rows];
    for (&cell, _) in cells.iter().zip(&*points).filter(|(_, point)| point.x.is_nan()) {
        free[place(cell)] = 1;
    }
    for axis in 0..3 {
        let mut values = vec![f64::NAN; columns * rows];
        for (&cell, point) in cells.iter().zip(&*points) {
            values[place(cell)] = point[axis];
        }
        solve(columns, rows, &free, 0.0, &mut values, progress)?;
        for (&cell, point) in cells.iter().zip(&mut *points) {
            point[axis] = values[place(cell)];
        }
    }
    Ok(())
}
