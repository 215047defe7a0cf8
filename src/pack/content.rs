//! What a file is to hold: bytes that are there, or pieces that are made while they are written.

use blake3::hazmat::{self, ChainingValue, HasherExt, Mode};

use crate::memory::huge_vec;
use crate::parallel::*;
use crate::value::Hash;

/// So many bytes are made and written at a time: few enough to stay in a core's cache in between, and a power of two, so that each piece
/// is a subtree of the hash of all.
const PIECE: usize = 1 << 18;

/// From so many bytes on a file is not held in memory only to be written.
const LARGE: usize = 16 << 20;

/// Fills in the bytes of a file from this place on.
type Fill<'a> = Box<dyn Fn(usize, &mut [u8]) + Sync + 'a>;

/// The content of a file.
pub struct Content<'a>(Kind<'a>);

enum Kind<'a> {
    Whole(Vec<u8>),
    Pieces { len: usize, fill: Fill<'a> },
}

impl<'a> Content<'a> {
    /// So many bytes, of which `fill` makes any stretch: from the place of its first byte on, all that it is given.
    pub fn pieces(len: usize, fill: impl Fn(usize, &mut [u8]) + Sync + 'a) -> Self {
        Self(Kind::Pieces { len, fill: Box::new(fill) })
    }

    /// How many bytes there are.
    pub fn len(&self) -> usize {
        match &self.0 {
            Kind::Whole(bytes) => bytes.len(),
            Kind::Pieces { len, .. } => *len,
        }
    }

    /// Whether it is an empty file.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// All bytes.
    pub fn into_bytes(self) -> Vec<u8> {
        match self.0 {
            Kind::Whole(bytes) => bytes,
            Kind::Pieces { len, fill } => {
                let mut bytes = huge_vec(len);
                let pieces = bytes.par_chunks_mut(PIECE).enumerate();
                pieces.for_each(|(k, piece)| fill(k * PIECE, piece));
                bytes
            }
        }
    }

    /// Fills in the bytes from a place on.
    pub(crate) fn fill(&self, place: usize, bytes: &mut [u8]) {
        match &self.0 {
            Kind::Whole(whole) => bytes.copy_from_slice(&whole[place..][..bytes.len()]),
            Kind::Pieces { fill, .. } => fill(place, bytes),
        }
    }

    /// The same content: all of it in memory, unless it is large.
    #[must_use]
    pub(crate) fn in_memory_if_small(self) -> Self {
        if self.len() < LARGE { self.into_bytes().into() } else { self }
    }

    /// The bytes that are in memory; none of pieces.
    pub(crate) fn as_bytes(&self) -> Option<&[u8]> {
        match &self.0 {
            Kind::Whole(bytes) => Some(bytes),
            Kind::Pieces { .. } => None,
        }
    }

    /// Hands each piece on with the place of its first byte, several at once and in no order. Gives the hash of all.
    pub(crate) fn each<E: Send>(
        &self,
        take: impl Fn(usize, &[u8]) -> Result<(), E> + Sync,
    ) -> Result<Hash, E> {
        let len = self.len();
        let piece = |buffer: &mut Vec<u8>, k: usize| {
            let start = k * PIECE;
            let count = PIECE.min(len - start);
            let piece = match &self.0 {
                Kind::Whole(bytes) => &bytes[start..][..count],
                Kind::Pieces { fill, .. } => {
                    buffer.resize(count, 0);
                    fill(start, buffer);
                    &buffer[..]
                }
            };
            take(start, piece)?;
            Ok(match len <= PIECE {
                true => *blake3::hash(piece).as_bytes(),
                false => subtree(start, piece),
            })
        };
        let pieces = (0..len.div_ceil(PIECE).max(1)).into_par_iter();
        let parts = pieces.map_init(Vec::new, piece).collect::<Result<Vec<_>, E>>()?;
        Ok(Hash(match &parts[..] {
            [hash] => *hash,
            _ => {
                let (left, right) = children(&parts);
                *hazmat::merge_subtrees_root(&left, &right, Mode::Hash).as_bytes()
            }
        }))
    }
}

impl From<Vec<u8>> for Content<'_> {
    fn from(bytes: Vec<u8>) -> Self {
        Self(Kind::Whole(bytes))
    }
}

/// The hash of a piece within that of a larger file.
fn subtree(start: usize, piece: &[u8]) -> ChainingValue {
    blake3::Hasher::new().set_input_offset(start as u64).update(piece).finalize_non_root()
}

/// Both halves of a tree of several pieces: the left one is as large as a full tree can be.
fn children(pieces: &[ChainingValue]) -> (ChainingValue, ChainingValue) {
    let (left, right) = pieces.split_at(pieces.len().next_power_of_two() / 2);
    (merged(left), merged(right))
}

fn merged(pieces: &[ChainingValue]) -> ChainingValue {
    match pieces {
        [piece] => *piece,
        _ => {
            let (left, right) = children(pieces);
            hazmat::merge_subtrees_non_root(&left, &right, Mode::Hash)
        }
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;
    use std::sync::Mutex;

    use super::*;

    fn byte(place: usize) -> u8 {
        (place * 7 + place / 251) as u8
    }

    #[test]
    fn pieces_are_all_bytes_and_their_hash_is_that_of_the_whole() {
        for len in [0, 1, 1000, PIECE - 1, PIECE, PIECE + 1, 2 * PIECE, 3 * PIECE, 11 * PIECE + 77]
        {
            let bytes = Vec::from_iter((0..len).map(byte));
            let fill = |place: usize, piece: &mut [u8]| {
                piece.iter_mut().zip(place..).for_each(|(out, place)| *out = byte(place));
            };
            assert_eq!(Content::pieces(len, fill).into_bytes(), bytes);
            for content in [Content::pieces(len, fill), bytes.clone().into()] {
                let seen = Mutex::new(vec![0u8; len]);
                let hash = content.each(|place, piece| {
                    seen.lock().unwrap()[place..][..piece.len()].copy_from_slice(piece);
                    Ok::<_, Infallible>(())
                });
                assert_eq!(hash, Ok(Hash::of(&bytes)), "{len}");
                assert!(seen.into_inner().unwrap() == bytes, "{len}");
            }
        }
    }

    #[test]
    fn what_cannot_be_taken_ends_it() {
        let content = Content::from(vec![0; 3 * PIECE]);
        let taken = content.each(|place, _| if place == PIECE { Err("full") } else { Ok(()) });
        assert_eq!(taken, Err("full"));
    }

    #[test]
    fn only_large_files_stay_in_pieces() {
        let of = |len| Content::pieces(len, |_, bytes| bytes.fill(1)).in_memory_if_small();
        assert_eq!(of(5).as_bytes(), Some(&[1; 5][..]));
        assert!(of(LARGE).as_bytes().is_none());
    }
}
