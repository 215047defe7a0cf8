//! The numbers behind the header of a PLY file.

use std::borrow::Cow;

use maquette_value::Faces;
use maquette_value::parallel::*;

use super::error::PlyError;
use super::header::{Element, Encoding, Header, Scalar};
use super::table::Column;
use crate::{At, excerpt, real};

/// Reads numbers one after the other.
pub(super) struct Body<'a> {
    encoding: Encoding,
    bytes: &'a [u8],
    next: usize,
    /// Where the last number was that was read: its byte, and in a text its line.
    last: usize,
    line: usize,
}

impl<'a> Body<'a> {
    pub(super) fn new(header: &Header, bytes: &'a [u8]) -> Self {
        let (next, line) = (header.start, header.start_line);
        Self { encoding: header.encoding, bytes, next, last: next, line }
    }

    /// Where the last number was that was read.
    pub(super) fn at(&self) -> At {
        match self.encoding {
            Encoding::Ascii => At::Line(self.line),
            Encoding::LittleEndian | Encoding::BigEndian => At::Byte(self.last),
        }
    }

    /// Checks that the rest can hold an element, before memory is reserved for it and rows are counted.
    pub(super) fn check_room(&self, element: &Element) -> Result<(), PlyError> {
        let found = self.bytes.len() - self.next.min(self.bytes.len());
        let expected = element.count.saturating_mul(self.encoding.least_row(element));
        if found < expected {
            let Element { name, count, line, .. } = element.clone();
            return Err(PlyError::CutOff { line, name, count, found, expected });
        }
        Ok(())
    }

    /// How many faces of an element the rest can hold, if they have three corners and are not degenerate.
    pub(super) fn room_for_faces(&self, element: &Element) -> usize {
        let corner = element.properties.iter().find(|property| property.length.is_some());
        let corner = corner.map_or(1, |property| self.encoding.least_size(property.scalar));
        let room = self.bytes.len() - self.next.min(self.bytes.len());
        element.count.min(room / (self.encoding.least_row(element) + 3 * corner))
    }

    /// The rows of an element without lists, and whether they are big endian; none in a text.
    pub(super) fn take_rows(
        &mut self,
        element: &Element,
    ) -> Result<Option<(&'a [u8], bool)>, PlyError> {
        if self.encoding == Encoding::Ascii {
            return Ok(None);
        }
        self.check_room(element)?;
        let size = element.count * self.encoding.least_row(element);
        let rows = &self.bytes[self.next..][..size];
        self.next += size;
        Ok(Some((rows, self.encoding == Encoding::BigEndian)))
    }

    /// The triangles of an element that is nothing but little endian triangles; none, and nothing is taken, if anything else is
    /// there or a triangle repeats a corner.
    pub(super) fn take_triangles(&mut self, element: &Element) -> Option<Faces> {
        let [property] = &element.properties[..] else { return None };
        let known = property.length.is_some_and(|length| length.size() == 1)
            && matches!(property.scalar, Scalar::I32 | Scalar::U32)
            && self.encoding == Encoding::LittleEndian;
        let size = element.count.checked_mul(TRIANGLE).filter(|_| known)?;
        let rows = self.bytes.get(self.next..)?.get(..size)?;
        fn corner(row: &[u8], k: usize) -> u32 {
            u32::from_le_bytes([0, 1, 2, 3].map(|b| row[k + b]))
        }
        let rows = rows.par_chunks_exact(TRIANGLE).with_min_len(BLOCK);
        let triangles = Faces::triangles(
            rows.map(|row| match row[0] {
                3 => [1, 5, 9].map(|k| corner(row, k)),
                _ => [0; 3],
            })
            .collect(),
        );
        let is_sound = triangles.needed().is_some_and(|needed| needed <= 1 << 31);
        is_sound.then(|| {
            self.next += size;
            triangles
        })
    }

    /// The next number.
    pub(super) fn number(&mut self, scalar: Scalar) -> Result<f64, PlyError> {
        match self.encoding {
            Encoding::Ascii => self.word(scalar),
            Encoding::LittleEndian => Ok(little(scalar, self.take(scalar.size())?)),
            Encoding::BigEndian => Ok(big(scalar, self.take(scalar.size())?)),
        }
    }

    /// The length of a list.
    pub(super) fn length(&mut self, scalar: Scalar) -> Result<usize, PlyError> {
        let length = self.number(scalar)?;
        if length < 0.0 || length.fract() != 0.0 {
            return Err(PlyError::Length { at: self.at(), length });
        }
        Ok(length as usize)
    }

    /// Passes over a list.
    pub(super) fn skip_list(&mut self, length: Scalar, scalar: Scalar) -> Result<(), PlyError> {
        let length = self.length(length)?;
        if self.encoding == Encoding::Ascii {
            return (0..length).try_for_each(|_| self.number(scalar).map(drop));
        }
        let end = length.checked_mul(scalar.size()).and_then(|size| self.next.checked_add(size));
        match end.filter(|&end| end <= self.bytes.len()) {
            Some(end) => self.next = end,
            None => return Err(PlyError::Ends { at: At::Byte(self.bytes.len()) }),
        }
        Ok(())
    }

    /// Ends a row: in a text the line ends with it, so that a number too few or too many does not shift all that follows.
    pub(super) fn end_row(&self, element: &Element) -> Result<(), PlyError> {
        let mut rest = self.bytes[self.next..].iter();
        let behind = rest.find(|byte| !matches!(byte, b' ' | b'\t'));
        let is_end = matches!(behind, None | Some(b'\n' | b'\r'));
        if is_end || self.encoding != Encoding::Ascii {
            return Ok(());
        }
        Err(PlyError::Row { at: self.at(), name: element.name.clone() })
    }

