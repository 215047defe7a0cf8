//! What a file is to hold: bytes that are there, or pieces that are made while they are written.

use std::any::Any;
use std::ops::Range;

use blake3::hazmat::{self, ChainingValue, HasherExt, Mode};
use maquette_value::Hash;
use maquette_value::memory::huge_vec;
use maquette_value::parallel::*;

/// So many bytes are made and written at a time: few enough to stay in a core's cache in between, and a power of two, so that each piece
/// is a subtree of the hash of all.
const PIECE: usize = 1 << 18;

/// From so many bytes on a file is not held in memory only to be written.
const LARGE: usize = 16 << 20;

/// Fills in the bytes of a file from this place on.
type Fill<'a> = Box<dyn Fn(usize, &mut [u8]) + Sync + 'a>;

/// What the bytes of a stretch are made of.
type MadeOf<'a> = Box<dyn Fn(Range<usize>) -> Hash + Sync + 'a>;

/// The content of a file.
pub struct Content<'a> {
    kind: Kind<'a>,
    kept: Kept,
}

/// What was found for a content, whatever it is.
#[doc(hidden)]
pub type Kept = Option<Box<dyn Any + Send + Sync>>;

enum Kind<'a> {
    Whole(Vec<u8>),
    Pieces { len: usize, fill: Fill<'a>, made_of: Option<MadeOf<'a>> },
}

/// What is known of the pieces of a content, or nothing yet.
#[derive(Clone, Default)]
#[doc(hidden)]
pub struct Pieces(Vec<Piece>);

#[derive(Clone, Copy)]
struct Piece {
    made_of: Hash,
    hash: ChainingValue,
}

impl Pieces {
    /// Whether nothing is known.
    #[doc(hidden)]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl<'a> Content<'a> {
    /// So many bytes, of which `fill` makes any stretch: from the place of its first byte on, all that it is given.
    pub fn pieces(len: usize, fill: impl Fn(usize, &mut [u8]) + Sync + 'a) -> Self {
        let kind = Kind::Pieces { len, fill: Box::new(fill), made_of: None };
        Self { kind, kept: None }
    }

    /// The same pieces, of which more is known: a stretch of which `made_of` says for another value what it says for this one has the same
    /// bytes. So who writes the file again need not make what has not changed. It is to cost less than the bytes do: a hash of the hashes of
    /// what they come from, and of all else that they hang on. Law 14 of `maquette::conformance` looks for one that is wrong.
    #[must_use]
    pub fn made_of(mut self, made_of: impl Fn(Range<usize>) -> Hash + Sync + 'a) -> Self {
        if let Kind::Pieces { made_of: slot, .. } = &mut self.kind {
            *slot = Some(Box::new(made_of));
        }
        self
    }

    /// The same content, and what is to be kept as long as the file may be written again, since others find it then.
    #[doc(hidden)]
    pub fn keeping(mut self, kept: impl Any + Send + Sync) -> Self {
        self.kept = Some(Box::new(kept));
        self
    }

    /// What is to be kept.
    #[doc(hidden)]
    pub fn into_kept(self) -> Kept {
        self.kept
    }

