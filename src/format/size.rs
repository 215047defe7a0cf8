//! The sizes of values in files, from the first bytes of a file and its length. Nothing else is read, except some samples of a text and the
//! description at the end of an E57 file.

use std::io::{self, Read, Seek, SeekFrom};

use e57::E57Reader;
use las::raw;
use maquette_node::{Certainty, FileHead, ValueSize};

use super::picture_file::Kind;
use super::{has_many_namespaces, parse, words};

/// The type of [`FileReader::SIZE`](maquette_node::FileReader::SIZE).
pub(crate) type SizeReader = Option<fn(&FileHead<'_>) -> Option<ValueSize>>;

/// Returns the size of the points in a LAS file. `None` if the file is compressed.
pub(super) fn las(head: &FileHead<'_>) -> Option<ValueSize> {
    /// Memory in bytes of the attributes `color`, `intensity` and `class` of a point.
    const ATTRIBUTES: f64 = 15.0;
    let header = raw::Header::read_from(head.start).ok()?;
    let count = match (header.number_of_point_records, header.large_file) {
        (0, Some(large)) => large.number_of_point_records,
        (count, _) => count.into(),
    };
    // A set bit 7 of the format marks points that are compressed.
    let is_plain = head.start.starts_with(&raw::LASF) && header.point_data_record_format < 128;
    is_plain.then(|| ValueSize::points(count as f64, ATTRIBUTES))
}

/// Returns the size of the mesh in an STL file.
pub(super) fn stl(head: &FileHead<'_>) -> Option<ValueSize> {
    let stated = head.start.get(80..84)?.first_chunk().map(|count| u32::from_le_bytes(*count))?;
    let room = head.length.saturating_sub(84) / 50;
    let is_binary = u64::from(stated) <= room && !head.start.starts_with(b"solid ")
        || u64::from(stated) == room;
    let (triangles, certainty) = match is_binary {
        true => (f64::from(stated), Certainty::Exact),
        // A text has a line `endfacet` for each triangle.
        false => {
            let ([triangles], certainty) = sample_lines(head, |line| {
                [f64::from(u8::from(words(line).next() == Some(b"endfacet")))]
            })?;
            (triangles, certainty)
        }
    };
    // Equal corners become one vertex. By Euler's formula a closed mesh without handles has two vertices more than half its triangles.
    let size = ValueSize::mesh(triangles / 2.0 + 2.0, triangles, 3.0 * triangles);
    Some(size.at_most(Certainty::Predicted).at_most(certainty))
}

/// Returns the size of the mesh in an OBJ file, extrapolated from samples of its lines.
pub(super) fn obj(head: &FileHead<'_>) -> Option<ValueSize> {
    let ([vertices, faces, corners], certainty) = sample_lines(head, |line| {
        let mut words = words(line);
        match words.next() {
            Some(b"v") => [1.0, 0.0, 0.0],
            Some(b"f") => [0.0, 1.0, words.count() as f64],
            _ => [0.0; 3],
        }
    })?;
    Some(ValueSize::mesh(vertices, faces, corners).at_most(certainty))
}

/// Returns the size of the points in a text with a point per line, extrapolated from samples of its lines.
pub(super) fn rows(head: &FileHead<'_>) -> Option<ValueSize> {
    let ([points, others], certainty) = sample_lines(head, |line| {
        let numbers = words(line).map_while(parse::<f64>).count() as f64;
        if numbers < 3.0 { [0.0; 2] } else { [1.0, numbers - 3.0] }
    })?;
    let attributes = if points > 0.0 { 8.0 * others / points } else { 0.0 };
    Some(ValueSize::points(points, attributes).at_most(certainty))
}

/// Counts in the lines of a text. `counts` returns the counts of a line. A text that is longer than the samples, which are at regular
/// distances, is taken to be like them; then the counts are a guess.
fn sample_lines<const N: usize>(
    head: &FileHead<'_>,
    counts: impl Fn(&[u8]) -> [f64; N],
) -> Option<([f64; N], Certainty)> {
    const SAMPLES: u64 = 32;
    const SAMPLE: usize = 1 << 14;
    fn add<const N: usize>(sum: [f64; N], more: [f64; N]) -> [f64; N] {
        std::array::from_fn(|k| sum[k] + more[k])
    }
    if head.start.len() as u64 >= head.length {
        let lines = head.start.split(|&byte| byte == b'\n').map(counts);
        return Some((lines.fold([0.0; N], add), Certainty::Predicted));
    }
    let (mut sum, mut seen) = ([0.0; N], 0);
    let step = head.length.saturating_sub(SAMPLE as u64) / (SAMPLES - 1);
    for sample in 0..SAMPLES {
        let bytes = head.read_at(sample * step, SAMPLE)?;
        // Leave out the line that the sample begins within, and the one that it ends within.
        let first = bytes.iter().position(|&byte| byte == b'\n').map_or(bytes.len(), |at| at + 1);
        let last = bytes.iter().rposition(|&byte| byte == b'\n').map_or(first, |at| at + 1);
        let lines = &bytes[first..last.max(first)];
        seen += lines.len();
        let lines = lines.split_inclusive(|&byte| byte == b'\n').map(&counts);
        sum = add(sum, lines.fold([0.0; N], add));
    }
    let factor = head.length as f64 / seen as f64;
    (seen > 0).then(|| (sum.map(|count| count * factor), Certainty::Guess))
}

/// The bytes of a file, of which only those are read that are asked for.
struct Window<'a, 'h> {
    head: &'a FileHead<'h>,
    position: u64,
}

impl Read for Window<'_, '_> {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        let bytes =
            self.head.read_at(self.position, to.len()).ok_or(io::ErrorKind::UnexpectedEof)?;
        to[..bytes.len()].copy_from_slice(&bytes);
        self.position += bytes.len() as u64;
        Ok(bytes.len())
    }
}

