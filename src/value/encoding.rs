//! The content of a value as bytes: to be hashed, and to be kept on disk and read back.
//!
//! Both see the same parts in the same order; they differ in columns and in values inside of values, of which the hash takes
//! the hash. Large columns are kept apart from their values, so that two values that share one keep it once.

use std::sync::Arc;

use bytemuck::{AnyBitPattern, NoUninit};

use super::memo::{Memo, hash_of_memo};
use super::{Column, Hash, Value};

/// Takes the content of a value, part by part.
///
/// Each part is written with its length, so that no two different contents look alike.
pub struct Encoder {
    bytes: Vec<u8>,
    /// From how many bytes on a column is kept apart.
    apart: usize,
    /// Large columns; none if the content is only hashed.
    columns: Option<Vec<Arc<dyn Bytes>>>,
    /// False if a column that is to be kept no longer has its hash.
    is_intact: bool,
}

/// A column below this many bytes is kept inside of its value: a file of its own would cost more.
const APART: usize = 32 << 10;

impl Encoder {
    fn new(columns: Option<Vec<Arc<dyn Bytes>>>) -> Self {
        Self { bytes: Vec::with_capacity(128), apart: APART, columns, is_intact: true }
    }

    /// The hash of what `encode` writes behind a name.
    pub(super) fn hash(name: &str, encode: impl FnOnce(&mut Self)) -> Hash {
        let mut encoder = Self::new(None);
        encode(encoder.text(name));
        Hash::of(&encoder.bytes)
    }

    /// All that `encode` writes, large columns too.
    pub(super) fn bytes(encode: impl FnOnce(&mut Self)) -> Vec<u8> {
        let mut encoder = Self { apart: usize::MAX, ..Self::new(Some(Vec::new())) };
        encode(&mut encoder);
        encoder.bytes
    }

    /// Writes a few bytes of plain data: numbers, points, small arrays of them.
    pub fn plain<T: NoUninit>(&mut self, part: &T) -> &mut Self {
        self.part(bytemuck::bytes_of(part))
    }

    /// Writes sizes and counts, the same on machines of every word length.
    pub fn counts(&mut self, part: &[usize]) -> &mut Self {
        part.iter().for_each(|&count| {
            self.plain(&(count as u64));
        });
        self
    }

    /// Writes a text.
    pub fn text(&mut self, part: &str) -> &mut Self {
        self.part(part.as_bytes())
    }

    /// Writes a column; in the hash by its own hash, which is computed once and shared with every value that holds the column.
    pub fn column<T: NoUninit + Send + Sync>(&mut self, part: &Column<T>) -> &mut Self {
        self.part(&part.hash().0);
        let Some(columns) = &mut self.columns else { return self };
        self.is_intact &= part.is_intact();
        let bytes: &[u8] = bytemuck::cast_slice(part);
        let apart = self.apart <= bytes.len();
        if apart {
            columns.push(Arc::new(part.clone()));
        }
        self.plain(&u8::from(apart)).counts(&[part.len()]);
        if apart { self } else { self.part(bytes) }
    }

    /// Writes a column of which the hash is known, and which is made only to be kept.
    pub(super) fn column_of_hash<T: NoUninit + Send + Sync>(
        &mut self,
        hash: Hash,
        column: impl FnOnce() -> Column<T>,
    ) -> &mut Self {
        match self.columns {
            Some(_) => self.column(&column()),
            None => self.part(&hash.0),
        }
    }

    /// Writes another value that is part of this one.
    pub fn value<T: Value>(&mut self, part: &T) -> &mut Self {
        if self.columns.is_none() {
            return self.part(&hash_of(part).0);
        }
        part.encode(self);
        self
    }

    /// Writes a memo that is part of another one.
    pub fn memo<T: Memo>(&mut self, part: &T) -> &mut Self {
        self.part(&hash_of_memo(part).0)
    }

    /// Writes a part that may be absent.
    pub fn option<T>(&mut self, part: Option<&T>, write: impl FnOnce(&mut Self, &T)) -> &mut Self {
        self.plain(&u8::from(part.is_some()));
        if let Some(part) = part {
            write(self, part);
        }
        self
    }

    fn part(&mut self, part: &[u8]) -> &mut Self {
        self.bytes.extend_from_slice(&(part.len() as u64).to_le_bytes());
        self.bytes.extend_from_slice(part);
        self
    }
}

/// The hash of a value's type and content.
pub fn hash_of<T: Value>(value: &T) -> Hash {
    Encoder::hash(T::NAME, |to| value.encode(to))
}

/// A column, of whatever items.
pub trait Bytes: Send + Sync {
    /// The hash of its bytes.
    fn hash(&self) -> Hash;
    /// Its bytes, of the machine's byte order.
    fn bytes(&self) -> &[u8];
    /// How many items it has.
    fn items(&self) -> usize;
}

impl<T: NoUninit + Send + Sync> Bytes for Column<T> {
    fn hash(&self) -> Hash {
        self.hash()
    }

    fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(self)
    }

    fn items(&self) -> usize {
        self.len()
    }
}

/// A value's content as it is kept: its bytes, and the large columns that they name by hash.
pub struct Kept {
    /// Everything but the large columns.
    pub bytes: Vec<u8>,
    /// The large columns.
    pub columns: Vec<Arc<dyn Bytes>>,
    /// False if something has written into the value's memory, so that the bytes no longer have the value's hash.
    pub is_intact: bool,
}

