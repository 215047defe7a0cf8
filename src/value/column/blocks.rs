//! The hash of a column, computed from the hashes of its blocks.
//!
//! BLAKE3 is a tree hash. Blocks that begin at multiples of a power of two are subtrees of that tree, so the root hash follows from the
//! hashes of the blocks. If the block hashes are stored, only changed blocks must be hashed again, and the result equals the hash of the
//! whole column computed in one pass.

use std::ops::{Range, RangeInclusive};

use blake3::Hasher;
use blake3::hazmat::{
    ChainingValue, HasherExt, Mode, merge_subtrees_non_root, merge_subtrees_root,
};

use super::diff::append;
use crate::parallel::*;
use crate::{Hash, SEVERAL_THREADS};

/// The size of a block in bytes: as many as the widest vector instructions hash at once. It is a power of two and a multiple of BLAKE3's
/// chunk size.
const BLOCK: usize = 16 << 10;

/// The number of bytes that are hashed before the items. They contain the number of items.
const HEADER: usize = size_of::<u64>();

/// The hashes of the blocks of a column that has at least two blocks.
#[derive(Clone)]
pub(super) struct Blocks(Box<[ChainingValue]>);

/// The number of blocks that hold `bytes` bytes of items.
fn count(bytes: usize) -> usize {
    (HEADER + bytes).div_ceil(BLOCK)
}

/// The indices of the blocks that contain a range of the items' bytes. The range must not be empty.
fn blocks_of_bytes(bytes: Range<usize>) -> RangeInclusive<usize> {
    (HEADER + bytes.start) / BLOCK..=(HEADER + bytes.end - 1) / BLOCK
}

/// The range of the items' bytes that the block `index` contains, if the block is full.
fn bytes_of_block(index: usize) -> Range<usize> {
    (index * BLOCK).saturating_sub(HEADER)..(index + 1) * BLOCK - HEADER
}

/// The hash of a column: of the number of its items and their bytes. `None` if the items fill more than one block.
pub(super) fn of_one_block(items: usize, bytes: &[u8]) -> Option<Hash> {
    let is_one = count(bytes.len()) == 1;
    is_one.then(|| Hash(*start(items).update(bytes).finalize().as_bytes()))
}

fn start(items: usize) -> Hasher {
    let mut hasher = Hasher::new();
    hasher.update(&(items as u64).to_le_bytes());
    hasher
}

impl Blocks {
    /// The hashes of the blocks of a column with `items` items whose bytes are `bytes`. The items must fill more than [one
    /// block](of_one_block).
    pub(super) fn new(items: usize, bytes: &[u8]) -> Self {
        let block = |index: usize| block(items, bytes, index);
        let blocks = 0..count(bytes.len());
        Self(if bytes.len() < SEVERAL_THREADS {
            blocks.map(block).collect()
        } else {
            blocks.into_par_iter().map(block).collect::<Vec<_>>().into()
        })
    }

    /// The hashes of the blocks after the items in the given rows have changed. `size` is the size of an item in bytes.
    pub(super) fn with_changed_rows(
        &self,
        changed: &[Range<u32>],
        size: usize,
        bytes: &[u8],
    ) -> Self {
        let mut is_dirty = vec![false; self.0.len()];
        for row in changed.iter().filter(|row| !row.is_empty()) {
            is_dirty[blocks_of_bytes(row.start as usize * size..row.end as usize * size)]
                .fill(true);
        }
        let dirty: Vec<_> = (0..self.0.len()).filter(|&index| is_dirty[index]).collect();
        let hashes: Vec<ChainingValue> = dirty
            .par_iter()
            .with_min_len(4)
            .map(|&index| block(bytes.len() / size, bytes, index))
            .collect();
        let mut blocks = self.0.clone();
        dirty.iter().zip(hashes).for_each(|(&index, hash)| blocks[index] = hash);
        Self(blocks)
    }

    /// Feeds the hashes of the blocks that contain the given bytes to a hasher. The range of bytes must not be empty.
    pub(crate) fn hash_around(&self, bytes: Range<usize>, to: &mut Hasher) {
        to.update(self.0[blocks_of_bytes(bytes)].as_flattened());
    }

    /// The rows of items whose blocks have other hashes than in `before`. Both columns have `len` items of `size` bytes.
    pub(super) fn changed_rows(&self, before: &Self, len: usize, size: usize) -> Vec<Range<u32>> {
        let mut rows = Vec::new();
        let pairs = self.0.iter().zip(&before.0).enumerate();
        for (index, _) in pairs.filter(|(_, (now, before))| now != before) {
            let Range { start, end } = bytes_of_block(index);
            append(&mut rows, (start / size) as u32..len.min(end.div_ceil(size)) as u32);
        }
        rows
    }

    /// The root hash: the hash of the whole column.
    pub(super) fn root(&self) -> Hash {
        let (left, right) = halves(&self.0);
        Hash(*merge_subtrees_root(&merge(left), &merge(right), Mode::Hash).as_bytes())
    }
}

fn block(items: usize, bytes: &[u8], index: usize) -> ChainingValue {
    let Range { start: begin, end } = bytes_of_block(index);
    let bytes = &bytes[begin..end.min(bytes.len())];
    match index {
        0 => start(items).update(bytes).finalize_non_root(),
        _ => later_block(bytes, index),
    }
}

