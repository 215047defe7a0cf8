//! The components of labels, each by itself: as small as it is, though it lies in the whole picture.
//!
//! Equal labels have equal hashes, so a component has that of the picture that is background but for it. It is had without that
//! picture: blake3 hashes a tree of chunks, and chunks of nothing but background are hashed once for all components. One that was there
//! before, run for run, is taken over: of what an artist changes, most is as it was.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use blake3::hazmat::{HasherExt, Mode, merge_subtrees_non_root, merge_subtrees_root};

use super::{LabelRun, Labels, Pixels, runs_of, statistics};
use crate::memory::huge_vec;
use crate::parallel::*;
use crate::{AnyValue, Column, Hash, NoElements};

/// One component.
#[derive(Debug)]
pub(super) struct One {
    width: usize,
    height: usize,
    /// Row by row from the top, all with the label 1.
    runs: Vec<LabelRun>,
    /// That of the column of all pixels.
    hash: Hash,
    pixels: OnceLock<Column<u32>>,
}

impl One {
    pub(super) fn hash(&self) -> Hash {
        self.hash
    }

    /// How much memory it holds; what is made of it when somebody asks for all pixels does not count.
    pub(super) fn size(&self) -> usize {
        size_of_val(&self.runs[..])
    }

    pub(super) fn contains(&self, [column, row]: [usize; 2]) -> bool {
        let behind = self
            .runs
            .partition_point(|run| (run.row as usize, run.start as usize) <= (row, column));
        let before = behind.checked_sub(1).map(|run| self.runs[run]);
        before.is_some_and(|run| run.row as usize == row && column < run.end as usize)
    }

    pub(super) fn pixels(&self) -> &Column<u32> {
        self.pixels.get_or_init(|| {
            let mut pixels: Vec<u32> = huge_vec(self.width * self.height);
            for run in &self.runs {
                let row = run.row as usize * self.width;
                pixels[row + run.start as usize..row + run.end as usize].fill(1);
            }
            Column::of_hash(pixels, self.hash)
        })
    }
}

/// The components, in the order of their numbers.
pub(super) fn cut(
    labels: &Labels,
    most: usize,
    before: &[AnyValue],
) -> Result<Vec<AnyValue>, NoElements> {
    let count = labels.statistics.len();
    if most < count {
        return Err(NoElements::TooMany { count });
    }
    let (width, height) = (labels.width, labels.height);
    let mut runs: Vec<Vec<LabelRun>> = vec![Vec::new(); count];
    for run in runs_of(width, labels.pixels()) {
        runs[run.label as usize - 1].push(LabelRun { label: 1, ..run });
    }
    // No two components of a picture begin at one place.
    let begun = before.iter().filter_map(|value| {
        let Labels { pixels: Pixels::One(one), .. } = value.get()? else { return None };
        let is_as_large = (one.width, one.height) == (width, height);
        Some((*one.runs.first().filter(|_| is_as_large)?, (one, value)))
    });
    let begun: HashMap<LabelRun, (&Arc<One>, &AnyValue)> = begun.collect();
    let background = OnceLock::new();
    // Nearly all of the time goes into hashes.
    Ok(runs
        .into_par_iter()
        .map(|runs: Vec<LabelRun>| {
            let same = runs.first().and_then(|first| begun.get(first));
            if let Some((_, value)) = same.filter(|(one, _)| one.runs == runs) {
                return (*value).clone();
            }
            let hash = background.get_or_init(|| Background::new(width, height)).with(&runs);
            let statistics = statistics(width, height, &runs);
            let one = One { width, height, runs, hash, pixels: OnceLock::new() };
            AnyValue::new(Labels { width, height, pixels: Pixels::One(one.into()), statistics })
        })
        .collect())
}

/// The bytes of a chunk.
const CHUNK: usize = blake3::CHUNK_LEN;

