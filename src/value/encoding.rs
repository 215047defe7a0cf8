//! The content of a value as bytes, for hashing and for storage on disk.
//!
//! Hashing and storage encode the same parts in the same order. They differ in columns and nested values: a hash includes only the hash of
//! each. For storage, large columns are written separately from their values, so that a column shared by two values is stored once.

use std::sync::Arc;

use bytemuck::{AnyBitPattern, NoUninit};

use super::memo::{Memo, hash_of_memo};
use super::{Column, Hash, Value};

/// Collects the content of a value, part by part.
///
/// Each part is preceded by its length, so that different contents never have equal bytes.
pub struct Encoder {
    bytes: Vec<u8>,
    /// The minimum size in bytes of a column that is stored separately.
    separate_size: usize,
    /// The columns that are stored separately. `None` if the content is only hashed.
    columns: Option<Vec<Arc<dyn Bytes>>>,
    /// False if the memory of a stored column was overwritten, so that its bytes do not match its hash.
    is_intact: bool,
}

/// The minimum size in bytes of a column that is stored separately. Smaller columns are stored inside their value, because a separate file
/// would cost more.
const SEPARATE_SIZE: usize = 32 << 10;

impl Encoder {
    fn new(columns: Option<Vec<Arc<dyn Bytes>>>) -> Self {
        Self {
            bytes: Vec::with_capacity(128),
            separate_size: SEPARATE_SIZE,
            columns,
            is_intact: true,
        }
    }

    /// The hash of a name and the content that `encode` writes.
    pub(super) fn hash(name: &str, encode: impl FnOnce(&mut Self)) -> Hash {
        let mut encoder = Self::new(None);
        encode(encoder.text(name));
        Hash::compute(&encoder.bytes)
    }

    /// Returns all bytes that `encode` writes, including large columns.
    pub(super) fn bytes(encode: impl FnOnce(&mut Self)) -> Vec<u8> {
        let mut encoder = Self { separate_size: usize::MAX, ..Self::new(Some(Vec::new())) };
        encode(&mut encoder);
        encoder.bytes
    }

    /// Writes small plain data: numbers, points, small arrays of them.
    pub fn plain<T: NoUninit>(&mut self, part: &T) -> &mut Self {
        self.part(bytemuck::bytes_of(part))
    }

    /// Writes sizes and counts as 64-bit numbers, independent of the machine's word length.
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

    /// Writes a column. A hash includes only the column's own hash, which is computed once and shared by all values that hold the column.
    pub fn column<T: NoUninit + Send + Sync>(&mut self, part: &Column<T>) -> &mut Self {
        self.part(&part.hash().0);
        let Some(columns) = &mut self.columns else { return self };
        self.is_intact &= part.is_intact();
        let bytes: &[u8] = bytemuck::cast_slice(part);
        let is_separate = self.separate_size <= bytes.len();
        if is_separate {
            columns.push(Arc::new(part.clone()));
        }
        self.plain(&u8::from(is_separate)).counts(&[part.len()]);
        if is_separate { self } else { self.part(bytes) }
    }

    /// Writes a column of which only the hash is known. The content cannot be stored.
    pub(super) fn column_hash(&mut self, hash: Hash) -> &mut Self {
        self.part(&hash.0)
    }

    /// Writes a column whose hash is known. The function `column` is called only if the column is to be stored.
    pub(super) fn column_of_hash<T: NoUninit + Send + Sync>(
        &mut self,
        hash: Hash,
        column: impl FnOnce() -> Column<T>,
    ) -> &mut Self {
        match self.columns {
            Some(_) => self.column(&column()),
            None => self.column_hash(hash),
        }
    }

    /// Writes a value that is a part of the encoded value.
    pub fn value<T: Value>(&mut self, part: &T) -> &mut Self {
        if self.columns.is_none() {
            return self.part(&hash_of(part).0);
        }
        part.encode(self);
        self
    }

