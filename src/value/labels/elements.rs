//! The components of labels as separate values. Each represents the whole picture, but is stored as runs.
//!
//! Equal labels must have equal hashes, so a component has the hash of the whole picture in which only that component is marked. The hash
//! is computed without expanding the picture. BLAKE3 hashes a tree of chunks, and the chunks that contain only background are hashed once
//! for all components. A component with the same runs as a component of the previous labels is reused, because an edit usually leaves most
//! components unchanged.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use blake3::hazmat::{HasherExt, Mode, merge_subtrees_non_root, merge_subtrees_root};

use super::{LabelRun, Labels, Pixels, runs_of, statistics};
use crate::memory::huge_vec;
use crate::parallel::*;
use crate::{AnyValue, Column, Hash, NoElements};

/// One component of a picture, stored as runs.
#[derive(Debug)]
pub(super) struct Component {
    width: usize,
    height: usize,
    /// The runs, row by row from the top, all with the label 1.
    runs: Vec<LabelRun>,
    /// The hash of the column of all pixels.
    hash: Hash,
    pixels: OnceLock<Column<u32>>,
}

impl Component {
    pub(super) fn hash(&self) -> Hash {
        self.hash
    }

    /// The memory of the runs in bytes. The expanded pixels do not count.
    pub(super) fn size(&self) -> usize {
        size_of_val(&self.runs[..])
    }

    pub(super) fn contains(&self, [column, row]: [usize; 2]) -> bool {
        let after = self
            .runs
            .partition_point(|run| (run.row as usize, run.start as usize) <= (row, column));
        let before = after.checked_sub(1).map(|run| self.runs[run]);
        before.is_some_and(|run| run.row as usize == row && column < run.end as usize)
    }

    pub(super) fn pixels(&self) -> &Column<u32> {
        self.pixels.get_or_init(|| {
            let mut pixels: Vec<u32> = huge_vec(self.width * self.height);
            for run in &self.runs {
                let row = run.row as usize * self.width;
                pixels[row + run.start as usize..row + run.end as usize].fill(1);
            }
            Column::with_known_hash(pixels, self.hash)
        })
    }
}

/// Splits labels into their components, in the order of their labels.
pub(super) fn cut(
    labels: &Labels,
    max_count: usize,
    before: &[AnyValue],
) -> Result<Vec<AnyValue>, NoElements> {
    let count = labels.statistics.len();
    if max_count < count {
        return Err(NoElements::TooMany { count });
    }
    let (width, height) = (labels.width, labels.height);
    let mut runs: Vec<Vec<LabelRun>> = vec![Vec::new(); count];
    for run in runs_of(width, labels.pixels()) {
        runs[run.label as usize - 1].push(LabelRun { label: 1, ..run });
    }
    // No two components of a picture begin at the same pixel, so the first run identifies a component.
    let begun = before.iter().filter_map(|value| {
        let Labels { pixels: Pixels::Component(one), .. } = value.get()? else { return None };
        let is_as_large = (one.width, one.height) == (width, height);
        Some((*one.runs.first().filter(|_| is_as_large)?, (one, value)))
    });
    let begun: HashMap<LabelRun, (&Arc<Component>, &AnyValue)> = begun.collect();
    let background = OnceLock::new();
    // The loop is parallel, because hashing takes nearly all of the time.
    Ok(runs
        .into_par_iter()
        .map(|runs: Vec<LabelRun>| {
            let same = runs.first().and_then(|first| begun.get(first));
            if let Some((_, value)) = same.filter(|(one, _)| one.runs == runs) {
                return (*value).clone();
            }
            let hash =
                background.get_or_init(|| Background::new(width, height)).hash_of_runs(&runs);
            let statistics = statistics(width, height, &runs);
            let one = Component { width, height, runs, hash, pixels: OnceLock::new() };
            AnyValue::new(Labels {
                width,
                height,
                pixels: Pixels::Component(one.into()),
                statistics,
            })
        })
        .collect())
}

/// The number of bytes per chunk of BLAKE3.
const CHUNK: usize = blake3::CHUNK_LEN;

/// The hash tree of a picture whose pixels are all background.
struct Background {
    width: usize,
    /// The number of hashed bytes: eight for the number of pixels, plus four per pixel.
    bytes: usize,
    root: Part,
}

