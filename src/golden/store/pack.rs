//! Packs all numbers of a value into few bytes. The numbers are rounded far below the tolerance, predicted from their neighbors, and the
//! residuals of the prediction are compressed.

use std::borrow::Cow;
use std::sync::OnceLock;

use maquette_value::Hash;
use maquette_value::parallel::*;
use nalgebra::Point3;
use serde_json::{Value as Json, json};

use self::numbers::{DIGITS, Layout, MeshNeighbors, WholeNumbers};
use self::streams::{Coder, Reader, Writer};
use super::precision::{LastDigits, MAX_EXACT_NUMBERS, Precision, precision};
use crate::compare::Tolerance;
use crate::parts::{CORNERS, Class, GoldenColumn, GoldenParts, SIDES};

mod faces;
mod numbers;
mod streams;

/// The names of the columns with the faces of a mesh, in the order in which they must be decoded.
const FACES: [&str; 2] = [SIDES, CORNERS];

const MAGIC: &[u8; 8] = b"golden3\n";

/// Returns true if the bytes are a golden in an earlier format.
pub(super) fn is_earlier(bytes: &[u8]) -> bool {
    bytes.starts_with(b"golden1\n") || bytes.starts_with(b"golden2\n")
}

/// A column of numbers as a golden stores it.
#[derive(Clone, Debug)]
pub(crate) struct StoredColumn {
    /// The column with its rounded numbers.
    pub(crate) part: GoldenColumn,
    pub(super) precision: Precision,
    /// For each element, true if it is stored to the last bit, without rounding. Empty if all are.
    pub(super) odd: Vec<bool>,
    /// The low-order bits of all numbers of the column, which rounding has removed. Empty if they are not stored.
    pub(super) digits: Vec<u8>,
    /// A hash of all numbers with their last digits (the mark of the column).
    pub(super) mark: String,
}

/// All stored numbers of a value.
#[derive(Clone, Debug, Default)]
pub(crate) struct StoredNumbers {
    pub(crate) columns: Vec<StoredColumn>,
    /// The number of elements per row, if the elements form a grid of pixels or control points.
    pub(crate) row: Option<usize>,
}

impl StoredNumbers {
    /// Returns the column with this name.
    pub(crate) fn column(&self, name: &str) -> Option<&StoredColumn> {
        self.columns.iter().find(|column| column.part.name == name)
    }

    /// Returns the points in the column of positions with this name.
    pub(super) fn points(&self, name: &str) -> Option<Vec<Point3<f64>>> {
        let points = self.numbers(name)?.chunks_exact(3);
        Some(points.map(|p| Point3::new(p[0], p[1], p[2])).collect())
    }

    /// Returns the numbers of a column.
    pub(super) fn numbers(&self, name: &str) -> Option<&[f64]> {
        self.column(name).map(|column| &column.part.numbers[..])
    }
}

/// Rounds the numbers of a column to multiples of the step. Elements that are stored to the last bit are marked as odd.
fn round_to_step(part: &GoldenColumn, precision: &Precision) -> WholeNumbers {
    let (step, finest) = (precision.step, precision.finest());
    let mut whole = WholeNumbers { width: part.width, ..WholeNumbers::default() };
    for element in part.numbers.chunks(part.width) {
        let is_odd = precision.is_odd(element, finest);
        whole.numbers.extend(element.iter().map(|x| match is_odd {
            true if x.is_nan() => f64::NAN.to_bits() as i64,
            true => x.to_bits() as i64,
            false => (x / step).round() as i64,
        }));
        whole.odd.push(is_odd);
    }
    whole
}

/// Returns the hash (mark) of numbers, which are given in units of the finest step.
pub(super) fn mark(numbers: impl Iterator<Item = i64>) -> String {
    Hash::compute(&numbers.flat_map(i64::to_le_bytes).collect::<Vec<u8>>()).short().to_string()
}

/// The faces of a mesh. A column of vertices is predicted from the neighbors in these faces.
#[derive(Default)]
struct Mesh {
    vertices: usize,
    sides: Vec<usize>,
    corners: Vec<u32>,
    neighbors: OnceLock<Option<MeshNeighbors>>,
}

impl Mesh {
    /// Returns the kind of neighbors from which the elements of a column are predicted. The column has `count` elements.
    fn layout(&self, name: &str, count: usize, stride: usize, row: Option<usize>) -> Layout<'_> {
        let of_vertices = !name.starts_with("corner ") && !name.starts_with("face ");
        // Assume that a column belongs to vertices if it has as many entries. If it does not, it only takes a few more bytes.
        if of_vertices
            && stride == 1
            && count == self.vertices
            && !self.sides.is_empty()
            && let Some(around) = self
                .neighbors
                .get_or_init(|| MeshNeighbors::new(self.vertices, &self.sides, &self.corners))
        {
            return Layout::Mesh(around);
        }
        match row {
            Some(row) if row > 1 && stride == 1 && count.is_multiple_of(row) => Layout::Grid(row),
            _ => Layout::List,
        }
    }
}

