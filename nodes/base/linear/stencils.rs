//! Sparse matrices. Typically a row expresses a new vertex as a weighted sum of old vertices.

use maquette_value::Column;
use maquette_value::parallel::*;
use nalgebra::Point3;

use super::weighted_mean::WeightedMean;

/// The number of rows per parallel task: enough to outweigh the cost of starting a task, about 10 us.
const BLOCK: usize = 4096;

/// A sparse matrix, stored by rows: row `r` has the entries `starts[r]..starts[r + 1]` of the lists of column indices and weights.
#[derive(Clone, Debug)]
pub struct Stencils {
    starts: Column<u32>,
    indices: Column<u32>,
    weights: Column<f64>,
}

/// Collects the rows of a sparse matrix while they are written.
#[derive(Default)]
pub struct Rows {
    ends: Vec<u32>,
    indices: Vec<u32>,
    weights: Vec<f64>,
}

impl Rows {
    /// Adds an entry to the current row.
    pub fn push(&mut self, index: u32, weight: f64) {
        self.indices.push(index);
        self.weights.push(weight);
    }

    /// The number of entries in all rows.
    pub fn len(&self) -> usize {
        self.indices.len()
    }

    /// Returns true if there are no entries.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Multiplies the weights of all entries from index `first` on by `factor`.
    pub fn scale_from(&mut self, first: usize, factor: f64) {
        self.weights[first..].iter_mut().for_each(|weight| *weight *= factor);
    }

    /// Removes all entries from the collected rows and returns them as pairs of column index and weight.
    pub fn take_entries(&mut self) -> Vec<(u32, f64)> {
        self.indices.drain(..).zip(self.weights.drain(..)).collect()
    }

    /// Ends the current row and begins the next one.
    pub fn end(&mut self) {
        self.ends.push(self.indices.len() as u32);
    }
}

impl Stencils {
    /// Builds a matrix. `write` is called for each of the items `0..items` and writes any number of rows; the rows are in the order of the
    /// items. Also returns the index of each item's first row, followed by the number of rows. The arguments of `write` are a scratch
    /// space, an item, and the writer.
    pub fn build<S: Default>(
        items: usize,
        write: impl Fn(&mut S, usize, &mut Rows) + Sync,
    ) -> (Self, Column<u32>) {
        let blocks: Vec<(Vec<u32>, Rows)> = (0..items.div_ceil(BLOCK))
            .into_par_iter()
            .map(|block| {
                let (mut scratch, mut rows) = (S::default(), Rows::default());
                rows.indices.reserve(BLOCK * 4);
                rows.weights.reserve(BLOCK * 4);
                let items = block * BLOCK..items.min((block + 1) * BLOCK);
                let ends = items.map(|item| {
                    write(&mut scratch, item, &mut rows);
                    rows.ends.len() as u32
                });
                (ends.collect(), rows)
            })
            .collect();
        fn total(len: fn(&Rows) -> usize, blocks: &[(Vec<u32>, Rows)]) -> usize {
            blocks.iter().map(|(_, rows)| len(rows)).sum()
        }
        let mut groups = Vec::with_capacity(items + 1);
        let mut starts = Vec::with_capacity(total(|rows| rows.ends.len(), &blocks) + 1);
        let mut indices = Vec::with_capacity(total(|rows| rows.indices.len(), &blocks));
        let mut weights = Vec::with_capacity(indices.capacity());
        groups.push(0);
        starts.push(0);
        for (ends, rows) in &blocks {
            let (row, entry) = (starts.len() as u32 - 1, indices.len() as u32);
            groups.extend(ends.iter().map(|end| row + end));
            starts.extend(rows.ends.iter().map(|end| entry + end));
            indices.extend_from_slice(&rows.indices);
            weights.extend_from_slice(&rows.weights);
        }
        let stencils =
            Self { starts: starts.into(), indices: indices.into(), weights: weights.into() };
        (stencils, groups.into())
    }

    /// Creates a matrix whose row `r` has the entries `starts[r]..starts[r + 1]` of the lists `indices` (columns) and `weights`. `starts`
    /// must begin with 0.
    pub fn from_parts(starts: Vec<u32>, indices: Vec<u32>, weights: Vec<f64>) -> Self {
        Self { starts: starts.into(), indices: indices.into(), weights: weights.into() }
    }

    /// The number of rows.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Returns true if there are no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The number of pairs of entries in the same row, that is, the sum of the squared row lengths.
    pub fn products(&self) -> f64 {
        let lengths = self.starts.windows(2).map(|ends| f64::from(ends[1] - ends[0]));
        lengths.map(|length| length * length).sum()
    }

    /// The column indices and weights of a row's entries.
    pub fn row(&self, row: usize) -> (&[u32], &[f64]) {
        let entries = self.starts[row] as usize..self.starts[row + 1] as usize;
        (&self.indices[entries.clone()], &self.weights[entries])
    }

    /// Iterates over the rows from `first` on. Each item is the row's index, its column indices and its weights.
    #[inline(always)]
    pub fn rows_from(&self, first: usize) -> impl Iterator<Item = (usize, &[u32], &[f64])> {
        let (indices, weights) = (&self.indices[..], &self.weights[..]);
        self.starts[first..].windows(2).zip(first..).map(move |(ends, row)| {
            let entries = ends[0] as usize..ends[1] as usize;
            (row, &indices[entries.clone()], &weights[entries])
        })
    }

    /// Multiplies one row by a column vector.
    pub fn apply_row<T: WeightedMean>(&self, row: usize, column: &[T]) -> T {
        let (indices, weights) = self.row(row);
        T::weighted_mean(
            weights.iter().zip(indices).map(|(&weight, &index)| (weight, column[index as usize])),
        )
    }

    /// Multiplies one row by a column vector of positions. `column` returns the position for each column index.
    pub fn point(&self, row: usize, column: impl Fn(u32) -> Point3<f64>) -> Point3<f64> {
        let (indices, weights) = self.row(row);
        let terms = indices.iter().zip(weights);
        terms.fold(Point3::origin(), |sum, (&index, &weight)| sum + column(index).coords * weight)
    }

    /// Multiplies the matrix by a column vector, in parallel over the rows. The terms of each row are added in order.
    pub fn apply<T: WeightedMean>(&self, column: &[T]) -> Vec<T> {
        let rows = (0..self.len()).into_par_iter().with_min_len(BLOCK);
        rows.map(|row| self.apply_row(row, column)).collect()
    }

    /// Returns the memory that this value uses, in bytes.
    pub fn size(&self) -> usize {
        self.starts.size() + self.indices.size() + self.weights.size()
    }
}

/// Sorts entries by column and adds them to the current row. Entries of the same column are summed.
pub fn push_merged(rows: &mut Rows, row: &mut [(u32, f64)]) {
    row.sort_by_key(|(column, _)| *column);
    for group in row.chunk_by(|a, b| a.0 == b.0) {
        let weight: f64 = group.iter().map(|entry| entry.1).sum();
        if weight != 0.0 {
            rows.push(group[0].0, weight);
        }
    }
}
