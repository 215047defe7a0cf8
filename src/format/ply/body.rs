//! Reads the body of a PLY file.

use std::borrow::Cow;

use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::Faces;
use maquette_value::parallel::*;

use super::header::{Element, Encoding, Header, Scalar};
use super::table::Column;
use crate::{FilePosition, excerpt, parse_real};

/// Reads the numbers of a body one after another.
pub(super) struct Body<'a> {
    encoding: Encoding,
    bytes: &'a [u8],
    next: usize,
    /// The position of the last number that was read, in bytes.
    last: usize,
    /// The number of the line with the last number that was read, if the body is text.
    line: usize,
}

impl<'a> Body<'a> {
    pub(super) fn new(header: &Header, bytes: &'a [u8]) -> Self {
        let (next, line) = (header.start, header.start_line);
        Self { encoding: header.encoding, bytes, next, last: next, line }
    }

    /// Reads rows without the header before them.
    pub(super) fn of_rows(header: &Header, bytes: &'a [u8]) -> Self {
        Self { next: 0, last: 0, ..Self::new(header, bytes) }
    }

    /// Returns the position of the last number that was read.
    pub(super) fn position(&self) -> FilePosition {
        match self.encoding {
            Encoding::Ascii => FilePosition::Line(self.line),
            Encoding::LittleEndian | Encoding::BigEndian => FilePosition::Byte(self.last),
        }
    }

    /// Checks that the rest of the file is long enough for an element. This is done before memory is reserved and rows are counted.
    pub(super) fn check_room(&self, element: &Element) -> Result<(), Error> {
        let found = self.bytes.len() - self.next.min(self.bytes.len());
        let expected = element.count.saturating_mul(self.encoding.min_row_size(element));
        if found < expected {
            let Element { name, count, line, .. } = element;
            bail!(
                "line {line}: {count} rows of `{name}` need at least {expected} bytes, but only {found} are left"
            );
        }
        Ok(())
    }

    /// Returns the maximum number of triangles that the rest of the file can contain.
    pub(super) fn room_for_faces(&self, element: &Element) -> usize {
        let corner = element.properties.iter().find(|property| property.length.is_some());
        let corner = corner.map_or(1, |property| self.encoding.min_size(property.scalar));
        let room = self.bytes.len() - self.next.min(self.bytes.len());
        element.count.min(room / (self.encoding.min_row_size(element) + 3 * corner))
    }

    /// Takes the rows of an element without lists. Returns the rows, and true if they are big endian; `None` for a text.
    pub(super) fn take_rows(
        &mut self,
        element: &Element,
    ) -> Result<Option<(&'a [u8], bool)>, Error> {
        if self.encoding == Encoding::Ascii {
            return Ok(None);
        }
        self.check_room(element)?;
        let size = element.count * self.encoding.min_row_size(element);
        let rows = &self.bytes[self.next..][..size];
        self.next += size;
        Ok(Some((rows, self.encoding == Encoding::BigEndian)))
    }

