//! Tables of bytes, filled column by column: what binary formats store.

use std::borrow::Cow;

use bytemuck::{NoUninit, bytes_of};

use crate::pack::Content;
use crate::parallel::*;

/// Rows that one task fills: few enough to stay in a core's cache from column to column.
const BLOCK: usize = 4096;

/// Fills a table with rows of `stride` bytes (at least 1), block by block: `fill` is given a block and the number of its first
/// row.
pub(super) fn fill_blocks(bytes: &mut [u8], stride: usize, fill: impl Fn(&mut [u8], usize) + Sync) {
    bytes
        .par_chunks_mut(BLOCK * stride)
        .enumerate()
        .for_each(|(block, rows)| fill(rows, block * BLOCK));
}

/// Writes the bytes of `entry(item)` at `offset` of each row of `stride` bytes, one item per row.
pub(super) fn fill_column<T, B: NoUninit>(
    rows: &mut [u8],
    stride: usize,
    offset: usize,
    items: &[T],
    entry: impl Fn(&T) -> B,
) {
    for (row, item) in rows.chunks_exact_mut(stride).zip(items) {
        row[offset..][..size_of::<B>()].copy_from_slice(bytes_of(&entry(item)));
    }
}

/// Fills rows of `stride` bytes in, the first of which has this number: given rows, number, stride.
type Fill<'a> = Box<dyn Fn(&mut [u8], usize, usize) + Sync + 'a>;

/// A table of a file, any stretch of which can be made by itself.
pub(super) struct Table<'a> {
    count: usize,
    stride: usize,
    fill: Fill<'a>,
}

impl<'a> Table<'a> {
    /// So many rows of `stride` bytes (at least 1).
    pub(super) fn new(
        count: usize,
        stride: usize,
        fill: impl Fn(&mut [u8], usize, usize) + Sync + 'a,
    ) -> Self {
        Self { count, stride, fill: Box::new(fill) }
    }

    /// Bytes that are there.
    pub(super) fn of_bytes(bytes: Vec<u8>) -> Self {
        Self::new(bytes.len(), 1, move |rows, first, _| {
            rows.copy_from_slice(&bytes[first..][..rows.len()]);
        })
    }

    /// The bytes of `entry(item)`, one item per row.
    pub(super) fn of_column<T: Clone + Send + Sync, B: NoUninit>(
        items: Cow<'a, [T]>,
        entry: impl Fn(&T) -> B + Sync + 'a,
    ) -> Self {
        Self::new(items.len(), size_of::<B>(), move |rows, first, _| {
            for (row, item) in rows.chunks_exact_mut(size_of::<B>()).zip(&items[first..]) {
                row.copy_from_slice(bytes_of(&entry(item)));
            }
        })
    }

    /// How many bytes it has.
    pub(super) fn size(&self) -> usize {
        self.count * self.stride
    }

    /// Fills the bytes of a stretch in. A row that begins before it, or ends behind it, is made as a whole beside it.
    fn fill(&self, place: usize, mut bytes: &mut [u8]) {
        let stride = self.stride;
        let (mut row, lead) = (place / stride, place % stride);
        let whole = |row: usize| {
            let mut bytes = vec![0; stride];
            (self.fill)(&mut bytes, row, stride);
            bytes
        };
        if lead > 0 {
            let count = bytes.len().min(stride - lead);
            let (end, behind) = bytes.split_at_mut(count);
            end.copy_from_slice(&whole(row)[lead..][..count]);
            (bytes, row) = (behind, row + 1);
        }
        let (rows, start) = bytes.split_at_mut(bytes.len() / stride * stride);
        for rows in rows.chunks_mut(BLOCK * stride) {
            (self.fill)(rows, row, stride);
            row += rows.len() / stride;
        }
        if !start.is_empty() {
            start.copy_from_slice(&whole(row)[..start.len()]);
        }
    }
}

/// A file of tables, one behind the other.
pub(super) fn in_pieces(tables: Vec<Table<'_>>) -> Content<'_> {
    let len = tables.iter().map(Table::size).sum();
    Content::pieces(len, move |mut place, mut bytes| {
        let mut end = 0;
        for table in &tables {
            let start = end;
            end += table.size();
            if start <= place && place < end {
                let count = bytes.len().min(end - place);
                let (own, behind) = bytes.split_at_mut(count);
                table.fill(place - start, own);
                (bytes, place) = (behind, place + count);
            }
        }
    })
}

/// Numbers as single precision floats, little endian.
pub(super) fn floats<const N: usize>(numbers: [f64; N]) -> [[u8; 4]; N] {
    numbers.map(|number| (number as f32).to_le_bytes())
}

/// Whole numbers, little endian.
pub(super) fn indices<const N: usize>(numbers: [u32; N]) -> [[u8; 4]; N] {
    numbers.map(u32::to_le_bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_stretch_of_tables_is_that_of_the_whole_file() {
        let numbers = |rows: &mut [u8], first: usize, stride: usize| {
            assert!(!rows.is_empty() && rows.len().is_multiple_of(stride), "whole rows");
            let rows = rows.chunks_exact_mut(stride).zip(first..);
            rows.for_each(|(row, number)| row.fill((number as u8).wrapping_add(1)));
        };
        let tables = vec![
            Table::of_bytes(b"head".to_vec()),
            Table::new(0, 5, numbers),
            Table::new(3, 7, numbers),
            Table::new(BLOCK + 5, 2, numbers),
        ];
        let content = in_pieces(tables);
        let len = content.len();
        let mut whole = vec![0; len];
        content.fill(0, &mut whole);
        assert_eq!(len, 4 + 3 * 7 + (BLOCK + 5) * 2);
        assert_eq!(whole[..13], *b"head\x01\x01\x01\x01\x01\x01\x01\x02\x02");
        for place in (0..40).chain(len - 9..len) {
            for count in (0..30).filter(|count| place + count <= len) {
                let mut bytes = vec![0; count];
                content.fill(place, &mut bytes);
                assert_eq!(bytes, whole[place..][..count], "{place} {count}");
            }
        }
    }
}
