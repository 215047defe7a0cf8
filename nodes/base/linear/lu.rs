//! Square systems of linear equations, by elimination with partial pivoting.
//!
//! Golub and Van Loan, *Matrix Computations*, 4th ed. (2013), algorithm 3.4.1. The condition number is estimated as in Higham, "FORTRAN
//! codes for estimating the one-norm of a real or complex matrix" (1988), algorithm 2.1 after Hager (1984). All sums are computed in index
//! order, so the result is the same on every machine.

use maquette_value::Memo;
use maquette_value::simd::{Kernel, widest};
use maquette_value::{Column, Encoder};

/// A square matrix and its L U factors: `matrix` with its rows permuted into the order `rows` is the product `L U`.
#[derive(Clone, Debug)]
pub struct Lu {
    size: usize,
    /// The entries of the matrix before factorization, row by row.
    matrix: Column<f64>,
    /// The entries of U, and below the diagonal the entries of L. The diagonal of L consists of ones and is not stored.
    factors: Column<f64>,
    rows: Column<u32>,
    condition: f64,
}

/// The maximum number of steps for estimating the condition number. More than three steps are rarely necessary.
const MAX_ESTIMATE_STEPS: usize = 5;

impl Lu {
    /// Factors a matrix that is given row by row. A singular matrix has an infinite condition number.
    ///
    /// # Panics
    /// If the matrix is not square.
    pub fn new(size: usize, matrix: Vec<f64>) -> Self {
        assert_eq!(matrix.len(), size * size, "the matrix is square");
        let mut factors = matrix.clone();
        let mut rows: Vec<u32> = (0..size as u32).collect();
        let mut regular = true;
        for step in 0..size {
            // The pivot is the entry of largest absolute value; of several, the first. A NaN is never chosen.
            let pivot = (step..size).fold(step, |best, row| {
                let [entry, max] = [row, best].map(|row| factors[row * size + step].abs());
                if entry > max { row } else { best }
            });
            rows.swap(step, pivot);
            let (upper, lower) = factors.split_at_mut((step + 1) * size);
            if pivot != step {
                let other = &mut lower[(pivot - step - 1) * size..][..size];
                upper[step * size..].swap_with_slice(other);
            }
            let top = &upper[step * size + step..];
            if top[0] == 0.0 || !top[0].is_finite() {
                regular = false;
                continue;
            }
            widest(Eliminate { top, step, size, lower });
        }
        let mut lu = Self {
            size,
            matrix: matrix.into(),
            factors: factors.into(),
            rows: rows.into(),
            condition: f64::INFINITY,
        };
        if regular {
            let condition = lu.norm() * lu.norm_of_inverse();
            lu.condition = if condition.is_nan() { f64::INFINITY } else { condition };
        }
        lu
    }

    /// An estimate of the condition number in the 1-norm. It is rarely less than a third of the exact value.
    pub fn condition(&self) -> f64 {
        self.condition
    }

    /// Solves for one right side, with one step of iterative refinement.
    pub fn solve(&self, right: &[f64]) -> Vec<f64> {
        let mut solution = self.eliminate(right);
        let rows = self.matrix.chunks_exact(self.size.max(1));
        let missing: Vec<f64> =
            rows.zip(right).map(|(row, right)| right - dot(row, &solution)).collect();
        let correction = self.eliminate(&missing);
        solution.iter_mut().zip(correction).for_each(|(x, step)| *x += step);
        solution
    }

    /// Row `k` of the combined factors.
    fn factor_row(&self, k: usize) -> &[f64] {
        &self.factors[k * self.size..][..self.size]
    }

    fn eliminate(&self, right: &[f64]) -> Vec<f64> {
        let mut x: Vec<f64> = self.rows.iter().map(|&row| right[row as usize]).collect();
        for k in 0..self.size {
            x[k] -= dot(&self.factor_row(k)[..k], &x[..k]);
        }
        for k in (0..self.size).rev() {
            x[k] = (x[k] - dot(&self.factor_row(k)[k + 1..], &x[k + 1..])) / self.factor_row(k)[k];
        }
        x
    }

    /// Solves the linear system whose matrix is the transpose of the factored matrix.
    fn eliminate_transposed(&self, right: &[f64]) -> Vec<f64> {
        let mut x = right.to_vec();
        for k in 0..self.size {
            x[k] /= self.factor_row(k)[k];
            let ratio = x[k];
            x[k + 1..]
                .iter_mut()
                .zip(&self.factor_row(k)[k + 1..])
                .for_each(|(x, factor)| *x -= ratio * factor);
        }
        for k in (0..self.size).rev() {
            let ratio = x[k];
            x[..k].iter_mut().zip(self.factor_row(k)).for_each(|(x, factor)| *x -= ratio * factor);
        }
        let mut solution = vec![0.0; self.size];
        self.rows.iter().zip(x).for_each(|(&row, x)| solution[row as usize] = x);
        solution
    }