    /// How many bytes there are.
    pub fn len(&self) -> usize {
        match &self.kind {
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
        match self.kind {
            Kind::Whole(bytes) => bytes,
            Kind::Pieces { len, fill, .. } => {
                let mut bytes = huge_vec(len);
                let pieces = bytes.par_chunks_mut(PIECE).enumerate();
                pieces.for_each(|(k, piece)| fill(k * PIECE, piece));
                bytes
            }
        }
    }

    /// Fills in the bytes from a place on.
    #[doc(hidden)]
    pub fn fill(&self, place: usize, bytes: &mut [u8]) {
        match &self.kind {
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
    #[doc(hidden)]
    pub fn as_bytes(&self) -> Option<&[u8]> {
        match &self.kind {
            Kind::Whole(bytes) => Some(bytes),
            Kind::Pieces { .. } => None,
        }
    }

    /// Hands each piece on with the place of its first byte, several at once and in no order. Gives the hash of all, and for a file that is
    /// written again what is known of its pieces then: what is `known` from before is not found again, and a piece that is `there` in the
    /// file is not handed on.
    #[doc(hidden)]
    pub fn each<E: Send>(
        &self,
        known: Option<&Pieces>,
        there: Option<&Pieces>,
        take: impl Fn(usize, &[u8]) -> Result<(), E> + Sync,
    ) -> Result<(Hash, Pieces), E> {
        let len = self.len();
        let piece = |buffer: &mut Vec<u8>, k: usize| {
            let start = k * PIECE;
            let count = PIECE.min(len - start);
            fn of(pieces: Option<&Pieces>, k: usize) -> Option<Piece> {
                pieces.and_then(|pieces| pieces.0.get(k)).copied()
            }
            let made_of = known.and_then(|_| self.stretch(start..start + count));
            let before = of(known, k).filter(|before| Some(before.made_of) == made_of);
            let (before, there) = (before.map(|it| it.hash), of(there, k).map(|it| it.hash));
            if let Some(hash) = before.filter(|_| before == there) {
                return Ok((hash, made_of));
            }
            let piece = match &self.kind {
                Kind::Whole(bytes) => &bytes[start..][..count],
                Kind::Pieces { fill, .. } => {
                    buffer.resize(count, 0);
                    fill(start, buffer);
                    &buffer[..]
                }
            };
            let hash = before.unwrap_or_else(|| match len <= PIECE {
                true => *blake3::hash(piece).as_bytes(),
                false => subtree(start, piece),
            });
            if Some(hash) != there {
                take(start, piece)?;
            }
            Ok((hash, made_of))
        };
        let pieces = (0..len.div_ceil(PIECE).max(1)).into_par_iter();
        let parts = pieces.map_init(Vec::new, piece).collect::<Result<Vec<_>, E>>()?;
        let known = parts.iter().map(|&(hash, made_of)| Some(Piece { made_of: made_of?, hash }));
        let known = Pieces(known.collect::<Option<_>>().unwrap_or_default());
        let hashes: Vec<_> = parts.into_iter().map(|(hash, _)| hash).collect();
        let hash = Hash(match &hashes[..] {
            [hash] => *hash,
            _ => {
                let (left, right) = children(&hashes);
                *hazmat::merge_subtrees_root(&left, &right, Mode::Hash).as_bytes()
            }
        });
        Ok((hash, known))
    }

    /// What the bytes of a stretch are made of, if that is known.
    #[doc(hidden)]
    pub fn stretch(&self, stretch: Range<usize>) -> Option<Hash> {
        match &self.kind {
            Kind::Pieces { made_of: Some(made_of), .. } => Some(made_of(stretch)),
            _ => None,
        }
    }
}

impl From<Vec<u8>> for Content<'_> {
    fn from(bytes: Vec<u8>) -> Self {
        Self { kind: Kind::Whole(bytes), kept: None }
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
            let bytes: Vec<_> = (0..len).map(byte).collect();
            fn fill(place: usize, piece: &mut [u8]) {
                piece.iter_mut().zip(place..).for_each(|(out, place)| *out = byte(place));
            }
            assert_eq!(Content::pieces(len, fill).into_bytes(), bytes);
            for content in [Content::pieces(len, fill), bytes.clone().into()] {
                let seen = Mutex::new(vec![0u8; len]);
                let hash = content.each(None, None, |place, piece| {
                    seen.lock().unwrap()[place..][..piece.len()].copy_from_slice(piece);
                    Ok::<_, Infallible>(())
                });
                assert_eq!(hash.map(|(hash, _)| hash), Ok(Hash::of(&bytes)), "{len}");
                assert!(seen.into_inner().unwrap() == bytes, "{len}");
            }
        }
    }

    #[test]
    fn what_cannot_be_taken_ends_it() {
        let content = Content::from(vec![0; 3 * PIECE]);
        let taken =
            content.each(None, None, |place, _| if place == PIECE { Err("full") } else { Ok(()) });
        assert_eq!(taken.map(|(hash, _)| hash), Err("full"));
    }

    #[test]
    fn what_is_known_of_pieces_is_taken_over_where_they_are_made_of_the_same() {
        let len = 5 * PIECE + 9;
        // All bytes of a piece are this one.
        let made_of = |numbers: [u8; 6]| {
            let content = Content::pieces(len, move |place, bytes| {
                bytes.fill(numbers[place / PIECE]);
            });
            content.made_of(move |stretch| Hash::of(&numbers[stretch.start / PIECE..][..1]))
        };
        let mut known = Pieces::default();
        let file = Mutex::new(vec![0; len]);
        for numbers in [[1, 2, 3, 4, 5, 6], [1, 2, 9, 4, 5, 6], [2, 2, 9, 4, 5, 7], [0; 6]] {
            let content = made_of(numbers);
            // Over the file that holds what was known, and then into a new one.
            let (hash, pieces) = content
                .each(Some(&known), Some(&known), |place: usize, piece| {
                    file.lock().unwrap()[place..][..piece.len()].copy_from_slice(piece);
                    Ok::<_, Infallible>(())
                })
                .unwrap();
            let bytes = content.into_bytes();
            assert!(*file.lock().unwrap() == bytes, "{numbers:?}");
            let content = made_of(numbers);
            let (anew, same) =
                content.each(Some(&known), None, |_, _| Ok::<_, Infallible>(())).unwrap();
            assert_eq!([hash, anew], [Hash::of(&bytes); 2]);
            let nothing = content.each(Some(&pieces), Some(&same), |place, _| Err(place)).unwrap();
            assert_eq!(nothing.0, hash, "all is there");
            known = pieces;
        }
        // What lies about what it is made of is believed: a law of formats asks.
        let liar = Content::pieces(len, |_, bytes| bytes.fill(1)).made_of(|_| Hash::of(&[0]));
        let lie = liar.each(Some(&known), None, |_, _| Ok::<_, Infallible>(())).map(|it| it.0);
        assert_eq!(lie, Ok(Hash::of(&vec![0; len])));
    }

    #[test]
    fn only_large_files_stay_in_pieces() {
        let of = |len| Content::pieces(len, |_, bytes| bytes.fill(1)).in_memory_if_small();
        assert_eq!(of(5).as_bytes(), Some(&[1; 5][..]));
        assert!(of(LARGE).as_bytes().is_none());
    }
}
