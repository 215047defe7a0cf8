//! Tables of bytes in binary formats, filled column by column.

use std::ops::Range;
use std::sync::Arc;

use blake3::Hasher;
use bytemuck::{NoUninit, bytes_of};
use maquette_node::pack::Content;
use maquette_value::parallel::*;
use maquette_value::{Column, Hash};

/// The number of rows per task. A block of this many rows is small enough to stay in a core's cache while it is filled column by column.
const BLOCK: usize = 4096;

/// Fills a table with rows of `stride` bytes (at least 1), block by block. `fill` receives a block of rows and the index of its first row.
pub(super) fn fill_blocks(bytes: &mut [u8], stride: usize, fill: impl Fn(&mut [u8], usize) + Sync) {
    bytes
        .par_chunks_mut(BLOCK * stride)
        .enumerate()
        .for_each(|(block, rows)| fill(rows, block * BLOCK));
}

/// Writes a column of a table: the bytes of `entry(item)` at `offset` of each row of `stride` bytes, one item per row.
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

/// The content of a table's rows.
pub(super) trait Rows: Send + Sync {
    /// Fills rows of `stride` bytes. The first of them is the row with the index `first`.
    fn fill(&self, rows: &mut [u8], first: usize, stride: usize);

    /// Hashes the content of some rows. Equal hashes mean equal bytes if the rows have equal length.
    fn hash(&self, rows: Range<usize>, to: &mut Hasher);
}

/// A table in a file. Any range of its bytes can be generated separately.
pub(super) struct Table<'a> {
    count: usize,
    stride: usize,
    rows: Box<dyn Rows + 'a>,
}

/// A table whose bytes are stored in memory.
struct Bytes(Column<u8>);

impl Rows for Bytes {
    fn fill(&self, rows: &mut [u8], first: usize, _: usize) {
        rows.copy_from_slice(&self.0[first..][..rows.len()]);
    }

    fn hash(&self, rows: Range<usize>, to: &mut Hasher) {
        self.0.hash_rows(rows, to);
    }
}

/// A table whose rows are the bytes of `entry(item)`, one item per row.
struct Entries<'a, T, F> {
    name: &'a str,
    items: Column<T>,
    entry: F,
}

impl<T: NoUninit + Send + Sync, B: NoUninit, F: Fn(&T) -> B + Send + Sync> Rows
    for Entries<'_, T, F>
{
    fn fill(&self, rows: &mut [u8], first: usize, stride: usize) {
        for (row, item) in rows.chunks_exact_mut(stride).zip(&self.items[first..]) {
            row.copy_from_slice(bytes_of(&(self.entry)(item)));
        }
    }

    fn hash(&self, rows: Range<usize>, to: &mut Hasher) {
        to.update(self.name.as_bytes());
        self.items.hash_rows(rows, to);
    }
}

impl<'a> Table<'a> {
    /// Creates a table of `count` rows of `stride` bytes (at least 1).
    pub(super) fn new(count: usize, stride: usize, rows: impl Rows + 'a) -> Self {
        Self { count, stride, rows: Box::new(rows) }
    }

    /// Creates a table of the given bytes.
    pub(super) fn from_bytes(bytes: Vec<u8>) -> Self {
        Self::from_shared(bytes.into())
    }

    /// Creates a table of shared bytes.
    pub(super) fn from_shared(bytes: Column<u8>) -> Self {
        Self::new(bytes.len(), 1, Bytes(bytes))
    }

    /// Creates a table whose rows are the bytes of `entry(item)`, one item per row. Tables with the same `name` must have the same `entry`,
    /// because the name is hashed in place of the function.
    pub(super) fn from_column<T: NoUninit + Send + Sync, B: NoUninit>(
        name: &'a str,
        items: Column<T>,
        entry: impl Fn(&T) -> B + Send + Sync + 'a,
    ) -> Self {
        Self::new(items.len(), size_of::<B>(), Entries { name, items, entry })
    }

    /// The size in bytes.
    pub(super) fn size(&self) -> usize {
        self.count * self.stride
    }

