//! The numbers of a value in few bytes: rounded, as differences of neighbors, deflated.

use serde_json::{Value as Json, json};

use crate::golden::compare::{Tolerance, given, size};
use crate::golden::parts::{Class, Part, Parts};

/// More than this is not kept of one value: the goldens of a project stay small enough to be committed again and again.
pub(super) const MOST_BYTES: usize = 24 << 10;

/// Columns of no more numbers than this are kept to the last bit.
const FEW: usize = 256;

/// To how much the numbers of longer ones are rounded, as a share of the diagonal of all of them: some three bytes a number.
const KEPT_STEP: f64 = 2e-6;

/// The columns that are the faces of a mesh.
pub(super) const FACES: [&str; 2] = ["corners", "sides"];

const MAGIC: &[u8; 8] = b"golden1\n";

/// The numbers of all columns, and which of their elements they are.
pub(super) fn pack(parts: &Parts, tolerance: &Tolerance) -> (usize, Vec<u8>) {
    let mut stride = 1;
    loop {
        // Some corners say nothing of a mesh, whose counts and mark without order are in the summary.
        let some =
            parts.columns.iter().filter(|part| stride == 1 || !FACES.contains(&&part.name[..]));
        let kept =
            some.map(|part| if part.count <= FEW { part.clone() } else { part.every(stride) });
        let bytes = pack_columns(&kept.collect::<Vec<_>>(), parts.row, tolerance);
        if bytes.len() <= MOST_BYTES || parts.columns.iter().all(|part| part.count <= FEW) {
            return (stride, bytes);
        }
        // Without the faces it is much less: the second try says how much.
        stride = if stride == 1 {
            2
        } else {
            (stride * bytes.len()).div_ceil(MOST_BYTES).max(stride + 1)
        };
    }
}

fn pack_columns(columns: &[Part], row: Option<usize>, tolerance: &Tolerance) -> Vec<u8> {
    let (mut head, mut body) = (Vec::new(), Vec::new());
    for part in columns {
        let step = match part.class {
            _ if part.numbers.len() <= FEW => 0.0,
            Class::Exact | Class::Level => 1.0,
            Class::Normal => 1e-3,
            Class::Place | Class::Number => match given(part, tolerance) {
                Some(most) if 0.0 < most && most < f64::INFINITY => most / 10.0,
                _ => KEPT_STEP * size(part),
            },
        };
        let start = body.len();
        if step > 0.0 {
            let mut before = vec![0i64; part.width];
            for (index, x) in part.numbers.iter().enumerate() {
                // What is not finite is written as a step that no other number takes.
                let whole = if x.is_finite() { (x / step).round() as i64 } else { i64::MIN >> 2 };
                let before = &mut before[index % part.width];
                varint(&mut body, whole.wrapping_sub(*before));
                *before = whole;
            }
        } else {
            part.numbers.iter().for_each(|x| body.extend(x.to_le_bytes()));
        }
        head.push(json!({
            "name": part.name, "class": class_word(part.class), "width": part.width, "count": part.count,
            "stride": part.stride, "step": step, "bytes": body.len() - start, "row": row,
        }));
    }
    let head = json!(head).to_string();
    let mut content = (head.len() as u32).to_le_bytes().to_vec();
    content.extend(head.as_bytes());
    content.extend(&body);
    let mut bytes = MAGIC.to_vec();
    bytes.extend(miniz_oxide::deflate::compress_to_vec(&content, 9));
    bytes
}

const CLASSES: [(Class, &str); 5] = [
    (Class::Place, "place"),
    (Class::Normal, "normal"),
    (Class::Number, "number"),
    (Class::Level, "level"),
    (Class::Exact, "exact"),
];

fn class_word(class: Class) -> &'static str {
    CLASSES.iter().find(|(known, _)| *known == class).map_or("", |(_, word)| word)
}

fn varint(bytes: &mut Vec<u8>, x: i64) {
    let mut x = (x << 1 ^ x >> 63) as u64;
    while x >= 0x80 {
        bytes.push(x as u8 | 0x80);
        x >>= 7;
    }
    bytes.push(x as u8);
}

fn read_varint(bytes: &mut &[u8]) -> Option<i64> {
    let mut x = 0u64;
    for shift in (0..70).step_by(7) {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        x |= u64::from(byte & 0x7f).checked_shl(shift).unwrap_or(0);
        if byte < 0x80 {
            return Some((x >> 1) as i64 ^ -((x & 1) as i64));
        }
    }
    None
}

/// The columns that [`pack`] wrote; none if the bytes are damaged.
pub(super) fn unpack(bytes: &[u8]) -> Option<Parts> {
    /// No golden that this program writes is longer.
    const LONGEST: usize = 1 << 28;
    let packed = bytes.strip_prefix(MAGIC)?;
    let content = miniz_oxide::inflate::decompress_to_vec_with_limit(packed, LONGEST).ok()?;
    let (length, rest) = content.split_first_chunk()?;
    let (head, mut body) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    let head: Json = serde_json::from_slice(head).ok()?;
    let mut parts = Parts::default();
    for column in head.as_array()? {
        let number = |name: &str| column[name].as_u64().map(|number| number as usize);
        let (width, stride, step) =
            (number("width")?.max(1), number("stride")?.max(1), column["step"].as_f64()?);
        let (mut own, rest) = body.split_at_checked(number("bytes")?)?;
        body = rest;
        let count = number("count")?;
        let length = count.div_ceil(stride).checked_mul(width)?;
        let mut numbers = Vec::new();
        if step > 0.0 {
            let mut before = vec![0i64; width];
            for index in 0..length {
                let before = &mut before[index % width];
                *before = before.wrapping_add(read_varint(&mut own)?);
                let unknown = *before == i64::MIN >> 2;
                numbers.push(if unknown { f64::NAN } else { *before as f64 * step });
            }
        } else {
            numbers.extend(
                own.chunks_exact(8).map(|x| f64::from_le_bytes(x.try_into().unwrap_or_default())),
            );
        }
        if numbers.len() != length {
            return None;
        }
        let class = CLASSES.iter().find(|(_, word)| column["class"] == *word)?.0;
        let name = column["name"].as_str()?.to_owned();
        parts.columns.push(Part { name, class, width, count, stride, numbers });
        parts.row = number("row");
    }
    Some(parts)
}
