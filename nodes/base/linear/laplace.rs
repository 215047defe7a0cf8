//! The discrete Poisson equation on part of a grid, solved by conjugate gradients.
//!
//! Hestenes and Stiefel, "Methods of conjugate gradients for solving linear systems" (1952). The preconditioner is the diagonal for a small
//! part of a grid, and a sequence of coarser grids for a large part, where otherwise the number of steps would grow with the width of the
//! part. Sums are computed in index order, so the result is the same for any number of threads.

use maquette_node::{Error, Progress, bail};

use super::multigrid::{Grid, Multigrid, NONE};

/// The maximum residual of a solution, relative to the right side. It is well above the rounding errors (1e-16 times the condition number,
/// which is about 1e4 for a part of 100 x 100 cells) and far below the resolution of a scan.
const TOLERANCE: f64 = 1e-12;

/// The minimum number of unknowns for which the multigrid preconditioner is used; for fewer unknowns, it saves no time.
const MIN_MULTIGRID_UNKNOWNS: usize = 20_000;

/// Solves `sum over the 4-neighbors of (x - neighbor) = load` for each free cell of a `width` x `height` grid.
///
/// `values` contains the known values and receives the solution. The sum does not include neighbors outside of the grid, nor neighbors that
/// are not free and have the value NaN. Free cells that are not connected to a known value get NaN.
///
/// # Errors
/// If the iteration does not converge, which well-formed input never causes, or the evaluation is cancelled.
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
) -> Result<(), Error> {
    solve_to_border(width, height, free, load, |_, _| 1.0, values, progress)
}

/// Solves the equation of [`solve`] for a border that is not at the known cells: `distance`, called with a free cell and a known neighbor,
/// returns how far from the free cell the neighbor's value is reached, in cells; greater than 0.
///
/// The discretization is that of Gibou, Fedkiw, Cheng and Kang, "A second-order-accurate symmetric discretization of the Poisson equation
/// on irregular domains" (2002).
///
/// # Errors
/// As for [`solve`].
///
/// # Panics
/// As for [`solve`].
pub fn solve_to_border(
    width: usize,
    height: usize,
    free: &[u8],
    load: f64,
    distance: impl Fn(usize, usize) -> f64,
    values: &mut [f64],
    progress: &Progress<'_>,
) -> Result<(), Error> {
    assert_eq!([free.len(), values.len()], [width * height; 2], "one entry per cell");
    let system = System::new(width, height, free, load, distance, values);
    let coarser =
        if system.cells.len() < MIN_MULTIGRID_UNKNOWNS { None } else { system.coarser(width) };
    let solution = match coarser {
        Some(coarser) => system.solve(|residual| coarser.solve(residual), progress)?,
        None => {
            system.solve(|residual| system.apply_diagonal_preconditioner(residual), progress)?
        }
    };
    for cell in (0..free.len()).filter(|&cell| free[cell] == 1) {
        values[cell] = f64::NAN;
    }
    for (cell, x) in system.cells.iter().zip(solution) {
        values[*cell] = x;
    }
    Ok(())
}

/// The equations `diagonal * x - sum of the unknown neighbors = right` for those unknowns that are connected to a known value.
struct System {
    cells: Vec<usize>,
    neighbors: Vec<[u32; 4]>,
    diagonal: Vec<f64>,
    right: Vec<f64>,
}

