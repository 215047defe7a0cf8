//! Which cells of a range grid a labelled part of the picture covers.
//!
//! A cell sees a rectangle of the picture: half a cell to each side of its center, by the registration. A pixel counts by the
//! share of that rectangle that it fills.

use maquette_value::parallel::*;
use maquette_value::{Labels, Mask, RangeImage};

/// What a cell sees along one axis of the picture.
struct Footprint {
    /// The first pixel.
    first: usize,
    /// How much of each pixel, from 0 to 1.
    weights: Vec<f64>,
}

/// How far below one half a share may be by rounding.
const HALF: f64 = 0.5 - 1e-9;

/// The cells of which at least half of what they see of the picture has the label `number`. A cell that looks past the picture is
/// outside. The labels must be those of the range image's picture.
pub(crate) fn covered_cells(labels: &Labels, number: u32, range: &RangeImage) -> Mask {
    let (width, height, map) = (range.width(), range.height(), range.registration());
    let [columns, rows] = [(0, width), (1, height)].map(|(axis, cells)| {
        let (scale, offset) = (map.scale[axis], map.offset[axis]);
        Vec::from_iter(
            (0..cells).map(|cell| Footprint::new(cell, scale, offset, map.picture[axis])),
        )
    });
    let part = Component::new(labels, number);
    let mut cells = vec![0; width * height];
    let strips = cells.par_chunks_mut(width.max(1)).zip(&rows).with_min_len(16);
    strips.filter(|(_, row)| row.meets(part.low[1], part.high[1])).for_each(|(cells, row)| {
        for (cell, column) in cells.iter_mut().zip(&columns) {
            let near = column.meets(part.low[0], part.high[0]);
            *cell = u8::from(near && share(&part, column, row) >= HALF);
        }
    });
    Mask::new(width, height, cells).expect("one entry per cell")
}

/// The pixels of a labelled part, within the box around them.
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

/// The share of what a cell sees that belongs to the part.
fn share(part: &Component, column: &Footprint, row: &Footprint) -> f64 {
    let (mut inside, mut seen) = (0.0, 0.0);
    for (y, vertical) in (row.first..).zip(&row.weights) {
        for (x, horizontal) in (column.first..).zip(&column.weights) {
            let weight = vertical * horizontal;
            seen += weight;
            inside += if part.contains([x, y]) { weight } else { 0.0 };
        }
    }
    inside / seen
}

impl Footprint {
    /// What the cell sees along an axis with this many pixels.
    fn new(cell: usize, scale: f64, offset: f64, pixels: usize) -> Self {
        // Pixel k reaches from k to k + 1 here.
        let [low, high] = [-0.5, 0.5].map(|side| scale * (cell as f64 + side) + offset + 0.5);
        // Not `max` and `min`: these would make a bound of a NaN, and the cell see everything.
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

    /// Whether it sees a pixel from `low` to `high`.
    fn meets(&self, low: usize, high: usize) -> bool {
        self.first <= high && low < self.first + self.weights.len()
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::Registration;
    use nalgebra::Point3;

    use super::*;

    fn covered(rows: &[&str], grid: [usize; 2], scale: f64, offset: f64) -> String {
        let mask = Mask::drawn(rows);
        let picture = [mask.width(), mask.height()];
        let pixels = mask.pixels().iter().map(|&pixel| u32::from(pixel)).collect();
        let labels = Labels::new(picture[0], picture[1], pixels).unwrap();
        let map = Registration { scale: [scale; 2], offset: [offset; 2], picture };
        let points = vec![Point3::origin(); grid[0] * grid[1]];
        let range = RangeImage::new(grid[0], grid[1], points).unwrap().with_registration(map);
        covered_cells(&labels, 1, &range).draw()
    }

    #[test]
    fn two_of_four_pixels_are_enough_and_one_is_not() {
        assert_eq!(covered(&["##.#.#", "..#..."], [3, 1], 2.0, 0.5), "##.\n");
    }

    #[test]
    fn between_pixels_the_middle_counts_half_and_its_neighbors_a_quarter() {
        // The second cell sees pixels 1 to 3, in columns and rows, with the weights 1/4, 1/2, 1/4.
        fn middle(rows: &[&str]) -> bool {
            &covered(rows, [2, 2], 2.0, 0.0)[4..5] == "#"
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
    fn a_grid_finer_than_the_picture_sees_parts_of_pixels() {
        assert_eq!(covered(&["#.", ".."], [4, 4], 0.5, -0.25), "##..\n##..\n....\n....\n");
        assert_eq!(covered(&["#."], [3, 1], 2.0 / 3.0, -1.0 / 6.0), "##.\n");
    }

    #[test]
    fn a_cell_that_looks_past_the_picture_is_outside() {
        assert_eq!(covered(&["##"], [4, 3], 1.0, -1.0), "....\n.##.\n....\n");
        assert_eq!(covered(&["##"], [2, 1], f64::NAN, 0.0), "..\n");
        assert_eq!(covered(&["##"], [2, 1], 0.0, 0.0), "..\n");
    }
}
