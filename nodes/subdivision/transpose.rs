//! The transposed of a sparse matrix, and the symmetric matrices that are made of one.

use super::stencils::Stencils;
use crate::cholesky::Symmetric;

impl Stencils {
    /// The same matrix with rows and columns exchanged; it has this many columns.
    pub(super) fn transposed(&self, columns: usize) -> Self {
        let mut starts = vec![0usize; columns + 1];
        let all = || (0..self.len()).map(|row| (row, self.row(row)));
        for &column in all().flat_map(|(_, (indices, _))| indices) {
            starts[column as usize + 1] += 1;
        }
        for column in 0..columns {
            starts[column + 1] += starts[column];
        }
        let mut next = starts.clone();
        let mut entries = vec![(0u32, 0.0); starts[columns]];
        for (row, (indices, weights)) in all() {
            for (&column, &weight) in indices.iter().zip(weights) {
                entries[next[column as usize]] = (row as u32, weight);
                next[column as usize] += 1;
            }
        }
        let (transposed, _) = Self::build(columns, |_: &mut (), column, rows| {
            let own = &entries[starts[column]..starts[column + 1]];
            own.iter().for_each(|&(row, weight)| rows.push(row, weight));
            rows.end();
        });
        transposed
    }

    /// The first rows.
    pub(super) fn head(&self, count: usize) -> Self {
        let (head, _) = Self::build(count, |_: &mut (), row, rows| {
            let (indices, weights) = self.row(row);
            indices.iter().zip(weights).for_each(|(&index, &weight)| rows.push(index, weight));
            rows.end();
        });
        head
    }

    /// The rows times these factors, which make them a symmetric matrix.
    pub(super) fn scaled(&self, scale: &[f64]) -> Symmetric {
        let mut matrix = Symmetric { starts: vec![0], indices: Vec::new(), entries: Vec::new() };
        for (row, scale) in scale.iter().enumerate() {
            let (indices, weights) = self.row(row);
            matrix.indices.extend(indices);
            matrix.entries.extend(weights.iter().map(|weight| weight * scale));
            matrix.starts.push(matrix.indices.len() as u32);
        }
        matrix
    }

    /// `A^T A` of this matrix `A` with so many columns.
    pub(super) fn squared(&self, columns: usize) -> Symmetric {
        let transposed = self.transposed(columns);
        let mut matrix = Symmetric { starts: vec![0], indices: Vec::new(), entries: Vec::new() };
        let mut terms: Vec<(u32, f64)> = Vec::new();
        for column in 0..columns {
            terms.clear();
            let (rows, weights) = transposed.row(column);
            for (&row, &weight) in rows.iter().zip(weights) {
                let (indices, others) = self.row(row as usize);
                terms.extend(indices.iter().zip(others).map(|(&k, other)| (k, weight * other)));
            }
            // A stable order, so that both halves of the matrix are equal sums.
            terms.sort_by_key(|(index, _)| *index);
            for same in terms.chunk_by(|a, b| a.0 == b.0) {
                matrix.indices.push(same[0].0);
                matrix.entries.push(same.iter().map(|(_, entry)| entry).sum());
            }
            matrix.starts.push(matrix.indices.len() as u32);
        }
        matrix
    }
}
