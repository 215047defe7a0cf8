//! The number below which a given share of many numbers lies.

use maquette::parallel::*;

/// Numbers that one thread counts at a time.
const CHUNK: usize = 1 << 20;

/// Of `numbers`, none negative and none NaN, where `within` is 1 (everywhere if left out), the least one that at least
/// `percent` of them do not exceed: the nearest rank, one of the numbers themselves. None if there are none.
///
/// Two passes count the numbers, whose order is that of their bits: one by their upper 16 bits, the other by the lower ones those that
/// have the upper bits of the one looked for.
pub(crate) fn percentile(numbers: &[f32], within: Option<&[u8]>, percent: f64) -> Option<f32> {
    let counts = count(numbers, within, |numbers, counts| {
        (0..).zip(numbers).for_each(|(k, number)| counts[upper_bits(*number)][k % 2] += 1);
    });
    let total: u64 = counts.iter().sum();
    let rank = ((percent / 100.0 * total as f64).ceil() as u64).clamp(1, total.max(1)) - 1;
    let (upper, rank) = find(&counts, rank)?;
    let counts = count(numbers, within, |numbers, counts| {
        // Few are alike: whether any of some is, is found by wide instructions.
        for numbers in numbers.chunks(64) {
            if numbers.iter().fold(false, |any, number| any | (upper_bits(*number) == upper)) {
                let alike = (0..).zip(numbers).filter(|(_, number)| upper_bits(**number) == upper);
                alike
                    .for_each(|(k, number)| counts[number.to_bits() as usize & 0xffff][k % 2] += 1);
            }
        }
    });
    let (lower, _) = find(&counts, rank)?;
    Some(f32::from_bits((upper << 16 | lower) as u32))
}

fn upper_bits(number: f32) -> usize {
    (number.to_bits() >> 16) as usize
}

/// Where the number of this rank was counted, and its rank there.
fn find(counts: &[u64], mut rank: u64) -> Option<(usize, u64)> {
    for (place, &count) in counts.iter().enumerate() {
        if rank < count {
            return Some((place, rank));
        }
        rank -= count;
    }
    None
}

/// The sums of what `f` counts of the numbers inside of the mask, some at a time, in 2^16 pairs. Neighbors are often alike; with two
/// counts for each the processor need not wait for the sum just written.
fn count(
    numbers: &[f32],
    within: Option<&[u8]>,
    f: impl Fn(&[f32], &mut [[u32; 2]]) + Sync + Send + Copy,
) -> Vec<u64> {
    let of_chunk = |(chunk, numbers): (usize, &[f32])| {
        let mut counts = vec![[0; 2]; 1 << 16];
        match within {
            None => f(numbers, &mut counts),
            Some(within) => {
                let pairs = numbers.iter().zip(&within[chunk * CHUNK..]);
                let inside = pairs.filter(|(_, inside)| **inside == 1).map(|(number, _)| *number);
                f(&Vec::from_iter(inside), &mut counts);
            }
        }
        counts
    };
    let mut sums = vec![0; 1 << 16];
    for counts in numbers.par_chunks(CHUNK).enumerate().map(of_chunk).collect::<Vec<_>>() {
        sums.iter_mut().zip(counts).for_each(|(sum, [a, b])| *sum += u64::from(a) + u64::from(b));
    }
    sums
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
    fn numbers_outside_of_the_mask_do_not_count() {
        let numbers = [5.0, 1.0, 9.0, 2.0];
        assert_eq!(percentile(&numbers, Some(&[0, 1, 0, 1]), 100.0), Some(2.0));
        assert_eq!(percentile(&numbers, Some(&[0; 4]), 50.0), None);
        assert_eq!(percentile(&[], None, 50.0), None);
    }
}
