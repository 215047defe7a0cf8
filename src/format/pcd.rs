//! PCD 0.7, the point clouds of the Point Cloud Library: grids of points, with or without colors.
//!
//! All three encodings are read, with fields of any type in any order. Files are written as `binary`, with the fields x y z as `float` and,
//! if there are colors, a fourth field `rgb`. The file does not state units and axes, so the user of the reader must know them.

use header::{Encoding, Field, Header, Scalar, count_error, value_error};
use maquette_node::importers::{FileReader, InputFile};
use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::parallel::*;
use maquette_value::{Attribute, Points, RangeImage, Rgb};
use nalgebra::Point3;

use super::colors::{self, ColorRange};
use super::finite::{self, FiniteMask};
use super::losses;
use super::rows::{fill_blocks, fill_column};
use super::{FilePosition, check_single, max_memory, parse, parse_real, words};

mod header;
mod lzf;
pub(crate) mod size;

/// The error that the points are a list instead of a grid.
#[derive(Debug, thiserror::Error)]
#[error(
    "line {line}: HEIGHT is 1: the {width} points are a list, not the rows of a grid (the cloud is not organized)"
)]
pub struct NotOrganizedError {
    line: usize,
    width: usize,
}

/// Reads a PCD file whose points are organized as a grid. A cell is invalid if a coordinate is NaN or infinite, or z is 0.
///
/// Returns an error if the bytes are not a PCD file, its points are not organized as a grid, or the file is truncated.
pub fn read(bytes: &[u8]) -> Result<RangeImage, Error> {
    Ok(read_range(bytes)?.0)
}

/// Reads the range image of an organized PCD file. Also returns warnings about fields that are left out.
pub(super) fn read_range(bytes: &[u8]) -> Result<(RangeImage, Vec<String>), Error> {
    let header = header::read(bytes)?;
    if header.height == 1 {
        let (line, width) = (header.height_line, header.width);
        return Err(NotOrganizedError { line, width }.into());
    }
    let (points, colors) = cells(&header, bytes, valid_point)?;
    let range = RangeImage::new(header.width, header.height, points)
        .expect("a point was read for each cell");
    let range = match header.color {
        Some(_) => range.with_colors(colors).expect("a color was read for each cell"),
        None => range,
    };
    let normal = header.normal.map(|_| "normal").into_iter();
    let channels = header.channels.filter(|_| header.color.is_none()).map(|_| "r g b").into_iter();
    let others = header.others.iter().map(|(name, _)| &name[..]);
    let notes = losses::range_warning(normal.chain(channels).chain(others));
    Ok((range, notes.into_iter().collect()))
}

