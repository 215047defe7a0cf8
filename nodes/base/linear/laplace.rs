//! The discrete Poisson equation on part of a grid, solved by conjugate gradients.
//!
//! Hestenes and Stiefel, "Methods of conjugate gradients for solving linear systems" (1952), with the diagonal as
//! preconditioner. Sums run in index order, so that the result is the same for any number of threads.

use maquette::{Cancelled, Progress};
use thiserror::Error;

/// Why the Poisson equation has no solution.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Unsolved {
    /// The iteration did not converge.
    #[error("the Poisson equation was not solved: residual {residual:e} after {iterations} steps")]
    NotConverged {
        /// The length of the residual.
        residual: f64,
        /// The steps done.
        iterations: usize,
    },
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Residual at which a solution is good enough, relative to the right side: well above rounding (1e-16 times the condition,
/// some 1e4 for a 100 x 100 part) and far below what a scan resolves.
const TOLERANCE: f64 = 1e-12;

/// Solves `sum over the 4-neighbors of (x - neighbor) = load` for each free cell of a `width` x `height` grid.
///
/// `values` holds the known values and receives the solution. A neighbor that is not free and whose value is NaN is left out
/// of the sum, as is one beyond the grid. A part of the free cells that touches no known value gets NaN.
///
/// # Errors
/// If the iteration does not converge, which well-formed input never causes, or the evaluation is told to stop.
///
/// # Panics
/// If `free` or `values` does not have `width * height` entries.
pub fn solve(
    width: usize,
    height: usize,
    free: &[u8],
    load: f64,
    values: &mut [f64],
    progress: &Progress<'_>,
) -> Result<(), Unsolved> {
    assert_eq!([free.len(), values.len()], [width * height; 2], "one entry per cell");
    let system = System::new(width, height, free, load, values);
    let solution = system.solve(progress)?;
    for cell in (0..free.len()).filter(|&cell| free[cell] == 1) {
        values[cell] = f64::NAN;
    }
    for (cell, x) in system.cells.iter().zip(solution) {
        values[*cell] = x;
    }
    Ok(())
}

/// `diagonal x - sum of the unknown neighbors = right`, for the unknowns that some known value reaches.
struct System {
    cells: Vec<usize>,
    neighbors: Vec<[u32; 4]>,
    diagonal: Vec<f64>,
    right: Vec<f64>,
}

/// In place of a neighbor that is not an unknown.
const NONE: u32 = u32::MAX;

impl System {
    fn new(width: usize, height: usize, free: &[u8], load: f64, values: &[f64]) -> Self {
        let around = |cell: usize| {
            let (row, column) = (cell / width, cell % width);
            [
                (row > 0).then(|| cell - width),
                (column > 0).then(|| cell - 1),
                (column + 1 < width).then(|| cell + 1),
                (row + 1 < height).then(|| cell + width),
            ]
        };
        let known = |cell: usize| free[cell] == 0 && !values[cell].is_nan();
        // Unknowns, reached from the known cells.
        let mut reached: Vec<bool> = (0..free.len()).map(known).collect();
        let mut stack: Vec<usize> = (0..free.len()).filter(|&cell| reached[cell]).collect();
        while let Some(cell) = stack.pop() {
            for next in around(cell).into_iter().flatten() {
                if free[next] == 1 && !reached[next] {
                    reached[next] = true;
                    stack.push(next);
                }
            }
        }
        let cells: Vec<usize> =
            (0..free.len()).filter(|&cell| free[cell] == 1 && reached[cell]).collect();
        let mut unknown = vec![NONE; free.len()];
        (0u32..).zip(&cells).for_each(|(index, &cell)| unknown[cell] = index);
        let mut system = Self {
            neighbors: Vec::with_capacity(cells.len()),
            diagonal: Vec::with_capacity(cells.len()),
            right: Vec::with_capacity(cells.len()),
            cells: Vec::new(),
        };
        for &cell in &cells {
            let (mut diagonal, mut right) = (0.0, load);
            for next in around(cell).into_iter().flatten() {
                if known(next) {
                    right += values[next];
                }
                if known(next) || unknown[next] != NONE {
                    diagonal += 1.0;
                }
            }
            system.diagonal.push(diagonal);
            system.right.push(right);
            system.neighbors.push(around(cell).map(|next| next.map_or(NONE, |next| unknown[next])));
        }
        Self { cells, ..system }
    }

    fn apply(&self, x: &[f64], out: &mut [f64]) {
        for (index, out) in out.iter_mut().enumerate() {
            let near = self.neighbors[index].iter().filter(|&&next| next != NONE);
            *out =
                self.diagonal[index] * x[index] - near.map(|&next| x[next as usize]).sum::<f64>();
        }
    }

    fn solve(&self, progress: &Progress<'_>) -> Result<Vec<f64>, Unsolved> {
        let n = self.cells.len();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let precondition = |r: &[f64]| -> Vec<f64> {
            r.iter().zip(&self.diagonal).map(|(r, diagonal)| r / diagonal).collect()
        };
        let mut x = vec![0.0; n];
        let mut r = self.right.clone();
        let mut z = precondition(&r);
        let mut p = z.clone();
        let mut q = vec![0.0; n];
        let mut rz = dot(&r, &z);
        let goal = TOLERANCE * TOLERANCE * dot(&r, &r);
        let most = 100 + 10 * n;
        for _ in 0..most {
            progress.check()?;
            if dot(&r, &r) <= goal {
                return Ok(x);
            }
            self.apply(&p, &mut q);
            let step = rz / dot(&p, &q);
            for k in 0..n {
                x[k] += step * p[k];
                r[k] -= step * q[k];
            }
            z = precondition(&r);
            let next = dot(&r, &z);
            let share = next / rz;
            rz = next;
            p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + share * *p);
        }
        if dot(&r, &r) <= goal {
            return Ok(x);
        }
        Err(Unsolved::NotConverged { residual: dot(&r, &r).sqrt(), iterations: most })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_load_the_solution_is_linear_between_its_ends() {
        let mut values = vec![1.0, 0.0, 0.0, 0.0, 5.0];
        solve(5, 1, &[0, 1, 1, 1, 0], 0.0, &mut values, &Progress::none()).unwrap();
        let expected = [1.0, 2.0, 3.0, 4.0, 5.0];
        assert!(values.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-11), "{values:?}");
    }

    #[test]
    fn with_load_it_is_a_parabola() {
        let mut values = vec![0.0; 5];
        solve(5, 1, &[0, 1, 1, 1, 0], 1.0, &mut values, &Progress::none()).unwrap();
        let expected = [0.0, 1.5, 2.0, 1.5, 0.0];
        assert!(values.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-11), "{values:?}");
    }

    #[test]
    fn unknown_neighbors_are_left_out_and_islands_stay_unknown() {
        let mut values = vec![2.0, 0.0, f64::NAN, 0.0];
        solve(4, 1, &[0, 1, 0, 1], 0.0, &mut values, &Progress::none()).unwrap();
        assert_eq!(values[..2], [2.0, 2.0]);
        assert!(values[2].is_nan() && values[3].is_nan());
    }
}
