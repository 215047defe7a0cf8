//! The header of a PCD file.

use maquette_syntax::bail;
use maquette_syntax::error::Error;

use crate::{excerpt, parse, words};

/// The storage type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    F32,
    F64,
    I8,
    I16,
    I32,
    I64,
    U8,
    U16,
    U32,
    U64,
}

impl Scalar {
    fn new(kind: u8, size: usize) -> Option<Self> {
        Some(match (kind, size) {
            (b'F', 4) => Self::F32,
            (b'F', 8) => Self::F64,
            (b'I', 1) => Self::I8,
            (b'I', 2) => Self::I16,
            (b'I', 4) => Self::I32,
            (b'I', 8) => Self::I64,
            (b'U', 1) => Self::U8,
            (b'U', 2) => Self::U16,
            (b'U', 4) => Self::U32,
            (b'U', 8) => Self::U64,
            _ => return None,
        })
    }

    /// Reads the number at the start of `bytes`, which must be long enough.
    pub(super) fn read(self, bytes: &[u8]) -> f64 {
        match self {
            Self::F32 => f32::from_le_bytes(first_bytes(bytes)).into(),
            Self::F64 => f64::from_le_bytes(first_bytes(bytes)),
            Self::I8 => i8::from_le_bytes(first_bytes(bytes)).into(),
            Self::I16 => i16::from_le_bytes(first_bytes(bytes)).into(),
            Self::I32 => i32::from_le_bytes(first_bytes(bytes)).into(),
            Self::I64 => i64::from_le_bytes(first_bytes(bytes)) as f64,
            Self::U8 => bytes[0].into(),
            Self::U16 => u16::from_le_bytes(first_bytes(bytes)).into(),
            Self::U32 => u32::from_le_bytes(first_bytes(bytes)).into(),
            Self::U64 => u64::from_le_bytes(first_bytes(bytes)) as f64,
        }
    }
}

/// Returns the first N bytes.
pub(super) fn first_bytes<const N: usize>(bytes: &[u8]) -> [u8; N] {
    *bytes.first_chunk().expect("the size of the data was checked against the header")
}

/// A field of the points.
#[derive(Clone, Copy, Debug)]
pub(super) struct Field {
    pub(super) scalar: Scalar,
    /// The offset of the field in a point, in bytes.
    pub(super) offset: usize,
    /// The offset of the field in a point, counted in numbers.
    pub(super) index: usize,
    /// The size of the field in bytes. The field may have several numbers.
    pub(super) bytes: usize,
}

/// The maximum count of a point's numbers besides its position, normal and color. Descriptors of points have some hundred numbers.
const MAX_OTHERS: usize = 1024;

impl Field {
    /// Splits the field into one field per number. Each gets the name of the field, followed by an index if there are several numbers.
    fn split(&self, name: &str) -> Vec<(String, Self)> {
        let bytes = size(self.scalar);
        let count = self.bytes / bytes;
        (0..count.min(MAX_OTHERS))
            .map(|k: usize| {
                let name = if count == 1 { name.to_owned() } else { format!("{name}_{k}") };
                (name, Self { offset: self.offset + k * bytes, index: self.index + k, ..*self })
            })
            .collect()
    }
}

/// The encoding of the points in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    Binary,
    Compressed,
}

/// The parsed header. The parser has checked that neither width x height nor the size of the points in bytes overflows.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) width: usize,
    pub(super) height: usize,
    /// The number of the line that states the height, from 1.
    pub(super) height_line: usize,
    /// The fields `x`, `y` and `z`.
    pub(super) position: [Field; 3],
    /// The fields `normal_x`, `normal_y` and `normal_z`, or `nx`, `ny` and `nz`.
    pub(super) normal: Option<[Field; 3]>,
    /// The fields `r`, `g` and `b`.
    pub(super) channels: Option<[Field; 3]>,
    /// All other fields. A field with several numbers is split, and each number has a name.
    pub(super) others: Vec<(String, Field)>,
    /// True if the viewpoint is not at the origin, or is rotated.
    pub(super) has_viewpoint: bool,
    /// The field with a packed color of four bytes, blue first.
    pub(super) color: Option<Field>,
    /// The number of bytes per point.
    pub(super) stride: usize,
    /// The count of numbers per point.
    pub(super) numbers: usize,
    pub(super) encoding: Encoding,
    /// The position in bytes at which the points begin. `start_line` is the number of the line at this position, from 1.
    pub(super) start: usize,
    pub(super) start_line: usize,
}

