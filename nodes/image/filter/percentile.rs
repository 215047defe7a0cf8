//! The number below which a given share of many numbers lies.

use std::borrow::Cow;

use maquette::parallel::*;

/// Numbers that one thread counts at a time.
const CHUNK: usize = 1 << 20;

/// Of `numbers`, none negative and none NaN, where `within` is 1 (everywhere if left out), the least one that at least
/// `percent` of them do not exceed: the nearest rank, one of the numbers themselves. None if there are none.
///
/// Two passes: one counts the numbers by their upper 16 bits, whose order is that of the numbers; the other sorts out those
/// that have the same upper bits as the one looked for.
pub(crate) fn percentile(numbers: &[f32], within: Option<&[u8]>, percent: f64) -> Option<f32> {
    let counts = count_by_upper_bits(numbers, within);
    let total: u64 = counts.iter().sum();
    let rank = ((percent / 100.0 * total as f64).ceil() as u64).clamp(1, total.max(1)) - 1;
    let mut before = 0;
    let upper = counts.iter().position(|count| {
        before += count;
        rank < before
    })?;
    let alike = |numbers: &[f32]| -> Vec<f32> {
        numbers.iter().copied().filter(|number| upper_bits(*number) == upper).collect()
    };
    let mut alike =
        inside(numbers, within).map(|numbers| alike(&numbers)).collect::<Vec<_>>().concat();
    let place = (rank - (before - counts[upper])) as usize;
    Some(*alike.select_nth_unstable_by(place, f32::total_cmp).1)
}

fn upper_bits(number: f32) -> usize {
    (number.to_bits() >> 16) as usize
}

/// The numbers inside of the mask, some at a time.
fn inside<'a>(
    numbers: &'a [f32],
    within: Option<&'a [u8]>,
) -> impl Parallel<Item = Cow<'a, [f32]>> {
    numbers.par_chunks(CHUNK).enumerate().map(move |(chunk, numbers)| match within {
        None => Cow::Borrowed(numbers),
        Some(within) => {
            let pairs = numbers.iter().zip(&within[chunk * CHUNK..]);
            pairs.filter(|(_, inside)| **inside == 1).map(|(number, _)| *number).collect()
        }
    })
}

fn count_by_upper_bits(numbers: &[f32], within: Option<&[u8]>) -> Vec<u64> {
    let count = |numbers: Cow<'_, [f32]>| {
        // Neighbors are often alike; with two tables the processor need not wait for the sum just written.
        let mut tables = [vec![0u64; 1 << 16], vec![0u64; 1 << 16]];
        let (pairs, rest) = numbers.as_chunks::<2>();
        for pair in pairs {
            (0..2).for_each(|k| tables[k][upper_bits(pair[k])] += 1);
        }
        rest.iter().for_each(|number| tables[0][upper_bits(*number)] += 1);
        let [a, b] = tables;
        add(a, b)
    };
    inside(numbers, within).map(count).reduce(|| vec![0; 1 << 16], add)
}

fn add(mut a: Vec<u64>, b: Vec<u64>) -> Vec<u64> {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
    a
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
