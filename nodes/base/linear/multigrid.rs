//! A multigrid preconditioner for the Poisson equation on part of a grid: slowly varying errors are reduced on coarser grids.
//!
//! Braess, "Towards algebraic multigrid for elliptic problems of second order" (1995): four cells become one coarse cell, on which the
//! correction is constant. Such corrections are too small and are therefore scaled up. With this preconditioner the conjugate gradient
//! method takes a few dozen steps, independent of the width of the grid.

use maquette_value::parallel::*;

use super::cholesky::{Cholesky, Symmetric};

/// Marks a neighboring cell that is not an unknown.
pub(super) const NONE: u32 = u32::MAX;

/// The number of unknowns per parallel task.
const BLOCK: usize = 8192;

/// A grid with at most this many unknowns is solved directly.
const MAX_DIRECT_UNKNOWNS: usize = 1000;

/// The damping factor of Jacobi steps, which reduce quickly varying errors.
const DAMPING: f64 = 0.7;

/// The factor by which corrections from coarser grids are scaled up, after Braess.
const CORRECTION_SCALE: f64 = 1.8;

/// The equations `diagonal * x - sum of weight * neighbor = right` for some cells of a grid.
pub(super) struct Grid {
    /// The index of each cell in the full grid, whose rows have `width` cells.
    pub(super) cells: Vec<usize>,
    pub(super) width: usize,
    /// For each cell the indices of the neighboring unknowns above, to the left, to the right and below; [`NONE`] where there is none.
    pub(super) neighbors: Vec<[u32; 4]>,
    pub(super) weights: Vec<[f64; 4]>,
    pub(super) diagonal: Vec<f64>,
}

impl Grid {
    /// Returns the residual of `x`: `right` minus the matrix times `x`.
    fn residual(&self, right: &[f64], x: &[f64]) -> Vec<f64> {
        let numbers = (0..right.len()).into_par_iter().with_min_len(BLOCK);
        numbers
            .map(|index: usize| {
                let near = self.neighbors[index].iter().zip(&self.weights[index]);
                let near = near.filter(|(next, _)| **next != NONE);
                let near: f64 = near.map(|(&next, weight)| weight * x[next as usize]).sum();
                right[index] - (self.diagonal[index] * x[index] - near)
            })
            .collect()
    }

    /// Performs a damped Jacobi step.
    fn smooth(&self, right: &[f64], x: &mut [f64]) {
        let residual = self.residual(right, x);
        let terms = x.iter_mut().zip(residual.iter().zip(&self.diagonal));
        terms.for_each(|(x, (residual, diagonal))| *x += DAMPING * residual / diagonal);
    }

    /// Returns the grid with half as many rows and columns, and for each cell the coarse cell that contains it.
    fn coarser(&self) -> (Self, Vec<u32>) {
        let width = self.width.div_ceil(2);
        fn cell(&cell: &usize, width: usize, self_width: usize) -> usize {
            cell / self_width / 2 * width + cell % self_width / 2
        }
        let rows = self.cells.last().map_or(0, |cell| cell / self.width / 2 + 1);
        let mut index = vec![NONE; rows * width];
        self.cells.iter().for_each(|it| index[cell(it, width, self.width)] = 0);
        let cells: Vec<_> = (0..index.len()).filter(|&cell| index[cell] == 0).collect();
        (0..).zip(&cells).for_each(|(number, &cell)| index[cell] = number);
        let parents: Vec<_> =
            self.cells.iter().map(|it| index[cell(it, width, self.width)]).collect();
        let mut coarse = Self {
            width,
            neighbors: vec![[NONE; 4]; cells.len()],
            weights: vec![[0.0; 4]; cells.len()],
            diagonal: vec![0.0; cells.len()],
            cells,
        };
        for (own, &parent) in parents.iter().enumerate() {
            let parent = parent as usize;
            coarse.diagonal[parent] += self.diagonal[own];
            for side in 0..4 {
                let (next, weight) = (self.neighbors[own][side], self.weights[own][side]);
                match parents.get(next as usize) {
                    None => {}
                    Some(&other) if other as usize == parent => coarse.diagonal[parent] -= weight,
                    Some(&other) => {
                        coarse.neighbors[parent][side] = other;
                        coarse.weights[parent][side] += weight;
                    }
                }
            }
        }
        (coarse, parents)
    }

    fn factors(&self) -> Option<Cholesky> {
        let mut matrix = Symmetric { starts: vec![0], indices: Vec::new(), entries: Vec::new() };
        for (own, &diagonal) in self.diagonal.iter().enumerate() {
            let [above, left, right, below] =
                [0, 1, 2, 3].map(|side| (self.neighbors[own][side], -self.weights[own][side]));
            let row = [above, left, (own as u32, diagonal), right, below];
            for (column, entry) in row.into_iter().filter(|(column, _)| *column != NONE) {
                matrix.indices.push(column);
                matrix.entries.push(entry);
            }
            matrix.starts.push(matrix.indices.len() as u32);
        }
        Cholesky::new(&matrix)
    }
}

/// A sequence of grids, each with half as many rows and columns as the previous one.
pub(super) struct Multigrid {
    levels: Vec<Level>,
    last: Cholesky,
}

struct Level {
    grid: Grid,
    /// For each cell of this grid, the cell of the next coarser grid that contains it. `n_parents` is the number of cells in the next grid.
    parents: Vec<u32>,
    n_parents: usize,
}

impl Multigrid {
    /// Creates the sequence of grids below `grid`. Returns `None` if a pivot becomes 0 or negative by rounding.
    pub(super) fn new(mut grid: Grid) -> Option<Self> {
        let mut levels = Vec::new();
        while grid.cells.len() > MAX_DIRECT_UNKNOWNS {
            let (coarse, parents) = grid.coarser();
            let n_parents = coarse.cells.len();
            let grid = std::mem::replace(&mut grid, coarse);
            levels.push(Level { grid, parents, n_parents });
        }
        Some(Self { levels, last: grid.factors()? })
    }

    /// Returns an approximate solution for the right side `right`. The solution is a linear function of `right`, with a symmetric and
    /// positive definite matrix.
    pub(super) fn solve(&self, right: &[f64]) -> Vec<f64> {
        self.solve_on(0, right)
    }

    fn solve_on(&self, level: usize, right: &[f64]) -> Vec<f64> {
        let Some(Level { grid, parents, n_parents }) = self.levels.get(level) else {
            let mut sides: Vec<_> = right.iter().map(|&right| [right, 0.0, 0.0]).collect();
            self.last.solve(&mut sides);
            return sides.into_iter().map(|[x, ..]| x).collect();
        };
        let first = right.iter().zip(&grid.diagonal);
        let mut x: Vec<_> = first.map(|(right, diagonal)| DAMPING * right / diagonal).collect();
        grid.smooth(right, &mut x);
        let mut sums = vec![0.0; *n_parents];
        let residual = grid.residual(right, &x);
        parents.iter().zip(residual).for_each(|(&parent, rest)| sums[parent as usize] += rest);
        let correction = self.solve_on(level + 1, &sums);
        let corrected = x.iter_mut().zip(parents);
        corrected.for_each(|(x, &parent)| *x += CORRECTION_SCALE * correction[parent as usize]);
        grid.smooth(right, &mut x);
        grid.smooth(right, &mut x);
        x
    }
}