    /// Takes the triangles of an element that consists only of little-endian triangles. Returns `None` and takes nothing if the element
    /// contains anything else, or if a triangle repeats a corner.
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
        let is_sound = triangles.min_vertices().is_some_and(|needed| needed <= 1 << 31);
        is_sound.then(|| {
            self.next += size;
            triangles
        })
    }

    /// Reads the next number, whose type is `scalar`.
    pub(super) fn number(&mut self, scalar: Scalar) -> Result<f64, Error> {
        match self.encoding {
            Encoding::Ascii => self.word(scalar),
            Encoding::LittleEndian => Ok(little(scalar, self.take(scalar.size())?)),
            Encoding::BigEndian => Ok(big(scalar, self.take(scalar.size())?)),
        }
    }

    /// Reads the length of a list.
    pub(super) fn length(&mut self, scalar: Scalar) -> Result<usize, Error> {
        let length = self.number(scalar)?;
        if length < 0.0 || length.fract() != 0.0 {
            bail!("{}: a list cannot have {length} entries", self.position());
        }
        Ok(length as usize)
    }

    /// Skips a list. `length` is the type of the list's length, `scalar` the type of its items.
    pub(super) fn skip_list(&mut self, length: Scalar, scalar: Scalar) -> Result<(), Error> {
        let length = self.length(length)?;
        if self.encoding == Encoding::Ascii {
            return (0..length).try_for_each(|_| self.number(scalar).map(drop));
        }
        let end = length.checked_mul(scalar.size()).and_then(|size| self.next.checked_add(size));
        match end.filter(|&end| end <= self.bytes.len()) {
            Some(end) => self.next = end,
            None => return Err(ends_error(FilePosition::Byte(self.bytes.len()))),
        }
        Ok(())
    }

    /// Ends a row. In a text the line must end together with the row; otherwise a missing or additional number would shift all following
    /// rows.
    pub(super) fn end_row(&self, element: &Element) -> Result<(), Error> {
        let mut rest = self.bytes[self.next..].iter();
        let next = rest.find(|byte| !matches!(byte, b' ' | b'\t'));
        let is_end = matches!(next, None | Some(b'\n' | b'\r'));
        if is_end || self.encoding != Encoding::Ascii {
            return Ok(());
        }
        bail!(
            "{}: expected one row of `{}` per line: this line has too many numbers, or the previous one too few",
            self.position(),
            element.name
        )
    }

    /// Returns a warning if there are data after the last element.
    pub(super) fn rest(&self) -> Option<String> {
        let rest = &self.bytes[self.next..];
        match self.encoding {
            Encoding::Ascii => {
                let first = rest.iter().position(|byte| !byte.is_ascii_whitespace())?;
                let line = self.line + rest[..first].iter().filter(|&&byte| byte == b'\n').count();
                Some(format!(
                    "the text from line {line} on is left out: the header states fewer rows"
                ))
            }
            _ if rest.is_empty() => None,
            _ => Some(format!(
                "{} bytes at the end are left out: the header states fewer rows",
                rest.len()
            )),
        }
    }

    fn take(&mut self, size: usize) -> Result<&'a [u8], Error> {
        let taken = self.bytes[self.next..].get(..size);
        let taken = taken.ok_or_else(|| ends_error(FilePosition::Byte(self.bytes.len())))?;
        self.last = self.next;
        self.next += size;
        Ok(taken)
    }

    fn word(&mut self, scalar: Scalar) -> Result<f64, Error> {
        let rest = &self.bytes[self.next..];
        let blank = rest.iter().take_while(|byte| byte.is_ascii_whitespace()).count();
        self.line += rest[..blank].iter().filter(|&&byte| byte == b'\n').count();
        let rest = &rest[blank..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        if length == 0 {
            return Err(ends_error(self.position()));
        }
        self.next += blank + length;
        let number = match scalar {
            // Single-precision numbers are parsed as such, because rounding twice can differ from rounding once.
            Scalar::F32 => parse_real::<f32>(&rest[..length]).map(f64::from),
            _ => parse_real(&rest[..length]),
        };
        match number {
            Some(number) => Ok(number),
            None => bail!("{}: `{}` is not a number", self.position(), excerpt(&rest[..length])),
        }
    }
}

fn ends_error(at: FilePosition) -> Error {
    Error::new(format!("{at}: the file ends too early"))
}

/// The number of bytes of a triangle: one for the number of its corners, and four for each of three corners.
const TRIANGLE: usize = 13;

/// The number of rows per parallel task.
const BLOCK: usize = 8192;

/// Rows of equal length in a binary body.
pub(super) struct Rows<'a> {
    pub(super) bytes: Cow<'a, [u8]>,
    pub(super) stride: usize,
    pub(super) count: usize,
    pub(super) big_endian: bool,
}

impl Rows<'_> {
    /// Applies `make` to the numbers that each row has in the given columns.
    pub(super) fn gather<const N: usize, T: Send>(
        &self,
        columns: &[Column; N],
        make: impl Fn([f64; N]) -> T + Sync,
    ) -> Vec<T> {
        let rows = (0..self.count).into_par_iter().with_min_len(BLOCK);
        let rows = rows.map(|row| &self.bytes[row * self.stride..][..self.stride]);
        let is_single = columns.iter().all(|column| column.stored == Scalar::F32);
        // Testing for the type before the loop makes the loop several times faster.
        if is_single && !self.big_endian {
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

/// Reads the little-endian number at the start of `row`.
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

/// Reads the big-endian number at the start of `row`.
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
