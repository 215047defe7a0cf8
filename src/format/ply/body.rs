//! The numbers behind the header of a PLY file.

use super::PlyError;
use super::header::{Element, Encoding, Header, Scalar};
use crate::format::{At, excerpt, parse};

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

    /// The next number.
    pub(super) fn number(&mut self, scalar: Scalar) -> Result<f64, PlyError> {
        match self.encoding {
            Encoding::Ascii => self.word(scalar),
            Encoding::LittleEndian => Ok(match scalar {
                Scalar::I8 => i8::from_le_bytes(self.take()?).into(),
                Scalar::U8 => u8::from_le_bytes(self.take()?).into(),
                Scalar::I16 => i16::from_le_bytes(self.take()?).into(),
                Scalar::U16 => u16::from_le_bytes(self.take()?).into(),
                Scalar::I32 => i32::from_le_bytes(self.take()?).into(),
                Scalar::U32 => u32::from_le_bytes(self.take()?).into(),
                Scalar::F32 => f32::from_le_bytes(self.take()?).into(),
                Scalar::F64 => f64::from_le_bytes(self.take()?),
            }),
            Encoding::BigEndian => Ok(match scalar {
                Scalar::I8 => i8::from_be_bytes(self.take()?).into(),
                Scalar::U8 => u8::from_be_bytes(self.take()?).into(),
                Scalar::I16 => i16::from_be_bytes(self.take()?).into(),
                Scalar::U16 => u16::from_be_bytes(self.take()?).into(),
                Scalar::I32 => i32::from_be_bytes(self.take()?).into(),
                Scalar::U32 => u32::from_be_bytes(self.take()?).into(),
                Scalar::F32 => f32::from_be_bytes(self.take()?).into(),
                Scalar::F64 => f64::from_be_bytes(self.take()?),
            }),
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

    fn take<const N: usize>(&mut self) -> Result<[u8; N], PlyError> {
        let taken = self.bytes[self.next..].first_chunk();
        let taken = *taken.ok_or(PlyError::Ends { at: At::Byte(self.bytes.len()) })?;
        self.last = self.next;
        self.next += N;
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
            Scalar::F32 => parse::<f32>(&rest[..length]).map(f64::from),
            _ => parse(&rest[..length]),
        };
        number.ok_or_else(|| PlyError::Number { at: self.at(), text: excerpt(&rest[..length]) })
    }
}
