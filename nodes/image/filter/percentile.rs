//! The number below which a given share of many numbers lies.

use maquette_value::parallel::*;

use super::hysteresis::{WORD, retain};

/// Numbers that one thread compares at a time: they stay in its first cache.
const CHUNK: usize = 1 << 12;

/// One of so many numbers is in the sample.
const SAMPLED: usize = 256;

/// Of `numbers`, none negative and none NaN, where `within` is 1 (everywhere if left out), the least one that at least
/// `percent` of them do not exceed: the nearest rank, one of the numbers themselves. None if there are none.
///
/// A sample says between which two numbers it lies; one pass counts what is below and picks what is between, a hundredth of all. If the
/// sample was wrong, a second pass looks on the other side of one of the two: Floyd and Rivest, "Expected time bounds for selection",
/// Communications of the ACM 18 (1975), section 2.
pub(crate) fn percentile(numbers: &[f32], within: Option<&[u8]>, percent: f64) -> Option<f32> {
    let share = (percent / 100.0).clamp(0.0, 1.0);
    let mut bounds = estimate(sample(numbers, within), share);
    loop {
        let [least, most] = bounds;
        let ([below, to_least, below_most, total], mut between) = split(numbers, within, bounds);
        let rank = ((share * total as f64).ceil() as usize).max(1) - 1;
        bounds = match rank {
            _ if total == 0 => return None,
            _ if rank < below => [0.0, least],
            _ if rank < to_least => return Some(least),
            _ if rank < below_most => {
                let rank = rank - to_least;
                return Some(*between.select_nth_unstable_by(rank, f32::total_cmp).1);
            }
            _ => [most, f32::INFINITY],
        };
    }
}

fn sample(numbers: &[f32], within: Option<&[u8]>) -> Vec<f32> {
    let places = (0..numbers.len() / SAMPLED)
        .map(sampled)
        .filter(|k| within.is_none_or(|within| within[*k] == 1));
    places.map(|k| numbers[k]).collect()
}

/// A place among the `k`th [`SAMPLED`], such that no pattern of a picture repeats the places.
fn sampled(k: usize) -> usize {
    SAMPLED * k + k.wrapping_mul(0x9e37_79b1) / (1 << 24) % SAMPLED
}

/// Two numbers between which that of this share lies, but for one of some ten thousand samples: four deviations of its rank to either
/// side.
fn estimate(mut sample: Vec<f32>, share: f64) -> [f32; 2] {
    let rank = share * sample.len() as f64;
    let margin = 4.0 * (rank * (1.0 - share)).sqrt() + 1.0;
    [(rank - margin, 0.0), (rank + margin, f32::INFINITY)].map(|(rank, none)| {
        if (0.0..sample.len() as f64).contains(&rank) {
            *sample.select_nth_unstable_by(rank as usize, f32::total_cmp).1
        } else {
            none
        }
    })
}

/// How many numbers inside of the mask are less than the first bound, at most the first, less than the second, and there at all; and
/// those that lie between the bounds.
fn split(numbers: &[f32], within: Option<&[u8]>, bounds: [f32; 2]) -> ([usize; 4], Vec<f32>) {
    let chunks = numbers.par_chunks(CHUNK).enumerate().map(|(chunk, numbers)| {
        let within = within.map(|within| &within[chunk * CHUNK..][..numbers.len()]);
        pulp::Arch::new().dispatch(Chunk { numbers, within, bounds })
    });
    let mut sums = [0; 4];
    let mut between = Vec::new();
    for (counts, numbers) in chunks.collect::<Vec<_>>() {
        sums.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
        between.extend(numbers);
    }
    (sums, between)
}

/// Some numbers, to be compared by wide instructions.
struct Chunk<'a> {
    numbers: &'a [f32],
    within: Option<&'a [u8]>,
    bounds: [f32; 2],
}

impl pulp::NullaryFnOnce for Chunk<'_> {
    type Output = ([usize; 4], Vec<f32>);

    #[inline(always)]
    fn call(self) -> Self::Output {
        let [least, most] = self.bounds;
        let bits = [self.bits(|x| x < least), self.bits(|x| x <= least), self.bits(|x| x < most)];
        let count =
            |words: &[u64]| words.iter().fold(0, |count, word| count + word.count_ones() as usize);
        let [below, to_least, below_most] = bits.each_ref().map(|words| count(words));
        let inside = self.within.map_or(self.numbers.len(), |_| count(&self.bits(|_| true)));
        let mut between = Vec::with_capacity(below_most.saturating_sub(to_least));
        let words = bits[2].iter().zip(&bits[1]).map(|(below, to_least)| below & !to_least);
        for (mut word, numbers) in words.zip(self.numbers.chunks(WORD)) {
            while word != 0 {
                between.push(numbers[word.trailing_zeros() as usize]);
                word &= word - 1;
            }
        }
        ([below, to_least, below_most, inside], between)
    }
}

impl Chunk<'_> {
    /// The numbers inside of the mask for which `is` is true, as set bits.
    #[inline(always)]
    fn bits(&self, is: impl Fn(f32) -> bool) -> [u64; CHUNK / WORD] {
        let mut bits = [u64::MAX; CHUNK / WORD];
        retain(&mut bits, self.numbers, is);
        if let Some(within) = self.within {
            retain(&mut bits, within, |inside| inside == 1);
        }
        bits
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_percentile_is_the_one_of_the_sorted_numbers() {
        let numbers: Vec<f32> = (0..9999u32).map(|k| (k * 7919 % 9999) as f32 * 0.37).collect();
        let mut sorted = numbers.clone();
        sorted.sort_by(f32::total_cmp);
        for (percent, rank) in [(0.0, 0), (0.001, 0), (50.0, 4999), (90.0, 8999), (100.0, 9998)] {
            assert_eq!(percentile(&numbers, None, percent), Some(sorted[rank]), "{percent}");
        }
    }

    #[test]
    fn a_sample_unlike_the_rest_changes_nothing() {
        for odd in [0.0, 500.0, 1e9] {
            let mut numbers: Vec<f32> = (0..90_000u32).map(|k| (k * 7919 % 1009) as f32).collect();
            (0..numbers.len() / SAMPLED).for_each(|k| numbers[sampled(k)] = odd);
            let mut sorted = numbers.clone();
            sorted.sort_by(f32::total_cmp);
            for (percent, rank) in [(0.0, 0), (10.0, 8999), (50.0, 44_999), (100.0, 89_999)] {
                assert_eq!(percentile(&numbers, None, percent), Some(sorted[rank]), "{odd}");
            }
        }
    }

    #[test]
    fn numbers_outside_of_the_mask_do_not_count() {
        let numbers = [5.0, 1.0, 9.0, 2.0];
        assert_eq!(percentile(&numbers, Some(&[0, 1, 0, 1]), 100.0), Some(2.0));
        assert_eq!(percentile(&numbers, Some(&[0; 4]), 50.0), None);
        assert_eq!(percentile(&[], None, 50.0), None);
    }
}