impl Seek for Window<'_, '_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let position = match to {
            SeekFrom::Start(position) => Some(position),
            SeekFrom::End(offset) => self.head.length.checked_add_signed(offset),
            SeekFrom::Current(offset) => self.position.checked_add_signed(offset),
        };
        self.position = position.ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.position)
    }
}

/// Returns the size of the points in an E57 file, which its description states.
pub(super) fn e57(head: &FileHead<'_>) -> Option<ValueSize> {
    /// The maximum length of a description in bytes: the crate reads it into memory.
    const MAX_DESCRIPTION: u64 = 16 << 20;
    let length = u64::from_le_bytes(*head.start.get(32..40)?.first_chunk()?);
    if length > MAX_DESCRIPTION {
        return None;
    }
    let description = E57Reader::raw_xml(Window { head, position: 0 }).ok()?;
    if has_many_namespaces(&description) {
        return None;
    }
    let scans = E57Reader::new(Window { head, position: 0 }).ok()?.pointclouds();
    let count = scans.iter().map(|scan| scan.records as f64).sum();
    let color = if scans.iter().any(|scan| scan.has_color()) { 3.0 } else { 0.0 };
    let intensity = if scans.iter().any(|scan| scan.has_intensity()) { 8.0 } else { 0.0 };
    Some(ValueSize::points(count, color + intensity))
}

/// Returns the size of the picture in a file.
pub(super) fn picture(head: &FileHead<'_>) -> Option<ValueSize> {
    let [width, height] = picture_size(head)?;
    Some(ValueSize::items(f64::from(width) * f64::from(height), 3.0))
}

/// Returns the size of the mask in a picture file.
pub(super) fn mask(head: &FileHead<'_>) -> Option<ValueSize> {
    let [width, height] = picture_size(head)?;
    Some(ValueSize::items(f64::from(width) * f64::from(height), 1.0))
}

/// Returns the size of the range image in a file: a grid of points, or a depth map.
pub(super) fn range(head: &FileHead<'_>) -> Option<ValueSize> {
    match head.extension {
        "pcd" => super::pcd::size::range(head),
        "ply" => super::ply::size::range(head),
        "ptx" => {
            let mut lines = head.start.split(|&byte| byte == b'\n').map(<[u8]>::trim_ascii);
            let [columns, rows] = [parse::<f64>(lines.next()?)?, parse::<f64>(lines.next()?)?];
            Some(ValueSize::points(columns * rows, 3.0))
        }
        _ => {
            let [width, height] = picture_size(head)?;
            Some(ValueSize::points(f64::from(width) * f64::from(height), 0.0))
        }
    }
}

/// Returns the width and height of a picture in pixels.
fn picture_size(head: &FileHead<'_>) -> Option<[u32; 2]> {
    let bytes = head.start;
    match Kind::detect(bytes)? {
        Kind::Png => Some([16, 20].map(|at| big_u32(bytes, at))).and_then(both),
        Kind::Bmp => {
            let rows = little_u32(bytes, 22)?.cast_signed().unsigned_abs();
            Some([little_u32(bytes, 18)?, rows])
        }
        Kind::Jpeg => jpeg(bytes),
        Kind::Tiff => tiff(head),
        Kind::WebP => webp(bytes),
        Kind::Exr => exr(bytes),
        Kind::Hdr => hdr(bytes),
    }
}

