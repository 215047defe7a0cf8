//! Code shared by several formats: positions in files, limits, and notes on coordinates.

use std::fmt;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::Mesh;
use maquette_value::parallel::*;
use nalgebra::Point3;

/// A position in a file: a line of a text, or a byte of a binary file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FilePosition {
    /// A line of a text, counted from 1.
    Line(usize),
    /// A byte of a binary file, counted from 0.
    Byte(usize),
}

impl fmt::Display for FilePosition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Byte(byte) => write!(f, "byte {byte}"),
        }
    }
}

/// The maximum memory in bytes that reading a file of this size may take: 32 times the file size, but at least 1 GiB. Well-compressed large
/// files unpack to less memory, whereas a small malicious file can unpack to a thousand times its size.
pub(crate) fn max_memory(bytes: usize) -> usize {
    bytes.saturating_mul(32).max(1 << 30)
}

/// Checks that all coordinates are finite in single precision, in which most formats store coordinates. NaN is allowed. `what` names an
/// element in the message: `vertex`, `cell` or `point`.
pub(crate) fn check_single(what: &str, points: &[Point3<f64>]) -> Result<(), Error> {
    fn exceeds_single(point: &Point3<f64>) -> bool {
        point.iter().any(|&x| (x as f32).is_infinite())
    }
    let first = points.par_chunks(BLOCK).enumerate().find_map_first(|(block, points)| {
        // There is no branch per point, which allows the compiler to vectorize the loop.
        let is_far = points.iter().fold(false, |is_far, point| is_far | exceeds_single(point));
        is_far.then(|| block * BLOCK + points.iter().position(exceeds_single).unwrap_or_default())
    });
    if let Some(index) = first {
        let [x, y, z] = points[index].into();
        bail!(
            "{what} {index} is at ({x:e}, {y:e}, {z:e}), but coordinates in this format are at most 3.4e38: scale it or move it to the origin first"
        );
    }
    Ok(())
}

/// Performs [`check_single`] for the vertices of a mesh. The vertices are read only if the bounds of the mesh exceed single precision.
pub(crate) fn check_mesh(mesh: &Mesh) -> Result<(), Error> {
    fn is_near(position: Point3<f64>) -> bool {
        position.iter().all(|&x| (x as f32).is_finite())
    }
    match mesh.cached_bounds().is_none_or(|(low, high)| is_near(low) && is_near(high)) {
        true => Ok(()),
        false => check_single("vertex", mesh.positions()),
    }
}

/// The number of points per parallel task.
pub(crate) const BLOCK: usize = 4096;

/// The maximum rounding step of coordinates, relative to the size of the object. Smaller steps are neither visible nor printable.
pub(crate) const MAX_RELATIVE_STEP: f64 = 1e-4;

/// Returns a note if the points are so far from the origin, relative to their extent, that rounding to single precision moves them visibly.
pub(crate) fn precision_note(points: &[Point3<f64>]) -> Option<String> {
    let none = (Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3]));
    let of_blocks: Vec<_> = points
        .par_chunks(BLOCK)
        .map(|points| {
            let known = points.iter().filter(|point| !point.x.is_nan());
            known.fold(none, |(low, high), point| (low.inf(point), high.sup(point)))
        })
        .collect();
    let (low, high) = of_blocks
        .iter()
        .fold(none, |a: (Point3<f64>, Point3<f64>), b| (a.0.inf(&b.0), a.1.sup(&b.1)));
    bounds_precision_note(low, high)
}

/// Returns the note of [`precision_note`] for the vertices of a mesh.
pub(crate) fn mesh_precision_note(mesh: &Mesh) -> Option<String> {
    mesh.cached_bounds().and_then(|(low, high)| bounds_precision_note(low, high))
}

/// Returns the note of [`precision_note`] for points in a bounding box.
pub(crate) fn bounds_precision_note(low: Point3<f64>, high: Point3<f64>) -> Option<String> {
    let size = (high - low).norm();
    let far = low.coords.amax().max(high.coords.amax());
    let step = far * f64::from(f32::EPSILON);
    // The points are equal except for rounding errors.
    let is_point = size <= 8.0 * far * f64::EPSILON;
    (!is_point && MAX_RELATIVE_STEP * size < step).then(|| {
        format!(
            "this format has single-precision coordinates: {far:.0} mm from the origin they are rounded to {step:.2} mm, and the object is \
             only {size:.0} mm large: move it to the origin (`Transform`) first"
        )
    })
}