/// A node of the hash tree: its hash, and its two children if the node has more than one chunk.
struct Part {
    value: [u8; 32],
    halves: Option<Box<[Self; 2]>>,
    /// The index of the chunk after the last chunk of the node.
    end: usize,
}

/// The index of a chunk among all chunks of the hashed bytes, and its content.
type Chunk = (usize, [u8; CHUNK]);

impl Background {
    fn new(width: usize, height: usize) -> Self {
        let bytes = 8 + 4 * width * height;
        let mut background = Self { width, bytes, root: Part::chunk([0; 32], 1) };
        background.root = background.part(0, bytes.div_ceil(CHUNK));
        background
    }

    /// Builds the node for a range of chunks.
    fn part(&self, start: usize, end: usize) -> Part {
        if end - start == 1 {
            return Part::chunk(self.hash_chunk(&self.empty(start)), end);
        }
        // BLAKE3 requires that the left child is the largest complete tree that leaves at least one chunk to the right child.
        let middle = start + (end - start).next_power_of_two() / 2;
        let halves = [self.part(start, middle), self.part(middle, end)];
        let value = merge_subtrees_non_root(&halves[0].value, &halves[1].value, Mode::Hash);
        Part { value, halves: Some(halves.into()), end }
    }

    fn empty(&self, chunk: usize) -> Chunk {
        let mut bytes = [0; CHUNK];
        if chunk == 0 {
            bytes[..8].copy_from_slice(&((self.bytes as u64 - 8) / 4).to_le_bytes());
        }
        (chunk, bytes)
    }

    fn content<'c>(&self, (chunk, bytes): &'c Chunk) -> &'c [u8] {
        &bytes[..(self.bytes - chunk * CHUNK).min(CHUNK)]
    }

    fn hash_chunk(&self, chunk: &Chunk) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new();
        hasher.set_input_offset((chunk.0 * CHUNK) as u64).update(self.content(chunk));
        hasher.finalize_non_root()
    }

    /// The hash of a picture in which the pixels of the given runs have the label 1.
    fn hash_of_runs(&self, runs: &[LabelRun]) -> Hash {
        let mut chunks: Vec<Chunk> = Vec::new();
        for run in runs {
            let row = 8 + 4 * run.row as usize * self.width;
            let mut at = row + 4 * run.start as usize;
            // Each chunk begins at the start of a pixel, because the sizes of chunks and of the header are multiples of four.
            while at < row + 4 * run.end as usize {
                let chunk = at / CHUNK;
                if chunks.last().is_none_or(|(last, _)| *last != chunk) {
                    chunks.push(self.empty(chunk));
                }
                if let Some((_, bytes)) = chunks.last_mut() {
                    bytes[at % CHUNK] = 1;
                }
                at += 4;
            }
        }
        let Some(halves) = &self.root.halves else {
            let only = chunks.pop().unwrap_or_else(|| self.empty(0));
            return Hash(*blake3::hash(self.content(&only)).as_bytes());
        };
        let [left, right] = self.hash_halves(halves, &chunks);
        Hash(*merge_subtrees_root(&left, &right, Mode::Hash).as_bytes())
    }

    /// The hashes of two nodes of the tree after the given chunks have been replaced.
    fn hash_halves(&self, halves: &[Part; 2], chunks: &[Chunk]) -> [[u8; 32]; 2] {
        let (left, right) = chunks.split_at(chunks.partition_point(|it| it.0 < halves[0].end));
        [self.hash_part(&halves[0], left), self.hash_part(&halves[1], right)]
    }

    /// The hash of a node of the tree after the given chunks have been replaced.
    fn hash_part(&self, part: &Part, chunks: &[Chunk]) -> [u8; 32] {
        match (chunks, &part.halves) {
            ([], _) => part.value,
            (_, Some(halves)) => {
                let [left, right] = self.hash_halves(halves, chunks);
                merge_subtrees_non_root(&left, &right, Mode::Hash)
            }
            ([chunk, ..], None) => self.hash_chunk(chunk),
        }
    }
}