fn sides_of(sides: Option<&[f64]>, width: usize, count: usize) -> Vec<usize> {
    match sides {
        Some(sides) => sides.iter().map(|&x| x as usize).collect(),
        None => vec![width; count],
    }
}

/// Packs the numbers of all columns, or only those of every `stride`-th element.
pub(super) fn pack(parts: &GoldenParts, tolerance: &Tolerance, stride: usize) -> Vec<u8> {
    // A mesh cannot be restored without all of its corners, so leave out the faces. Their count, and their hash without order, are in the
    // summary.
    let mut columns: Vec<&GoldenColumn> =
        parts.columns.iter().filter(|part| stride == 1 || !part.is_faces).collect();
    columns.sort_by_key(|part| FACES.iter().position(|name| part.name == *name).unwrap_or(2));
    let (mut head, mut body) = (Vec::new(), Vec::new());
    let mut mesh = Mesh::default();
    if let Some(corners) = columns.iter().find(|part| is_faces(part)) {
        let sides = parts.column(SIDES).filter(|part| part.is_faces).map(|part| &part.numbers[..]);
        mesh.sides = sides_of(sides, corners.width, corners.count);
        mesh.corners = corners.numbers.iter().map(|&x| x as u32).collect();
        mesh.vertices = parts.column("position").map_or(0, |part| part.count);
    }
    let columns: Vec<_> = columns
        .into_iter()
        .map(|part| {
            let precision = precision(part, tolerance);
            let is_whole = part.count <= MAX_EXACT_NUMBERS || stride == 1;
            let part = if is_whole { Cow::Borrowed(part) } else { Cow::Owned(part.sample(stride)) };
            let layout = mesh.layout(&part.name, part.count, part.stride, parts.row);
            (part, layout, precision)
        })
        .collect();
    // Pack a column that has separate last digits both with and without them, and use the shorter result.
    let ways: Vec<_> = columns
        .iter()
        .flat_map(|column| {
            let precisions = [Some(column.2), column.2.in_one_part()].into_iter().flatten();
            precisions.map(move |precision| (column, precision))
        })
        .collect();
    let pack_column_as =
        |(column, precision): &(&(Cow<'_, GoldenColumn>, Layout<'_>, _), Precision)| {
            let (part, layout, _) = column;
            if !is_faces(part) {
                return pack_column(part, layout, precision);
            }
            let mut writer = Writer::default();
            faces::code(&mut writer, &mesh.sides, &mesh.corners);
            writer.finish()
        };
    let bytes: Vec<Vec<u8>> = ways.par_iter().map(&pack_column_as).collect();
    let mut packed_columns = ways.iter().map(|(_, precision)| *precision).zip(bytes);
    for (part, _, precision) in &columns {
        let count = 1 + usize::from(precision.in_one_part().is_some());
        let way = packed_columns
            .by_ref()
            .take(count)
            .min_by_key(|(way, bytes)| (bytes.len(), way.last.is_some()));
        let (precision, bytes) = way.expect("a way for each column");
        let last = precision.last.map(|last| {
            let fine = Precision { step: last.step, ..precision };
            let whole = round_to_step(part, &fine);
            json!({"step": last.step, "bits": last.bits, "error": last.error, "mark": mark(whole.numbers.into_iter())})
        });
        let mut column = json!({
            "name": part.name, "class": class_word(part.class), "width": part.width, "count": part.count,
            "stride": part.stride, "step": precision.step, "error": precision.error, "last": last, "bytes": bytes.len(),
        });
        if !part.is_faces && FACES.contains(&&part.name[..]) {
            column[NO_FACES] = true.into();
        }
        head.push(column);
        body.extend(bytes);
    }
    let head = json!({"row": parts.row, "columns": head}).to_string();
    let head = miniz_oxide::deflate::compress_to_vec(head.as_bytes(), 9);
    let mut bytes = MAGIC.to_vec();
    bytes.extend((head.len() as u32).to_le_bytes());
    bytes.extend(head);
    bytes.extend(&body);
    bytes
}

/// The header key for a column that has the name of a column of faces but does not contain faces.
const NO_FACES: &str = "no faces";

/// Returns true if a column contains the corners of all faces. Such a column is coded by the module `faces`.
fn is_faces(part: &GoldenColumn) -> bool {
    part.is_faces && part.name == CORNERS && part.stride == 1
}

fn pack_column(part: &GoldenColumn, layout: &Layout<'_>, precision: &Precision) -> Vec<u8> {
    let mut writer = Writer::default();
    if precision.step > 0.0 {
        let whole = round_to_step(part, precision);
        let read = numbers::code(&mut writer, layout, whole.odd.len(), &whole);
        if let Some(last) = precision.last {
            let fine = round_to_step(part, &Precision { step: last.step, ..*precision });
            code_digits(&mut writer, last.bits, &read, |place| fine.numbers[place] as u64);
        }
    } else {
        code_bits(&mut writer, part.numbers.iter().copied());
    }
    writer.finish()
}