    fn norm(&self) -> f64 {
        let mut sums = vec![0.0; self.size];
        for row in self.matrix.chunks_exact(self.size.max(1)) {
            sums.iter_mut().zip(row).for_each(|(sum, entry)| *sum += entry.abs());
        }
        sums.into_iter().fold(0.0, f64::max)
    }

    fn norm_of_inverse(&self) -> f64 {
        let n = self.size as f64;
        fn length(x: &[f64]) -> f64 {
            x.iter().map(|x| x.abs()).sum::<f64>()
        }
        let mut x = vec![1.0 / n; self.size];
        let mut estimate = 0.0_f64;
        for step in 0..MAX_ESTIMATE_STEPS {
            let y = self.eliminate(&x);
            estimate = estimate.max(length(&y));
            let signs: Vec<f64> = y.iter().map(|y| if *y < 0.0 { -1.0 } else { 1.0 }).collect();
            let z = self.eliminate_transposed(&signs);
            let best =
                (0..self.size).fold(0, |best, k| if z[k].abs() > z[best].abs() { k } else { best });
            if step > 0 && z.get(best).is_none_or(|z_best| z_best.abs() <= dot(&z, &x)) {
                break;
            }
            x.fill(0.0);
            x.iter_mut().skip(best).take(1).for_each(|x| *x = 1.0);
        }
        let other = self.eliminate(
            &(0..self.size)
                .map(|k: usize| {
                    let size = 1.0 + k as f64 / (n - 1.0).max(1.0);
                    if k.is_multiple_of(2) { size } else { -size }
                })
                .collect::<Vec<_>>(),
        );
        estimate.max(2.0 * length(&other) / (3.0 * n))
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Subtracts multiples of the pivot row from the rows below it.
struct Eliminate<'a> {
    /// The pivot row, from the pivot on.
    top: &'a [f64],
    step: usize,
    size: usize,
    lower: &'a mut [f64],
}

impl Kernel for Eliminate<'_> {
    #[inline(always)]
    fn run(self) {
        let Self { top, step, size, lower } = self;
        for row in lower.chunks_exact_mut(size) {
            let row = &mut row[step..];
            let ratio = row[0] / top[0];
            row[0] = ratio;
            row[1..].iter_mut().zip(&top[1..]).for_each(|(x, top)| *x -= ratio * top);
        }
    }
}

/// The factors are memoized, because a deformation reuses them if only the target positions of its handles change.
impl Memo for Lu {
    const NAME: &'static str = "FactoredMatrix";

    fn encode(&self, to: &mut Encoder) {
        to.counts(&[self.size]).column(&self.matrix);
    }

    fn size(&self) -> usize {
        self.matrix.size() + self.factors.size() + self.rows.size()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the `k`-th number of a reproducible pseudorandom sequence, from -1 to 1.
    fn number(k: usize) -> f64 {
        libm::sin((k * k) as f64 * 0.7 + k as f64 + 1.0)
    }

    #[test]
    fn a_solution_solves_its_system_and_the_transposed_one_its_own() {
        let n = 23;
        let matrix: Vec<f64> = (0..n * n).map(number).collect();
        let right: Vec<f64> = (0..n).map(|k| number(k + 1000)).collect();
        let lu = Lu::new(n, matrix.clone());
        let (x, y) = (lu.solve(&right), lu.eliminate_transposed(&right));
        for row in 0..n {
            let column: Vec<f64> = (0..n).map(|k| matrix[k * n + row]).collect();
            assert!((dot(&matrix[row * n..][..n], &x) - right[row]).abs() <= 1e-13);
            assert!((dot(&column, &y) - right[row]).abs() <= 1e-11);
        }
    }

    #[test]
    fn the_condition_is_estimated_within_a_factor_of_three() {
        for n in [1, 2, 5, 12] {
            let matrix: Vec<f64> = (0..n * n).map(number).collect();
            let lu = Lu::new(n, matrix.clone());
            let inverse = nalgebra::DMatrix::from_row_slice(n, n, &matrix).try_inverse().unwrap();
            fn norm(m: &nalgebra::DMatrix<f64>) -> f64 {
                m.column_iter().map(|column| column.lp_norm(1)).fold(0.0, f64::max)
            }
            let exact = norm(&inverse) * norm(&nalgebra::DMatrix::from_row_slice(n, n, &matrix));
            let ratio = lu.condition() / exact;
            assert!((0.33..=1.000_001).contains(&ratio), "{n}: {ratio}");
        }
    }

    #[test]
    fn a_singular_matrix_has_an_infinite_condition() {
        assert_eq!(Lu::new(2, vec![1.0, 2.0, 2.0, 4.0]).condition(), f64::INFINITY);
        assert_eq!(Lu::new(2, vec![f64::NAN; 4]).condition(), f64::INFINITY);
        assert_eq!(Lu::new(2, vec![0.0, 1.0, 1.0, 0.0]).condition(), 1.0);
    }
}
