//! Tables of bytes, filled column by column: what binary formats store.

use std::ops::Range;
use std::sync::Arc;

use blake3::Hasher;
use bytemuck::{NoUninit, bytes_of};
use maquette_node::pack::Content;
use maquette_value::parallel::*;
use maquette_value::{Column, Hash};

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

/// The rows of a table.
pub(super) trait Rows: Send + Sync {
    /// Fills rows of `stride` bytes in, the first of which has this number.
    fn fill(&self, rows: &mut [u8], first: usize, stride: usize);

    /// Hashes what tells these rows from others: where this hashes the same, rows of as many bytes are the same.
    fn hash(&self, rows: Range<usize>, to: &mut Hasher);
}

/// A table of a file, any stretch of which can be made by itself.
pub(super) struct Table<'a> {
    count: usize,
    stride: usize,
    rows: Box<dyn Rows + 'a>,
}

/// Bytes that are there.
struct Bytes(Column<u8>);

impl Rows for Bytes {
    fn fill(&self, rows: &mut [u8], first: usize, _: usize) {
        rows.copy_from_slice(&self.0[first..][..rows.len()]);
    }

    fn hash(&self, rows: Range<usize>, to: &mut Hasher) {
        self.0.hash_rows(rows, to);
    }
}

/// The bytes of `entry(item)`, one item per row.
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
    /// So many rows of `stride` bytes (at least 1).
    pub(super) fn new(count: usize, stride: usize, rows: impl Rows + 'a) -> Self {
        Self { count, stride, rows: Box::new(rows) }
    }

    /// Bytes that are there.
    pub(super) fn of_bytes(bytes: Vec<u8>) -> Self {
        Self::of_shared(bytes.into())
    }

    /// Bytes that somebody else has, too.
    pub(super) fn of_shared(bytes: Column<u8>) -> Self {
        Self::new(bytes.len(), 1, Bytes(bytes))
    }

    /// The bytes of `entry(item)`, one item per row; tables of the same name have the same `entry`.
    pub(super) fn of_column<T: NoUninit + Send + Sync, B: NoUninit>(
        name: &'a str,
        items: Column<T>,
        entry: impl Fn(&T) -> B + Send + Sync + 'a,
    ) -> Self {
        Self::new(items.len(), size_of::<B>(), Entries { name, items, entry })
    }

    /// How many bytes it has.
    pub(super) fn size(&self) -> usize {
        self.count * self.stride
    }

    /// Fills the bytes of a stretch in. A row that begins before it, or ends behind it, is made as a whole beside it.
    fn fill(&self, place: usize, mut bytes: &mut [u8]) {
        let stride = self.stride;
        let (mut row, lead) = (place / stride, place % stride);
        fn whole(row: usize, stride: usize, rows: &dyn Rows) -> Vec<u8> {
            let mut bytes = vec![0; stride];
            rows.fill(&mut bytes, row, stride);
            bytes
        }
        if lead > 0 {
            let count = bytes.len().min(stride - lead);
            let (end, behind) = bytes.split_at_mut(count);
            end.copy_from_slice(&whole(row, stride, &*self.rows)[lead..][..count]);
            (bytes, row) = (behind, row + 1);
        }
        let (rows, start) = bytes.split_at_mut(bytes.len() / stride * stride);
        for rows in rows.chunks_mut(BLOCK * stride) {
            self.rows.fill(rows, row, stride);
            row += rows.len() / stride;
        }
        if !start.is_empty() {
            start.copy_from_slice(&whole(row, stride, &*self.rows)[..start.len()]);
        }
    }
}

/// A file of tables, one behind the other.
pub(super) fn in_pieces(tables: Vec<Table<'_>>) -> Content<'_> {
    let tables = Arc::new(tables);
    let same = tables.clone();
    let len = tables.iter().map(Table::size).sum();
    Content::pieces(len, move |place: usize, mut bytes: &mut [u8]| {
        for (table, stretch) in stretches(&tables, place..place + bytes.len()) {
            let (own, behind) = bytes.split_at_mut(stretch.len());
            table.fill(stretch.start, own);
            bytes = behind;
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

/// The tables that have bytes in a stretch of a file, in order, and which bytes of each.
fn stretches<'t, 'a>(
    tables: &'t [Table<'a>],
    stretch: Range<usize>,
) -> impl Iterator<Item = (&'t Table<'a>, Range<usize>)> {
    let mut end = 0;
    tables.iter().filter_map(move |table| {
        let start = end;
        end += table.size();
        let own = stretch.start.max(start)..stretch.end.min(end);
        (!own.is_empty()).then(|| (table, own.start - start..own.end - start))
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

    /// Rows that are full of their number.
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
    fn any_stretch_of_tables_is_that_of_the_whole_file() {
        let tables = vec![
            Table::of_bytes(b"head".to_vec()),
            Table::new(0, 5, Numbers),
            Table::new(3, 7, Numbers),
            Table::new(BLOCK + 5, 2, Numbers),
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