/// The hash of a block that is not the first one. `bytes` are the bytes of the block.
fn later_block(bytes: &[u8], index: usize) -> ChainingValue {
    Hasher::new().set_input_offset((index * BLOCK) as u64).update(bytes).finalize_non_root()
}

/// Computes the hash of a column that is never in memory as a whole. Keeps 32 bytes for each 16 KiB of the column.
#[derive(Default)]
pub(crate) struct ColumnHasher {
    items: usize,
    /// The bytes of the first block, whose hash depends on the number of items.
    first: Vec<u8>,
    /// The hashes of the full blocks after the first one.
    later: Vec<ChainingValue>,
    /// The bytes after these blocks.
    rest: Vec<u8>,
}

impl ColumnHasher {
    /// Appends items to the column. `bytes` are the bytes of the items.
    pub(crate) fn push(&mut self, items: usize, bytes: &[u8]) {
        self.items += items;
        let (first, bytes) = bytes.split_at(bytes.len().min(BLOCK - HEADER - self.first.len()));
        self.first.extend_from_slice(first);
        self.rest.extend_from_slice(bytes);
        let full = self.rest.len() - self.rest.len() % BLOCK;
        let next = 1 + self.later.len();
        let blocks = self.rest[..full].par_chunks(BLOCK).enumerate();
        let hashes: Vec<_> = blocks.map(|(k, block)| later_block(block, next + k)).collect();
        self.later.extend(hashes);
        self.rest.drain(..full);
    }

    /// The hash of the column.
    pub(crate) fn finish(mut self) -> Hash {
        if self.later.is_empty() && self.rest.is_empty() {
            return Hash(*start(self.items).update(&self.first).finalize().as_bytes());
        }
        if !self.rest.is_empty() {
            self.later.push(later_block(&self.rest, 1 + self.later.len()));
        }
        let first = start(self.items).update(&self.first).finalize_non_root();
        let blocks: Vec<_> = [first].into_iter().chain(self.later).collect();
        Blocks(blocks.into()).root()
    }
}

/// The blocks of the left and the right subtree. The number of blocks in the left one is a power of two and at least the number in the
/// right one.
fn halves(blocks: &[ChainingValue]) -> (&[ChainingValue], &[ChainingValue]) {
    blocks.split_at(blocks.len().next_power_of_two() / 2)
}

fn merge(blocks: &[ChainingValue]) -> ChainingValue {
    if let [block] = blocks {
        return *block;
    }
    let (left, right) = halves(blocks);
    merge_subtrees_non_root(&merge(left), &merge(right), Mode::Hash)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lengths in bytes, near those at which the shape of the hash tree changes.
    fn lengths() -> impl Iterator<Item = usize> {
        fn lengths_near(length: usize) -> [usize; 5] {
            [length - 9, length - 8, length - 7, length, length + 1]
        }
        [1, 2, 3, 4, 5, 7, 8, 9, 17, 40]
            .into_iter()
            .flat_map(move |blocks| lengths_near(blocks * BLOCK))
    }

    fn bytes(length: usize) -> Vec<u8> {
        (0..length).map(|k| (k * k / 7 + k) as u8).collect()
    }

    fn in_one_piece(items: usize, bytes: &[u8]) -> Hash {
        Hash::compute(&[&(items as u64).to_le_bytes(), bytes].concat())
    }

    fn in_blocks(items: usize, bytes: &[u8]) -> Hash {
        of_one_block(items, bytes).unwrap_or_else(|| Blocks::new(items, bytes).root())
    }

    #[test]
    fn block_hashes_give_the_hash_of_the_whole_column() {
        for length in [0, 1, 100].into_iter().chain(lengths()) {
            let bytes = bytes(length);
            assert_eq!(in_blocks(length, &bytes), in_one_piece(length, &bytes), "{length}");
        }
    }

    #[test]
    fn a_column_in_pieces_has_the_hash_of_the_whole_column() {
        for length in [0, 1, 100].into_iter().chain(lengths()) {
            let bytes = bytes(length);
            for piece in [length.max(1), BLOCK, 1000, 70_001] {
                let mut hasher = ColumnHasher::default();
                bytes.chunks(piece).for_each(|piece| hasher.push(piece.len(), piece));
                assert_eq!(hasher.finish(), in_one_piece(length, &bytes), "{length} {piece}");
            }
        }
    }

    #[test]
    fn changed_items_change_their_blocks() {
        for length in lengths().filter(|length| BLOCK <= *length) {
            for size in [1, 3, 24] {
                let items = length / size;
                let mut bytes = bytes(items * size);
                if of_one_block(items, &bytes).is_some() {
                    continue;
                }
                let before = Blocks::new(items, &bytes);
                let first = ((BLOCK - HEADER) / size).min(items - 1);
                let indices = [0, 1, first, items / 2, items - 1];
                for index in indices {
                    bytes[(index + 1) * size - 1] ^= 1;
                }
                let rows = indices.map(|index| index as u32..index as u32 + 1);
                let after = before.with_changed_rows(&rows, size, &bytes);
                assert_eq!(after.root(), in_one_piece(items, &bytes), "{length} {size}");
            }
        }
    }
}
