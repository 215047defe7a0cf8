//! Hysteresis: keeps the weak pixels that are connected with strong pixels, 64 pixels at a time.
//!
//! Sweeps over rows of bits, downward and upward, until nothing changes. This is morphological reconstruction of the weak pixels from the
//! strong ones, on packed bits: Vincent, "Morphological grayscale reconstruction in image analysis", IEEE Transactions on Image Processing
//! 2 (1993), section 3. A run of pixels along a row is filled at once, by the carry of an addition. The result does not depend on the order
//! of the sweeps. The usual time is about three passes over the bits; a spiral needs one pass per winding.

use maquette_value::parallel::*;

/// The number of pixels per word.
pub(crate) const WORD: usize = u64::BITS as usize;

/// Rows of bits, one bit per pixel: bit `k` of word `n` of a row is for column `64 n + k`. Bits after the last column are 0.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Bits {
    /// The number of words per row.
    pub(crate) words: usize,
    /// All words, row by row from the top.
    pub(crate) rows: Vec<u64>,
}

impl Bits {
    /// Creates rows without set bits.
    pub(crate) fn new(width: usize, height: usize) -> Self {
        let words = width.div_ceil(WORD);
        Self { words, rows: vec![0; words * height] }
    }
}

/// Clears, in a row of bits, those of pixels for which `is_wanted` is false, and those after the last pixel.
#[inline(always)]
pub(crate) fn retain<T: Copy>(bits: &mut [u64], pixels: &[T], is_wanted: impl Fn(T) -> bool) {
    // Process whole words separately: a loop of fixed length is several times faster.
    let (blocks, rest) = pixels.as_chunks::<WORD>();
    let (words, others) = bits.split_at_mut(blocks.len());
    words.iter_mut().zip(blocks).for_each(|(word, block)| *word &= pack(block, &is_wanted));
    if let [last, unused @ ..] = others {
        *last &= pack(rest, &is_wanted);
        unused.fill(0);
    }
}

/// Packs up to 64 pixels into bits: 1 if `is_wanted` is true for the pixel.
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

/// The number of rows that one task processes.
const STRIP_ROWS: usize = 64;

/// Returns the weak pixels from which a path over weak pixels, along sides and corners, leads to a strong pixel. Each strong pixel must
/// also be weak.
///
/// Strips of rows are processed first, in parallel. Afterwards, only rows at the borders of strips, and rows that these change, can grow.
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

/// Adds connected weak pixels to the rows for which `waiting` is true, and then to neighbors of changed rows, until no row changes.
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

/// Adds to a row the weak pixels that are connected with its own pixels or with those of the neighboring rows. Returns true if the row has
/// changed. `touching` is a buffer for a row, followed by a word that is 0.
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

/// Extends the seeds to the upper ends of the runs of weak bits that contain them. `carry` is passed from one word to the next.
fn run_on(seeds: u64, weak: u64, carry: &mut bool) -> u64 {
    // Adding a seed to its run flips all bits from the seed to the end of the run, except other seeds.
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

    /// Checks the result against the definition: the components of the weak pixels that contain a strong pixel.
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
    fn components_with_a_strong_pixel_are_kept() {
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