/// The hash of the column of a picture's pixels of which none has a label, as a tree.
struct Background {
    width: usize,
    /// The bytes that are hashed: the number of pixels in eight, and four for each.
    bytes: usize,
    root: Part,
}

/// A part of the tree: what it is hashed to, and the two halves of more than one chunk.
struct Part {
    value: [u8; 32],
    halves: Option<Box<[Self; 2]>>,
    /// The chunk behind it.
    end: usize,
}

/// A chunk that is not all background, by its number.
type Chunk = (usize, [u8; CHUNK]);

impl Background {
    fn new(width: usize, height: usize) -> Self {
        let bytes = 8 + 4 * width * height;
        let mut background = Self { width, bytes, root: Part::chunk([0; 32], 1) };
        background.root = background.part(0, bytes.div_ceil(CHUNK));
        background
    }

    /// The part of the tree from one chunk to another.
    fn part(&self, start: usize, end: usize) -> Part {
        if end - start == 1 {
            return Part::chunk(self.hashed(&self.empty(start)), end);
        }
        // The left half is as large as a whole tree can be, and leaves something to the right one.
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

    fn hashed(&self, chunk: &Chunk) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new();
        hasher.set_input_offset((chunk.0 * CHUNK) as u64).update(self.content(chunk));
        hasher.finalize_non_root()
    }

    /// The hash of the column in which these runs have the label 1.
    fn with(&self, runs: &[LabelRun]) -> Hash {
        let mut chunks: Vec<Chunk> = Vec::new();
        for run in runs {
            let row = 8 + 4 * run.row as usize * self.width;
            let mut at = row + 4 * run.start as usize;
            // A chunk begins with a whole pixel, because its size and that of what comes first are multiples of four.
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
        let [left, right] = self.changed(halves, &chunks);
        Hash(*merge_subtrees_root(&left, &right, Mode::Hash).as_bytes())
    }

    /// What two halves are hashed to with these chunks in them.
    fn changed(&self, halves: &[Part; 2], chunks: &[Chunk]) -> [[u8; 32]; 2] {
        let (left, right) = chunks.split_at(chunks.partition_point(|it| it.0 < halves[0].end));
        let value = |half: &Part, chunks: &[Chunk]| match (chunks, &half.halves) {
            ([], _) => half.value,
            (_, Some(halves)) => {
                let [left, right] = self.changed(halves, chunks);
                merge_subtrees_non_root(&left, &right, Mode::Hash)
            }
            ([chunk, ..], None) => self.hashed(chunk),
        };
        [value(&halves[0], left), value(&halves[1], right)]
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

    /// A picture of many small components, row by row.
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
    fn an_element_is_the_picture_that_is_background_but_for_its_component() {
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
    fn what_was_there_before_is_taken_over_if_every_run_is_the_same() {
        let before = cut(&spots(64, 40), usize::MAX, &[]).unwrap();
        // One loses a pixel in its last row, one is gone, and one of another size begins where another one did.
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
        fn one(value: &AnyValue) -> Arc<One> {
            match &value.get::<Labels>().unwrap().pixels {
                Pixels::One(one) => one.clone(),
                Pixels::All(_) => panic!("a component is kept as runs"),
            }
        }
        for (before, same) in [(&before[..], before.len() - 3), (&before[..0], 0)] {
            let found = cut(&labels, usize::MAX, before).unwrap();
            assert_eq!(hashes(&found), hashes(&alone));
            let is_taken = |found: &&AnyValue| {
                before.iter().any(|before| Arc::ptr_eq(&one(before), &one(found)))
            };
            assert_eq!(found.iter().filter(is_taken).count(), same);
        }
        // Those of a wider picture lie elsewhere.
        let wide = cut(&spots(65, 40), usize::MAX, &before).unwrap();
        assert_eq!(hashes(&wide), hashes(&cut(&spots(65, 40), usize::MAX, &[]).unwrap()));
    }

    #[test]
    fn more_components_than_are_wanted_are_counted() {
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
