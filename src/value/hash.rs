//! The hash of a value's content.

use std::fmt;
use std::io::Read;

/// The minimum number of bytes that are hashed by several threads. For fewer bytes one thread is faster, because waking the other threads
/// costs about 10 us.
pub(crate) const SEVERAL_THREADS: usize = 256 * 1024;

/// The blake3 hash of a value's content.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Hash(#[doc(hidden)] pub [u8; 32]);

impl Hash {
    /// Computes the hash of some bytes.
    pub fn compute(bytes: &[u8]) -> Self {
        if bytes.len() < SEVERAL_THREADS {
            return Self(*blake3::hash(bytes).as_bytes());
        }
        Self(*blake3::Hasher::new().update_rayon(bytes).finalize().as_bytes())
    }

    /// Computes the hash of all bytes of a file, piece by piece.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn of_reader(mut file: impl Read) -> std::io::Result<Self> {
        const PIECE: u64 = 4 << 20;
        let (mut hasher, mut piece) = (blake3::Hasher::new(), Vec::new());
        while file.by_ref().take(PIECE).read_to_end(&mut piece)? > 0 {
            hasher.update_rayon(&piece);
            piece.clear();
        }
        Ok(Self(*hasher.finalize().as_bytes()))
    }

    /// Parses a text that [`Display`](fmt::Display) has written. `None` if the text is not a hash.
    pub fn parse(text: &str) -> Option<Self> {
        let mut bytes = [0; 32];
        let digits = Some(text.as_bytes()).filter(|digits| digits.len() == 64)?;
        for (byte, pair) in bytes.iter_mut().zip(digits.chunks_exact(2)) {
            fn digit(c: u8) -> Option<u32> {
                char::from(c).to_digit(16)
            }
            *byte = (digit(pair[0])? << 4 | digit(pair[1])?) as u8;
        }
        Some(Self(bytes))
    }

    /// The first 12 hexadecimal digits, which are enough to distinguish values by eye.
    pub fn short(&self) -> String {
        self.to_string()[..12].to_owned()
    }
}

impl serde::Serialize for Hash {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> serde::Deserialize<'de> for Hash {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        Self::parse(&text)
            .ok_or_else(|| serde::de::Error::custom("expected a hash of 64 hexadecimal digits"))
    }
}

impl fmt::Display for Hash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for Hash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.short())
    }
}
