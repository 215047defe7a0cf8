//! Distances of a region's cells from its border.

use maquette_value::Region;

/// Returns, for each cell of the region, the distance from the nearest cell outside of the region, in cells between their centers.
/// Distances above `most` are returned as infinity. The border of the grid is not a border of the region.
///
/// Two exact passes, first along the columns, then across the columns within reach: Saito and Toriwaki, "New algorithms for Euclidean
/// distance transformation of an n-dimensional digitized picture" (1994).
pub(crate) fn from_border(region: &Region, most: f64) -> Vec<f64> {
    let (width, height) = (region.width(), region.height());
    let mut steps: Vec<u32> =
        region.grid().into_iter().map(|inside: u8| if inside == 1 { FAR } else { 0 }).collect();
    for cell in width..width * height {
        steps[cell] = steps[cell].min(steps[cell - width].saturating_add(1));
    }
    for cell in (0..width * height - width).rev() {
        steps[cell] = steps[cell].min(steps[cell + width].saturating_add(1));
    }
    let reach = most.max(0.0).ceil() as usize;
    region
        .cells()
        .iter()
        .map(|&cell| {
            let (row, column) = (cell as usize / width, cell as usize % width);
            let columns =
                column.saturating_sub(reach)..=column.saturating_add(reach).min(width - 1);
            let least_sq = columns
                .map(|other| (steps[row * width + other], other.abs_diff(column) as f64))
                .filter(|(down, _)| *down < FAR)
                .map(|(down, aside)| f64::from(down) * f64::from(down) + aside * aside)
                .fold(f64::INFINITY, f64::min);
            if least_sq <= most * most { least_sq.sqrt() } else { f64::INFINITY }
        })
        .collect()
}

/// Stands for the number of steps from a cell to the nearest outside cell of its column if the column has no outside cell.
const FAR: u32 = u32::MAX;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control_net::tests::{range, region};

    #[test]
    fn distances_are_those_to_the_nearest_cell_outside() {
        let range = range(17, 13, |_, _| 0.0);
        let scattered = region(&range, |x: usize, y: usize| {
            !(x * 7 + y * 5).is_multiple_of(11) && (x, y) != (8, 6)
        });
        let wide = region(&range, |x, y| (2..15).contains(&x) && (1..12).contains(&y));
        for region in [scattered, wide] {
            for (cell, distance) in region.cells().iter().zip(from_border(&region, 4.0)) {
                let (x, y) = ((cell % 17) as usize, (cell / 17) as usize);
                let outside = (0..17 * 13).filter(|&other| region.find(other).is_none());
                let exact = outside
                    .map(|other| {
                        ((other % 17).abs_diff(x).pow(2) + (other / 17).abs_diff(y).pow(2)) as f64
                    })
                    .fold(f64::INFINITY, f64::min)
                    .sqrt();
                assert_eq!(distance, if exact <= 4.0 { exact } else { f64::INFINITY });
            }
        }
    }

    #[test]
    fn a_region_of_the_whole_grid_has_no_border() {
        let whole = region(&range(3, 2, |_, _| 0.0), |_, _| true);
        assert_eq!(from_border(&whole, 9.0), [f64::INFINITY; 6]);
    }
}