/// The lines of a header.
#[derive(Default)]
struct Lines<'a> {
    entries: Vec<Line<'a>>,
}

struct Line<'a> {
    keyword: &'a [u8],
    number: usize,
    words: Vec<&'a [u8]>,
}

impl<'a> Lines<'a> {
    fn find(&self, keyword: &str) -> Option<&Line<'a>> {
        self.entries.iter().find(|entry| entry.keyword == keyword.as_bytes())
    }

    fn require(&self, keyword: &str) -> Result<&Line<'a>, Error> {
        self.find(keyword).ok_or_else(|| missing_line(keyword))
    }
}

impl Line<'_> {
    /// Returns the number of the line, and the single number after the keyword.
    fn single_number(&self) -> Result<(usize, usize), Error> {
        match self.words[..] {
            [word] => Ok((self.number, number(self.number, word)?)),
            _ => Err(count_error(self.number, 1, self.words.len())),
        }
    }

    fn check_count(&self, expected: usize) -> Result<&Self, Error> {
        match self.words.len() {
            found if found != expected => Err(count_error(self.number, expected, found)),
            _ => Ok(self),
        }
    }
}

fn missing_line(keyword: &str) -> Error {
    Error::new(format!("the header has no line {keyword}"))
}

pub(super) fn count_error(line: usize, expected: usize, found: usize) -> Error {
    Error::new(format!("line {line}: expected {expected} values, found {found}"))
}

pub(super) fn value_error(line: usize, word: &[u8]) -> Error {
    Error::new(format!("line {line}: `{}` is not a valid value", excerpt(word)))
}

fn too_large(line: usize) -> Error {
    Error::new(format!("line {line}: the size is 0 or too large"))
}

fn number(line: usize, word: &[u8]) -> Result<usize, Error> {
    parse(word).ok_or_else(|| value_error(line, word))
}

pub(super) fn read(bytes: &[u8]) -> Result<Header, Error> {
    if bytes.is_empty() {
        bail!("the file is empty");
    }
    let mut lines = Lines::default();
    let mut start = 0;
    for line in 1.. {
        let rest = &bytes[start..];
        let Some(end) = rest.iter().position(|&byte| byte == b'\n') else {
            return Err(missing_line("DATA"));
        };
        start += end + 1;
        let mut words = words(&rest[..end]);
        match words.next() {
            Some(b"DATA") => {
                let encoding = match words.next() {
                    Some(b"ascii") => Encoding::Ascii,
                    Some(b"binary") => Encoding::Binary,
                    Some(b"binary_compressed") => Encoding::Compressed,
                    other => return Err(value_error(line, other.unwrap_or_default())),
                };
                return layout(&lines, encoding, start, line + 1);
            }
            Some(comment) if comment.starts_with(b"#") => {}
            Some(
                keyword @ (b"VERSION" | b"FIELDS" | b"SIZE" | b"TYPE" | b"COUNT" | b"WIDTH"
                | b"HEIGHT" | b"VIEWPOINT" | b"POINTS"),
            ) => lines.entries.push(Line { keyword, number: line, words: words.collect() }),
            Some(other) => {
                bail!("line {line}: `{}` is not a keyword of a PCD header", excerpt(other))
            }
            None => {}
        }
    }
    unreachable!("lines are counted without end")
}

