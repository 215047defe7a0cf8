//! Sketches: a few numbers that represent a whole column. Two sketches differ by about as much as their columns.
//!
//! Each number of a sketch is the sum of the column's numbers, multiplied by random weights. On average, the squared difference of two such
//! sums is the sum of the squared differences of all numbers: Johnson and Lindenstrauss, "Extensions of Lipschitz mappings into a Hilbert
//! space" (1984). A golden may store only some of the numbers, and those rounded. Even then the sketch shows if any number has changed, and
//! by how much in total.

use maquette_value::parallel::*;
use maquette_value::rng::{STEP, mix};

/// The number of sums in a sketch. One sum would show only that something has changed. Four sums also show by how much, within a factor of
/// about two.
const SUMS: usize = 4;

/// The number of numbers in a chunk that is summed separately. It is constant, so the result does not depend on the number of threads.
const CHUNK: usize = 1 << 14;

/// A summary of a column that shows any change of its numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sketch {
    sums: [f64; SUMS],
    /// A hash of the bits of all numbers. It shows a change in the last digit of a number, which the sums may miss.
    bits: u64,
}

impl Sketch {
    /// Computes the sketch of some numbers. NaN counts as 0 and infinity as 1; the hash still shows a change to or from them.
    pub(crate) fn compute(numbers: &[f64]) -> Self {
        fn of_chunk((chunk, numbers): (usize, &[f64])) -> ([f64; 4], u64) {
            let (mut sums, mut bits) = ([0.0; SUMS], 0u64);
            for (k, x) in numbers.iter().enumerate() {
                let mut state = (chunk * CHUNK + k) as u64;
                // Add 0.0 to turn negative zero into positive zero.
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

    /// Returns an estimate of the square root of the sum of the squared differences of all numbers. It is 0 if all differences are below
    /// the resolution of the sums.
    pub(crate) fn distance(&self, other: &Self) -> f64 {
        let squares = self.sums.iter().zip(other.sums).map(|(a, b)| (a - b) * (a - b));
        (squares.sum::<f64>() / SUMS as f64).sqrt()
    }

    /// Formats the sketch as text without loss.
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

/// Returns the next random weight. The weights are uniformly distributed between minus and plus the square root of 3, so their mean square
/// is 1.
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
    fn any_small_change_of_one_number_is_detected() {
        let old = column(100_000);
        let before = Sketch::compute(&old);
        for (place, by) in [(0, 1e-9), (50_001, -1e-6), (99_999, 3.0)] {
            let mut new = old.clone();
            new[place] += by;
            let apart = before.distance(&Sketch::compute(&new));
            assert!(apart > 0.2 * f64::abs(by) && apart < 1.8 * f64::abs(by), "{apart} for {by}");
        }
        let mut unknown = old.clone();
        unknown[777] = f64::NAN;
        assert!(before.distance(&Sketch::compute(&unknown)) > 1.0);
        assert_eq!(before.distance(&Sketch::compute(&old)), 0.0);
        // This change is so small that only the hash shows it.
        let mut last = old.clone();
        last[5] *= 1.0 + f64::EPSILON;
        assert_ne!(before, Sketch::compute(&last));
    }

    #[test]
    fn distance_estimates_the_root_of_the_sum_of_squares() {
        let old = column(40_000);
        let new: Vec<f64> = old.iter().map(|x| x + 0.01 * libm::cos(1e4 * x)).collect();
        let exact: f64 = old.iter().zip(&new).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
        let apart = Sketch::compute(&old).distance(&Sketch::compute(&new));
        assert!(apart > 0.4 * exact && apart < 2.0 * exact, "{apart} {exact}");
    }

    #[test]
    fn a_sketch_survives_writing_and_reading() {
        let sketch = Sketch::compute(&column(1000));
        assert_eq!(Sketch::read(&sketch.to_text()), Some(sketch));
        assert_eq!(Sketch::read("0123"), None);
    }
}
