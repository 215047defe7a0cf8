//! Files: what reads bytes into values, and what writes values to bytes.
//!
//! Readers are functions from bytes to a value or a typed error. They never panic, and never reserve more memory than a small
//! multiple of the bytes that are there, whatever a header promises. Writers are [`FileFormat`](maquette_node::pack::FileFormat)s, readers by ending
//! [`FileReader`](maquette_node::reading::FileReader)s; [`FORMATS`] and [`READERS`] list them, one line for each type of values and kind of files.

use std::fmt;

use maquette_node::pack::{Format, format};
use maquette_node::reading::{AnyReader, NoReader, Readers, Reading, reader};
use maquette_syntax::error::Error;
use maquette_value::parallel::*;
use maquette_value::{Mesh, Value, value_type};
use nalgebra::Point3;
use thiserror::Error;

pub mod abs;
pub mod camera;
#[cfg(test)]
mod chosen;
mod corners;
pub mod decoder;
pub mod depth;
pub mod e57;
pub mod exr;
mod finite;
pub mod glb;
pub mod handles;
pub mod jpeg;
mod json;
pub mod las;
pub mod obj;
pub mod pcd;
mod picture;
pub mod picture_file;
pub mod ply;
pub mod png;
pub mod ptx;
pub mod range_file;
mod rows;
mod step;
pub mod stl;
mod surface;
mod three_mf;
pub mod tiff;
mod upright;
pub mod xyz;
mod zip;

/// The files that the engine's own values can be written to; the first one of a type is preferred where nobody names a file.
pub const FORMATS: &[Format] = &[
    format::<png::ImagePng>(),
    format::<png::MaskPng>(),
    format::<png::LabelsPng>(),
    format::<png::FieldPng>(),
    format::<tiff::ImageTiff>(),
    format::<tiff::MaskTiff>(),
    format::<tiff::FieldTiff>(),
    format::<pcd::RangePcd>(),
    format::<glb::MeshGlb>(),
    format::<ply::MeshPly>(),
    format::<ply::ControlNetPly>(),
    format::<ply::RegionPly>(),
    format::<ply::RangePly>(),
    format::<ply::PointsPly>(),
    format::<ply::HandlesPly>(),
    format::<ply::CurvePly>(),
    format::<ptx::RangePtx>(),
    format::<xyz::RangeXyz>(),
    format::<depth::RangeDepthPng>(),
    format::<xyz::PointsXyz>(),
    format::<obj::MeshObj>(),
    format::<obj::CurveObj>(),
    format::<stl::MeshStl>(),
    format::<three_mf::MeshThreeMf>(),
    format::<step::SurfaceStep>(),
    format::<surface::SurfaceGlb>(),
    format::<surface::SurfacePly>(),
    format::<obj::SurfaceObj>(),
    format::<picture::MeshPng>(),
    format::<picture::SurfacePng>(),
    format::<json::DirectionJson>(),
    format::<json::KnotVectorJson>(),
    format::<json::LabelsJson>(),
    format::<json::TraceJson>(),
    format::<json::ControlNetJson>(),
    format::<handles::HandlesJson>(),
];

/// The files that the engine's own values can be read from; where only the ending is known, the first one that finds something.
pub const READERS: &[AnyReader] = &[
    reader::<picture_file::ImageFiles>(),
    reader::<range_file::RangeFiles>(),
    reader::<obj::MeshObj>(),
    reader::<ply::MeshPly>(),
    reader::<stl::MeshStl>(),
    reader::<glb::MeshGlb>(),
    reader::<glb::MeshGltf>(),
    reader::<ply::PointsPly>(),
    reader::<pcd::PointsPcd>(),
    reader::<xyz::PointsXyz>(),
    reader::<las::PointsLas>(),
    reader::<e57::PointsE57>(),
    reader::<obj::CurveObj>(),
    reader::<picture_file::MaskFiles>(),
    reader::<handles::HandlesRon>(),
    reader::<handles::HandlesJson>(),
    reader::<handles::HandlesCsv>(),
];

