//! The cells of a capture as places in its picture: which of them a mesh shows, and which are on one surface.

use std::collections::VecDeque;

use maquette_range::{JUMP, longest_edge};
use maquette_value::{Mesh, RangeImage};

/// The cells of a capture's grid, by their positions in its picture.
pub(super) struct CaptureGrid<'a> {
    range: &'a RangeImage,
    /// Maximum distance in mm of neighboring points on one surface.
    longest: f64,
}

impl<'a> CaptureGrid<'a> {
    pub(super) fn new(range: &'a RangeImage) -> Self {
        Self { range, longest: longest_edge(range, JUMP) }
    }

    pub(super) fn count(&self) -> usize {
        self.range.points().len()
    }

    /// Returns the position in the grid, as column and row, that sees the texture coordinate `uv`.
    fn position(&self, uv: [f64; 2]) -> [f64; 2] {
        let map = self.range.registration();
        let [width, height] = map.picture.map(|size| size as f64);
        map.range_from_picture([uv[0] * width - 0.5, (1.0 - uv[1]) * height - 0.5])
    }

    /// Returns the cell that sees the texture coordinate `uv`; `None` if it is outside of the grid.
    pub(super) fn cell(&self, uv: [f64; 2]) -> Option<usize> {
        let [column, row] = self.position(uv).map(f64::round);
        let size = [self.range.width(), self.range.height()].map(|size| size as f64);
        let is_inside = 0.0 <= column && column < size[0] && 0.0 <= row && row < size[1];
        is_inside.then(|| row as usize * self.range.width() + column as usize)
    }

    /// Returns true if two cells with points, `steps` columns or rows apart, are on one surface.
    fn is_joined(&self, a: usize, b: usize, steps: usize) -> bool {
        match (self.range.point(a), self.range.point(b)) {
            (Some(a), Some(b)) => (b - a).norm() <= self.longest * steps as f64,
            _ => false,
        }
    }

    /// Returns true if no depth step is on the line between two texture coordinates.
    pub(super) fn is_connected(&self, from: [f64; 2], to: [f64; 2]) -> bool {
        let [a, b] = [from, to].map(|uv| self.position(uv));
        let length = (b[0] - a[0]).abs().max((b[1] - a[1]).abs());
        if length.is_nan() || length > self.count() as f64 {
            return false;
        }
        let (steps, map) = (length.ceil() as usize, self.range.registration());
        let (mut last, mut gap) = (None, 0);
        for step in 0..=steps {
            let share = step as f64 / steps.max(1) as f64;
            let at = [0, 1].map(|k| a[k] + share * (b[k] - a[k]));
            let Some(cell) = self.cell(map.uv_from_range(at)) else { return false };
            gap += 1;
            if self.range.point(cell).is_none() {
                continue;
            }
            if last.is_some_and(|last| !self.is_joined(last, cell, gap)) {
                return false;
            }
            (last, gap) = (Some(cell), 0);
        }
        true
    }

    /// Calls `visit` with the cells in a face of a mesh with the texture coordinates `uv` at its corners, and with those at its corners. A
    /// cell outside of the grid is `None`.
    pub(super) fn visit_cells(&self, uv: &[[f64; 2]], mut visit: impl FnMut(Option<usize>)) {
        uv.iter().for_each(|&uv| visit(self.cell(uv)));
        let size = [self.range.width(), self.range.height()];
        for k in 1..uv.len().saturating_sub(1) {
            let [a, b, c] = [uv[0], uv[k], uv[k + 1]].map(|uv| self.position(uv));
            let [low, high] = [f64::min as fn(f64, f64) -> f64, f64::max]
                .map(|pick| [0, 1].map(|k| pick(pick(a[k], b[k]), c[k])));
            let columns = low[0].ceil().max(0.0) as usize..=high[0].floor().max(-1.0) as usize;
            let rows = low[1].ceil().max(0.0) as usize..=high[1].floor().max(-1.0) as usize;
            if high[0] < 0.0 || high[1] < 0.0 {
                continue;
            }
            for row in rows.take_while(|&row| row < size[1]) {
                for column in columns.clone().take_while(|&column| column < size[0]) {
                    let at = [column as f64, row as f64];
                    let sides = [[a, b], [b, c], [c, a]].map(|[p, q]| cross(p, q, at));
                    if sides.iter().all(|side| *side >= 0.0)
                        || sides.iter().all(|side| *side <= 0.0)
                    {
                        visit(Some(row * size[0] + column));
                    }
                }
            }
        }
    }

    /// Returns, for each cell, true if the mesh shows it in one of the faces that `is_shown` selects.
    pub(super) fn shown_cells(
        &self,
        mesh: &Mesh,
        uv: &[[f64; 2]],
        is_shown: impl Fn(&[u32]) -> bool,
    ) -> Vec<bool> {
        let mut shown = vec![false; self.count()];
        for face in mesh.faces().iter().filter(|face| is_shown(face)) {
            let corners: Vec<[f64; 2]> = face.iter().map(|&vertex| uv[vertex as usize]).collect();
            self.visit_cells(&corners, |cell| {
                if let Some(cell) = cell {
                    shown[cell] = true;
                }
            });
        }
        shown
    }

    /// Visits the cells that are connected to `seeds` without a depth step, nearest first, as far as `may_enter` allows. `may_enter` is
    /// called with a cell and its distance from the seeds in steps, and returns true at most once for each cell.
    pub(super) fn flood(&self, seeds: &[usize], mut may_enter: impl FnMut(usize, u32) -> bool) {
        let (width, height) = (self.range.width(), self.range.height());
        let mut queue: VecDeque<(usize, u32)> = seeds.iter().map(|&cell| (cell, 0)).collect();
        while let Some((cell, distance)) = queue.pop_front() {
            let [column, row] = [cell % width, cell / width];
            for row in row.saturating_sub(1)..=(row + 1).min(height - 1) {
                for column in column.saturating_sub(1)..=(column + 1).min(width - 1) {
                    let other = row * width + column;
                    if self.is_joined(cell, other, 1) && may_enter(other, distance + 1) {
                        queue.push_back((other, distance + 1));
                    }
                }
            }
        }
    }
}

/// Twice the signed area of the triangle between three positions.
fn cross(a: [f64; 2], b: [f64; 2], at: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (at[1] - a[1]) - (b[1] - a[1]) * (at[0] - a[0])
}
