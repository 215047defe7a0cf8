//! The outline of a region between the cells of the grid.
//!
//! A part of a picture covers fractions of cells. Linear interpolation of these fractions (marching squares) gives an outline that is right
//! within about half a pixel, but has the steps of the pixels. These are removed by parabolas that fit the outline within this error.

use super::closed_line::ClosedLine;

/// The steps (column, row) from a cell to its neighbors, counter-clockwise as seen in the picture, beginning on the right.
const SIDES: [[isize; 2]; 4] = [[1, 0], [0, -1], [-1, 0], [0, 1]];
const RIGHT: usize = 0;
const LEFT: usize = 2;

/// Half length of the shortest parabolas, which are used also where they do not fit, and of those that smooth the result, in cells.
const MIN_REACH: f64 = 2.25;
const LAST_REACH: f64 = 3.5;

/// An outline passes at least this far from the centers of cells, in cells, before it is smoothed.
const MIN_DISTANCE: f64 = 0.05;

/// Returns the outlines of the cells whose entry in `inside` is 1, in the order of [`contours`](super::contour::contours), and in their
/// direction. `covered` is the fraction of each cell that the part of the picture covers; where it contradicts `inside`, the cell counts as
/// covered entirely or not at all. `pixel` is the width of a pixel of the picture in cells, which bounds the steps to remove.
///
/// # Panics
/// Panics if `inside` or `covered` does not have `width * height` entries.
pub(crate) fn rims(
    width: usize,
    height: usize,
    inside: &[u8],
    covered: &[f64],
    pixel: f64,
) -> Vec<Vec<[f64; 2]>> {
    assert_eq!([inside.len(), covered.len()], [width * height; 2], "one entry per cell");
    let grid = Coverage { width, height, inside, covered };
    let pixel = pixel.clamp(0.0, 1.0);
    let mut visited = vec![[false; 4]; inside.len()];
    let mut rims = Vec::new();
    for cell in (0..inside.len()).filter(|&cell| inside[cell] == 1) {
        for side in [LEFT, RIGHT] {
            let at = [(cell % width) as isize, (cell / width) as isize];
            if !visited[cell][side] && !grid.is_inside(step(at, side)) {
                rims.push(smooth(&grid.follow(at, side, &mut visited), pixel));
            }
        }
    }
    rims
}

/// Returns the cell next to a cell on the given side.
fn step([column, row]: [isize; 2], side: usize) -> [isize; 2] {
    [column + SIDES[side][0], row + SIDES[side][1]]
}

/// The cells inside of a region, and the fraction of each cell that is covered.
struct Coverage<'a> {
    width: usize,
    height: usize,
    inside: &'a [u8],
    covered: &'a [f64],
}

impl Coverage<'_> {
    /// Returns the index of a cell; `None` beyond the grid.
    fn index(&self, [column, row]: [isize; 2]) -> Option<usize> {
        let inside =
            (0..self.width as isize).contains(&column) && (0..self.height as isize).contains(&row);
        inside.then(|| row as usize * self.width + column as usize)
    }

    fn is_inside(&self, at: [isize; 2]) -> bool {
        self.index(at).is_some_and(|cell| self.inside[cell] == 1)
    }

    /// Returns the covered fraction of a cell: at least 0.5 inside of the region and at most 0.5 outside.
    fn fraction(&self, at: [isize; 2]) -> f64 {
        let Some(cell) = self.index(at) else { return 0.0 };
        let (covered, inside) = (self.covered[cell], self.inside[cell] == 1);
        match (inside, covered >= super::footprint::HALF) {
            (true, true) | (false, false) => covered,
            (true, false) => 1.0,
            (false, true) => 0.0,
        }
    }

    /// Returns the point between a cell and its neighbor outside of the region at which half of a cell is covered.
    fn crossing(&self, at: [isize; 2], side: usize) -> [f64; 2] {
        let (here, there) = (self.fraction(at), self.fraction(step(at, side)));
        let share = if here > there { (here - 0.5) / (here - there) } else { 0.5 };
        let share = share.clamp(MIN_DISTANCE, 1.0 - MIN_DISTANCE);
        [0, 1].map(|k| at[k] as f64 + share * SIDES[side][k] as f64)
    }

    /// Follows the outline that begins on the given side of a cell, with the region on its left as seen in the picture. Cells of the region
    /// that touch in a corner are connected.
    fn follow(
        &self,
        start: [isize; 2],
        first_side: usize,
        visited: &mut [[bool; 4]],
    ) -> Vec<[f64; 2]> {
        let (mut at, mut side) = (start, first_side);
        let mut line = Vec::new();
        loop {
            let cell = self.index(at).expect("an outline is around cells of the grid");
            visited[cell][side] = true;
            line.push(self.crossing(at, side));
            let along = (side + 1) % 4;
            let (ahead, diagonal) = (step(at, along), step(step(at, along), side));
            if self.is_inside(diagonal) {
                (at, side) = (diagonal, (side + 3) % 4);
            } else if self.is_inside(ahead) {
                at = ahead;
            } else {
                side = along;
            }
            if (at, side) == (start, first_side) {
                return line;
            }
        }
    }
}

/// Removes the steps of pixels of the width `pixel` (in cells) from a closed line. Returns as many points as before; each moves by less
/// than a cell and a quarter, and by less than 0.7 cells for pixels half as wide as a cell.
fn smooth(line: &[[f64; 2]], pixel: f64) -> Vec<[f64; 2]> {
    let closed = ClosedLine::new(line);
    let tolerance = 0.1 + 0.8 * pixel;
    let mut reaches: Vec<f64> = (0..line.len()).map(|k| closed.reach(k, line, tolerance)).collect();
    closed.even_out(&mut reaches);
    reaches.iter_mut().for_each(|reach| *reach = reach.max(MIN_REACH));
    let smooth = move_to_parabolas(line, &reaches, tolerance);
    move_to_parabolas(&smooth, &vec![LAST_REACH; line.len()], 0.05 + 0.3 * pixel)
}

/// Moves each point of a line to the parabola of the given reach, by at most `limit`.
fn move_to_parabolas(line: &[[f64; 2]], reaches: &[f64], limit: f64) -> Vec<[f64; 2]> {
    let closed = ClosedLine::new(line);
    let points = line.iter().zip(reaches).enumerate();
    points
        .map(|(k, (&old, &reach))| {
            let parabola = closed.fit(k, reach, line).filter(|_| closed.has_room(reach));
            let [x, y] = parabola.map_or(old, |parabola| parabola.at(0.0));
            let moved = [x - old[0], y - old[1]];
            let factor = (limit / libm::hypot(moved[0], moved[1])).min(1.0);
            [old[0] + moved[0] * factor, old[1] + moved[1] * factor]
        })
        .collect()
}

#[cfg(test)]
mod tests;
