//! Sparse matrices from old to new vertices.

use maquette_value::Column;
use maquette_value::parallel::*;
use nalgebra::Point3;

use super::mix::Mix;

/// Rows that one task computes: enough to outweigh the cost of giving it to a thread, some 10 us.
const BLOCK: usize = 4096;

/// A sparse matrix by rows: row `r` has the entries `starts[r]..starts[r + 1]`.
#[derive(Clone, Debug)]
pub struct Stencils {
    starts: Column<u32>,
    indices: Column<u32>,
    weights: Column<f64>,
}

/// Rows of a sparse matrix while they are written.
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

    /// Number of entries of all rows.
    pub fn len(&self) -> usize {
        self.indices.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Multiplies the entries from the one at `first` on.
    pub fn scale_from(&mut self, first: usize, factor: f64) {
        self.weights[first..].iter_mut().for_each(|weight| *weight *= factor);
    }

    /// Takes all entries away.
    pub fn take_entries(&mut self) -> Vec<(u32, f64)> {
        self.indices.drain(..).zip(self.weights.drain(..)).collect()
    }

    /// Ends the current row.
    pub fn end(&mut self) {
        self.ends.push(self.indices.len() as u32);
    }
}

impl Stencils {
    /// The rows that `write` writes for each of `items`, in their order, and the first row of each item (with the number of
    /// rows behind the last). `write` gets a scratch space, an item, and where to write its rows.
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

    /// The rows that end where the next one of `starts` is; the first one starts at 0.
    pub fn from_parts(starts: Vec<u32>, indices: Vec<u32>, weights: Vec<f64>) -> Self {
        Self { starts: starts.into(), indices: indices.into(), weights: weights.into() }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// How many products of two entries of one row there are.
    pub fn products(&self) -> f64 {
        let lengths = self.starts.windows(2).map(|ends| f64::from(ends[1] - ends[0]));
        lengths.map(|length| length * length).sum()
    }

    /// The entries of a row: indices and weights.
    pub fn row(&self, row: usize) -> (&[u32], &[f64]) {
        let entries = self.starts[row] as usize..self.starts[row + 1] as usize;
        (&self.indices[entries.clone()], &self.weights[entries])
    }

    /// The rows from one on, with their numbers.
    #[inline(always)]
    pub fn rows_from(&self, first: usize) -> impl Iterator<Item = (usize, &[u32], &[f64])> {
        let (indices, weights) = (&self.indices[..], &self.weights[..]);
        self.starts[first..].windows(2).zip(first..).map(move |(ends, row)| {
            let entries = ends[0] as usize..ends[1] as usize;
            (row, &indices[entries.clone()], &weights[entries])
        })
    }

    /// One row times a column.
    pub fn apply_row<T: Mix>(&self, row: usize, column: &[T]) -> T {
        let (indices, weights) = self.row(row);
        T::mix(
            weights.iter().zip(indices).map(|(&weight, &index)| (weight, column[index as usize])),
        )
    }

    /// One row times the places that `column` gives.
    pub fn point(&self, row: usize, column: impl Fn(u32) -> Point3<f64>) -> Point3<f64> {
        let (indices, weights) = self.row(row);
        let terms = indices.iter().zip(weights);
        terms.fold(Point3::origin(), |sum, (&index, &weight)| sum + column(index).coords * weight)
    }

    /// The matrix times a column, row by row in parallel; each row adds its terms in their order.
    pub fn apply<T: Mix>(&self, column: &[T]) -> Vec<T> {
        let rows = (0..self.len()).into_par_iter().with_min_len(BLOCK);
        rows.map(|row| self.apply_row(row, column)).collect()
    }

    /// Bytes of memory.
    pub fn size(&self) -> usize {
        self.starts.size() + self.indices.size() + self.weights.size()
    }
}

/// Adds entries to the current row, those of the same column as one; sorts them.
pub fn push_merged(rows: &mut Rows, row: &mut [(u32, f64)]) {
    row.sort_by_key(|(column, _)| *column);
    for group in row.chunk_by(|a, b| a.0 == b.0) {
        let weight: f64 = group.iter().map(|entry| entry.1).sum();
        if weight != 0.0 {
            rows.push(group[0].0, weight);
        }
    }
}
