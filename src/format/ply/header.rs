//! Reads the header of a PLY file.

use maquette_syntax::bail;
use maquette_syntax::error::Error;

use crate::{excerpt, parse, words};

/// The usual name of the property with the texture coordinates of a face's corners.
pub(super) const TEXCOORD: &str = "texcoord";

/// The name that the writer gives to the property [`TEXCOORD`] if the mesh has polygons: MeshLab rejects polygons with the usual name. The
/// alternatives are worse: duplicated vertices would open a closed mesh, and triangulation would lose the polygons. The writer warns about
/// the name.
pub(super) const CORNER_UV: &str = "corner_uv";

/// The storage type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn new(word: &[u8]) -> Option<Self> {
        Some(match word {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    pub(super) fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }
}

/// A property of an element.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Property {
    pub(super) name: String,
    /// The type of the list's length; `None` if the property is not a list.
    pub(super) length: Option<Scalar>,
    pub(super) scalar: Scalar,
}

/// An element: a table in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: usize,
    pub(super) properties: Vec<Property>,
    /// The number of the line that declares the element in the header.
    pub(super) line: usize,
}

/// The encoding of the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

impl Encoding {
    /// The minimum number of bytes that a number takes. In a text this is one digit, because the blank after the last number may be
    /// missing.
    pub(super) fn min_size(self, scalar: Scalar) -> usize {
        match self {
            Self::Ascii => 1,
            Self::LittleEndian | Self::BigEndian => scalar.size(),
        }
    }

    /// The minimum number of bytes that a row takes.
    pub(super) fn min_row_size(self, element: &Element) -> usize {
        element
            .properties
            .iter()
            .map(|property| self.min_size(property.length.unwrap_or(property.scalar)))
            .sum()
    }
}

/// The type of an attribute. Comments declare it for one or several properties.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Flag,
    Pair,
    Vector,
    Color,
}

impl Kind {
    const ALL: [Self; 4] = [Self::Flag, Self::Pair, Self::Vector, Self::Color];

    /// The word by which comments declare the type.
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Flag => "flag",
            Self::Pair => "pair",
            Self::Vector => "vector",
            Self::Color => "color",
        }
    }

    fn new(word: &[u8]) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.word().as_bytes() == word)
    }

    /// The suffixes that are appended to the attribute's name to form the names of its properties.
    pub(super) fn suffixes(self) -> &'static [&'static str] {
        match self {
            Self::Flag => &[""],
            Self::Pair => &["_0", "_1"],
            Self::Vector => &["_x", "_y", "_z"],
            Self::Color => &["_red", "_green", "_blue"],
        }
    }
}

#[derive(Debug)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// The lines `obj_info` that consist of a name and a number.
    pub(super) info: Vec<(String, f64)>,
    /// The vertex attributes that this crate declares in comments `comment attribute <kind> <name>`.
    pub(super) attributes: Vec<(Kind, String)>,
    /// The face attributes that this crate declares in comments `comment attribute <kind> <name> face`.
    pub(super) face_attributes: Vec<(Kind, String)>,
    /// The pictures that are named in comments `comment TextureFile <name>`.
    pub(super) pictures: Vec<String>,
    /// The position in bytes at which the body begins. `start_line` is the number of the line at this position, from 1.
    pub(super) start: usize,
    pub(super) start_line: usize,
}

impl Header {
    /// Returns the number in an `obj_info` line; `None` if the line is missing or has no number.
    pub(super) fn info(&self, name: &str) -> Option<f64> {
        self.info.iter().find(|(known, _)| known == name).map(|&(_, number)| number)
    }
}

pub(super) fn read(bytes: &[u8]) -> Result<Header, Error> {
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    let (mut info, mut attributes, mut face_attributes) = (Vec::new(), Vec::new(), Vec::new());
    let mut pictures = Vec::new();
    let mut start = 0;
    // Very old programs end lines with CR alone.
    let first = bytes.iter().position(|byte| matches!(byte, b'\r' | b'\n'));
    let is_cr = first.is_some_and(|at| bytes[at] == b'\r' && bytes.get(at + 1) != Some(&b'\n'));
    let end_of_line = if is_cr { b'\r' } else { b'\n' };
    for line in 1.. {
        let rest = &bytes[start..];
        let end = rest.iter().position(|&byte| byte == end_of_line);
        let text = &rest[..end.unwrap_or(rest.len())];
        let words: Vec<_> = words(text).collect();
        if line == 1 && words != [b"ply"] {
            bail!("expected `ply` in the first line: this is not a PLY file");
        }
        let Some(end) = end else { bail!("the header has no line `end_header`") };
        start += end + 1;
        let line_error = || {
            let text = excerpt(&words.join(&b' '));
            Error::new(format!("line {line}: `{text}` is not a line of a PLY header"))
        };
        match words[..] {
            [b"ply"] if line == 1 => {}
            [b"obj_info", name, number] => {
                let name = String::from_utf8_lossy(name).into_owned();
                info.extend(parse(number).map(|number| (name, number)));
            }
            [b"comment", b"attribute", kind, name, ref domain @ ..]
                if matches!(domain, [] | [b"face"]) =>
            {
                let name = String::from_utf8_lossy(name).into_owned();
                let all = if domain.is_empty() { &mut attributes } else { &mut face_attributes };
                all.extend(Kind::new(kind).map(|kind| (kind, name)));
            }
            [b"comment", b"TextureFile", _, ..] => {
                // The name of a picture may contain blanks.
                let text = String::from_utf8_lossy(text);
                pictures
                    .extend(text.split_once("TextureFile").map(|(_, name)| name.trim().to_owned()));
            }
            [] | [b"comment" | b"obj_info", ..] => {}
            [b"format", kind, _] => {
                encoding = Some(match kind {
                    b"ascii" => Encoding::Ascii,
                    b"binary_little_endian" => Encoding::LittleEndian,
                    b"binary_big_endian" => Encoding::BigEndian,
                    _ => return Err(line_error()),
                });
            }
            [b"element", name, count] => {
                let name = String::from_utf8_lossy(name).into_owned();
                let count = parse(count).ok_or_else(line_error)?;
                elements.push(Element { name, count, properties: Vec::new(), line });
            }
            [b"property", ref kind @ .., name] => {
                let name = String::from_utf8_lossy(name).into_owned();
                let (length, scalar) = match kind {
                    [scalar] => (None, Scalar::new(scalar)),
                    [b"list", length, scalar] => {
                        let length = Scalar::new(length).filter(|length| !length.is_float());
                        (Some(length.ok_or_else(line_error)?), Scalar::new(scalar))
                    }
                    _ => return Err(line_error()),
                };
                let element = elements.last_mut().ok_or_else(line_error)?;
                let scalar = scalar.ok_or_else(line_error)?;
                element.properties.push(Property { name, length, scalar });
            }
            [b"end_header"] => {
                let Some(encoding) = encoding else { bail!("the header has no line `format`") };
                let start_line = line + 1;
                return Ok(Header {
                    encoding,
                    elements,
                    info,
                    attributes,
                    face_attributes,
                    pictures,
                    start,
                    start_line,
                });
            }
            _ => return Err(line_error()),
        }
    }
    unreachable!("lines are counted without end")
}
