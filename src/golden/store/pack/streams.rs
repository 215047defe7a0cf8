//! Packs streams of whole numbers. Numbers with a small magnitude take few bits.

use miniz_oxide::deflate::compress_to_vec;
use miniz_oxide::inflate::decompress_to_vec_with_limit;

/// Writes or reads numbers. Because writing and reading run the same code, the format is defined only once.
pub(super) trait Coder {
    /// Codes the next number of a stream. A writer writes `number` and returns it; a reader returns the number that it has read.
    fn code(&mut self, stream: usize, number: i64) -> i64;
}

#[derive(Default)]
pub(super) struct Writer(Vec<Vec<u64>>);

impl Writer {
    /// Compresses the streams. Each stream is a count of planes, and each plane is a length and compressed bytes. A plane has the bytes at
    /// one position of all numbers, because these are similar; upper planes of zeros are left out.
    pub(super) fn finish(self) -> Vec<u8> {
        let mut bytes = Vec::new();
        for stream in self.0 {
            let digits = stream.iter().fold(0, |digits, number| digits | number);
            let planes = (64 - digits.leading_zeros()).div_ceil(8) as u8;
            bytes.push(planes);
            for k in 0..planes {
                let plane: Vec<u8> =
                    stream.iter().map(|number| (number >> (8 * k)) as u8).collect();
                let plane = compress_to_vec(&plane, 9);
                bytes.extend((plane.len() as u32).to_le_bytes());
                bytes.extend(plane);
            }
        }
        bytes
    }
}

impl Coder for Writer {
    fn code(&mut self, stream: usize, number: i64) -> i64 {
        if self.0.len() <= stream {
            self.0.resize(stream + 1, Vec::new());
        }
        // The sign becomes the lowest bit, so the upper bytes of small negative numbers are zero.
        self.0[stream].push((number << 1 ^ number >> 63) as u64);
        number
    }
}

pub(super) struct Reader(Vec<std::vec::IntoIter<u64>>);

impl Reader {
    /// Returns `None` if the bytes are damaged, or if a stream contains more than `max` numbers.
    pub(super) fn new(mut bytes: &[u8], max: usize) -> Option<Self> {
        let mut streams = Vec::new();
        while let Some((&planes, rest)) = bytes.split_first() {
            bytes = rest;
            let mut stream = Vec::new();
            for k in 0..planes {
                let (length, rest) = bytes.split_first_chunk()?;
                let (plane, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
                bytes = rest;
                let plane = decompress_to_vec_with_limit(plane, max).ok()?;
                stream.resize(plane.len(), 0);
                for (number, byte) in stream.iter_mut().zip(plane) {
                    *number |= u64::from(byte).checked_shl(8 * u32::from(k))?;
                }
            }
            streams.push(stream.into_iter());
        }
        Some(Self(streams))
    }
}

impl Coder for Reader {
    /// Numbers that are missing are zero: a stream of zeros has no planes, and a damaged stream may be too short.
    fn code(&mut self, stream: usize, _: i64) -> i64 {
        let number = self.0.get_mut(stream).and_then(Iterator::next).unwrap_or(0);
        (number >> 1) as i64 ^ -((number & 1) as i64)
    }
}
