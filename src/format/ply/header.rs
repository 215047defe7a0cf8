//! The header of a PLY file.

use super::error::PlyError;
use crate::{excerpt, parse, words};

/// The usual name for the texture coordinates of a face's corners.
pub(super) const TEXCOORD: &str = "texcoord";

/// Our name for them where faces are not triangles: MeshLab refuses such a file if they have the usual name.
/// Split vertices would open a closed mesh, and triangles would lose the quads; a warning tells of the name.
pub(super) const CORNER_UV: &str = "corner_uv";

/// How one number is stored.
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

/// What an element has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Property {
    pub(super) name: String,
    /// For a list, how its length is stored.
    pub(super) length: Option<Scalar>,
    pub(super) scalar: Scalar,
}

/// A table of the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: usize,
    pub(super) properties: Vec<Property>,
    /// The line that promises it.
    pub(super) line: usize,
}

/// How the numbers are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

impl Encoding {
    /// The fewest bytes that a number takes: in a text a digit and a blank, though the last blank may be missing.
    pub(super) fn least_size(self, scalar: Scalar) -> usize {
        match self {
            Self::Ascii => 1,
            Self::LittleEndian | Self::BigEndian => scalar.size(),
        }
    }

    /// The fewest bytes that a row of an element takes.
    pub(super) fn least_row(self, element: &Element) -> usize {
        let least =
            |property: &Property| self.least_size(property.length.unwrap_or(property.scalar));
        element.properties.iter().map(least).sum()
    }
}

/// What several properties are together, or one is beside a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Flag,
    Pair,
    Vector,
    Color,
}

impl Kind {
    const ALL: [Self; 4] = [Self::Flag, Self::Pair, Self::Vector, Self::Color];

    /// The word for it in a comment.
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

    /// What stands behind the attribute's name in those of its properties.
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
    /// The `obj_info` lines of a name and a number.
    pub(super) info: Vec<(String, f64)>,
    /// What our own comments `comment attribute <kind> <name>` say of the vertices' properties.
    pub(super) attributes: Vec<(Kind, String)>,
    /// What our own comments `comment attribute <kind> <name> face` say of the faces' properties.
    pub(super) face_attributes: Vec<(Kind, String)>,
    /// The pictures that comments `comment TextureFile <name>` name.
    pub(super) pictures: Vec<String>,
    /// Where the body begins: byte and line.
    pub(super) start: usize,
    pub(super) start_line: usize,
}

impl Header {
    /// What an `obj_info` line says, if it is there and a number.
    pub(super) fn info(&self, name: &str) -> Option<f64> {
        self.info.iter().find(|(known, _)| known == name).map(|&(_, number)| number)
    }
}

pub(super) fn read(bytes: &[u8]) -> Result<Header, PlyError> {
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
        let words = Vec::from_iter(words(text));
        if line == 1 && words != [b"ply"] {
            return Err(PlyError::NotPly);
        }
        start += end.ok_or(PlyError::EndlessHeader)? + 1;
        let wrong = || PlyError::Header { line, text: excerpt(&words.join(&b' ')) };
        match words[..] {
            [b"ply"] if line == 1 => {}
            [b"obj_info", name, number] => {
                let name = String::from_utf8_lossy(name).into_owned();
                info.extend(parse(number).map(|number| (name, number)));
            }
            [b"comment", b"attribute", kind, name, ref of @ ..] if matches!(of, [] | [b"face"]) => {
                let name = String::from_utf8_lossy(name).into_owned();
                let all = if of.is_empty() { &mut attributes } else { &mut face_attributes };
                all.extend(Kind::new(kind).map(|kind| (kind, name)));
            }
            [b"comment", b"TextureFile", _, ..] => {
                // A name may have blanks.
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
                    _ => return Err(wrong()),
                });
            }
            [b"element", name, count] => {
                let name = String::from_utf8_lossy(name).into_owned();
                let count = parse(count).ok_or_else(wrong)?;
                elements.push(Element { name, count, properties: Vec::new(), line });
            }
            [b"property", ref kind @ .., name] => {
                let name = String::from_utf8_lossy(name).into_owned();
                let (length, scalar) = match kind {
                    [scalar] => (None, Scalar::new(scalar)),
                    [b"list", length, scalar] => {
                        let length = Scalar::new(length).filter(|length| !length.is_float());
                        (Some(length.ok_or_else(wrong)?), Scalar::new(scalar))
                    }
                    _ => return Err(wrong()),
                };
                let element = elements.last_mut().ok_or_else(wrong)?;
                let scalar = scalar.ok_or_else(wrong)?;
                element.properties.push(Property { name, length, scalar });
            }
            [b"end_header"] => {
                let encoding = encoding.ok_or(PlyError::NoFormat)?;
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
            _ => return Err(wrong()),
        }
    }
    unreachable!("lines are counted without end")
}
