//! Transposes and products of sparse matrices, and symmetric matrices computed from sparse matrices.

use super::cholesky::Symmetric;
use super::stencils::{Stencils, push_merged};
use crate::topology::lists::Lists;

impl Stencils {
    /// Returns the transposed matrix. `columns` is the number of columns of the original matrix.
    pub fn transpose(&self, columns: usize) -> Self {
        let entries = Lists::group(columns, || {
            (0..self.len()).flat_map(|row| {
                let (indices, weights) = self.row(row);
                let entries = indices.iter().zip(weights);
                entries.map(move |(&column, &weight)| (column, (row as u32, weight)))
            })
        });
        let (transposed, _) = Self::build(columns, |_: &mut (), column, rows| {
            let own = entries.list(column);
            own.iter().for_each(|&(row, weight)| rows.push(row, weight));
            rows.end();
        });
        transposed
    }

    /// Returns the first `count` rows.
    pub fn head(&self, count: usize) -> Self {
        let (head, _) = Self::build(count, |_: &mut (), row, rows| {
            let (indices, weights) = self.row(row);
            indices.iter().zip(weights).for_each(|(&index, &weight)| rows.push(index, weight));
            rows.end();
        });
        head
    }

    /// Appends the rows of `others`, multiplied by `factor`, below the rows of this matrix.
    pub fn stack(&self, others: &Self, factor: f64) -> Self {
        let (rows, _) = Self::build(self.len() + others.len(), |_: &mut (), row, rows| {
            let ((indices, weights), factor) = match row.checked_sub(self.len()) {
                None => (self.row(row), 1.0),
                Some(row) => (others.row(row), factor),
            };
            indices
                .iter()
                .zip(weights)
                .for_each(|(&index, &weight)| rows.push(index, factor * weight));
            rows.end();
        });
        rows
    }

    /// Multiplies row `r` by `scale[r]`. The result must be symmetric.
    pub fn scale_rows(&self, scale: &[f64]) -> Symmetric {
        let mut matrix = Symmetric { starts: vec![0], indices: Vec::new(), entries: Vec::new() };
        for (row, scale) in scale.iter().enumerate() {
            let (indices, weights) = self.row(row);
            matrix.indices.extend(indices);
            matrix.entries.extend(weights.iter().map(|weight| weight * scale));
            matrix.starts.push(matrix.indices.len() as u32);
        }
        matrix
    }

    /// Returns the matrix product of this matrix and `before`.
    pub fn times(&self, before: &Self) -> Self {
        let (rows, _) = Self::build(self.len(), |terms: &mut Vec<(u32, f64)>, row, rows| {
            terms.clear();
            let (indices, weights) = self.row(row);
            for (&index, weight) in indices.iter().zip(weights) {
                let (inner, others) = before.row(index as usize);
                terms.extend(inner.iter().zip(others).map(|(&k, other)| (k, weight * other)));
            }
            push_merged(rows, terms);
            rows.end();
        });
        rows
    }

    /// Returns `A^T A`, where `A` is this matrix with `columns` columns.
    pub fn normal_matrix(&self, columns: usize) -> Symmetric {
        self.normal_matrix_with(&self.transpose(columns))
    }

    /// Returns `A^T A`, where `A` is this matrix and `transposed` is `A^T`. Terms are added in row order, so the result is exactly
    /// symmetric.
    pub fn normal_matrix_with(&self, transposed: &Self) -> Symmetric {
        let columns = transposed.len();
        let (rows, _) = Self::build(columns, |sums: &mut Sums, column, rows| {
            sums.entries.resize(columns, 0.0);
            let (own, weights) = transposed.row(column);
            for (&row, &weight) in own.iter().zip(weights) {
                let (indices, others) = self.row(row as usize);
                for (&k, other) in indices.iter().zip(others) {
                    let entry = &mut sums.entries[k as usize];
                    if *entry == 0.0 {
                        sums.touched.push(k);
                    }
                    *entry += weight * other;
                }
            }
            sums.touched.sort_unstable();
            sums.touched.dedup();
            for k in sums.touched.drain(..) {
                rows.push(k, std::mem::take(&mut sums.entries[k as usize]));
            }
            rows.end();
        });
        rows.scale_rows(&vec![1.0; columns])
    }
}

/// Scratch space for one row of a product: a sum for each column, and the list of columns that have terms.
#[derive(Default)]
struct Sums {
    entries: Vec<f64>,
    touched: Vec<u32>,
}