impl System {
    fn new(
        width: usize,
        height: usize,
        free: &[u8],
        load: f64,
        distance: impl Fn(usize, usize) -> f64,
        values: &[f64],
    ) -> Self {
        fn grid_neighbors(cell: usize, width: usize, height: usize) -> [Option<usize>; 4] {
            let (row, column) = (cell / width, cell % width);
            [
                (row > 0).then(|| cell - width),
                (column > 0).then(|| cell - 1),
                (column + 1 < width).then(|| cell + 1),
                (row + 1 < height).then(|| cell + width),
            ]
        }
        let known = |cell: usize| free[cell] == 0 && !values[cell].is_nan();
        // Find the unknowns that are connected to known cells.
        let mut reached: Vec<bool> = (0..free.len()).map(known).collect();
        let mut stack: Vec<usize> = (0..free.len()).filter(|&cell| reached[cell]).collect();
        while let Some(cell) = stack.pop() {
            for next in grid_neighbors(cell, width, height).into_iter().flatten() {
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
            for next in grid_neighbors(cell, width, height).into_iter().flatten() {
                if known(next) {
                    let weight = 1.0 / distance(cell, next);
                    right += values[next] * weight;
                    diagonal += weight;
                } else if unknown[next] != NONE {
                    diagonal += 1.0;
                }
            }
            system.diagonal.push(diagonal);
            system.right.push(right);
            system.neighbors.push(
                grid_neighbors(cell, width, height)
                    .map(|next| next.map_or(NONE, |next| unknown[next])),
            );
        }
        Self { cells, ..system }
    }

    /// Creates the sequence of coarser grids. Returns `None` if a pivot becomes 0 or negative by rounding.
    fn coarser(&self, width: usize) -> Option<Multigrid> {
        Multigrid::new(Grid {
            cells: self.cells.clone(),
            width,
            neighbors: self.neighbors.clone(),
            weights: vec![[1.0; 4]; self.cells.len()],
            diagonal: self.diagonal.clone(),
        })
    }

    fn apply_diagonal_preconditioner(&self, residual: &[f64]) -> Vec<f64> {
        residual.iter().zip(&self.diagonal).map(|(r, diagonal)| r / diagonal).collect()
    }

    fn apply(&self, x: &[f64], out: &mut [f64]) {
        for (index, out) in out.iter_mut().enumerate() {
            let near = self.neighbors[index].iter().filter(|&&next| next != NONE);
            *out =
                self.diagonal[index] * x[index] - near.map(|&next| x[next as usize]).sum::<f64>();
        }
    }

    fn solve(
        &self,
        precondition: impl Fn(&[f64]) -> Vec<f64>,
        progress: &Progress<'_>,
    ) -> Result<Vec<f64>, Error> {
        let n = self.cells.len();
        fn dot(a: &[f64], b: &[f64]) -> f64 {
            a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>()
        }
        let mut x = vec![0.0; n];
        let mut r = self.right.clone();
        let mut z = precondition(&r);
        let mut p = z.clone();
        let mut q = vec![0.0; n];
        let mut rz = dot(&r, &z);
        let goal = TOLERANCE * TOLERANCE * dot(&r, &r);
        let max_iterations = 100 + 10 * n;
        for _ in 0..max_iterations {
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
            let ratio = next / rz;
            rz = next;
            p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + ratio * *p);
        }
        if dot(&r, &r) <= goal {
            return Ok(x);
        }
        let residual = dot(&r, &r).sqrt();
        bail!(
            "the Poisson equation was not solved: residual {residual:e} after {max_iterations} steps"
        )
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    #[test]
    fn without_load_the_solution_is_linear_between_its_ends() {
        let mut values = vec![1.0, 0.0, 0.0, 0.0, 5.0];
        solve(5, 1, &[0, 1, 1, 1, 0], 0.0, &mut values, &Progress::silent()).unwrap();
        let expected = [1.0, 2.0, 3.0, 4.0, 5.0];
        assert!(values.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-11), "{values:?}");
    }

