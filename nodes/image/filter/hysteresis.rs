//! Keeps weak pixels that are connected with strong ones, 64 pixels at a time.
//!
//! Rows of bits are swept downwards and upwards until nothing changes: morphological reconstruction of the weak pixels from
//! the strong ones, Vincent, "Morphological grayscale reconstruction in image analysis", IEEE Transactions on Image Processing
//! 2 (1993), section 3, on packed bits. Along a row a whole run is filled at once, because the carry of an addition runs
//! through it. The result does not depend on the order of the sweeps. The time is about that of three passes over the bits;
//! a spiral needs a pass for each of its turns.

use maquette_value::parallel::*;

/// Pixels in a word.
pub(crate) const WORD: usize = u64::BITS as usize;

/// Rows of bits: bit `k` of word `n` of a row is its column `64 n + k`. Bits behind the last column are 0.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Bits {
    /// Words in a row.
    pub(crate) words: usize,
    /// Row by row from the top.
    pub(crate) rows: Vec<u64>,
}

impl Bits {
    /// No bit set.
    pub(crate) fn new(width: usize, height: usize) -> Self {
        let words = width.div_ceil(WORD);
        Self { words, rows: vec![0; words * height] }
    }
}

/// Clears the bits of a row's pixels that are not wanted, and those behind the last one.
#[inline(always)]
pub(crate) fn retain<T: Copy>(bits: &mut [u64], pixels: &[T], is_wanted: impl Fn(T) -> bool) {
    // The loops over whole words have a known length, which makes them several times as fast.
    let (blocks, rest) = pixels.as_chunks::<WORD>();
    let (words, others) = bits.split_at_mut(blocks.len());
    words.iter_mut().zip(blocks).for_each(|(word, block)| *word &= pack(block, &is_wanted));
    if let [last, behind @ ..] = others {
        *last &= pack(rest, &is_wanted);
        behind.fill(0);
    }
}

/// Packs 64 pixels or fewer, those that are wanted as set bits.
#[inline(always)]
fn pack<T: Copy>(pixels: &[T], is_wanted: impl Fn(T) -> bool) -> u64 {
    let mut bytes = [0; WORD];
    bytes.iter_mut().zip(pixels).for_each(|(byte, &pixel)| *byte = u8::from(is_wanted(pixel)));
    let (groups, _) = bytes.as_chunks::<8>();
    (groups.iter().enumerate()).fold(0, |word, (k, group)| {
        // The factor brings the lowest bit of byte i to bit 56 + i.
        let eight = u64::from_le_bytes(*group).wrapping_mul(0x0102_0408_1020_4080) >> 56;
        word | eight << (8 * k)
    })
}

/// Rows that one thread works on at a time.
const STRIP_ROWS: usize = 64;

/// The weak pixels from which a path over weak pixels, along sides and corners, leads to a strong one. Every strong pixel must
/// be weak, too.
///
/// Strips of rows come first, each for itself and in parallel; then only the rows along their borders can still grow.
pub(crate) fn reconstruct(weak: &Bits, strong: Bits) -> Bits {
    let mut kept = strong;
    let words = kept.words.max(1);
    let strips = kept.rows.par_chunks_mut(STRIP_ROWS * words);
    strips.zip(weak.rows.par_chunks(STRIP_ROWS * words)).for_each(|(kept, weak)| {
        let all = vec![true; kept.len() / words];
        grow_rows(words, weak, kept, all);
    });
    let borders = (0..kept.rows.len() / words)
        .map(|row: usize| [0, STRIP_ROWS - 1].contains(&(row % STRIP_ROWS)))
        .collect();
    grow_rows(words, &weak.rows, &mut kept.rows, borders);
    kept
}

/// Lets the rows that wait grow, and those whose neighbor has changed, until none changes.
fn grow_rows(words: usize, weak: &[u64], kept: &mut [u64], mut waiting: Vec<bool>) {
    let height = waiting.len();
    let mut touching = vec![0; words + 1];
    let mut is_done = height == 0;
    while !is_done {
        for row in (0..height).chain((0..height).rev()) {
            if std::mem::take(&mut waiting[row]) && grow(row, weak, kept, &mut touching) {
                waiting[row.saturating_sub(1)] = true;
                waiting[(row + 1).min(height - 1)] = true;
            }
        }
        is_done = !waiting.contains(&true);
    }
}