/// The value in a file, by the engine's own reader of such values and its ending.
///
/// # Errors
/// [`NoReader`] if there is none, or those of the reader.
pub fn read<T: Value>(file: &Reading<'_>) -> Result<T, Error> {
    let value = Readers::new(READERS.iter().copied()).read(value_type::<T>(), file)?;
    value.get().cloned().ok_or_else(|| {
        let (what, ending) = (T::NAME, file.ending());
        NoReader { what, ending, known: Vec::new() }.into()
    })
}

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
fn most_memory(bytes: usize) -> usize {
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
fn check_single(what: &'static str, points: &[Point3<f64>]) -> Result<(), TooFar> {
    let far = |point: &Point3<f64>| point.iter().any(|&x| (x as f32).is_infinite());
    let first = points.par_chunks(BLOCK).enumerate().find_map_first(|(block, points)| {
        // Without a branch for each point, so that wide vectors look at several of them at once.
        let is_far = points.iter().fold(false, |is_far, point| is_far | far(point));
        is_far.then(|| block * BLOCK + points.iter().position(far).unwrap_or_default())
    });
    first.map_or(Ok(()), |index| Err(TooFar { what, index, place: points[index].coords.into() }))
}

/// The same of the vertices of a mesh, which are looked at only if one of them is there.
fn check_mesh(mesh: &Mesh) -> Result<(), TooFar> {
    let is_near = |place: Point3<f64>| place.iter().all(|&x| (x as f32).is_finite());
    match mesh.known_bounds().is_none_or(|(low, high)| is_near(low) && is_near(high)) {
        true => Ok(()),
        false => check_single("vertex", mesh.positions()),
    }
}

/// Points that one task looks at.
const BLOCK: usize = 4096;

/// A mesh is told by steps of no more than this share of its size: less than what is seen or printed.
const COARSEST: f64 = 1e-4;

/// What is said of places that lie so far from the origin, beside their size, that single precision moves them.
fn coarse(points: &[Point3<f64>]) -> Option<String> {
    let none = (Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3]));
    let of_block = |points: &[Point3<f64>]| {
        let known = points.iter().filter(|point| !point.x.is_nan());
        known.fold(none, |(low, high), point| (low.inf(point), high.sup(point)))
    };
    let of_blocks: Vec<_> = points.par_chunks(BLOCK).map(of_block).collect();
    let both = |a: (Point3<f64>, Point3<f64>), b: &(_, _)| (a.0.inf(&b.0), a.1.sup(&b.1));
    let (low, high) = of_blocks.iter().fold(none, both);
    coarse_within(low, high)
}

/// The same of a mesh.
fn coarse_mesh(mesh: &Mesh) -> Option<String> {
    mesh.known_bounds().and_then(|(low, high)| coarse_within(low, high))
}

/// The same of places between these.
fn coarse_within(low: Point3<f64>, high: Point3<f64>) -> Option<String> {
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
fn open(mesh: &Mesh) -> Option<String> {
    let open = mesh.edges().faces.iter().filter(|faces| **faces != 2).count();
    (open > 0).then(|| {
        format!(
            "the mesh is not closed: {open} of its edges have not two faces, and a slicer guesses what is inside; `Solid` closes it"
        )
    })
}

/// The first part of some bytes as text, for a message: whatever a hostile file holds, short and on one line.
fn excerpt(bytes: &[u8]) -> String {
    let start = &bytes[..bytes.len().min(40)];
    start.iter().flat_map(|byte| byte.escape_ascii()).map(char::from).collect()
}

/// A number in a text, if it is one.
fn parse<T: std::str::FromStr>(token: &[u8]) -> Option<T> {
    std::str::from_utf8(token).ok()?.parse().ok()
}

/// The words of a line.
fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

#[cfg(test)]
mod hostile {
    //! Files that lie: valid ones, cut and bent.

    use maquette_value::random::{STEP, mix};

    /// Calls `read` with `file` cut at every length, and with some thousand versions of it in which a few bytes are others:
    /// by any result but a panic the reader passes.
    pub(super) fn survive<T>(file: &[u8], read: impl Fn(&[u8]) -> T) {
        (0..file.len()).for_each(|length| drop(read(&file[..length])));
        for case in 0..3000 {
            let mut bent = file.to_vec();
            for change in 0..1 + case % 4 {
                let random = scramble(case * 8 + change);
                let at = random as usize % bent.len();
                let byte = (random >> 40) as u8;
                // Digits make other numbers of numbers, other bytes break them.
                bent[at] = if random >> 63 == 0 { byte } else { b'0' + byte % 10 };
            }
            drop(read(&bent));
        }
    }

    fn scramble(counter: u64) -> u64 {
        mix(counter.wrapping_add(1).wrapping_mul(STEP))
    }
}