    /// Fills `bytes` with the table's bytes, beginning at position `offset`. Rows that are only partly inside the range are generated
    /// separately.
    fn fill(&self, offset: usize, mut bytes: &mut [u8]) {
        let stride = self.stride;
        let (mut row, lead) = (offset / stride, offset % stride);
        fn fill_row(row: usize, stride: usize, rows: &dyn Rows) -> Vec<u8> {
            let mut bytes = vec![0; stride];
            rows.fill(&mut bytes, row, stride);
            bytes
        }
        if lead > 0 {
            let count = bytes.len().min(stride - lead);
            let (end, remaining) = bytes.split_at_mut(count);
            end.copy_from_slice(&fill_row(row, stride, &*self.rows)[lead..][..count]);
            (bytes, row) = (remaining, row + 1);
        }
        let (rows, start) = bytes.split_at_mut(bytes.len() / stride * stride);
        for rows in rows.chunks_mut(BLOCK * stride) {
            self.rows.fill(rows, row, stride);
            row += rows.len() / stride;
        }
        if !start.is_empty() {
            start.copy_from_slice(&fill_row(row, stride, &*self.rows)[..start.len()]);
        }
    }
}

/// Concatenates tables to the content of a file.
pub(super) fn concatenate(tables: Vec<Table<'_>>) -> Content<'_> {
    let tables = Arc::new(tables);
    let same = tables.clone();
    let len = tables.iter().map(Table::size).sum();
    Content::pieces(len, move |offset: usize, mut bytes: &mut [u8]| {
        for (table, stretch) in stretches(&tables, offset..offset + bytes.len()) {
            let (part, remaining) = bytes.split_at_mut(stretch.len());
            table.fill(stretch.start, part);
            bytes = remaining;
        }
    })
    .made_of(move |stretch| {
        let mut to = Hasher::new();
        for (table, Range { start, end }) in stretches(&same, stretch) {
            let numbers = [table.count, table.stride, start, end].map(usize::to_le_bytes);
            to.update(numbers.as_flattened());
            table.rows.hash(start / table.stride..end.div_ceil(table.stride), &mut to);
        }
        Hash(*to.finalize().as_bytes())
    })
}

/// Returns the tables that have bytes in the range `stretch` of the file, in order. Each comes with the part of the range that is inside
/// the table, counted from the start of the table.
fn stretches<'t, 'a>(
    tables: &'t [Table<'a>],
    stretch: Range<usize>,
) -> impl Iterator<Item = (&'t Table<'a>, Range<usize>)> {
    let mut end = 0;
    tables.iter().filter_map(move |table| {
        let start = end;
        end += table.size();
        let part = stretch.start.max(start)..stretch.end.min(end);
        (!part.is_empty()).then(|| (table, part.start - start..part.end - start))
    })
}

/// Encodes numbers as little-endian single-precision floats.
pub(super) fn floats<const N: usize>(numbers: [f64; N]) -> [[u8; 4]; N] {
    numbers.map(|number| (number as f32).to_le_bytes())
}

/// Encodes integers as little endian.
pub(super) fn indices<const N: usize>(numbers: [u32; N]) -> [[u8; 4]; N] {
    numbers.map(u32::to_le_bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Test rows filled with their index + 1.
    struct Numbers;

    impl Rows for Numbers {
        fn fill(&self, rows: &mut [u8], first: usize, stride: usize) {
            assert!(!rows.is_empty() && rows.len().is_multiple_of(stride), "whole rows");
            let rows = rows.chunks_exact_mut(stride).zip(first..);
            rows.for_each(|(row, number)| row.fill((number as u8).wrapping_add(1)));
        }

        fn hash(&self, _: Range<usize>, _: &mut Hasher) {}
    }

    #[test]
    fn any_range_of_tables_equals_that_of_the_whole_file() {
        let tables = vec![
            Table::from_bytes(b"head".to_vec()),
            Table::new(0, 5, Numbers),
            Table::new(3, 7, Numbers),
            Table::new(BLOCK + 5, 2, Numbers),
        ];
        let content = concatenate(tables);
        let len = content.len();
        let mut expected = vec![0; len];
        content.fill(0, &mut expected);
        assert_eq!(len, 4 + 3 * 7 + (BLOCK + 5) * 2);
        assert_eq!(expected[..13], *b"head\x01\x01\x01\x01\x01\x01\x01\x02\x02");
        for offset in (0..40).chain(len - 9..len) {
            for count in (0..30).filter(|count| offset + count <= len) {
                let mut bytes = vec![0; count];
                content.fill(offset, &mut bytes);
                assert_eq!(bytes, expected[offset..][..count], "{offset} {count}");
            }
        }
    }
}