/// Returns a note if a mesh that is written for a 3D printer is not closed.
pub(crate) fn open_mesh_note(mesh: &Mesh) -> Option<String> {
    let open = mesh.edges().faces.iter().filter(|faces| **faces != 2).count();
    (open > 0).then(|| {
        format!(
            "the mesh is not closed: {open} edges do not have two faces, so a slicer must guess the inside; close it with `Solid`"
        )
    })
}

/// Returns a note if borders of a mesh coincide: the format stores vertices, and the file has several at the same position.
pub(crate) fn unjoined_note(mesh: &Mesh) -> Option<String> {
    match mesh.count_unjoined() {
        0 => None,
        count => Some(format!("{count} vertices share a position with another: `Weld` joins them")),
    }
}

/// Returns the first 40 bytes as text for a message. Control characters are escaped, so the text has only one line.
pub(crate) fn excerpt(bytes: &[u8]) -> String {
    let start = &bytes[..bytes.len().min(40)];
    start.iter().flat_map(|byte| byte.escape_ascii()).map(char::from).collect()
}

/// Returns the error that a word is not a number.
pub(crate) fn not_a_number(line: usize, word: &[u8]) -> Error {
    Error::new(format!("line {line}: `{}` is not a number", excerpt(word)))
}

/// Returns the error that a line has too many or too few numbers.
pub(crate) fn count_error(line: usize, expected: impl fmt::Display, found: usize) -> Error {
    Error::new(format!("line {line}: expected {expected} numbers, found {found}"))
}

/// Parses a number; returns `None` if the text is not a number.
pub(crate) fn parse<T: std::str::FromStr>(token: &[u8]) -> Option<T> {
    std::str::from_utf8(token).ok()?.parse().ok()
}

/// Parses a coordinate. Many spellings are accepted: `nan`, `-nan(ind)` and `1.#QNAN` are NaN, `inf` and `-1.#INF` are infinite.
pub(crate) fn parse_real<T: std::str::FromStr + From<f32>>(token: &[u8]) -> Option<T> {
    parse(token).or_else(|| {
        let (sign, digits) = match token {
            [b'-', digits @ ..] => (-1.0, digits),
            [b'+', digits @ ..] | digits => (1.0, digits),
        };
        fn starts(word: &str, digits: &[u8]) -> bool {
            digits.get(..word.len()).is_some_and(|it| it.eq_ignore_ascii_case(word.as_bytes()))
        }
        if starts("nan(", digits) || starts("nanq", digits) || starts("nans", digits) {
            return Some(f32::NAN.into());
        }
        // The C library of Windows prints infinite numbers and NaN as a digit, `.#`, and the kind of the number.
        let [b'0'..=b'9', b'.', b'#', kind @ ..] = digits else { return None };
        let is_infinite = kind.starts_with(b"INF") || kind.starts_with(b"inf");
        Some(if is_infinite { sign * f32::INFINITY } else { f32::NAN }.into())
    })
}

/// The maximum number of namespace declarations in an XML text. The parser gives each element a list of the namespaces in scope, so the
/// memory for nested declarations grows with the square of their number.
pub(crate) const MAX_NAMESPACES: usize = 256;

/// Returns true if an XML text declares more namespaces than [`MAX_NAMESPACES`].
pub(crate) fn has_many_namespaces(xml: &[u8]) -> bool {
    xml.windows(5).filter(|five| five == b"xmlns").nth(MAX_NAMESPACES).is_some()
}

/// The words of a line, separated by ASCII white space.
pub(crate) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

/// Returns a URI that contains a file of this media type, such as `image/png`.
pub fn data_uri(media_type: &str, file: &[u8]) -> String {
    format!("data:{media_type};base64,{}", BASE64_STANDARD.encode(file))
}
