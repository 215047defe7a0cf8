//! Frontal matrices: dense columns of a factor, and the update that their elimination makes to later columns.

use maquette_node::{Cancelled, Progress};

/// The lower half of a symmetric matrix, by columns, of which the first ones are eliminated.
pub(super) struct Front {
    /// The length of a column.
    pub height: usize,
    pub entries: Vec<f64>,
    /// How many rows were eliminated before the first column.
    skipped: usize,
}

impl Front {
    /// Zeros.
    pub(super) fn new(height: usize) -> Self {
        Self { height, entries: vec![0.0; height * height], skipped: 0 }
    }

    pub(super) fn column(&mut self, column: usize) -> &mut [f64] {
        &mut self.entries[column * self.height..][..self.height]
    }

    /// Adds the update of another front: the entries that its elimination has left. `local` maps their rows to those of this front.
    pub(super) fn add(&mut self, left: &Self, rows: &[u32], local: &[u32]) {
        for (k, (column, &place)) in left.entries.chunks_exact(left.height).zip(rows).enumerate() {
            let own = self.column(local[place as usize] as usize);
            for (&row, entry) in rows[k..].iter().zip(&column[left.skipped + k..]) {
                own[local[row as usize] as usize] += entry;
            }
        }
    }

    /// Turns the first columns, as many as `least` has pivots, into those of the factor, and the others into the update for later fronts;
    /// false if a pivot is not above its least.
    ///
    /// # Errors
    /// If the evaluation is told to stop.
    pub(super) fn eliminate(
        &mut self,
        least: &[f64],
        progress: &Progress<'_>,
    ) -> Result<bool, Cancelled> {
        let Self { height, entries, .. } = self;
        pulp::Arch::new().dispatch(Eliminate { height: *height, entries, least, progress })
    }

    /// Takes off all columns behind the first ones.
    pub(super) fn split(&mut self, count: usize) -> Self {
        let entries = self.entries.split_off(count * self.height);
        Self { height: self.height, entries, skipped: count }
    }
}

/// An elimination, to be compiled for wide instructions.
struct Eliminate<'a> {
    height: usize,
    entries: &'a mut [f64],
    least: &'a [f64],
    progress: &'a Progress<'a>,
}

impl pulp::NullaryFnOnce for Eliminate<'_> {
    type Output = Result<bool, Cancelled>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Self { height, entries, least, progress } = self;
        eliminate(entries, height, least, progress)
    }
}

/// So many columns are eliminated before all others change: they stay in the nearest memory meanwhile.
const BLOCK: usize = 16;

#[inline(always)]
fn eliminate(
    entries: &mut [f64],
    height: usize,
    least: &[f64],
    progress: &Progress<'_>,
) -> Result<bool, Cancelled> {
    let columns = entries.len() / height;
    for first in (0..least.len()).step_by(BLOCK) {
        progress.check()?;
        let end = (first + BLOCK).min(least.len());
        for column in first..columns {
            let (done, own) = entries.split_at_mut(column * height);
            let own = &mut own[column..height];
            subtract(&done[first * height..column.min(end) * height], height, column, own);
            if column >= end {
                continue;
            }
            // A pivot that is NaN divides no better.
            let divides = own[0] > least[column];
            if !divides {
                return Ok(false);
            }
            let root = own[0].sqrt();
            own.iter_mut().for_each(|entry| *entry /= root);
        }
    }
    Ok(true)
}

/// Subtracts from the rows of a column, from `row` on, its products with those that are done.
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