/// Reads the points of a PCD file, organized as a grid or not, with their colors (`rgb`, or `r g b`) and normals
/// (`normal_x normal_y normal_z`, or `nx ny nz`). Each other field becomes a number attribute with the name of the field. Also returns
/// warnings about data that are left out or ambiguous.
fn read_points(bytes: &[u8], range: Option<ColorRange>) -> Result<(Points, Vec<String>), Error> {
    let header = header::read(bytes)?;
    let (mut positions, colors) = cells(&header, bytes, Point3::from)?;
    let finite = FiniteMask::clear_non_finite(&mut positions);
    let mut notes: Vec<_> =
        finite::left_out_note(finite.n_left_out(), "point").into_iter().collect();
    if header.has_viewpoint {
        notes.push(
            "VIEWPOINT is ignored: points are read with the coordinates in the file".to_owned(),
        );
    }
    let mut points = Points::new(positions).expect("places are finite");
    let has_entry_per_point = "an entry was read for each point";
    fn read_triple(
        fields: [Field; 3],
        header: &Header,
        bytes: &[u8],
    ) -> Result<Vec<Point3<f64>>, Error> {
        let only = Header { position: fields, color: None, others: Vec::new(), ..*header };
        Ok(cells(&only, bytes, Point3::from)?.0)
    }
    if header.color.is_some() {
        points = points
            .with_attribute("color", Attribute::Color(colors.into()))
            .expect(has_entry_per_point);
    } else if let Some(fields) = header.channels {
        let channels = read_triple(fields, &header, bytes)?;
        let all = channels.iter().flat_map(|color| color.iter().copied());
        let are_whole = all.clone().all(|channel| channel.fract() == 0.0);
        let range = colors::decide(range, all, are_whole, ColorRange::To255, &mut notes);
        let colors = channels
            .iter()
            .map(|color| [color.x, color.y, color.z].map(|channel| colors::byte(range, channel)))
            .collect();
        points =
            points.with_attribute("color", Attribute::Color(colors)).expect(has_entry_per_point);
    }
    if let Some(fields) = header.normal {
        // Programs write NaN for a missing normal. Such normals become zero vectors.
        let mut normals: Vec<_> = read_triple(fields, &header, bytes)?
            .iter()
            .map(|normal| normal.coords.into())
            .collect();
        notes.extend(finite::replace_non_finite(&mut normals, "normal", "point", |index| {
            finite.contains(index)
        }));
        points = points
            .with_attribute("normal", Attribute::Vector(normals.into()))
            .expect(has_entry_per_point);
    }
    for some in header.others.chunks(3) {
        let numbers = read_triple(
            [0, 1, 2].map(|k: usize| some.get(k).unwrap_or(&some[0]).1),
            &header,
            bytes,
        )?;
        for (k, (name, _)) in some.iter().enumerate() {
            let column = numbers.iter().map(|numbers| numbers[k]).collect();
            points =
                points.with_attribute(name, Attribute::Number(column)).expect(has_entry_per_point);
        }
    }
    Ok((finite.points(points), notes))
}

/// Reads all points and colors. `to_point` converts three coordinates to a point.
fn cells(
    header: &Header,
    bytes: &[u8],
    to_point: impl Fn([f64; 3]) -> Point3<f64> + Sync,
) -> Result<(Vec<Point3<f64>>, Vec<Rgb>), Error> {
    let body = &bytes[header.start..];
    match header.encoding {
        Encoding::Ascii => ascii(header, body, to_point),
        Encoding::Binary => {
            need(header, body, header.width * header.height * header.stride)?;
            Ok(gather(
                header,
                |index: usize, field| &body[index * header.stride + field.offset..],
                to_point,
            ))
        }
        Encoding::Compressed => {
            let columns = unpack(header, body)?;
            let count = header.width * header.height;
            Ok(gather(
                header,
                |index, field| &columns[field.offset * count + index * field.bytes..],
                to_point,
            ))
        }
    }
}

/// Checks that `body` has at least `expected` bytes. This is done before memory is reserved for the points.
fn need(header: &Header, body: &[u8], expected: usize) -> Result<(), Error> {
    if body.len() < expected {
        let at = match header.encoding {
            Encoding::Ascii => FilePosition::Line(header.start_line),
            Encoding::Binary | Encoding::Compressed => FilePosition::Byte(header.start),
        };
        return Err(truncated(at, body.len(), expected));
    }
    Ok(())
}

fn truncated(at: FilePosition, found: usize, expected: usize) -> Error {
    Error::new(format!("{at}: expected at least {expected} bytes of data, found {found}"))
}

/// Unpacks a compressed body. It is stored by columns: all values of the first field, then all of the second, and so on.
fn unpack(header: &Header, body: &[u8]) -> Result<Vec<u8>, Error> {
    let at = FilePosition::Byte(header.start);
    let (sizes, rest) =
        body.split_first_chunk::<8>().ok_or_else(|| truncated(at, body.len(), 8))?;
    let [packed, unpacked] =
        [0, 4].map(|at| u32::from_le_bytes(header::first_bytes(&sizes[at..])) as usize);
    if unpacked != header.width * header.height * header.stride {
        let byte = header.start + 4;
        bail!("byte {byte}: the size of the data does not match the points in the header");
    }
    let (width, height) = (header.width, header.height);
    let limit = max_memory(body.len());
    let per_point = header.stride.saturating_add(size_of::<Point3<f64>>() + size_of::<Rgb>());
    if limit / per_point < width * height {
        bail!(
            "{width} x {height} points would take more than {limit} bytes of memory: write them uncompressed, as `DATA binary`"
        );
    }
    let stream = rest.get(..packed);
    let stream = stream.ok_or_else(|| truncated(at, body.len(), packed.saturating_add(8)))?;
    lzf::unpack(stream, unpacked).map_err(|error| {
        Error::new(format!("byte {}: {}", header.start + 8 + error.byte, error.what))
    })
}

