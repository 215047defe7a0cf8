//! Finds the outer border and the hole borders of a connected part of a grid.
//!
//! Border following: Suzuki and Abe, "Topological structural analysis of digitized binary images by border following", Computer Vision,
//! Graphics, and Image Processing 30 (1985), algorithm 1. Comments refer to the step numbers of that paper.

use maquette_value::Contour;

/// The eight neighbors of a cell as (column, row) steps, counter-clockwise in the picture (rows run down), beginning on the right.
const AROUND: [(isize, isize); 8] =
    [(1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1)];
const RIGHT: usize = 0;
const LEFT: usize = 4;

/// Returns the borders of the cells whose entry is 1 in a `width` x `height` grid. The outer border comes first. The borders of holes
/// follow in the order in which they are found row by row from the top. A hole is a group of cells with entry 0 that is connected by sides
/// and does not reach the border of the grid. Seen with y up, the outer border is counter-clockwise and the others are clockwise. A cell
/// can occur twice in a border where the part is one cell wide. The contours have no rims; the module `rim` finds those.
///
/// The cells with entry 1 must be connected. Otherwise each component has an outer border, and not only the first border in the result is
/// an outer one.
///
/// # Panics
/// Panics if `inside` does not have `width * height` entries.
pub fn contours(width: usize, height: usize, inside: &[u8]) -> Vec<Contour> {
    assert_eq!(inside.len(), width * height, "one entry per cell");
    let mut borders = Borders::new(width, height, inside);
    let mut contours = Vec::new();
    for row in 0..height {
        for column in 0..width {
            let cell = borders.frame_index(column, row);
            if borders.marks[cell] == 0 {
                continue;
            }
            let (left, right) = (borders.marks[cell - 1], borders.marks[cell + 1]);
            // Step 1 of the paper: find the next border.
            if borders.marks[cell] == 1 && left == 0 {
                contours.push(contour(false, borders.follow(cell, LEFT)));
            } else if borders.marks[cell] >= 1 && right == 0 {
                contours.push(contour(true, borders.follow(cell, RIGHT)));
            }
        }
    }
    contours.sort_by_key(|contour| contour.hole);
    contours
}

fn contour(hole: bool, cells: Vec<u32>) -> Contour {
    Contour { hole, cells, rim: Vec::new() }
}

/// The grid, surrounded by a frame of background cells.
struct Borders {
    width: usize,
    /// For each cell of the grid with its frame: 0 outside the part. Inside it is first 1, later [`VISITED`], or [`VISITED_RIGHT`] if a
    /// border passed the cell with background to the right of the cell.
    marks: Vec<i8>,
    steps: [isize; 8],
}

const VISITED: i8 = 2;
const VISITED_RIGHT: i8 = -2;

impl Borders {
    fn new(width: usize, height: usize, inside: &[u8]) -> Self {
        let wide = width + 2;
        let mut marks = vec![0; wide * (height + 2)];
        for row in 0..height {
            let marks = &mut marks[(row + 1) * wide + 1..][..width];
            marks.iter_mut().zip(&inside[row * width..]).for_each(|(mark, &in_it)| {
                *mark = i8::from(in_it == 1);
            });
        }
        Self { width, marks, steps: AROUND.map(|(x, y)| y * wide as isize + x) }
    }

    fn frame_index(&self, column: usize, row: usize) -> usize {
        (row + 1) * (self.width + 2) + column + 1
    }

    fn cell_index(&self, cell: usize) -> u32 {
        let wide = self.width + 2;
        ((cell / wide - 1) * self.width + cell % wide - 1) as u32
    }

    fn next(&self, cell: usize, direction: usize) -> usize {
        cell.wrapping_add_signed(self.steps[direction])
    }

    /// Follows the border that passes through `start` and has background in the direction `background`: step 3 of the paper.
    fn follow(&mut self, start: usize, background: usize) -> Vec<u32> {
        // Step 3.1: search clockwise from the background for the neighbor that precedes the start on the border.
        let clockwise = (1..8).map(|turn| (background + 8 - turn) % 8);
        let Some(mut from) =
            { clockwise }.find(|direction| self.marks[self.next(start, *direction)] != 0)
        else {
            self.marks[start] = VISITED_RIGHT;
            return vec![self.cell_index(start)];
        };
        let last = self.next(start, from);
        let mut cells = Vec::new();
        let mut cell = start;
        loop {
            cells.push(self.cell_index(cell));
            // Step 3.3: find the next cell, counter-clockwise from the previous one. If there is no other cell around this one, the border
            // returns to the previous cell.
            let mut to = (from + 1) % 8;
            let mut right_is_outside = false;
            while self.marks[self.next(cell, to)] == 0 {
                right_is_outside |= to == RIGHT;
                to = (to + 1) % 8;
            }
            // Step 3.4: mark the cell as visited.
            if right_is_outside {
                self.marks[cell] = VISITED_RIGHT;
            } else if self.marks[cell] == 1 {
                self.marks[cell] = VISITED;
            }
            // Step 3.5: move to the next cell, or stop at the start.
            let next = self.next(cell, to);
            if next == start && cell == last {
                return cells;
            }
            cell = next;
            from = (to + 4) % 8;
        }
    }
}

