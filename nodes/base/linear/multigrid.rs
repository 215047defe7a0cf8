//! A preconditioner for Poisson's equation on part of a grid: what changes slowly is solved on coarser grids.
//!
//! Braess, "Towards algebraic multigrid for elliptic problems of second order" (1995): four cells become one, over which a correction is
//! constant. Such corrections are too small, and are enlarged. So conjugate gradients take some dozens of steps, however wide the part is.

use maquette_value::parallel::*;

use super::cholesky::{Cholesky, Symmetric};

/// In place of a neighbor that is not an unknown.
pub(super) const NONE: u32 = u32::MAX;

/// Unknowns that one task works on.
const BLOCK: usize = 8192;

/// So few unknowns are solved exactly.
const FEW: usize = 1000;

/// How much of a Jacobi step is taken.
const DAMPING: f64 = 0.7;

/// By how much corrections of coarser grids are enlarged, as Braess has it.
const ENLARGED: f64 = 1.8;

/// `diagonal x - sum of weight times neighbor`, for some cells of a grid.
pub(super) struct Grid {
    /// Which cells, and how many of the whole grid are in a row.
    pub(super) cells: Vec<usize>,
    pub(super) width: usize,
    /// Above, to the left, to the right, below.
    pub(super) neighbors: Vec<[u32; 4]>,
    pub(super) weights: Vec<[f64; 4]>,
    pub(super) diagonal: Vec<f64>,
}

impl Grid {
    /// What is left of `right` with these values.
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

    /// A damped step of Jacobi's iteration.
    fn smooth(&self, right: &[f64], x: &mut [f64]) {
        let residual = self.residual(right, x);
        let terms = x.iter_mut().zip(residual.iter().zip(&self.diagonal));
        terms.for_each(|(x, (residual, diagonal))| *x += DAMPING * residual / diagonal);
    }

    /// The grid of half as many rows and columns, and the cell there of each one here.
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
            let entry = |side: usize| (self.neighbors[own][side], -self.weights[own][side]);
            let row = [entry(0), entry(1), (own as u32, diagonal), entry(2), entry(3)];
            for (column, entry) in row.into_iter().filter(|(column, _)| *column != NONE) {
                matrix.indices.push(column);
                matrix.entries.push(entry);
            }
            matrix.starts.push(matrix.indices.len() as u32);
        }
        Cholesky::new(&matrix)
    }
}

/// Grids, each of half as many rows and columns as the one before it.
pub(super) struct Multigrid {
    levels: Vec<Level>,
    last: Cholesky,
}

struct Level {
    grid: Grid,
    /// For each cell the one of the next grid, and how many there are.
    parents: Vec<u32>,
    n_parents: usize,
}

impl Multigrid {
    /// None if rounding leaves nothing of a pivot.
    pub(super) fn new(mut grid: Grid) -> Option<Self> {
        let mut levels = Vec::new();
        while grid.cells.len() > FEW {
            let (coarse, parents) = grid.coarser();
            let n_parents = coarse.cells.len();
            let grid = std::mem::replace(&mut grid, coarse);
            levels.push(Level { grid, parents, n_parents });
        }
        Some(Self { levels, last: grid.factors()? })
    }

    /// About the solution for these right sides: a linear map of them, symmetric and positive.
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
        corrected.for_each(|(x, &parent)| *x += ENLARGED * correction[parent as usize]);
        grid.smooth(right, &mut x);
        grid.smooth(right, &mut x);
        x
    }
}
