//! What several formats share: places in files, limits, and what is said of coordinates.

use std::fmt;

use maquette_value::Mesh;
use maquette_value::parallel::*;
use nalgebra::Point3;
use thiserror::Error;

/// A place in a file: a line of a text, or a byte of anything else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum At {
    /// A line, counted from 1.
    Line(usize),
    /// A byte, counted from 0.
    Byte(usize),
}

impl fmt::Display for At {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Byte(byte) => write!(f, "byte {byte}"),
        }
    }
}

/// The most memory that reading a file may take: so much that no honest file of a few megabytes is refused, and as many times the
/// file's own bytes as the best packed of the large ones unpack to. A small file can unpack to a thousand times its size.
pub(crate) fn most_memory(bytes: usize) -> usize {
    bytes.saturating_mul(32).max(1 << 30)
}

/// A place that single precision cannot tell, in which most formats have places: it would be infinite in the file.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[error(
    "{what} {index} is at ({:e}, {:e}, {:e}), but coordinates in such a file are at most 3.4e38 in size: scale or move it nearer before it is written",
    place[0], place[1], place[2]
)]
pub struct TooFar {
    /// `vertex`, `cell` or `point`.
    pub what: &'static str,
    /// Which of them, from 0.
    pub index: usize,
    /// Where it is.
    pub place: [f64; 3],
}

/// Checks that single precision can tell these places, or that there are none.
pub(crate) fn check_single(what: &'static str, points: &[Point3<f64>]) -> Result<(), TooFar> {
    fn far(point: &Point3<f64>) -> bool {
        point.iter().any(|&x| (x as f32).is_infinite())
    }
    let first = points.par_chunks(BLOCK).enumerate().find_map_first(|(block, points)| {
        // Without a branch for each point, so that wide vectors look at several of them at once.
        let is_far = points.iter().fold(false, |is_far, point| is_far | far(point));
        is_far.then(|| block * BLOCK + points.iter().position(far).unwrap_or_default())
    });
    first.map_or(Ok(()), |index| Err(TooFar { what, index, place: points[index].coords.into() }))
}

/// The same of the vertices of a mesh, which are looked at only if one of them is there.
pub(crate) fn check_mesh(mesh: &Mesh) -> Result<(), TooFar> {
    fn is_near(place: Point3<f64>) -> bool {
        place.iter().all(|&x| (x as f32).is_finite())
    }
    match mesh.known_bounds().is_none_or(|(low, high)| is_near(low) && is_near(high)) {
        true => Ok(()),
        false => check_single("vertex", mesh.positions()),
    }
}

/// Points that one task looks at.
pub(crate) const BLOCK: usize = 4096;

/// A mesh is told by steps of no more than this share of its size: less than what is seen or printed.
pub(crate) const COARSEST: f64 = 1e-4;

/// What is said of places that lie so far from the origin, beside their size, that single precision moves them.
pub(crate) fn coarse(points: &[Point3<f64>]) -> Option<String> {
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
    coarse_within(low, high)
}

/// The same of a mesh.
pub(crate) fn coarse_mesh(mesh: &Mesh) -> Option<String> {
    mesh.known_bounds().and_then(|(low, high)| coarse_within(low, high))
}

/// The same of places between these.
pub(crate) fn coarse_within(low: Point3<f64>, high: Point3<f64>) -> Option<String> {
    let size = (high - low).norm();
    let far = low.coords.amax().max(high.coords.amax());
    let step = far * f64::from(f32::EPSILON);
    // What is a point but for rounding has nothing to lose.
    let is_point = size <= 8.0 * far * f64::EPSILON;
    (!is_point && COARSEST * size < step).then(|| {
        format!(
            "coordinates in such a file are single, and {far:.0} mm from the origin they go by steps of {step:.2} mm, while all is \
             {size:.0} mm large: move it nearer (`Transform`) before it is written"
        )
    })
}

/// What is said of a mesh that a printer shall make, and that is no closed skin.
pub(crate) fn open(mesh: &Mesh) -> Option<String> {
    let open = mesh.edges().faces.iter().filter(|faces| **faces != 2).count();
    (open > 0).then(|| {
        format!(
            "the mesh is not closed: {open} of its edges have not two faces, and a slicer guesses what is inside; `Solid` closes it"
        )
    })
}

/// The first part of some bytes as text, for a message: whatever a hostile file holds, short and on one line.
pub(crate) fn excerpt(bytes: &[u8]) -> String {
    let start = &bytes[..bytes.len().min(40)];
    start.iter().flat_map(|byte| byte.escape_ascii()).map(char::from).collect()
}

/// A number in a text, if it is one.
pub(crate) fn parse<T: std::str::FromStr>(token: &[u8]) -> Option<T> {
    std::str::from_utf8(token).ok()?.parse().ok()
}

/// A coordinate in a text, if it is one. What is not a number is spelled in many ways: `nan`, `-nan(ind)` and `1.#QNAN` are NaN, `inf` and
/// `-1.#INF` infinite.
pub(crate) fn real<T: std::str::FromStr + From<f32>>(token: &[u8]) -> Option<T> {
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
        // As the C library of Windows prints them: a digit, `.#`, and what it is.
        let [b'0'..=b'9', b'.', b'#', kind @ ..] = digits else { return None };
        let is_infinite = kind.starts_with(b"INF") || kind.starts_with(b"inf");
        Some(if is_infinite { sign * f32::INFINITY } else { f32::NAN }.into())
    })
}

/// Most declarations of namespaces that an XML text may have. The parser gives each element a list of those that hold in it, so that many
/// nested ones would take memory with their square.
pub(crate) const MOST_NAMESPACES: usize = 256;

/// Returns true if an XML text declares more namespaces than [`MOST_NAMESPACES`].
pub(crate) fn has_many_namespaces(xml: &[u8]) -> bool {
    xml.windows(5).filter(|five| five == b"xmlns").nth(MOST_NAMESPACES).is_some()
}

/// The words of a line.
pub(crate) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}
