//! Frontal matrices: dense columns of the factor, and the update that the elimination of these columns makes to later columns.

use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::*;

/// The lower half of a dense symmetric matrix, stored by columns. The first columns are eliminated; the other columns are the update for
/// later fronts.
pub(super) struct Front {
    /// The length of each stored column.
    pub height: usize,
    pub entries: Vec<f64>,
    /// The number of eliminated columns that are no longer stored. Each stored column still begins with their rows.
    skipped: usize,
}

impl Front {
    /// Creates a zero matrix with `height` rows and columns.
    pub(super) fn new(height: usize) -> Self {
        Self { height, entries: vec![0.0; height * height], skipped: 0 }
    }

    pub(super) fn column(&mut self, column: usize) -> &mut [f64] {
        &mut self.entries[column * self.height..][..self.height]
    }

    /// Adds the entries of `left`, the update that remained after the elimination of another front. `rows` has the position in the
    /// elimination order of each row of `left`, and `local` maps these positions to rows of this front.
    pub(super) fn add(&mut self, left: &Self, rows: &[u32], local: &[u32]) {
        for (k, (column, &place)) in left.entries.chunks_exact(left.height).zip(rows).enumerate() {
            let own = self.column(local[place as usize] as usize);
            for (&row, entry) in rows[k..].iter().zip(&column[left.skipped + k..]) {
                own[local[row as usize] as usize] += entry;
            }
        }
    }

    /// Eliminates the first columns, one for each entry of `min_pivots`. The eliminated columns become columns of the factor; the other
    /// columns become the update for later fronts. Returns false if a pivot is not greater than the minimum for its column.
    ///
    /// # Errors
    /// If the evaluation is cancelled.
    pub(super) fn eliminate(
        &mut self,
        min_pivots: &[f64],
        progress: &Progress<'_>,
    ) -> Result<bool, CancelledError> {
        let height = self.height;
        for first in (0..min_pivots.len()).step_by(BLOCK) {
            progress.check()?;
            let end = (first + BLOCK).min(min_pivots.len());
            let (done, later) = self.entries.split_at_mut(end * height);
            let done = &mut done[first * height..];
            let block = EliminateBlock { first, height, entries: done, min_pivots };
            if !pulp::Arch::new().dispatch(block) {
                return Ok(false);
            }
            let work = done.len() * (later.len() / height);
            if work < MIN_PARALLEL_WORK {
                pulp::Arch::new().dispatch(Update { done, height, first: end, columns: later });
                continue;
            }
            let done = &*done;
            let parts = later.par_chunks_mut(COLUMNS * height).enumerate();
            parts.for_each(|(part, columns): (usize, &mut [f64])| {
                let first = end + part * COLUMNS;
                pulp::Arch::new().dispatch(Update { done, height, first, columns });
            });
        }
        Ok(true)
    }

    /// Splits off and returns all columns after the first `count`.
    pub(super) fn split(&mut self, count: usize) -> Self {
        let entries = self.entries.split_off(count * self.height);
        Self { height: self.height, entries, skipped: count }
    }
}

/// The number of columns that are eliminated before the other columns are updated. This many columns fit into the processor cache.
const BLOCK: usize = 16;

/// The number of columns that one parallel task updates.
const COLUMNS: usize = 8;

/// The minimum number of multiplications, half of which are needed, for which columns are updated in parallel: about 50 us.
const MIN_PARALLEL_WORK: usize = 1 << 18;

/// Eliminates neighboring columns. This is a kernel, an inner loop that is compiled for several SIMD instruction sets. Returns false if a
/// pivot is not greater than the minimum for its column.
struct EliminateBlock<'a> {
    /// The index of the first of these columns.
    first: usize,
    height: usize,
    entries: &'a mut [f64],
    min_pivots: &'a [f64],
}

impl pulp::NullaryFnOnce for EliminateBlock<'_> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let Self { first, height, entries, min_pivots } = self;
        for number in 0..entries.len() / height {
            let column = first + number;
            let (done, own) = entries.split_at_mut(number * height);
            let own = &mut own[column..height];
            subtract(done, height, column, own);
            // The comparison is also false if the pivot is NaN.
            let is_usable = own[0] > min_pivots[column];
            if !is_usable {
                return false;
            }
            let root = own[0].sqrt();
            own.iter_mut().for_each(|entry| *entry /= root);
        }
        true
    }
}

/// Subtracts the contributions of a block of eliminated columns from later columns, as a kernel.
struct Update<'a> {
    done: &'a [f64],
    height: usize,
    /// The index of the first of the later columns.
    first: usize,
    columns: &'a mut [f64],
}

impl pulp::NullaryFnOnce for Update<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { done, height, first, columns } = self;
        for (column, own) in (first..).zip(columns.chunks_exact_mut(height)) {
            subtract(done, height, column, &mut own[column..]);
        }
    }
}

/// Subtracts the contributions of the eliminated columns `done` from another column. `own` contains the entries of that column from row
/// `row` on.
#[inline(always)]
fn subtract(done: &[f64], height: usize, row: usize, own: &mut [f64]) {
    let mut fours = done.chunks_exact(4 * height);
    for four in &mut fours {
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| &four[k * height..][row..height]);
        let count = own.len();
        let (a, b, c, d) = (&a[..count], &b[..count], &c[..count], &d[..count]);
        let factors = [a[0], b[0], c[0], d[0]];
        for k in 0..count {
            own[k] -=
                a[k] * factors[0] + b[k] * factors[1] + (c[k] * factors[2] + d[k] * factors[3]);
        }
    }
    for column in fours.remainder().chunks_exact(height) {
        let column = &column[row..];
        let factor = column[0];
        own.iter_mut().zip(column).for_each(|(own, entry)| *own -= entry * factor);
    }
}
