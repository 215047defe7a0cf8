//! Differences between two columns.

use std::iter;
use std::ops::Range;
use std::sync::Arc;

use bytemuck::NoUninit;

use super::Column;
use crate::parallel::*;

/// The number of items that one task compares: few enough to stay in the processor's cache.
const ITEMS_PER_TASK: usize = 1 << 12;

impl<T: NoUninit + Send + Sync> Column<T> {
    /// The rows of items whose bytes differ from those of the older column `before`, in ascending order and disjoint. `None` if the lengths
    /// of the columns differ. If both columns have been hashed, only the blocks whose hashes differ are compared.
    pub fn changed_rows(&self, before: &Self) -> Option<Vec<Range<u32>>> {
        let len = u32::try_from(self.len()).ok().filter(|_| self.len() == before.len())?;
        if Arc::ptr_eq(&self.0, &before.0) {
            return Some(Vec::new());
        }
        let suspects = match (self.0.blocks.get(), before.0.blocks.get()) {
            (Some(now), Some(before)) => now.changed_rows(before, self.len(), size_of::<T>()),
            _ => iter::once(0..len).collect(),
        };
        let pieces: Vec<_> = suspects
            .into_iter()
            .flat_map(|rows| {
                let end = rows.end;
                rows.step_by(ITEMS_PER_TASK)
                    .map(move |start| start..end.min(start + ITEMS_PER_TASK as u32))
            })
            .collect();
        let found: Vec<Vec<Range<u32>>> = pieces
            .par_iter()
            .with_min_len(4)
            .map(|piece| {
                let mut rows = Vec::new();
                let items = piece.start as usize..piece.end as usize;
                let pairs = self[items.clone()].iter().zip(&before[items]);
                for (row, (now, before)) in piece.clone().zip(pairs) {
                    if bytemuck::bytes_of(now) != bytemuck::bytes_of(before) {
                        append(&mut rows, row..row + 1);
                    }
                }
                rows
            })
            .collect();
        let mut rows = Vec::with_capacity(found.iter().map(Vec::len).sum());
        found.into_iter().flatten().for_each(|row| append(&mut rows, row));
        Some(rows)
    }
}

/// Appends a row to a list of ascending rows, or merges it with the last row if the two touch.
pub(super) fn append(rows: &mut Vec<Range<u32>>, next: Range<u32>) {
    match rows.last_mut() {
        Some(last) if next.start <= last.end => last.end = next.end,
        _ => rows.push(next),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the changed rows, and asserts that comparing with and without hashes gives the same rows.
    fn diff_with_and_without_hashes<T: NoUninit + Send + Sync>(
        now: Vec<T>,
        before: Vec<T>,
    ) -> Option<Vec<Range<u32>>> {
        let [now, before] = [now, before].map(Column::from);
        let plain = now.changed_rows(&before);
        let _ = (now.hash(), before.hash());
        assert_eq!(now.changed_rows(&before), plain);
        plain
    }

    #[test]
    fn rows_are_compared_by_their_bytes() {
        fn single_range(row: Range<u32>) -> Option<Vec<Range<u32>>> {
            Some(Vec::from_iter(iter::once(row)))
        }
        assert_eq!(
            diff_with_and_without_hashes(vec![0.0, 1.0, f64::NAN], vec![-0.0, 1.0, f64::NAN]),
            single_range(0..1)
        );
        assert_eq!(
            diff_with_and_without_hashes(vec![[1u8, 2], [3, 4]], vec![[1, 0], [0, 4]]),
            single_range(0..2)
        );
        assert_eq!(diff_with_and_without_hashes(vec![1, 2], vec![1, 2, 3]), None);
        assert_eq!(diff_with_and_without_hashes(Vec::<u32>::new(), Vec::new()), Some(vec![]));
        let column = Column::from(vec![f64::NAN]);
        assert_eq!(column.changed_rows(&column.clone()), Some(vec![]));
    }

    /// Tests columns whose lengths are near the ends of hash blocks and of parallel tasks. Items of 24 bytes extend across the ends of
    /// blocks.
    #[test]
    fn changed_rows_are_found_at_all_positions() {
        for len in [1_u32, 682, 683, 1365, 1366, 4096, 4097, 20_000] {
            let before: Vec<_> = (0..len).map(|k| [f64::from(k), 0.0, 1.0]).collect();
            let mut now = before.clone();
            let mut expected = Vec::new();
            for rows in [0..1, 681..683, 1364..1367, 4095..4097, 9000..9001, 19_998..20_000] {
                let rows = rows.start.min(len)..rows.end.min(len);
                if !rows.is_empty() {
                    rows.clone().for_each(|row| now[row as usize][row as usize % 3] -= 0.5);
                    append(&mut expected, rows);
                }
            }
            assert_eq!(diff_with_and_without_hashes(now, before), Some(expected), "{len}");
        }
    }
}