/// Computes the layout of the points from the header lines, and checks that these lines agree.
fn layout(
    lines: &Lines<'_>,
    encoding: Encoding,
    start: usize,
    start_line: usize,
) -> Result<Header, Error> {
    let names = &lines.require("FIELDS")?.words;
    let fields = fields(lines, names)?;
    let (width_line, width) = lines.require("WIDTH")?.single_number()?;
    let (height_line, height) = lines.require("HEIGHT")?.single_number()?;
    let overflow = || too_large(width_line);
    let count = width.checked_mul(height).filter(|&count| count > 0).ok_or_else(overflow)?;
    if let Some(points) = lines.find("POINTS") {
        let (line, points) = points.single_number()?;
        if points != count {
            bail!("line {line}: POINTS is {points}, but the grid is {width} x {height}");
        }
    }
    let find = |name: &str| {
        let index = names.iter().position(|given| *given == name.as_bytes());
        index.map(|index| fields[index]).filter(|field| field.bytes > 0)
    };
    let no_field = |name| Error::new(format!("the points have no field {name}"));
    let required = |name| find(name).ok_or_else(|| no_field(name));
    let three = |[a, b, c]: [&str; 3]| Some([find(a)?, find(b)?, find(c)?]);
    let normal = three(["normal_x", "normal_y", "normal_z"]).or_else(|| three(["nx", "ny", "nz"]));
    let last = fields.last().ok_or_else(|| no_field("x"))?;
    let color = find("rgb").or_else(|| find("rgba"));
    let color = color.filter(|field| {
        matches!(field.scalar, Scalar::F32 | Scalar::U32 | Scalar::I32) && field.bytes == 4
    });
    let channels = three(["r", "g", "b"]).or_else(|| three(["red", "green", "blue"]));
    let position = [required("x")?, required("y")?, required("z")?];
    let read = position
        .iter()
        .chain(normal.iter().flatten())
        .chain(&color)
        .chain(channels.iter().flatten());
    let read: Vec<_> = read.map(|field| field.index).collect();
    let others = names
        .iter()
        .zip(&fields)
        .filter(|(name, field)| !read.contains(&field.index) && field.bytes > 0 && **name != b"_");
    let others = others.flat_map(|(name, field)| field.split(&String::from_utf8_lossy(name)));
    let viewpoint = lines.find("VIEWPOINT").map_or(&[][..], |line| &line.words);
    let usual = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
    let has_viewpoint = viewpoint.iter().zip(usual).any(|(word, usual)| parse(word) != Some(usual));
    let others = others.take(MAX_OTHERS).collect();
    let header = Header {
        width,
        height,
        height_line,
        position,
        normal,
        channels,
        others,
        has_viewpoint,
        color,
        stride: last.offset + last.bytes,
        numbers: last.index + last.bytes / size(last.scalar),
        encoding,
        start,
        start_line,
    };
    count.checked_mul(header.stride).ok_or_else(overflow)?;
    Ok(header)
}

/// Returns the layout of all fields, in the order of the file.
fn fields(lines: &Lines<'_>, names: &[&[u8]]) -> Result<Vec<Field>, Error> {
    let sizes = lines.require("SIZE")?.check_count(names.len())?;
    let types = lines.require("TYPE")?.check_count(names.len())?;
    let counts = lines.find("COUNT").map(|line| line.check_count(names.len())).transpose()?;
    let (mut offset, mut index) = (0usize, 0usize);
    let mut fields = Vec::with_capacity(names.len());
    for (k, (size_word, kind)) in sizes.words.iter().zip(&types.words).enumerate() {
        let size = number(sizes.number, size_word)?;
        let scalar = (kind.len() == 1).then(|| Scalar::new(kind[0], size)).flatten();
        let Some(scalar) = scalar else {
            let (line, kind) = (types.number, excerpt(kind));
            bail!("line {line}: `{kind} of {size} bytes` is not a valid value");
        };
        let (line, count) = match counts {
            Some(counts) => (counts.number, number(counts.number, counts.words[k])?),
            None => (sizes.number, 1),
        };
        let bytes = count.checked_mul(size).ok_or_else(|| too_large(line))?;
        fields.push(Field { scalar, offset, index, bytes });
        offset = offset.checked_add(bytes).ok_or_else(|| too_large(line))?;
        index += count;
    }
    Ok(fields)
}

fn size(scalar: Scalar) -> usize {
    match scalar {
        Scalar::I8 | Scalar::U8 => 1,
        Scalar::I16 | Scalar::U16 => 2,
        Scalar::F32 | Scalar::I32 | Scalar::U32 => 4,
        Scalar::F64 | Scalar::I64 | Scalar::U64 => 8,
    }
}