/// Codes the last digits of all elements except those that are stored to the last bit.
fn code_digits(
    coder: &mut impl Coder,
    bits: u32,
    whole: &WholeNumbers,
    given: impl Fn(usize) -> u64,
) -> Vec<u8> {
    (0..whole.numbers.len())
        .map(|place: usize| match whole.odd[place / whole.width] {
            true => 0,
            false => coder.code(DIGITS, (given(place) & ((1 << bits) - 1)) as i64) as u8,
        })
        .collect()
}

/// Codes numbers exactly, to the last bit.
fn code_bits(coder: &mut impl Coder, numbers: impl Iterator<Item = f64>) -> Vec<f64> {
    numbers.map(|x| f64::from_bits(coder.code(0, x.to_bits() as i64) as u64)).collect()
}

const CLASSES: [(Class, &str); 5] = [
    (Class::Position, "place"),
    (Class::Normal, "normal"),
    (Class::Number, "number"),
    (Class::Level, "level"),
    (Class::Exact, "exact"),
];

fn class_word(class: Class) -> &'static str {
    CLASSES.iter().find(|(known, _)| *known == class).map_or("", |(_, word)| word)
}

/// Restores the columns that [`pack`] has packed. Returns `None` if the bytes are damaged.
pub(super) fn unpack(bytes: &[u8]) -> Option<StoredNumbers> {
    /// The maximum size of the header, in bytes.
    const MAX_HEAD_BYTES: usize = 1 << 24;
    /// The maximum count of numbers in a column.
    const MAX_NUMBERS: usize = 1 << 28;
    let packed = bytes.strip_prefix(MAGIC)?;
    let (length, rest) = packed.split_first_chunk()?;
    let (head, mut body) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    let content = miniz_oxide::inflate::decompress_to_vec_with_limit(head, MAX_HEAD_BYTES).ok()?;
    let head: Json = serde_json::from_slice(&content).ok()?;
    let row = head["row"].as_u64().map(|row| row as usize);
    let mut stored = StoredNumbers { columns: Vec::new(), row };
    let mut mesh = Mesh::default();
    for column in head["columns"].as_array()? {
        fn number(name: &str, column: &Json) -> Option<usize> {
            column[name].as_u64().map(|number| number as usize)
        }
        let (width, stride) = (number("width", column)?.max(1), number("stride", column)?.max(1));
        let count = number("count", column)?;
        let length = count.div_ceil(stride).checked_mul(width).filter(|n| *n <= MAX_NUMBERS)?;
        let (packed_bytes, rest) = body.split_at_checked(number("bytes", column)?)?;
        body = rest;
        let class = CLASSES.iter().find(|(_, word)| column["class"] == *word)?.0;
        let name = column["name"].as_str()?.to_owned();
        let last = match &column["last"] {
            Json::Null => None,
            last => Some(LastDigits {
                step: last["step"].as_f64()?,
                bits: last["bits"].as_u64().filter(|bits| *bits <= 8)? as u32,
                error: last["error"].as_f64()?,
            }),
        };
        let (step, error) = (column["step"].as_f64()?, column["error"].as_f64()?);
        let precision = Precision { step, error, last, shortest: 0.0 };
        let faces = FACES.contains(&&name[..]) && column[NO_FACES] != true;
        let mut part = GoldenColumn {
            name,
            class,
            width,
            count,
            stride,
            is_faces: faces,
            numbers: Vec::new(),
        };
        let mut reader = Reader::new(packed_bytes, length)?;
        let (mut odd, mut digits) = (Vec::new(), Vec::new());
        if is_faces(&part) {
            let sides =
                stored.column(SIDES).map(|column| &column.part).filter(|part| part.is_faces);
            mesh.sides = sides_of(sides.map(|part| &part.numbers[..]), width, count);
            let position =
                head["columns"].as_array()?.iter().find(|column| column["name"] == "position")?;
            mesh.vertices = position["count"].as_u64()? as usize;
            if mesh.sides.iter().try_fold(0usize, |sum, sides| sum.checked_add(*sides))? != length {
                return None;
            }
            mesh.corners = faces::code(&mut reader, &mesh.sides, &[])?;
            part.numbers = mesh.corners.iter().map(|&vertex| f64::from(vertex)).collect();
        } else if step > 0.0 {
            let layout = mesh.layout(&part.name, count, stride, row);
            let given = WholeNumbers { width, ..WholeNumbers::default() };
            let whole = numbers::code(&mut reader, &layout, length / width, &given);
            if let Some(last) = last {
                digits = code_digits(&mut reader, last.bits, &whole, |_| 0);
            }
            let numbers = whole.numbers.iter().enumerate();
            part.numbers = numbers
                .map(|(place, &number)| match whole.odd[place / width] {
                    true => f64::from_bits(number as u64),
                    false => number as f64 * step,
                })
                .collect::<Vec<_>>();
            odd = whole.odd;
        } else {
            part.numbers = code_bits(&mut reader, std::iter::repeat_n(0.0, length));
        }
        let mark = column["last"]["mark"].as_str().unwrap_or_default().to_owned();
        stored.columns.push(StoredColumn { part, precision, odd, digits, mark });
    }
    Some(stored)
}