/// In memory, the columns are those that were taken.
impl Columns for Kept {
    fn read(&self, hash: Hash, into: &mut [u8]) -> bool {
        let column = self.columns.iter().find(|column| column.hash() == hash);
        let bytes = column.map(|column| column.bytes()).filter(|bytes| bytes.len() == into.len());
        bytes.map(|bytes| into.copy_from_slice(bytes)).is_some()
    }

    fn damaged(&self, _: Hash) {}
}

pub(super) fn keep<T: Value>(value: &T) -> Kept {
    let mut encoder = Encoder::new(Some(Vec::new()));
    value.encode(&mut encoder);
    let Encoder { bytes, columns, is_intact, .. } = encoder;
    Kept { bytes, columns: columns.unwrap_or_default(), is_intact }
}

/// Where large columns come from.
pub trait Columns {
    /// Fills `into` with the column of this hash; false if there is none of this length.
    fn read(&self, hash: Hash, into: &mut [u8]) -> bool;

    /// Takes notice that what was read does not have this hash.
    fn damaged(&self, hash: Hash);
}

/// The parts of a kept value, in the order in which [`Encoder`] took them.
pub struct Decoder<'a> {
    bytes: &'a [u8],
    columns: &'a dyn Columns,
}

/// The content of a kept value is not what its type writes.
#[derive(Clone, Debug, thiserror::Error)]
#[error("the kept value is damaged, or its type cannot be read back")]
pub struct DecodeError;

impl Decoder<'_> {
    /// What `read` finds in what [`Encoder::bytes`] gave.
    pub(super) fn of_bytes<T>(
        bytes: &[u8],
        read: impl FnOnce(&mut Decoder<'_>) -> Result<T, DecodeError>,
    ) -> Result<T, DecodeError> {
        let columns = &Kept { bytes: Vec::new(), columns: Vec::new(), is_intact: true };
        read(&mut Decoder { bytes, columns })
    }

    /// What [`Encoder::plain`] took.
    ///
    /// # Errors
    /// If the content has no such part here; so with every method.
    pub fn plain<T: AnyBitPattern>(&mut self) -> Result<T, DecodeError> {
        bytemuck::try_pod_read_unaligned(self.part()?).map_err(|_| DecodeError)
    }

    /// What [`Encoder::counts`] took, `N` of them.
    ///
    /// # Errors
    /// As [`Decoder::plain`].
    pub fn counts<const N: usize>(&mut self) -> Result<[usize; N], DecodeError> {
        let mut counts = [0; N];
        for count in &mut counts {
            *count = self.plain::<u64>()?.try_into().map_err(|_| DecodeError)?;
        }
        Ok(counts)
    }

    /// What [`Encoder::text`] took.
    ///
    /// # Errors
    /// As [`Decoder::plain`].
    pub fn text(&mut self) -> Result<String, DecodeError> {
        String::from_utf8(self.part()?.to_vec()).map_err(|_| DecodeError)
    }

    /// What [`Encoder::column`] took.
    ///
    /// # Errors
    /// As [`Decoder::plain`], and if a column that is kept apart is gone or damaged.
    pub fn column<T>(&mut self) -> Result<Column<T>, DecodeError>
    where
        T: AnyBitPattern + NoUninit + Send + Sync,
    {
        let hash = Hash(self.plain()?);
        let apart = self.plain::<u8>()? == 1;
        let [len] = self.counts()?;
        let items: Vec<T> = if apart {
            let mut items = crate::memory::huge_vec(len);
            if !self.columns.read(hash, bytemuck::cast_slice_mut(&mut items)) {
                return Err(DecodeError);
            }
            items
        } else {
            let part = self.part()?;
            if part.len() != len * size_of::<T>() {
                return Err(DecodeError);
            }
            bytemuck::pod_collect_to_vec(part)
        };
        let column = Column::from(items);
        if column.hash() != hash {
            self.columns.damaged(hash);
            return Err(DecodeError);
        }
        Ok(column)
    }

    /// What [`Encoder::value`] took.
    ///
    /// # Errors
    /// As [`Decoder::plain`].
    pub fn value<T: Value>(&mut self) -> Result<T, DecodeError> {
        T::decode(self)
    }

    /// What [`Encoder::option`] took.
    ///
    /// # Errors
    /// Those of `read`.
    pub fn option<T>(
        &mut self,
        read: impl FnOnce(&mut Self) -> Result<T, DecodeError>,
    ) -> Result<Option<T>, DecodeError> {
        if self.plain::<u8>()? == 1 { read(self).map(Some) } else { Ok(None) }
    }

    fn part(&mut self) -> Result<&[u8], DecodeError> {
        let (length, rest) = self.bytes.split_first_chunk().ok_or(DecodeError)?;
        let length = u64::from_le_bytes(*length).try_into().map_err(|_| DecodeError)?;
        let (part, rest) = rest.split_at_checked(length).ok_or(DecodeError)?;
        self.bytes = rest;
        Ok(part)
    }
}

/// The value of a kept content that has this hash.
pub(super) fn decode<T: Value>(
    bytes: &[u8],
    columns: &dyn Columns,
    hash: Hash,
) -> Result<T, DecodeError> {
    let value = T::decode(&mut Decoder { bytes, columns })?;
    if hash_of(&value) == hash { Ok(value) } else { Err(DecodeError) }
}
