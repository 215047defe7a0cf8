//! The transposed of a sparse matrix, and the symmetric matrices that are made of one.

use super::cholesky::Symmetric;
use super::stencils::{Stencils, push_merged};
use crate::topology::lists::Lists;

impl Stencils {
    /// The same matrix with rows and columns exchanged; it has this many columns.
    pub fn transposed(&self, columns: usize) -> Self {
        let entries = Lists::group(columns, || {
            (0..self.len()).flat_map(|row| {
                let (indices, weights) = self.row(row);
                let entries = indices.iter().zip(weights);
                entries.map(move |(&column, &weight)| (column, (row as u32, weight)))
            })
        });
        let (transposed, _) = Self::build(columns, |_: &mut (), column, rows| {
            let own = entries.of(column);
            own.iter().for_each(|&(row, weight)| rows.push(row, weight));
            rows.end();
        });
        transposed
    }

    /// The first rows.
    pub fn head(&self, count: usize) -> Self {
        let (head, _) = Self::build(count, |_: &mut (), row, rows| {
            let (indices, weights) = self.row(row);
            indices.iter().zip(weights).for_each(|(&index, &weight)| rows.push(index, weight));
            rows.end();
        });
        head
    }

    /// These rows, and below them others, so many times.
    pub fn above(&self, others: &Self, factor: f64) -> Self {
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

    /// The rows times these factors, which make them a symmetric matrix.
    pub fn scaled(&self, scale: &[f64]) -> Symmetric {
        let mut matrix = Symmetric { starts: vec![0], indices: Vec::new(), entries: Vec::new() };
        for (row, scale) in scale.iter().enumerate() {
            let (indices, weights) = self.row(row);
            matrix.indices.extend(indices);
            matrix.entries.extend(weights.iter().map(|weight| weight * scale));
            matrix.starts.push(matrix.indices.len() as u32);
        }
        matrix
    }

    /// These rows of rows: the product with a matrix that is applied before.
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

    /// `A^T A` of this matrix `A` with so many columns.
    pub fn squared(&self, columns: usize) -> Symmetric {
        self.squared_with(&self.transposed(columns))
    }

    /// The same, where the transposed matrix is known. Terms are added in the order of the rows, so that both halves are equal sums.
    pub fn squared_with(&self, transposed: &Self) -> Symmetric {
        let columns = transposed.len();
        let (rows, _) = Self::build(columns, |sums: &mut Sums, column, rows| {
            sums.entries.resize(columns, 0.0);
            let (own, weights) = transposed.row(column);
            for (&row, &weight) in own.iter().zip(weights) {
                let (indices, others) = self.row(row as usize);
                for (&k, other) in indices.iter().zip(others) {
                    let entry = &mut sums.entries[k as usize];
                    if *entry == 0.0 {
                        sums.met.push(k);
                    }
                    *entry += weight * other;
                }
            }
            sums.met.sort_unstable();
            sums.met.dedup();
            for k in sums.met.drain(..) {
                rows.push(k, std::mem::take(&mut sums.entries[k as usize]));
            }
            rows.end();
        });
        rows.scaled(&vec![1.0; columns])
    }
}

/// Sums while they are made: one for each column, and which of them have terms.
#[derive(Default)]
struct Sums {
    entries: Vec<f64>,
    met: Vec<u32>,
}