/// Reads all points and colors. `bytes` returns the bytes of a point, beginning at a field.
fn gather<'a>(
    header: &Header,
    bytes: impl Fn(usize, &Field) -> &'a [u8] + Sync,
    point: impl Fn([f64; 3]) -> Point3<f64> + Sync,
) -> (Vec<Point3<f64>>, Vec<Rgb>) {
    let cells = || (0..header.width * header.height).into_par_iter().with_min_len(BLOCK);
    let position = &header.position;
    let single =
        |index, field| f64::from(f32::from_le_bytes(header::first_bytes(bytes(index, field))));
    // Most files have single precision. Testing for it before the loop makes the loop about 5 times faster.
    let points = if position.iter().all(|field| field.scalar == Scalar::F32) {
        cells().map(|index| point(position.each_ref().map(|field| single(index, field)))).collect()
    } else {
        cells()
            .map(|index| {
                point(position.each_ref().map(|field| field.scalar.read(bytes(index, field))))
            })
            .collect()
    };
    (
        points,
        header.color.as_ref().map_or_else(Vec::new, |field| {
            cells().map(|index| unpack_color(header::first_bytes(bytes(index, field)))).collect()
        }),
    )
}

/// The number of cells per parallel task.
const BLOCK: usize = 8192;

/// Converts coordinates to a point; a point with zero depth becomes NaN. Sensors write NaN or zero depth for missing measurements.
fn valid_point([x, y, z]: [f64; 3]) -> Point3<f64> {
    if z == 0.0 { Point3::new(f64::NAN, f64::NAN, f64::NAN) } else { Point3::new(x, y, z) }
}

fn unpack_color([blue, green, red, _]: [u8; 4]) -> Rgb {
    [red, green, blue]
}

/// Reads the points of an ASCII body, one per line.
fn ascii(
    header: &Header,
    body: &[u8],
    point: impl Fn([f64; 3]) -> Point3<f64>,
) -> Result<(Vec<Point3<f64>>, Vec<Rgb>), Error> {
    let count = header.width * header.height;
    // Each number takes at least a digit and a blank, but the blank after the last number may be missing.
    need(header, body, count.saturating_mul(header.numbers).saturating_mul(2) - 1)?;
    let mut points = Vec::with_capacity(count);
    let mut colors = Vec::new();
    let lines = body.split(|&byte| byte == b'\n').zip(header.start_line..).until_stopped();
    for (text, line) in lines.filter(|(text, _)| words(text).next().is_some()).take(count) {
        let numbers: Vec<_> = words(text).collect();
        if numbers.len() != header.numbers {
            return Err(count_error(line, header.numbers, numbers.len()));
        }
        let [x, y, z] = header.position.map(|field| number(&field, numbers[field.index], line));
        points.push(point([x?, y?, z?]));
        if let Some(field) = &header.color {
            colors.push(color(field, numbers[field.index], line)?);
        }
    }
    if points.len() < count {
        let (line, found) = (header.start_line, points.len());
        bail!("line {line}: expected {count} points, found {found}");
    }
    Ok((points, colors))
}

fn number(field: &Field, word: &[u8], line: usize) -> Result<f64, Error> {
    let number = match field.scalar {
        // Single-precision numbers are parsed as such, because rounding twice can differ from rounding once.
        Scalar::F32 => parse_real::<f32>(word).map(f64::from),
        _ => parse_real(word),
    };
    number.ok_or_else(|| value_error(line, word))
}

