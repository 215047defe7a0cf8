//! Reproducible pseudorandom numbers that are equal on every machine. The generator is SplitMix64 by Steele, Lea and Flood, "Fast
//! splittable pseudorandom number generators" (2014). The sequence must never change, because goldens (stored expected results) depend on
//! it.

/// The increment of the state: 2^64 times the fractional part of the golden ratio.
pub const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// Maps a state to a pseudorandom number. Flipping one bit of the state changes about half of the bits of the result.
pub fn mix(state: u64) -> u64 {
    let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Maps 64 random bits to a uniform number from 0 to 1 (1 excluded). Only the upper 53 bits are used.
pub fn even(number: u64) -> f64 {
    (number >> 11) as f64 / (1_u64 << 53) as f64
}

/// The generator, which holds its state.
#[derive(Clone, Debug)]
pub struct Random(pub u64);

impl Random {
    /// Returns the next 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(STEP);
        mix(self.0)
    }

    /// Returns a uniform number from 0 to 1 (1 excluded).
    pub fn even(&mut self) -> f64 {
        even(self.bits())
    }

    /// Returns a number from 0 to `count - 1`.
    ///
    /// # Panics
    /// If `count` is 0.
    pub fn next_below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_numbers_are_those_of_the_published_generator() {
        // The expected numbers are those that the authors' Java implementation and Vigna's C implementation give for the seed 1234567.
        let mut random = Random(1_234_567);
        let first = [0; 3].map(|_| random.bits());
        assert_eq!(
            first,
            [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423]
        );
    }
}