#[cfg(test)]
mod tests {
    use maquette_image::{Connectivity, label};
    use maquette_value::Mask;
    use proptest::prelude::*;

    use super::*;

    fn cells_of(rows: &[&str]) -> Vec<(bool, Vec<u32>)> {
        let mask = Mask::from_rows(rows);
        let contours = contours(mask.width(), mask.height(), mask.pixels());
        contours.into_iter().map(|contour| (contour.hole, contour.cells)).collect()
    }

    /// Returns twice the area enclosed by a chain of cells, seen with y up; negative if the chain is clockwise.
    fn area(cells: &[u32], width: usize) -> i64 {
        fn position(cell: u32, width: usize) -> (i64, i64) {
            (i64::from(cell) % width as i64, -(i64::from(cell) / width as i64))
        }
        let pairs = cells.iter().zip(cells.iter().cycle().skip(1));
        pairs
            .map(|(&a, &b)| {
                position(a, width).0 * position(b, width).1
                    - position(a, width).1 * position(b, width).0
            })
            .sum()
    }

    #[test]
    fn the_border_of_a_square_runs_counter_clockwise_seen_with_y_up() {
        assert_eq!(cells_of(&["###", "###", "###"]), [(false, vec![0, 3, 6, 7, 8, 5, 2, 1])]);
    }

    #[test]
    fn one_cell_is_its_own_border() {
        assert_eq!(cells_of(&["...", ".#."]), [(false, vec![4])]);
    }

    #[test]
    fn a_line_is_passed_on_both_sides() {
        assert_eq!(cells_of(&["###"]), [(false, vec![0, 1, 2, 1])]);
    }

    #[test]
    fn a_hole_has_a_border_that_runs_clockwise() {
        let contours = cells_of(&["####", "#.##", "####"]);
        assert_eq!(contours.len(), 2);
        assert_eq!(contours[1], (true, vec![4, 1, 6, 9]));
        assert!(area(&contours[0].1, 4) > 0 && area(&contours[1].1, 4) < 0);
    }

    proptest! {
        #[test]
        fn a_part_is_between_its_outer_border_and_those_of_its_holes(
            (width, pixels) in (1usize..20, 1usize..20).prop_flat_map(|(width, height)| {
                (Just(width), prop::collection::vec(prop::bool::weighted(0.65), width * height))
            }),
        ) {
            let height = pixels.len() / width;
            let mask = Mask::new(width, height, pixels.into_iter().map(u8::from).collect()).unwrap();
            let parts = label(&mask, Connectivity::Four);
            prop_assume!(!parts.statistics().is_empty());
            let largest = parts.by_area()[0];
            let inside: Vec<u8> = parts.pixels().iter().map(|&part| u8::from(part == largest)).collect();
            let contours = contours(width, height, &inside);

            // Find the expected holes by labelling the background, surrounded by a frame. The first component contains the frame, the
            // others are the holes.
            let (wide, high) = (width + 2, height + 2);
            let label_background = |pixels: &[u8]| {
                let rest = (0..wide * high).map(|index| {
                    let (column, row) = (index % wide, index / wide);
                    let on_frame = [0, wide - 1].contains(&column) || [0, high - 1].contains(&row);
                    u8::from(on_frame || pixels[(row - 1) * width + column - 1] == 0)
                });
                label(&Mask::new(wide, high, rest.collect()).unwrap(), Connectivity::Four)
            };
            let rest = label_background(&inside);
            prop_assert_eq!(contours.len(), rest.statistics().len());

            for (index, contour) in contours.iter().enumerate() {
                prop_assert_eq!(contour.hole, index > 0);
                let signed_area = area(&contour.cells, width);
                prop_assert_eq!(signed_area < 0, contour.hole);
                let next = contour.cells.iter().cycle().skip(1);
                for (&a, &b) in contour.cells.iter().zip(next) {
                    let [a_cell, b_cell] = [a as usize, b as usize];
                    prop_assert!((a_cell % width).abs_diff(b_cell % width) <= 1);
                    prop_assert!((a_cell / width).abs_diff(b_cell / width) <= 1);
                    prop_assert_eq!(inside[a as usize], 1);
                }
            }

            // The outer border must separate the part and its holes from the frame.
            let mut chain = vec![0; inside.len()];
            contours[0].cells.iter().for_each(|&cell| chain[cell as usize] = 1);
            let components = label_background(&chain);
            for cell in 0..inside.len() {
                let index = (cell / width + 1) * wide + cell % width + 1;
                prop_assert_eq!(components.pixels()[index] != 1, rest.pixels()[index] != 1);
            }
        }
    }
}