fn color(field: &Field, word: &[u8], line: usize) -> Result<Rgb, Error> {
    let bits = match field.scalar {
        // A packed color that was written as NaN has lost its bits, and becomes black.
        Scalar::F32 => parse_real::<f32>(word).map(|x| if x.is_nan() { 0 } else { x.to_bits() }),
        Scalar::I32 => parse::<i32>(word).map(|bits| bits as u32),
        _ => parse(word),
    };
    let bits = bits.ok_or_else(|| value_error(line, word))?;
    Ok(unpack_color(bits.to_le_bytes()))
}

/// Reads points, whether they are organized as a grid or not.
pub(super) struct PointsPcd;

impl FileReader for PointsPcd {
    type Value = Points;
    const EXTENSIONS: &'static [&'static str] = &["pcd"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::POINTS_READ;
    const SIZE: crate::SizeReader = Some(size::points);

    fn read(file: &InputFile<'_>) -> Result<Points, Error> {
        let (points, notes) = read_points(file.bytes(), file.color_range())?;
        notes.into_iter().for_each(|note| file.warn(note));
        Ok(points)
    }
}

/// Writes a range image as a binary PCD file, in single precision, with NaN for invalid cells.
pub(super) struct RangePcd;

impl FileFormat for RangePcd {
    type Value = RangeImage;
    const EXTENSION: &'static str = "pcd";

    fn write(range: &RangeImage, name: &str) -> Result<Vec<NewFile>, Error> {
        Ok(NewFile::single(name, encode(range)?))
    }
}

