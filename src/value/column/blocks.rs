//! The hash of a column from those of its blocks.
//!
//! BLAKE3 is a tree: the hashes of blocks that begin at multiples of a power of two are nodes of it, from which the hash of the whole
//! follows. So who keeps them hashes only the blocks that are other ones, and the whole has the hash that it has in one piece.

use std::ops::{Range, RangeInclusive};

use blake3::Hasher;
use blake3::hazmat::{
    ChainingValue, HasherExt, Mode, merge_subtrees_non_root, merge_subtrees_root,
};

use super::changed::append;
use crate::parallel::*;
use crate::{Hash, SEVERAL_THREADS};

/// Bytes of a block: as many as the widest vectors hash at once. A power of two, and whole chunks of BLAKE3.
const BLOCK: usize = 16 << 10;

/// What is hashed before the bytes of the items: their number.
const HEADER: usize = size_of::<u64>();

/// The hashes of the blocks of a column, at least two.
#[derive(Clone)]
pub(super) struct Blocks(Box<[ChainingValue]>);

/// The number of blocks of so many bytes.
fn count(bytes: usize) -> usize {
    (HEADER + bytes).div_ceil(BLOCK)
}

/// The blocks in which some bytes lie; there is at least one byte.
fn around(bytes: Range<usize>) -> RangeInclusive<usize> {
    (HEADER + bytes.start) / BLOCK..=(HEADER + bytes.end - 1) / BLOCK
}

/// The bytes of a block that is full.
fn within(index: usize) -> Range<usize> {
    (index * BLOCK).saturating_sub(HEADER)..(index + 1) * BLOCK - HEADER
}

/// The hash of `items` items and their bytes, if they are one block.
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
    /// Those of so many items with these bytes, which are more than [one block](of_one_block).
    pub(super) fn new(items: usize, bytes: &[u8]) -> Self {
        let block = |index: usize| block(items, bytes, index);
        let blocks = 0..count(bytes.len());
        Self(if bytes.len() < SEVERAL_THREADS {
            blocks.map(block).collect()
        } else {
            blocks.into_par_iter().map(block).collect::<Vec<_>>().into()
        })
    }

    /// The same, after the items in these rows have become others; `size` is that of an item.
    pub(super) fn after(&self, changed: &[Range<u32>], size: usize, bytes: &[u8]) -> Self {
        let mut is_dirty = vec![false; self.0.len()];
        for row in changed.iter().filter(|row| !row.is_empty()) {
            is_dirty[around(row.start as usize * size..row.end as usize * size)].fill(true);
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

    /// Hashes the hashes of the blocks in which some bytes lie; there is at least one byte.
    pub(crate) fn hash_around(&self, bytes: Range<usize>, to: &mut Hasher) {
        to.update(self.0[around(bytes)].as_flattened());
    }

    /// The rows of items of this size, of which there are `len`, that lie in blocks with other hashes than `before`. Both columns have
    /// the same length.
    pub(super) fn changed(&self, before: &Self, len: usize, size: usize) -> Vec<Range<u32>> {
        let mut rows = Vec::new();
        let pairs = self.0.iter().zip(&before.0).enumerate();
        for (index, _) in pairs.filter(|(_, (now, before))| now != before) {
            let Range { start, end } = within(index);
            append(&mut rows, (start / size) as u32..len.min(end.div_ceil(size)) as u32);
        }
        rows
    }

    /// The hash of the whole.
    pub(super) fn whole(&self) -> Hash {
        let (left, right) = halves(&self.0);
        Hash(*merge_subtrees_root(&merged(left), &merged(right), Mode::Hash).as_bytes())
    }
}

fn block(items: usize, bytes: &[u8], index: usize) -> ChainingValue {
    let Range { start: begin, end } = within(index);
    let bytes = &bytes[begin..end.min(bytes.len())];
    match index {
        0 => start(items).update(bytes).finalize_non_root(),
        _ => {
            Hasher::new().set_input_offset((index * BLOCK) as u64).update(bytes).finalize_non_root()
        }
    }
}

/// Blocks of the two subtrees: the left one has as many as a power of two, and at least as many as the right one.
fn halves(blocks: &[ChainingValue]) -> (&[ChainingValue], &[ChainingValue]) {
    blocks.split_at(blocks.len().next_power_of_two() / 2)
}

fn merged(blocks: &[ChainingValue]) -> ChainingValue {
    if let [block] = blocks {
        return *block;
    }
    let (left, right) = halves(blocks);
    merge_subtrees_non_root(&merged(left), &merged(right), Mode::Hash)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lengths around those at which the tree becomes another one.
    fn lengths() -> impl Iterator<Item = usize> {
        fn near(length: usize) -> [usize; 5] {
            [length - 9, length - 8, length - 7, length, length + 1]
        }
        [1, 2, 3, 4, 5, 7, 8, 9, 17, 40].into_iter().flat_map(move |blocks| near(blocks * BLOCK))
    }

    fn bytes(length: usize) -> Vec<u8> {
        (0..length).map(|k| (k * k / 7 + k) as u8).collect()
    }

    fn in_one_piece(items: usize, bytes: &[u8]) -> Hash {
        Hash::of(&[&(items as u64).to_le_bytes(), bytes].concat())
    }

    fn in_blocks(items: usize, bytes: &[u8]) -> Hash {
        of_one_block(items, bytes).unwrap_or_else(|| Blocks::new(items, bytes).whole())
    }

    #[test]
    fn the_hash_is_that_of_the_whole_in_one_piece() {
        for length in [0, 1, 100].into_iter().chain(lengths()) {
            let bytes = bytes(length);
            assert_eq!(in_blocks(length, &bytes), in_one_piece(length, &bytes), "{length}");
        }
    }

    #[test]
    fn where_items_are_others_the_blocks_follow() {
        for length in lengths().filter(|length| BLOCK <= *length) {
            for size in [1, 3, 24] {
                let items = length / size;
                let mut bytes = bytes(items * size);
                if of_one_block(items, &bytes).is_some() {
                    continue;
                }
                let before = Blocks::new(items, &bytes);
                let first = ((BLOCK - HEADER) / size).min(items - 1);
                let places = [0, 1, first, items / 2, items - 1];
                for place in places {
                    bytes[(place + 1) * size - 1] ^= 1;
                }
                let rows = places.map(|place| place as u32..place as u32 + 1);
                let after = before.after(&rows, size, &bytes);
                assert_eq!(after.whole(), in_one_piece(items, &bytes), "{length} {size}");
            }
        }
    }
}
