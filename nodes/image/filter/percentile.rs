//! Percentiles of many numbers, such as the gradients of a picture.

use maquette_value::parallel::*;

use super::hysteresis::{WORD, retain};

/// The count of numbers that one task processes: few enough to stay in the first-level cache.
const CHUNK: usize = 1 << 12;

/// One number in 256 is in the sample from which bounds are estimated.
const SAMPLED: usize = 256;

/// Returns the smallest of the numbers such that at least `percent` percent of them are not greater: the nearest rank. Only numbers for
/// which `within` is 1 count; if `within` is `None`, all numbers count. `numbers` must be neither negative nor NaN. Returns `None` if no
/// number counts.
///
/// A sample gives a lower and an upper bound for the result. One pass counts the numbers below the bounds and collects the numbers between
/// them, about a hundredth of all. If the result is not between the bounds, a second pass searches beyond one of them: Floyd and Rivest,
/// "Expected time bounds for selection", Communications of the ACM 18 (1975), section 2.
pub(crate) fn percentile(numbers: &[f32], within: Option<&[u8]>, percent: f64) -> Option<f32> {
    let fraction = (percent / 100.0).clamp(0.0, 1.0);
    let mut bounds = estimate(sample(numbers, within), fraction);
    loop {
        let [low, high] = bounds;
        let ([below, to_least, below_most, total], mut between) = split(numbers, within, bounds);
        let rank = ((fraction * total as f64).ceil() as usize).max(1) - 1;
        bounds = match rank {
            _ if total == 0 => return None,
            _ if rank < below => [0.0, low],
            _ if rank < to_least => return Some(low),
            _ if rank < below_most => {
                let rank = rank - to_least;
                return Some(*between.select_nth_unstable_by(rank, f32::total_cmp).1);
            }
            _ => [high, f32::INFINITY],
        };
    }
}

fn sample(numbers: &[f32], within: Option<&[u8]>) -> Vec<f32> {
    let indices = (0..numbers.len() / SAMPLED)
        .map(sample_index)
        .filter(|k| within.is_none_or(|within| within[*k] == 1));
    indices.map(|k| numbers[k]).collect()
}

/// Returns a pseudorandom index in the `k`th block of [`SAMPLED`] numbers. With regular indices, a regular pattern in the picture would
/// falsify the sample.
fn sample_index(k: usize) -> usize {
    SAMPLED * k + k.wrapping_mul(0x9e37_79b1) / (1 << 24) % SAMPLED
}

/// Returns a lower and an upper bound for the percentile: the sampled numbers whose ranks are four standard deviations below and above the
/// expected rank. For about one of ten thousand samples, the percentile is not between the bounds.
fn estimate(mut sample: Vec<f32>, fraction: f64) -> [f32; 2] {
    let rank = fraction * sample.len() as f64;
    let margin = 4.0 * (rank * (1.0 - fraction)).sqrt() + 1.0;
    [(rank - margin, 0.0), (rank + margin, f32::INFINITY)].map(|(rank, none)| {
        if (0.0..sample.len() as f64).contains(&rank) {
            *sample.select_nth_unstable_by(rank as usize, f32::total_cmp).1
        } else {
            none
        }
    })
}

/// Counts the numbers inside the mask: those less than the first bound, those not greater than the first bound, those less than the second
/// bound, and all. Also returns the numbers between the bounds.
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

/// A kernel that compares numbers with two bounds; dispatched to SIMD code.
struct Chunk<'a> {
    numbers: &'a [f32],
    within: Option<&'a [u8]>,
    bounds: [f32; 2],
}

impl pulp::NullaryFnOnce for Chunk<'_> {
    type Output = ([usize; 4], Vec<f32>);

    #[inline(always)]
    fn call(self) -> Self::Output {
        let [low, high] = self.bounds;
        let bits = [self.bits(|x| x < low), self.bits(|x| x <= low), self.bits(|x| x < high)];
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
    /// Returns one bit per number: 1 if the number is inside the mask and `is` returns true for the number.
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
            (0..numbers.len() / SAMPLED).for_each(|k| numbers[sample_index(k)] = odd);
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