impl Part {
    fn chunk(value: [u8; 32], end: usize) -> Self {
        Self { value, halves: None, end }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::{Value, hash_of};

    /// A picture with many small components, numbered row by row.
    fn spots(width: usize, height: usize) -> Labels {
        Labels::new(
            width,
            height,
            (0..width * height)
                .map(|at: usize| {
                    let [x, y] = [at % width, at / width];
                    if x % 5 < 3 && y % 4 < 2 { (x / 5 + y / 4 * width + 1) as u32 } else { 0 }
                })
                .collect(),
        )
        .unwrap()
    }

    #[test]
    fn an_element_equals_the_picture_with_only_its_component() {
        for (width, height) in [(3, 2), (7, 6), (31, 9), (64, 40), (127, 33), (300, 70)] {
            let labels = spots(width, height);
            let elements = cut(&labels, usize::MAX, &[]).unwrap();
            assert_eq!(elements.len(), labels.statistics().len());
            for (number, element) in (1..).zip(&elements) {
                let alone = labels.pixels().iter().map(|&label| u32::from(label == number));
                let alone = Labels::new(width, height, alone.collect()).unwrap();
                let element: &Labels = element.get().unwrap();
                assert_eq!(hash_of(element), hash_of(&alone), "{width} x {height}, {number}");
                assert_eq!(element.statistics(), alone.statistics());
                assert_eq!(element.component(1), labels.component(number));
                assert_eq!(element, &alone);
            }
        }
    }

    #[test]
    fn components_with_equal_runs_are_reused() {
        let before = cut(&spots(64, 40), usize::MAX, &[]).unwrap();
        // One component loses a pixel in its last row, one component disappears, and a component of another size begins at the first pixel
        // of an old one.
        let mut pixels = spots(64, 40).pixels().to_vec();
        (pixels[64 + 2], pixels[5], pixels[6], pixels[7]) = (0, 0, 0, 0);
        (pixels[64 + 5], pixels[64 + 6], pixels[64 + 7], pixels[13]) = (0, 0, 0, 3);
        let mut order = BTreeMap::new();
        for pixel in pixels.iter_mut().filter(|pixel| **pixel > 0) {
            let next = order.len() as u32 + 1;
            *pixel = *order.entry(*pixel).or_insert(next);
        }
        let labels = Labels::new(64, 40, pixels).unwrap();
        let alone = cut(&labels, usize::MAX, &[]).unwrap();
        fn hashes(all: &[AnyValue]) -> Vec<Hash> {
            all.iter().map(AnyValue::hash).collect::<Vec<_>>()
        }
        fn component(value: &AnyValue) -> Arc<Component> {
            match &value.get::<Labels>().unwrap().pixels {
                Pixels::Component(one) => one.clone(),
                Pixels::All(_) => panic!("a component is kept as runs"),
            }
        }
        for (before, same) in [(&before[..], before.len() - 3), (&before[..0], 0)] {
            let found = cut(&labels, usize::MAX, before).unwrap();
            assert_eq!(hashes(&found), hashes(&alone));
            let is_taken = |found: &&AnyValue| {
                before.iter().any(|before| Arc::ptr_eq(&component(before), &component(found)))
            };
            assert_eq!(found.iter().filter(is_taken).count(), same);
        }
        // In a wider picture the same components have other hashes.
        let wide = cut(&spots(65, 40), usize::MAX, &before).unwrap();
        assert_eq!(hashes(&wide), hashes(&cut(&spots(65, 40), usize::MAX, &[]).unwrap()));
    }

    #[test]
    fn too_many_components_are_counted() {
        let count = spots(20, 8).statistics().len();
        let refused = cut(&spots(20, 8), count - 1, &[]).unwrap_err();
        assert_eq!(refused, NoElements::TooMany { count });
        assert!(cut(&Labels::new(0, 0, vec![]).unwrap(), 0, &[]).unwrap().is_empty());
    }

    #[test]
    fn thousands_of_components_need_little_memory() {
        let elements = cut(&spots(1000, 1000), usize::MAX, &[]).unwrap();
        assert_eq!(elements.len(), 50_000);
        let bytes: usize = elements.iter().map(|it| it.get::<Labels>().unwrap().size()).sum();
        assert!(bytes < 20_000_000, "{bytes}");
    }
}