/// Lets a row grow into what its neighbors and the row itself touch; whether it did. `touching` is room for a row and a word of 0.
fn grow(row: usize, weak: &[u64], kept: &mut [u64], touching: &mut [u64]) -> bool {
    let words = touching.len() - 1;
    let rows = row.saturating_sub(1) * words..kept.len().min((row + 2) * words);
    touching[..words].fill(0);
    for row in kept[rows].chunks_exact(words) {
        touching.iter_mut().zip(row).for_each(|(touching, word)| *touching |= word);
    }
    let weak = &weak[row * words..][..words];
    let here = &mut kept[row * words..][..words];
    let mut changed = 0;
    let (mut carry, mut before) = (false, 0);
    for ((here, &weak), touching) in here.iter_mut().zip(weak).zip(touching.windows(2)) {
        let [word, after] = [touching[0], touching[1]];
        let seeds = word | word << 1 | word >> 1 | before | after << (WORD - 1);
        let grown = run_on(seeds & weak, weak, &mut carry);
        changed |= grown ^ *here;
        (*here, before) = (grown, word >> (WORD - 1));
    }
    carry = false;
    for (here, &weak) in here.iter_mut().zip(weak).rev() {
        let next = *here >> 1 | u64::from(carry) << (WORD - 1);
        if next & weak & !*here != 0 {
            let (seeds, weak) = (here.reverse_bits(), weak.reverse_bits());
            let grown = run_on(seeds, weak, &mut carry).reverse_bits();
            changed |= grown ^ *here;
            *here = grown;
        }
        carry = *here & 1 == 1;
    }
    changed != 0
}

/// Fills the runs of weak bits from their seeds to their upper ends; `carry` goes from one word to the next.
fn run_on(seeds: u64, weak: u64, carry: &mut bool) -> u64 {
    // Adding a seed to its run turns over every bit from the seed to the run's end, but for other seeds.
    let (sum, over) = weak.overflowing_add(seeds);
    let (sum, over_too) = sum.overflowing_add(u64::from(*carry));
    *carry = over | over_too;
    seeds | ((sum ^ weak) & weak)
}

#[cfg(test)]
mod tests {
    use maquette_value::Mask;

    use super::*;
    use crate::{Connectivity, label};

    fn bits(width: usize, pixels: &[u8]) -> Bits {
        let mut bits = Bits::new(width, pixels.len() / width);
        let words = bits.words;
        for (row, pixels) in bits.rows.chunks_mut(words).zip(pixels.chunks(width)) {
            row.fill(u64::MAX);
            retain(row, pixels, |pixel| pixel == 1);
        }
        bits
    }

    /// The definition: components of the weak pixels that have a strong one.
    fn check(width: usize, weak: &[u8], strong: &[u8]) {
        let mask = Mask::new(width, weak.len() / width, weak.to_vec()).unwrap();
        let labels = label(&mask, Connectivity::Eight);
        let mut has_strong = vec![false; labels.statistics().len() + 1];
        for (&label, &strong) in labels.pixels().iter().zip(strong) {
            has_strong[label as usize] |= strong == 1;
        }
        let expected: Vec<u8> = (labels.pixels().iter())
            .map(|&label| u8::from(label != 0 && has_strong[label as usize]))
            .collect();
        let kept = reconstruct(&bits(width, weak), bits(width, strong));
        assert_eq!(kept, bits(width, &expected), "{width}");
    }

    #[test]
    fn what_is_kept_are_the_components_with_a_strong_pixel() {
        let mut state = 1u64;
        fn random(state: &mut u64) -> u64 {
            *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (*state >> 33) % 100
        }
        for width in [1, 3, 63, 64, 65, 127, 130, 200] {
            for density in [20, 35, 41, 60, 95] {
                let weak: Vec<_> =
                    (0..width * 90).map(|_| u8::from(random(&mut state) < density)).collect();
                let strong = weak.iter().map(|weak| weak * u8::from(random(&mut state) < 1));
                check(width, &weak, &strong.collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn a_path_that_winds_through_all_rows_is_kept_to_its_end() {
        let (width, height) = (131, 66);
        fn is_path(index: usize, width: usize, height: usize) -> bool {
            let (column, row) = (index % width, index / width);
            let turn = if column % 4 == 1 { 0 } else { height - 1 };
            column % 2 == 0 || row == turn
        }
        let weak: Vec<_> =
            (0..width * height).map(|index| u8::from(is_path(index, width, height))).collect();
        for start in [0, width * height - 1] {
            let mut strong = vec![0; weak.len()];
            strong[start] = 1;
            check(width, &weak, &strong);
        }
    }
}
