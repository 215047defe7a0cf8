//! Systems of equations whose matrix is zero away from the diagonal.

use nalgebra::Vector3;

/// A square matrix with entries within `half` of the diagonal.
pub struct Banded {
    n: usize,
    half: usize,
    /// Row by row, from `half` before the diagonal to `half` after it.
    entries: Vec<f64>,
}

/// Below this share of a row's largest entry a pivot counts as zero: what is left is rounding.
const LEAST_PIVOT: f64 = 1e-13;

impl Banded {
    /// Zeros: `n` rows, with `half` entries on each side of the diagonal.
    pub fn new(n: usize, half: usize) -> Self {
        Self { n, half, entries: vec![0.0; n * (2 * half + 1)] }
    }

    /// Adds to the entry in a row and a column, which must lie within the band.
    pub fn add(&mut self, row: usize, column: usize, x: f64) {
        let at = self.at(row, column);
        self.entries[at] += x;
    }

    fn at(&self, row: usize, column: usize) -> usize {
        row * (2 * self.half + 1) + column + self.half - row
    }

    /// Factors the matrix into L U without exchanging rows, which is stable for the matrices of B-splines, whose minors are not
    /// negative: de Boor and Pinkus, "Backward error analysis for totally positive linear systems" (1977). None if it is singular.
    pub fn factor(mut self) -> Option<Factors> {
        let width = 2 * self.half + 1;
        let sizes: Vec<f64> = self
            .entries
            .chunks(width)
            .map(|row| row.iter().map(|x| x.abs()).fold(0.0, f64::max))
            .collect();
        for (k, &size) in sizes.iter().enumerate() {
            let pivot = self.entries[self.at(k, k)];
            // A pivot that is NaN divides no better.
            let divides = pivot.abs() > LEAST_PIVOT * size;
            if !divides {
                return None;
            }
            for row in k + 1..(k + self.half + 1).min(self.n) {
                let at = self.at(row, k);
                let factor = self.entries[at] / pivot;
                self.entries[at] = factor;
                if factor != 0.0 {
                    for column in k + 1..(k + self.half + 1).min(self.n) {
                        let change = factor * self.entries[self.at(k, column)];
                        let at = self.at(row, column);
                        self.entries[at] -= change;
                    }
                }
            }
        }
        Some(Factors(self))
    }
}

/// A factored matrix.
pub struct Factors(Banded);

impl Factors {
    /// Turns the right side into the solution.
    pub fn solve(&self, right: &mut [Vector3<f64>]) {
        let matrix = &self.0;
        let near =
            |row: usize| (row.saturating_sub(matrix.half), (row + matrix.half + 1).min(matrix.n));
        for row in 0..matrix.n {
            for column in near(row).0..row {
                let known = right[column];
                right[row] -= known * matrix.entries[matrix.at(row, column)];
            }
        }
        for row in (0..matrix.n).rev() {
            for column in row + 1..near(row).1 {
                let known = right[column];
                right[row] -= known * matrix.entries[matrix.at(row, column)];
            }
            right[row] /= matrix.entries[matrix.at(row, row)];
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
        let mut matrix = Banded::new(9, 2);
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
        let mut matrix = Banded::new(2, 1);
        [(0, 0), (0, 1), (1, 0), (1, 1)]
            .iter()
            .for_each(|&(row, column)| matrix.add(row, column, 1.0));
        assert!(matrix.factor().is_none());
        assert!(Banded::new(1, 0).factor().is_none());
    }
}
