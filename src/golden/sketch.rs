//! A few numbers that stand for a whole column: two columns differ in them about as much as in all of their numbers.
//!
//! Each is the sum of the column's numbers, weighed at random. The squared difference of two such sums is, in the mean, the sum
//! of the squared differences of all the numbers: Johnson and Lindenstrauss, "Extensions of Lipschitz mappings into a Hilbert
//! space" (1984). So a handful tells of a million numbers whether any changed, and by how much all of them together, where only
//! some of the numbers were kept, and those rounded.

use maquette_value::parallel::*;
use maquette_value::random::{STEP, mix};

/// How many sums: one would tell whether anything changed, four tell by how much within a factor of about two.
const SUMS: usize = 4;

/// Numbers that are summed together, so that the sums do not depend on the number of threads.
const CHUNK: usize = 1 << 14;

/// What is kept of a column so that any change of it is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sketch {
    sums: [f64; SUMS],
    /// A hash of the bits of all numbers: the sums may miss a change of the last digit of one number.
    bits: u64,
}

impl Sketch {
    /// Unknown numbers count as 0, infinite ones as 1: those that come or go are seen.
    pub(crate) fn of(numbers: &[f64]) -> Self {
        fn of_chunk((chunk, numbers): (usize, &[f64])) -> ([f64; 4], u64) {
            let (mut sums, mut bits) = ([0.0; SUMS], 0u64);
            for (k, x) in numbers.iter().enumerate() {
                let mut state = (chunk * CHUNK + k) as u64;
                // Both zeros are one.
                bits = bits.wrapping_add(mix((x + 0.0).to_bits() ^ mix(state)));
                let x = match x {
                    x if x.is_finite() => *x,
                    x if x.is_nan() => 0.0,
                    x => x.signum(),
                };
                sums.iter_mut().for_each(|sum| *sum += x * weight(&mut state));
            }
            (sums, bits)
        }
        let chunks: Vec<_> = numbers.par_chunks(CHUNK).enumerate().map(of_chunk).collect();
        chunks.iter().fold(Self { sums: [0.0; SUMS], bits: 0 }, |total, (sums, bits)| Self {
            sums: [0, 1, 2, 3].map(|k| total.sums[k] + sums[k]),
            bits: total.bits.wrapping_add(*bits),
        })
    }

    /// About the root of the sum of the squared differences of all numbers; 0 if none differs by more than the last digits.
    pub(crate) fn apart(&self, other: &Self) -> f64 {
        let squares = self.sums.iter().zip(other.sums).map(|(a, b)| (a - b) * (a - b));
        (squares.sum::<f64>() / SUMS as f64).sqrt()
    }

    /// To the last bit.
    pub(crate) fn to_text(self) -> String {
        let [a, b, c, d] = self.sums.map(f64::to_bits);
        [a, b, c, d, self.bits].map(|word| format!("{word:016x}")).join(" ")
    }

    pub(crate) fn read(text: &str) -> Option<Self> {
        let words = text.split(' ').map(|word| u64::from_str_radix(word, 16).ok());
        let [sums @ .., bits]: [u64; SUMS + 1] =
            words.collect::<Option<Vec<_>>>()?.try_into().ok()?;
        Some(Self { sums: sums.map(f64::from_bits), bits })
    }
}

/// The next weight of a row of them, even between the two roots of 3, so that its square is 1 in the mean.
fn weight(state: &mut u64) -> f64 {
    const ROOT_OF_3: f64 = 1.732_050_807_568_877_2;
    const HALF: f64 = (1u64 << 52) as f64;
    *state = state.wrapping_mul(0xd134_2543_de82_ef95).wrapping_add(STEP);
    (mix(*state) >> 11) as f64 * (ROOT_OF_3 / HALF) - ROOT_OF_3
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(n: usize) -> Vec<f64> {
        (0..n).map(|k| 100.0 * libm::sin(k as f64)).collect()
    }

    #[test]
    fn one_changed_number_of_many_is_seen_however_small() {
        let old = column(100_000);
        let before = Sketch::of(&old);
        for (place, by) in [(0, 1e-9), (50_001, -1e-6), (99_999, 3.0)] {
            let mut new = old.clone();
            new[place] += by;
            let apart = before.apart(&Sketch::of(&new));
            assert!(apart > 0.2 * f64::abs(by) && apart < 1.8 * f64::abs(by), "{apart} for {by}");
        }
        let mut unknown = old.clone();
        unknown[777] = f64::NAN;
        assert!(before.apart(&Sketch::of(&unknown)) > 1.0);
        assert_eq!(before.apart(&Sketch::of(&old)), 0.0);
        // Not in the sums, but in the mark.
        let mut last = old.clone();
        last[5] *= 1.0 + f64::EPSILON;
        assert_ne!(before, Sketch::of(&last));
    }

    #[test]
    fn what_is_apart_is_the_root_of_all_squares() {
        let old = column(40_000);
        let new: Vec<f64> = old.iter().map(|x| x + 0.01 * libm::cos(1e4 * x)).collect();
        let exact: f64 = old.iter().zip(&new).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
        let apart = Sketch::of(&old).apart(&Sketch::of(&new));
        assert!(apart > 0.4 * exact && apart < 2.0 * exact, "{apart} {exact}");
    }

    #[test]
    fn a_sketch_is_read_as_it_was_written() {
        let sketch = Sketch::of(&column(1000));
        assert_eq!(Sketch::read(&sketch.to_text()), Some(sketch));
        assert_eq!(Sketch::read("0123"), None);
    }
}