    /// Writes a memo that is a part of the encoded content.
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

/// A column whose item type is not known.
pub trait Bytes: Send + Sync {
    /// The hash of the column's bytes.
    fn hash(&self) -> Hash;
    /// The column's bytes, in the machine's byte order.
    fn bytes(&self) -> &[u8];
    /// The number of items of the column.
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

/// A value's content for storage: bytes, and the large columns to which these bytes refer by hash.
pub struct EncodedValue {
    /// The content except the large columns.
    pub bytes: Vec<u8>,
    /// The columns that are stored separately because they are large.
    pub columns: Vec<Arc<dyn Bytes>>,
    /// False if the value's memory was overwritten, so that its bytes do not match its hash.
    pub is_intact: bool,
}

/// Reads columns from memory.
impl Columns for EncodedValue {
    fn read(&self, hash: Hash, into: &mut [u8]) -> bool {
        let column = self.columns.iter().find(|column| column.hash() == hash);
        let bytes = column.map(|column| column.bytes()).filter(|bytes| bytes.len() == into.len());
        bytes.map(|bytes| into.copy_from_slice(bytes)).is_some()
    }

    fn report_damage(&self, _: Hash) {}
}

pub(super) fn encode<T: Value>(value: &T) -> EncodedValue {
    let mut encoder = Encoder::new(Some(Vec::new()));
    value.encode(&mut encoder);
    let Encoder { bytes, columns, is_intact, .. } = encoder;
    EncodedValue { bytes, columns: columns.unwrap_or_default(), is_intact }
}

/// A source of separately stored columns.
pub trait Columns {
    /// Reads the column with this hash into `into`. Returns false if there is no such column of this length.
    fn read(&self, hash: Hash, into: &mut [u8]) -> bool;

    /// Reports that the column that was read does not have this hash.
    fn report_damage(&self, hash: Hash);
}

/// Reads the parts of a stored value, in the order in which [`Encoder`] wrote them.
pub struct Decoder<'a> {
    bytes: &'a [u8],
    columns: &'a dyn Columns,
}

/// Error of decoding a stored value: the content does not have the form that the value's type writes.
#[derive(Clone, Debug, thiserror::Error)]
#[error("the stored value is damaged, or its type cannot be decoded")]
pub struct DecodeError;

impl Decoder<'_> {
    /// Calls `read` with a decoder for bytes from [`Encoder::bytes`].
    pub(super) fn of_bytes<T>(
        bytes: &[u8],
        read: impl FnOnce(&mut Decoder<'_>) -> Result<T, DecodeError>,
    ) -> Result<T, DecodeError> {
        let columns = &EncodedValue { bytes: Vec::new(), columns: Vec::new(), is_intact: true };
        read(&mut Decoder { bytes, columns })
    }

    /// Reads what [`Encoder::plain`] wrote.
    ///
    /// # Errors
    /// If the next part of the content has another form. All other methods of the decoder fail in this case too.
    pub fn plain<T: AnyBitPattern>(&mut self) -> Result<T, DecodeError> {
        bytemuck::try_pod_read_unaligned(self.part()?).map_err(|_| DecodeError)
    }

    /// Reads `N` counts that [`Encoder::counts`] wrote.
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

    /// Reads what [`Encoder::text`] wrote.
    ///
    /// # Errors
    /// As [`Decoder::plain`].
    pub fn text(&mut self) -> Result<String, DecodeError> {
        String::from_utf8(self.part()?.to_vec()).map_err(|_| DecodeError)
    }

    /// Reads what [`Encoder::column`] wrote.
    ///
    /// # Errors
    /// As [`Decoder::plain`]; also if a separately stored column is missing or damaged.
    pub fn column<T>(&mut self) -> Result<Column<T>, DecodeError>
    where
        T: AnyBitPattern + NoUninit + Send + Sync,
    {
        let hash = Hash(self.plain()?);
        let is_separate = self.plain::<u8>()? == 1;
        let [len] = self.counts()?;
        let items: Vec<T> = if is_separate {
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
            self.columns.report_damage(hash);
            return Err(DecodeError);
        }
        Ok(column)
    }

    /// Reads what [`Encoder::value`] wrote.
    ///
    /// # Errors
    /// As [`Decoder::plain`].
    pub fn value<T: Value>(&mut self) -> Result<T, DecodeError> {
        T::decode(self)
    }

    /// Reads what [`Encoder::option`] wrote.
    ///
    /// # Errors
    /// The errors of `read`.
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

/// Decodes a stored value, and checks that its hash is the given one.
pub(super) fn decode<T: Value>(
    bytes: &[u8],
    columns: &dyn Columns,
    hash: Hash,
) -> Result<T, DecodeError> {
    let value = T::decode(&mut Decoder { bytes, columns })?;
    if hash_of(&value) == hash { Ok(value) } else { Err(DecodeError) }
}