fn both([width, height]: [Option<u32>; 2]) -> Option<[u32; 2]> {
    Some([width?, height?])
}

fn little_u32(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn big_u32(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_be_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn little_u16(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u16::from_le_bytes(*bytes.get(at..)?.first_chunk()?).into())
}

fn big_u16(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u16::from_be_bytes(*bytes.get(at..)?.first_chunk()?).into())
}

/// Follows the segments of a JPEG file to the start of the frame (SOF), which has the size.
fn jpeg(bytes: &[u8]) -> Option<[u32; 2]> {
    let mut at = 2;
    loop {
        let marker = *bytes.get(at + 1)?;
        // The markers C4, C8 and CC in the range of frames have other meanings.
        if (0xc0..0xd0).contains(&marker) && ![0xc4, 0xc8, 0xcc].contains(&marker) {
            return both([big_u16(bytes, at + 7), big_u16(bytes, at + 5)]);
        }
        at += match marker {
            0xff => 1,
            _ => 2 + big_u16(bytes, at + 2)? as usize,
        };
    }
}

/// Reads the tags 256 and 257 of the first directory of a TIFF file.
fn tiff(head: &FileHead<'_>) -> Option<[u32; 2]> {
    let (u16_at, u32_at): (ReadAt, ReadAt) =
        if head.start.starts_with(b"MM") { (big_u16, big_u32) } else { (little_u16, little_u32) };
    // Files with 64-bit offsets have the version 43.
    if u16_at(head.start, 2)? != 42 {
        return None;
    }
    const ENTRY: usize = 12;
    const SHORT: u32 = 3;
    let directory = head.read_at(u32_at(head.start, 4)?.into(), 2 + ENTRY * 64)?;
    let entries = directory.get(2..)?.as_chunks::<ENTRY>().0.iter();
    let entries = entries.take(u16_at(&directory, 0)? as usize);
    let [mut width, mut height] = [None; 2];
    for entry in entries {
        let value = if u16_at(entry, 2)? == SHORT { u16_at(entry, 8) } else { u32_at(entry, 8) };
        match u16_at(entry, 0)? {
            256 => width = width.or(value),
            257 => height = height.or(value),
            _ => {}
        }
    }
    both([width, height])
}

/// Reads a number at a position.
type ReadAt = fn(&[u8], usize) -> Option<u32>;

/// Reads the size in the first chunk of a WebP file: extended, lossless or lossy.
fn webp(bytes: &[u8]) -> Option<[u32; 2]> {
    match bytes.get(12..16)? {
        b"VP8X" => both([24, 27].map(|at| Some((little_u32(bytes, at)? & 0xff_ffff) + 1))),
        b"VP8L" => {
            let bits = little_u32(bytes, 21)?;
            Some([bits & 0x3fff, bits >> 14 & 0x3fff].map(|less_one| less_one + 1))
        }
        _ => both([26, 28].map(|at| Some(little_u32(bytes, at)? & 0x3fff))),
    }
}

/// Reads the attribute `dataWindow` of an OpenEXR file.
fn exr(bytes: &[u8]) -> Option<[u32; 2]> {
    const NAME: &[u8] = b"dataWindow\0box2i\0";
    let at = bytes.windows(NAME.len()).position(|window| window == NAME)? + NAME.len() + 4;
    let (corners, _) = bytes.get(at..)?.as_chunks::<4>();
    let [left, top, right, bottom] =
        corners.first_chunk()?.map(|number: [u8; 4]| i32::from_le_bytes(number));
    Some([right.abs_diff(left).saturating_add(1), bottom.abs_diff(top).saturating_add(1)])
}

/// Reads the line `-Y height +X width` of a Radiance HDR file.
fn hdr(bytes: &[u8]) -> Option<[u32; 2]> {
    bytes.split(|&byte| byte == b'\n').find_map(|line| match words(line).collect::<Vec<_>>()[..] {
        [b"-Y" | b"+Y", height, b"+X" | b"-X", width] => both([parse(width), parse(height)]),
        _ => None,
    })
}

#[cfg(test)]
mod tests;
