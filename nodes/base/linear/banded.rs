//! Linear systems with a banded matrix.

use nalgebra::Vector3;

/// A square matrix whose nonzero entries are at most `half` columns away from the diagonal.
pub struct BandedMatrix {
    n: usize,
    half: usize,
    /// The entries of the band, row by row. Each row has the entries from `half` columns before the diagonal to `half` columns after it.
    entries: Vec<f64>,
}

/// A pivot that is less than this fraction of the largest entry of its row counts as zero, because such a pivot consists only of rounding
/// errors.
const MIN_PIVOT: f64 = 1e-13;

impl BandedMatrix {
    /// Creates a zero matrix with `n` rows and `half` entries on each side of the diagonal.
    pub fn new(n: usize, half: usize) -> Self {
        Self { n, half, entries: vec![0.0; n * (2 * half + 1)] }
    }

    /// Adds `x` to an entry, which must be within the band.
    pub fn add(&mut self, row: usize, column: usize, x: f64) {
        let at = self.entry_index(row, column);
        self.entries[at] += x;
    }

    /// Returns the columns that the band covers in a row.
    fn band(&self, row: usize) -> std::ops::Range<usize> {
        row.saturating_sub(self.half)..(row + self.half + 1).min(self.n)
    }

    fn entry_index(&self, row: usize, column: usize) -> usize {
        row * (2 * self.half + 1) + column + self.half - row
    }

    /// Factors the matrix into L U without pivoting. Returns `None` if the matrix is singular. Without pivoting the factorization is stable
    /// for B-spline matrices, whose minors are not negative: de Boor and Pinkus, "Backward error analysis for totally positive linear
    /// systems" (1977).
    pub fn factor(mut self) -> Option<Factors> {
        let width = 2 * self.half + 1;
        let sizes: Vec<f64> = self
            .entries
            .chunks(width)
            .map(|row| row.iter().map(|x| x.abs()).fold(0.0, f64::max))
            .collect();
        for (k, &size) in sizes.iter().enumerate() {
            let pivot = self.entries[self.entry_index(k, k)];
            // The comparison is also false if the pivot is NaN.
            let is_usable = pivot.abs() > MIN_PIVOT * size;
            if !is_usable {
                return None;
            }
            for row in k + 1..(k + self.half + 1).min(self.n) {
                let at = self.entry_index(row, k);
                let factor = self.entries[at] / pivot;
                self.entries[at] = factor;
                if factor != 0.0 {
                    for column in k + 1..(k + self.half + 1).min(self.n) {
                        let change = factor * self.entries[self.entry_index(k, column)];
                        let at = self.entry_index(row, column);
                        self.entries[at] -= change;
                    }
                }
            }
        }
        Some(Factors(self))
    }
}

/// The L U factors of a banded matrix.
pub struct Factors(BandedMatrix);

impl Factors {
    /// Solves the linear system for the right side `right`, which is replaced by the solution.
    pub fn solve(&self, right: &mut [Vector3<f64>]) {
        let matrix = &self.0;
        for row in 0..matrix.n {
            for column in matrix.band(row).start..row {
                let solved = right[column];
                right[row] -= solved * matrix.entries[matrix.entry_index(row, column)];
            }
        }
        for row in (0..matrix.n).rev() {
            for column in row + 1..matrix.band(row).end {
                let solved = right[column];
                right[row] -= solved * matrix.entries[matrix.entry_index(row, column)];
            }
            right[row] /= matrix.entries[matrix.entry_index(row, row)];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_solution_solves() {
        fn entry(row: usize, column: usize) -> f64 {
            match row.abs_diff(column) {
                0 => 4.0 + row as f64,
                1 => -1.0,
                2 => 0.5 * column as f64 / 9.0,
                _ => 0.0,
            }
        }
        let mut matrix = BandedMatrix::new(9, 2);
        for row in 0..9usize {
            for column in row.saturating_sub(2)..(row + 3).min(9) {
                matrix.add(row, column, entry(row, column));
            }
        }
        let expected: Vec<_> = (0..9).map(|k| Vector3::new(f64::from(k), 1.0, -2.0)).collect();
        let mut x: Vec<Vector3<f64>> = (0..9)
            .map(|row| (0..9).map(|column| expected[column] * entry(row, column)).sum())
            .collect();
        matrix.factor().unwrap().solve(&mut x);
        assert!(x.iter().zip(expected).all(|(x, expected)| (x - expected).norm() <= 1e-13));
    }

    #[test]
    fn a_singular_matrix_has_no_factors() {
        let mut matrix = BandedMatrix::new(2, 1);
        [(0, 0), (0, 1), (1, 0), (1, 1)]
            .iter()
            .for_each(|&(row, column)| matrix.add(row, column, 1.0));
        assert!(matrix.factor().is_none());
        assert!(BandedMatrix::new(1, 0).factor().is_none());
    }
}
