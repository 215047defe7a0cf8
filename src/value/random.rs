//! Numbers that look random and are the same on every machine: the generator SplitMix64 of Steele, Lea and Flood, "Fast splittable
//! pseudorandom number generators" (2014). What it gives never changes: goldens are made with it.

/// What each number adds to the state: the fraction of the golden ratio.
pub const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// The number of a state: each of its bits changes about half of those of the number.
pub fn mix(state: u64) -> u64 {
    let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// From 0 to 1, without 1, evenly: the upper 53 bits of a number.
pub fn even(number: u64) -> f64 {
    (number >> 11) as f64 / (1_u64 << 53) as f64
}

/// The generator, with its state.
#[derive(Clone, Debug)]
pub struct Random(pub u64);

impl Random {
    /// The next number.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(STEP);
        mix(self.0)
    }

    /// From 0 to 1, without 1, evenly.
    pub fn even(&mut self) -> f64 {
        even(self.bits())
    }

    /// Less than this many.
    ///
    /// # Panics
    /// If `count` is 0.
    pub fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_numbers_are_those_of_the_published_generator() {
        // As its authors' Java and Vigna's C give them for the seed 1234567.
        let mut random = Random(1_234_567);
        let first = [0; 3].map(|_| random.bits());
        assert_eq!(
            first,
            [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423]
        );
    }
}