    #[test]
    fn with_load_it_is_a_parabola() {
        let mut values = vec![0.0; 5];
        solve(5, 1, &[0, 1, 1, 1, 0], 1.0, &mut values, &Progress::silent()).unwrap();
        let expected = [0.0, 1.5, 2.0, 1.5, 0.0];
        assert!(values.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-11), "{values:?}");
    }

    #[test]
    fn a_border_between_cells_counts_where_it_is() {
        let mut values = vec![1.0, 0.0, 0.0, 0.0, 5.0];
        fn distance(_: usize, known: usize) -> f64 {
            if known == 0 { 0.5 } else { 1.5 }
        }
        let free = [0, 1, 1, 1, 0];
        solve_to_border(5, 1, &free, 0.0, distance, &mut values, &Progress::silent()).unwrap();
        let expected = [1.0, 1.5, 2.5, 3.5, 5.0];
        assert!(values.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-11), "{values:?}");
    }

    #[test]
    fn coarser_grids_change_only_the_number_of_steps() {
        // The free cells form a disk. The disk contains a known cell and a cell that has no value.
        let (width, height) = (73, 70);
        fn free(cell: usize, width: usize) -> bool {
            let [x, y] = [cell % width, cell / width].map(|k| k as f64 - 35.0);
            x * x + y * y < 900.0
        }
        let mut free: Vec<_> =
            (0..width * height).map(|cell| u8::from(free(cell, width))).collect();
        let mut values = vec![0.0; width * height];
        for (cell, value) in [(width * 30 + 30, 7.0), (width * 40 + 20, f64::NAN)] {
            (free[cell], values[cell]) = (0, value);
        }
        let system = System::new(width, height, &free, 1.0, |_, _| 1.0, &values);
        let coarser = system.coarser(width).unwrap();
        let steps = [Cell::new(0), Cell::new(0)];
        fn count_step(which: usize, steps: &[Cell<i32>; 2]) {
            steps[which].set(steps[which].get() + 1);
        }
        let plain = system
            .solve(
                |r| {
                    count_step(0, &steps);
                    system.apply_diagonal_preconditioner(r)
                },
                &Progress::silent(),
            )
            .unwrap();
        let helped = system
            .solve(
                |r| {
                    count_step(1, &steps);
                    coarser.solve(r)
                },
                &Progress::silent(),
            )
            .unwrap();
        assert!(plain.len() > 2700);
        assert!(plain.iter().zip(helped).all(|(a, b)| (a - b).abs() < 1e-8 * a.abs()));
        let [plain, helped] = steps.each_ref().map(Cell::get);
        assert!(2 * helped < plain, "{helped} and {plain} steps");
    }

    #[test]
    fn a_large_disk_is_a_paraboloid() {
        let size = 401;
        let center = (size / 2) as f64;
        fn from_center(cell: usize, size: usize, center: f64) -> f64 {
            let [x, y] = [cell % size, cell / size].map(|k| k as f64 - center);
            x * x + y * y
        }
        let cells = 0..size * size;
        let free = cells
            .clone()
            .map(|it| u8::from(from_center(it, size, center) < 190.0 * 190.0))
            .collect::<Vec<_>>();
        assert!(free.iter().filter(|&&free| free == 1).count() > MIN_MULTIGRID_UNKNOWNS);
        let mut values = vec![0.0; size * size];
        solve(size, size, &free, 1.0, &mut values, &Progress::silent()).unwrap();
        // The boundary of the disk is a staircase that deviates from the circle by up to one cell.
        fn exact_value(cell: usize, size: usize, center: f64) -> f64 {
            (190.0 * 190.0 - from_center(cell, size, center)) / 4.0
        }
        let worst = cells
            .filter(|&cell| free[cell] == 1)
            .map(|cell: usize| (values[cell] - exact_value(cell, size, center)).abs())
            .fold(0.0, f64::max);
        assert!(worst < 190.0 / 2.0, "{worst}");
    }

    #[test]
    fn unknown_neighbors_are_left_out_and_islands_stay_unknown() {
        let mut values = vec![2.0, 0.0, f64::NAN, 0.0];
        solve(4, 1, &[0, 1, 0, 1], 0.0, &mut values, &Progress::silent()).unwrap();
        assert_eq!(values[..2], [2.0, 2.0]);
        assert!(values[2].is_nan() && values[3].is_nan());
    }
}
