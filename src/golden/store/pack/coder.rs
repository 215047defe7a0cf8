//! An adaptive arithmetic coder for whole numbers. It learns the probability of each kind of binary decision.
//!
//! It is a range coder with carry, as in Martin, "Range encoding: an algorithm for removing redundancy from a digitised message" (1979), in
//! the binary form of LZMA. The probability of each decision is the mean of two estimates; one of them adapts faster than the other.

/// Two estimates of the probability that a decision is "no", in units of 2^-16. One adapts fast, the other slowly.
#[derive(Clone, Copy)]
pub(super) struct Bit {
    fast: u16,
    slow: u16,
}

/// The initial estimate: "yes" and "no" are equally likely.
pub(super) const EVEN: Bit = Bit { fast: 1 << 15, slow: 1 << 15 };

impl Bit {
    fn chance(self) -> u32 {
        ((u32::from(self.fast) + u32::from(self.slow)) >> 1).clamp(64, (1 << 16) - 64)
    }

    fn adapt(&mut self, yes: bool) {
        fn learn(chance: &mut u16, shift: u32, yes: bool) {
            *chance = if yes {
                *chance - (*chance >> shift)
            } else {
                *chance + ((u16::MAX - *chance) >> shift)
            };
        }
        learn(&mut self.fast, 4, yes);
        learn(&mut self.slow, 7, yes);
    }
}

/// Writes or reads binary decisions. Writing and reading run the same code, so the format is defined in one place.
pub(super) trait Coder {
    /// Codes a decision whose probability is `bit`. A writer writes `yes` and returns it; a reader returns the decision that it has read.
    fn bit(&mut self, bit: &mut Bit, yes: bool) -> bool;

    /// Codes the lowest `count` bits of a number (at most 64). Each bit is assumed to be 0 or 1 with equal probability.
    fn plain(&mut self, count: u32, number: u64) -> u64;
}

pub(super) struct Writer {
    low: u64,
    range: u32,
    held: u8,
    n_held: u64,
    bytes: Vec<u8>,
}

impl Writer {
    pub(super) fn new() -> Self {
        Self { low: 0, range: u32::MAX, held: 0, n_held: 1, bytes: Vec::new() }
    }

    /// Outputs a byte. Bytes that a later carry may still change are held back.
    fn shift(&mut self) {
        if self.low < 0xff00_0000 || self.low > 0xffff_ffff {
            let carry = (self.low >> 32) as u8;
            for k in 0..self.n_held {
                let byte = if k == 0 { self.held } else { 0xff };
                self.bytes.push(byte.wrapping_add(carry));
            }
            self.n_held = 0;
            self.held = (self.low >> 24) as u8;
        }
        self.n_held += 1;
        self.low = (self.low & 0x00ff_ffff) << 8;
    }

    pub(super) fn finish(mut self) -> Vec<u8> {
        for _ in 0..5 {
            self.shift();
        }
        // Omit zeros at the end, because a reader treats missing bytes as zeros.
        while self.bytes.last() == Some(&0) {
            self.bytes.pop();
        }
        self.bytes
    }
}

impl Coder for Writer {
    fn bit(&mut self, bit: &mut Bit, yes: bool) -> bool {
        let bound = (self.range >> 16) * bit.chance();
        if yes {
            self.low += u64::from(bound);
            self.range -= bound;
        } else {
            self.range = bound;
        }
        bit.adapt(yes);
        while self.range < 1 << 24 {
            self.range <<= 8;
            self.shift();
        }
        yes
    }

    fn plain(&mut self, count: u32, number: u64) -> u64 {
        for place in (0..count).rev() {
            self.range >>= 1;
            if number >> place & 1 == 1 {
                self.low += u64::from(self.range);
            }
            if self.range < 1 << 24 {
                self.range <<= 8;
                self.shift();
            }
        }
        number
    }
}

pub(super) struct Reader<'a> {
    code: u32,
    range: u32,
    bytes: &'a [u8],
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        let mut reader = Self { code: 0, range: u32::MAX, bytes };
        // The first of the five bytes is the one that the writer holds back at the start.
        (0..5).for_each(|_| reader.shift());
        reader
    }

    fn shift(&mut self) {
        let (&byte, rest) = self.bytes.split_first().unwrap_or((&0, &[]));
        self.bytes = rest;
        self.code = self.code << 8 | u32::from(byte);
    }
}

impl Coder for Reader<'_> {
    fn bit(&mut self, bit: &mut Bit, _: bool) -> bool {
        let bound = (self.range >> 16) * bit.chance();
        let yes = self.code >= bound;
        if yes {
            self.code -= bound;
            self.range -= bound;
        } else {
            self.range = bound;
        }
        bit.adapt(yes);
        while self.range < 1 << 24 {
            self.range <<= 8;
            self.shift();
        }
        yes
    }

    fn plain(&mut self, count: u32, _: u64) -> u64 {
        let mut number = 0;
        for _ in 0..count {
            self.range >>= 1;
            let yes = self.code >= self.range;
            if yes {
                self.code -= self.range;
            }
            number = number << 1 | u64::from(yes);
            if self.range < 1 << 24 {
                self.range <<= 8;
                self.shift();
            }
        }
        number
    }
}

/// Returns the number of binary digits of a number, from 0 to 64. It is 0 for the number 0.
pub(super) fn length(number: u64) -> usize {
    64 - number.leading_zeros() as usize
}

/// The learned probabilities for coding numbers: those of their lengths, and those of their highest digits.
pub(super) struct Numbers {
    lengths: [Bit; 128],
    /// For each length of a number, the probabilities of its sign and of the two digits after the first.
    digits: Vec<[Bit; 4]>,
}

impl Numbers {
    pub(super) fn new() -> Self {
        Self { lengths: [EVEN; 128], digits: vec![[EVEN; 4]; 65] }
    }

    /// Codes a signed number. A number near 0 takes fewer bits.
    pub(super) fn code(&mut self, coder: &mut impl Coder, number: i64) -> i64 {
        let size = number.unsigned_abs();
        let mut node = 1;
        for place in (0..7).rev() {
            let yes = coder.bit(&mut self.lengths[node], length(size) >> place & 1 == 1);
            node = 2 * node + usize::from(yes);
        }
        let length = (node - 128).min(64) as u32;
        if length == 0 {
            return 0;
        }
        let bits = &mut self.digits[length as usize];
        let negative = coder.bit(&mut bits[0], number < 0);
        let mut read = 1u64;
        let mut left = length - 1;
        // Learn the probabilities of only the two digits after the first. The other digits are nearly random.
        let mut node = 1;
        while left > 0 && node < 4 {
            left -= 1;
            let yes = coder.bit(&mut bits[node], size >> left & 1 == 1);
            node = 2 * node + usize::from(yes);
            read = read << 1 | u64::from(yes);
        }
        if left > 0 {
            let rest = coder.plain(left, size & ((1 << left) - 1));
            read = read << left | rest;
        }
        if negative { (read as i64).wrapping_neg() } else { read as i64 }
    }
}
