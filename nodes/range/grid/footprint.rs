//! Finds the cells of a range grid that a labelled part of the picture covers.
//!
//! The footprint of a cell is a rectangle in the picture, given by the registration. It extends half a cell to each side of the cell's
//! center. A pixel counts by the fraction of the footprint that it fills.

use maquette_value::parallel::*;
use maquette_value::{Labels, Mask, RangeImage};

/// The footprint of a cell (its rectangle in the picture) along one axis of the picture.
struct Footprint {
    /// The first pixel that the footprint overlaps.
    first: usize,
    /// For each overlapped pixel, the length of the overlap in pixels, from 0 to 1.
    weights: Vec<f64>,
}

/// Minimum fraction of a cell's footprint that must be covered: one half, minus a tolerance for rounding.
pub(super) const HALF: f64 = 0.5 - 1e-9;

/// Returns the cells of which at least half of the footprint is covered, given the covered fraction of each.
pub(crate) fn covered_cells(width: usize, height: usize, fractions: &[f64]) -> Mask {
    let cells = fractions.iter().map(|&fraction| u8::from(fraction >= HALF)).collect();
    Mask::new(width, height, cells).expect("one entry per cell")
}

/// Returns for each cell the fraction of the footprint that the label `number` covers. Cells beyond the picture are not covered. The labels
/// must be those of the range image's picture.
pub(crate) fn covered_fractions(labels: &Labels, number: u32, range: &RangeImage) -> Vec<f64> {
    let (width, height, map) = (range.width(), range.height(), range.registration());
    let [columns, rows] = [(0, width), (1, height)].map(|(axis, cells)| {
        let (scale, offset) = (map.scale[axis], map.offset[axis]);
        let footprints =
            (0..cells).map(|cell| Footprint::new(cell, scale, offset, map.picture[axis]));
        footprints.collect::<Vec<_>>()
    });
    let part = Component::new(labels, number);
    let mut cells = vec![0.0; width * height];
    let strips = cells.par_chunks_mut(width.max(1)).zip(&rows).with_min_len(16);
    strips.filter(|(_, row)| row.meets(part.low[1], part.high[1])).for_each(|(cells, row)| {
        for (cell, column) in cells.iter_mut().zip(&columns) {
            let overlaps = column.meets(part.low[0], part.high[0]);
            // Without an overlap, the fraction would be NaN.
            *cell = if overlaps { covered_fraction(&part, column, row) } else { 0.0 };
        }
    });
    cells
}

/// The pixels of a labelled part of the picture, within the part's bounding box.
struct Component {
    pixels: Mask,
    low: [usize; 2],
    high: [usize; 2],
}

impl Component {
    fn new(labels: &Labels, number: u32) -> Self {
        let part = &labels.statistics()[number as usize - 1];
        Self { pixels: labels.component(number), low: part.low, high: part.high }
    }

    fn contains(&self, [column, row]: [usize; 2]) -> bool {
        let inside = column.checked_sub(self.low[0]).zip(row.checked_sub(self.low[1]));
        inside.is_some_and(|(column, row)| self.pixels.contains([column, row]))
    }
}

/// Returns the fraction of a cell's footprint in the picture that belongs to the labelled part.
fn covered_fraction(part: &Component, column: &Footprint, row: &Footprint) -> f64 {
    let (mut inside, mut total) = (0.0, 0.0);
    for (y, vertical) in (row.first..).zip(&row.weights) {
        for (x, horizontal) in (column.first..).zip(&column.weights) {
            let weight = vertical * horizontal;
            total += weight;
            inside += if part.contains([x, y]) { weight } else { 0.0 };
        }
    }
    inside / total
}

impl Footprint {
    /// Returns the footprint of a cell along an axis on which the picture has `pixels` pixels.
    fn new(cell: usize, scale: f64, offset: f64, pixels: usize) -> Self {
        // Use coordinates in which pixel k extends from k to k + 1.
        let [low, high] = [-0.5, 0.5].map(|side| scale * (cell as f64 + side) + offset + 0.5);
        // Unlike `max` and `min`, `clamp` keeps a NaN. `max` and `min` would replace the NaN by a bound, so that the cell would cover all
        // pixels.
        let [low, high] = [low, high].map(|end| end.clamp(0.0, pixels as f64));
        let (first, last) =
            if low < high { (low.floor() as usize, high.ceil() as usize) } else { (0, 0) };
        Self {
            first,
            weights: (first..last)
                .map(|pixel: usize| high.min((pixel + 1) as f64) - low.max(pixel as f64))
                .collect(),
        }
    }

    /// Returns true if the footprint overlaps the pixels from `low` to `high`.
    fn meets(&self, low: usize, high: usize) -> bool {
        self.first <= high && low < self.first + self.weights.len()
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::Registration;
    use nalgebra::Point3;

    use super::*;

    fn draw_covered(rows: &[&str], grid: [usize; 2], scale: f64, offset: f64) -> String {
        let mask = Mask::from_rows(rows);
        let picture = [mask.width(), mask.height()];
        let pixels = mask.pixels().iter().map(|&pixel| u32::from(pixel)).collect();
        let labels = Labels::new(picture[0], picture[1], pixels).unwrap();
        let map = Registration { scale: [scale; 2], offset: [offset; 2], picture };
        let points = vec![Point3::origin(); grid[0] * grid[1]];
        let range = RangeImage::new(grid[0], grid[1], points).unwrap().with_registration(map);
        covered_cells(grid[0], grid[1], &covered_fractions(&labels, 1, &range)).draw()
    }

    #[test]
    fn two_of_four_pixels_are_enough_and_one_is_not() {
        assert_eq!(draw_covered(&["##.#.#", "..#..."], [3, 1], 2.0, 0.5), "##.\n");
    }

    #[test]
    fn between_pixels_the_middle_counts_half_and_its_neighbors_a_quarter() {
        // The second cell covers pixels 1 to 3 in columns and rows, with the weights 1/4, 1/2 and 1/4.
        fn middle(rows: &[&str]) -> bool {
            &draw_covered(rows, [2, 2], 2.0, 0.0)[4..5] == "#"
        }
        assert!(middle(&[".....", "..#..", "..#..", "..#..", "....."]));
        assert!(!middle(&[".....", "..#..", "..#..", ".....", "....."]));
        assert!(middle(&[".....", "..#..", ".##..", ".....", "....."]));
        assert!(middle(&[".....", ".....", ".###.", ".....", "....."]));
        assert!(!middle(&[".....", ".#.#.", "..#..", ".....", "....."]));
        assert!(middle(&[".....", ".#.#.", "..#..", ".#.#.", "....."]));
        assert!(!middle(&[".....", "#.#.#", "#...#", "#.#.#", "#####"]));
    }

    #[test]
    fn a_grid_finer_than_the_picture_covers_parts_of_pixels() {
        assert_eq!(draw_covered(&["#.", ".."], [4, 4], 0.5, -0.25), "##..\n##..\n....\n....\n");
        assert_eq!(draw_covered(&["#."], [3, 1], 2.0 / 3.0, -1.0 / 6.0), "##.\n");
    }

    #[test]
    fn a_cell_outside_the_picture_is_outside() {
        assert_eq!(draw_covered(&["##"], [4, 3], 1.0, -1.0), "....\n.##.\n....\n");
        assert_eq!(draw_covered(&["##"], [2, 1], f64::NAN, 0.0), "..\n");
        assert_eq!(draw_covered(&["##"], [2, 1], 0.0, 0.0), "..\n");
    }
}