/// Encodes a range image as a binary PCD file, in single precision, with NaN for invalid cells.
///
/// Returns an error if a coordinate is too large for single precision.
pub fn encode(range: &RangeImage) -> Result<Vec<u8>, Error> {
    check_single("cell", range.points())?;
    let (width, height) = (range.width(), range.height());
    let (names, per_field) = match range.colors() {
        Some(_) => ("x y z rgb", 4),
        None => ("x y z", 3),
    };
    fn repeat_word(word: &str, per_field: usize) -> String {
        vec![word; per_field].join(" ")
    }
    let header = format!(
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {names}\nSIZE {}\nTYPE {}\nCOUNT {}\n\
         WIDTH {width}\nHEIGHT {height}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {}\nDATA binary\n",
        repeat_word("4", per_field),
        repeat_word("F", per_field),
        repeat_word("1", per_field),
        range.points().len(),
    );
    let stride = 4 * per_field;
    let mut bytes = vec![0; header.len() + stride * range.points().len()];
    let (head, body) = bytes.split_at_mut(header.len());
    head.copy_from_slice(header.as_bytes());
    fn coordinate(x: f64) -> f32 {
        if x.is_nan() { f32::NAN } else { x as f32 }
    }
    fill_blocks(body, stride, |rows, first| {
        fill_column(rows, stride, 0, &range.points()[first..], |point| {
            <[f64; 3]>::from(point.coords).map(|x| coordinate(x).to_le_bytes())
        });
        if let Some(colors) = range.colors() {
            fill_column(rows, stride, 12, &colors[first..], |&[red, green, blue]| {
                [blue, green, red, 0]
            });
        }
    });
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hostile;

    const ASCII: &[u8] = include_bytes!("../../tests/data/formats/ascii.pcd");
    const BINARY: &[u8] = include_bytes!("../../tests/data/formats/binary.pcd");
    const NO_COLOR: &[u8] = include_bytes!("../../tests/data/formats/binary_norgb.pcd");
    const COMPRESSED: &[u8] = include_bytes!("../../tests/data/formats/compressed_rgba.pcd");
    const ODD_FIELDS: &[u8] = include_bytes!("../../tests/data/formats/odd_fields.pcd");
    const GRID: &str = include_str!("../../tests/data/formats/grid.json");

    /// The points that all test files contain; `None` for a hole.
    fn grid() -> Vec<Option<[f64; 3]>> {
        let grid: serde_json::Value = serde_json::from_str(GRID).unwrap();
        let rows: Vec<Vec<Option<[f64; 3]>>> = serde_json::from_value(grid["xyz"].clone()).unwrap();
        rows.concat()
    }

    fn points(range: &RangeImage) -> Vec<Option<[f64; 3]>> {
        (0..range.points().len()).map(|cell| range.point(cell).map(Into::into)).collect()
    }

    #[test]
    fn every_encoding_and_field_order_gives_the_same_grid_and_colors() {
        let colors = read(BINARY).unwrap().colors().unwrap().to_vec();
        for (file, colored) in [
            (ASCII, true),
            (BINARY, true),
            (NO_COLOR, false),
            (COMPRESSED, true),
            (ODD_FIELDS, true),
        ] {
            let range = read(file).unwrap();
            assert_eq!((range.width(), range.height()), (8, 6));
            assert_eq!(points(&range), grid());
            assert_eq!(range.colors(), colored.then_some(&colors[..]));
        }
    }

    #[test]
    fn a_written_grid_is_read_back() {
        for file in [BINARY, NO_COLOR] {
            let range = read(file).unwrap();
            let again = read(&encode(&range).unwrap()).unwrap();
            assert_eq!(points(&again), points(&range));
            assert_eq!(again.colors(), range.colors());
        }
    }

    #[test]
    fn a_cell_of_zero_depth_is_invalid() {
        let file =
            b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 2\nDATA ascii\n1 2 0\n1 2 3\n";
        assert_eq!(points(&read(file).unwrap()), [None, Some([1.0, 2.0, 3.0])]);
    }

    /// Replaces a text in the header of a valid file. Returns the resulting error.
    fn error(from: &str, to: &str) -> String {
        let text = String::from_utf8(ASCII.to_vec()).unwrap();
        assert!(text.contains(from));
        read(text.replacen(from, to, 1).as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn invalid_headers_are_rejected_with_their_line() {
        assert_eq!(
            error("WIDTH 8\nHEIGHT 6", "WIDTH 48\nHEIGHT 1"),
            "line 8: HEIGHT is 1: the 48 points are a list, not the rows of a grid (the cloud is not organized)"
        );
        assert_eq!(error("POINTS 48", "POINTS 47"), "line 10: POINTS is 47, but the grid is 8 x 6");
        assert_eq!(error("WIDTH 8", "WIDTH 9"), "line 10: POINTS is 48, but the grid is 9 x 6");
        assert_eq!(error("SIZE 4 4 4 4", "SIZE 4 4 4"), "line 4: expected 4 values, found 3");
        assert_eq!(error("SIZE 4", "SIZE 3"), "line 5: `F of 3 bytes` is not a valid value");
        assert_eq!(error("FIELDS x", "FIELDS a"), "the points have no field x");
        assert_eq!(error("WIDTH", "BREADTH"), "line 7: `BREADTH` is not a keyword of a PCD header");
        assert_eq!(error("DATA ascii", "DATA morse"), "line 11: `morse` is not a valid value");
        assert_eq!(
            error("WIDTH 8\nHEIGHT 6\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 48", "WIDTH 8\nHEIGHT 7"),
            "line 10: expected 56 points, found 48"
        );
        let huge = error("WIDTH 8", "WIDTH 18446744073709551615");
        assert_eq!(huge, "line 7: the size is 0 or too large");
    }

    #[test]
    fn a_missing_grid_takes_no_memory() {
        for (encoding, expected) in [
            ("ascii", "line 7: expected at least 5999999999999 bytes of data, found 5"),
            ("binary", "byte 76: expected at least 12000000000000 bytes of data, found 5"),
            ("binary_compressed", "byte 87: expected at least 8 bytes of data, found 5"),
        ] {
            let file = format!(
                "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1000000\nHEIGHT 1000000\nDATA {encoding}\n1 2 3"
            );
            let error = read(file.as_bytes()).unwrap_err().to_string();
            assert!(error.starts_with(expected), "{error}");
        }
    }

    #[test]
    fn a_small_file_that_unpacks_to_very_many_points_is_rejected() {
        let header = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 10000\nHEIGHT 5000\nDATA binary_compressed\n";
        let (packed, unpacked) = (8_000_000u32, 600_000_000u32);
        let mut file = [header.as_bytes(), &packed.to_le_bytes(), &unpacked.to_le_bytes()].concat();
        // The compressed data are one byte, followed by copies of it.
        file.extend([0, 0]);
        file.extend([7 << 5, 255, 0].repeat(packed as usize / 3 - 1));
        file.resize(header.len() + 8 + packed as usize, 0);
        let text = "10000 x 5000 points would take more than 1073741824 bytes of memory: write them uncompressed, as `DATA binary`";
        assert_eq!(read(&file).unwrap_err().to_string(), text);
    }

    #[test]
    fn a_list_of_points_is_read_without_points_that_are_not_finite() {
        let file = b"FIELDS x y z rgb normal_x normal_y normal_z\nSIZE 4 4 4 4 4 4 4\nTYPE F F F U F F F\nWIDTH 3\nHEIGHT 1\n\
            DATA ascii\n1 2 0 65280 0 0 1\nnan 0 0 0 0 0 1\n4 5 6 255 nan nan nan\n";
        let (points, notes) = read_points(file, None).unwrap();
        let left_out = "1 point is left out: a coordinate is NaN or infinite";
        let no_normal = "`normal` of 1 point is NaN or infinite: there is a zero in place of it";
        assert_eq!(notes, [left_out, no_normal]);
        assert_eq!(
            points.positions()[..],
            [Point3::new(1.0, 2.0, 0.0), Point3::new(4.0, 5.0, 6.0)]
        );
        assert_eq!(points.attributes().colors("color").unwrap()[..], [[0, 255, 0], [0, 0, 255]]);
        assert_eq!(points.attributes().vectors("normal").unwrap()[..], [[0.0, 0.0, 1.0], [0.0; 3]]);
        let file = InputFile::standalone("a.pcd", file);
        PointsPcd::read(&file).unwrap();
        assert_eq!(file.warnings(), [left_out, no_normal]);
        let holes = grid().iter().filter(|point| point.is_none()).count();
        assert_eq!(read_points(COMPRESSED, None).unwrap().0.positions().len(), 48 - holes);
    }

    #[test]
    fn other_fields_become_numbers_and_padding_is_ignored() {
        let file = b"FIELDS x y z r g b _ ring histogram nx ny nz\nSIZE 4 4 4 1 1 1 1 2 4 4 4 4\nTYPE F F F U U U U U F F F F\nCOUNT 1 1 1 1 1 1 2 1 2 1 1 1\n\
            WIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 5 1 0 0 0\nDATA ascii\n1 2 0 255 0 0 9 9 7 .5 .25 0 0 1\n3 4 5 10 20 30 9 9 8 1 2 0 1 0\n";
        let (points, notes) = read_points(file, None).unwrap();
        let attributes = points.attributes();
        assert_eq!(attributes.colors("color").unwrap()[..], [[255, 0, 0], [10, 20, 30]]);
        assert_eq!(attributes.vectors("normal").unwrap()[1], [0.0, 1.0, 0.0]);
        fn number(name: &str, attributes: &maquette_value::Attributes) -> Option<Attribute> {
            attributes.get(name).cloned()
        }
        assert_eq!(number("ring", attributes), Some(Attribute::Number(vec![7.0, 8.0].into())));
        assert_eq!(
            number("histogram_1", attributes),
            Some(Attribute::Number(vec![0.25, 2.0].into()))
        );
        assert_eq!(attributes.iter().count(), 5);
        assert_eq!(notes.len(), 1, "{notes:?}");
    }

    #[test]
    fn an_empty_file_gives_an_error() {
        assert_eq!(read(b"").unwrap_err().to_string(), "the file is empty");
    }

    #[test]
    fn hostile_files_give_errors() {
        for file in [ASCII, BINARY, COMPRESSED, ODD_FIELDS] {
            hostile::check_no_panic(file, |bytes| read(bytes).map(|range| range.n_valid()));
        }
    }
}