    /// What is told of what stands behind the last element, if anything does.
    pub(super) fn rest(&self) -> Option<String> {
        let rest = &self.bytes[self.next..];
        match self.encoding {
            Encoding::Ascii => {
                let first = rest.iter().position(|byte| !byte.is_ascii_whitespace())?;
                let line = self.line + rest[..first].iter().filter(|&&byte| byte == b'\n').count();
                Some(format!(
                    "what stands from line {line} on is left out: the header counts fewer rows"
                ))
            }
            _ if rest.is_empty() => None,
            _ => Some(format!(
                "{} bytes at the end are left out: the header counts fewer rows",
                rest.len()
            )),
        }
    }

    fn take(&mut self, size: usize) -> Result<&'a [u8], PlyError> {
        let taken = self.bytes[self.next..].get(..size);
        let taken = taken.ok_or(PlyError::Ends { at: At::Byte(self.bytes.len()) })?;
        self.last = self.next;
        self.next += size;
        Ok(taken)
    }

    fn word(&mut self, scalar: Scalar) -> Result<f64, PlyError> {
        let rest = &self.bytes[self.next..];
        let blank = rest.iter().take_while(|byte| byte.is_ascii_whitespace()).count();
        self.line += rest[..blank].iter().filter(|&&byte| byte == b'\n').count();
        let rest = &rest[blank..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        if length == 0 {
            return Err(PlyError::Ends { at: self.at() });
        }
        self.next += blank + length;
        let number = match scalar {
            // Single precision is read as such: twice rounded is not always rightly rounded.
            Scalar::F32 => real::<f32>(&rest[..length]).map(f64::from),
            _ => real(&rest[..length]),
        };
        number.ok_or_else(|| PlyError::Number { at: self.at(), text: excerpt(&rest[..length]) })
    }
}

/// Bytes of a triangle: the number of its corners, and three of four bytes each.
const TRIANGLE: usize = 13;

/// Rows that one task reads.
const BLOCK: usize = 8192;

/// Numbers in rows of one length.
pub(super) struct Rows<'a> {
    pub(super) bytes: Cow<'a, [u8]>,
    pub(super) stride: usize,
    pub(super) count: usize,
    pub(super) big_endian: bool,
}

impl Rows<'_> {
    /// What `make` makes of the numbers of each row in these columns.
    pub(super) fn gather<const N: usize, T: Send>(
        &self,
        columns: &[Column; N],
        make: impl Fn([f64; N]) -> T + Sync,
    ) -> Vec<T> {
        let rows = (0..self.count).into_par_iter().with_min_len(BLOCK);
        let rows = rows.map(|row| &self.bytes[row * self.stride..][..self.stride]);
        let is = |scalar| columns.iter().all(|column| column.stored == scalar);
        // Knowing the type before the loop makes the loop several times faster.
        if is(Scalar::F32) && !self.big_endian {
            let offsets = columns.each_ref().map(|column| column.offset);
            fn number(row: &[u8], at: usize) -> f32 {
                f32::from_le_bytes(bytes(&row[at..]))
            }
            rows.map(|row| make(offsets.map(|at| number(row, at).into()))).collect()
        } else {
            fn number(row: &[u8], column: &Column, big_endian: bool) -> f64 {
                let row = &row[column.offset..];
                if big_endian { big(column.stored, row) } else { little(column.stored, row) }
            }
            rows.map(|row| {
                make(columns.each_ref().map(|column| number(row, column, self.big_endian)))
            })
            .collect()
        }
    }
}

fn bytes<const N: usize>(row: &[u8]) -> [u8; N] {
    *row.first_chunk().expect("a row holds all its columns")
}

/// The number that begins at the first byte, little endian.
fn little(scalar: Scalar, row: &[u8]) -> f64 {
    match scalar {
        Scalar::I8 => i8::from_le_bytes(bytes(row)).into(),
        Scalar::U8 => u8::from_le_bytes(bytes(row)).into(),
        Scalar::I16 => i16::from_le_bytes(bytes(row)).into(),
        Scalar::U16 => u16::from_le_bytes(bytes(row)).into(),
        Scalar::I32 => i32::from_le_bytes(bytes(row)).into(),
        Scalar::U32 => u32::from_le_bytes(bytes(row)).into(),
        Scalar::F32 => f32::from_le_bytes(bytes(row)).into(),
        Scalar::F64 => f64::from_le_bytes(bytes(row)),
    }
}

/// The number that begins at the first byte, big endian.
fn big(scalar: Scalar, row: &[u8]) -> f64 {
    match scalar {
        Scalar::I8 => i8::from_be_bytes(bytes(row)).into(),
        Scalar::U8 => u8::from_be_bytes(bytes(row)).into(),
        Scalar::I16 => i16::from_be_bytes(bytes(row)).into(),
        Scalar::U16 => u16::from_be_bytes(bytes(row)).into(),
        Scalar::I32 => i32::from_be_bytes(bytes(row)).into(),
        Scalar::U32 => u32::from_be_bytes(bytes(row)).into(),
        Scalar::F32 => f32::from_be_bytes(bytes(row)).into(),
        Scalar::F64 => f64::from_be_bytes(bytes(row)),
    }
}
