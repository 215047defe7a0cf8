//! PTX, the text files of Leica scanners: grids of points, stored column by column, each column from the bottom up, in meters.
//!
//! Each scan has a header of ten lines: columns, rows, the scanner's position and its axes (four lines), and a transformation of four rows
//! that multiplies row vectors. Then there is a line for each cell: x y z intensity, and optionally red green blue; x = y = z = 0 is a
//! hole. The file does not state the directions of the axes; they are assumed to be x right, y down, z away from the scanner. Points are
//! read from all scans, each moved by the transformation of its scan; a range grid is read from a single scan.

use maquette_node::importers::{FileReader, InputFile};
use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::parallel::UntilStopped;
use maquette_value::{Attribute, Points, RangeImage, Rgb};
use nalgebra::{Matrix4, Point3};

use super::losses;
use super::range_file::RangeFile;
use super::{camera, check_single, count_error, excerpt, finite, parse, parse_real, words};

/// Millimeters per unit of the format.
const METER: f64 = 1000.0;

/// Reads the range grid in a PTX file with one scan, in meters. The transformation becomes the pose of the grid, unless it is the identity.
///
/// Returns an error if the bytes are not a PTX file, the file is truncated, or it has several scans.
pub fn read(bytes: &[u8]) -> Result<RangeFile, Error> {
    match scans(bytes)?[..] {
        [only] => Scan::read(only)?.into_range(),
        ref scans => bail!(
            "the file has {} scans: choose one with `scan` of `ReadRange`, from 0 to {}, or read the points of all with `ReadPoints`",
            scans.len(),
            scans.len() - 1
        ),
    }
}

/// Returns the bytes of the scan with the index `scan`, from 0. These bytes are a valid PTX file themselves.
///
/// # Errors
/// If the bytes are not a PTX file, or it has no such scan.
pub fn scan(bytes: &[u8], scan: usize) -> Result<&[u8], Error> {
    let scans = scans(bytes)?;
    let Some(found) = scans.get(scan) else {
        let scans = scans.len();
        bail!("there is no scan {scan}: the file has {scans} scans, counted from 0");
    };
    Ok(found)
}

/// Adds the index of the scan, from 0, to an error after the first scan. The lines of the error are counted from the start of the scan.
fn in_scan(scan: usize, error: Error) -> Error {
    match scan {
        0 => error,
        scan => Error::new(format!("scan {scan}, {error}")),
    }
}

/// Splits a file into its scans, which are found by their headers. The last scan may be truncated.
fn scans(bytes: &[u8]) -> Result<Vec<&[u8]>, Error> {
    let mut scans = Vec::new();
    let mut rest = bytes;
    loop {
        let lines = Header::read(&mut lines(rest)).and_then(|header| header.cells());
        let lines = lines.map_err(|error| in_scan(scans.len(), error))?;
        let lines = Header::LINES.saturating_add(lines);
        fn is_full(line: &[u8]) -> bool {
            words(line).next().is_some()
        }
        let mut left = lines;
        let mut length = 0;
        let end = rest
            .split_inclusive(|&byte| byte == b'\n')
            .inspect(|line| length += line.len())
            .find(|line| {
                left -= usize::from(is_full(line));
                left == 0
            });
        if end.is_none() {
            length = rest.len();
        }
        let (scan, others) = rest.split_at(length);
        scans.push(scan);
        if !others.split(|&byte| byte == b'\n').any(is_full) {
            return Ok(scans);
        }
        rest = others;
    }
}

type Line<'a> = (&'a [u8], usize);

/// Returns the lines that are not empty, each with its number.
fn lines(bytes: &[u8]) -> impl Iterator<Item = Line<'_>> {
    let lines = bytes.split(|&byte| byte == b'\n').zip(1..).until_stopped();
    lines.filter(|(text, _)| words(text).next().is_some())
}

/// The header of a scan.
struct Header {
    columns: usize,
    rows: usize,
    transformation: [[f64; 4]; 4],
}

impl Header {
    const LINES: usize = 10;

    fn read<'a>(lines: &mut impl Iterator<Item = Line<'a>>) -> Result<Self, Error> {
        let mut next = |expected: usize| numbers(lines.next().unwrap_or_default(), expected);
        let [columns, rows] = [next(1)?, next(1)?].map(|size| size[0]);
        for _ in 0..4 {
            next(3)?;
        }
        let transformation = [next(4)?, next(4)?, next(4)?, next(4)?];
        Ok(Self { columns: size(columns, 1)?, rows: size(rows, 2)?, transformation })
    }

    fn cells(&self) -> Result<usize, Error> {
        let Self { columns, rows, .. } = *self;
        let cells = columns.checked_mul(rows).filter(|&cells| cells > 0);
        let Some(cells) = cells else {
            bail!("line 1: the grid of {columns} columns and {rows} rows is empty or too large");
        };
        Ok(cells)
    }
}

/// A scan. Its cells are stored row by row from the top.
struct Scan {
    header: Header,
    /// The point of each cell; NaN for a hole.
    points: Vec<Point3<f64>>,
    intensities: Vec<f64>,
    /// The color of each cell; empty if the scan has no colors.
    colors: Vec<Rgb>,
}

impl Scan {
    fn read(bytes: &[u8]) -> Result<Self, Error> {
        let mut lines = lines(bytes);
        let header = Header::read(&mut lines)?;
        let (columns, rows, cells) = (header.columns, header.rows, header.cells()?);
        // Reject a file that is too short for its cells: each line has at least four numbers, each of which takes at least a digit and a
        // blank.
        if bytes.len() / 8 < cells {
            return Err(too_few_points(cells, bytes.len() / 8));
        }
        let nowhere = Point3::new(f64::NAN, f64::NAN, f64::NAN);
        let mut points = vec![nowhere; cells];
        let mut intensities = vec![0.0; cells];
        let mut colors: Vec<Rgb> = Vec::new();
        for index in 0..cells {
            let line = lines.next().ok_or_else(|| too_few_points(cells, index))?;
            // In the file, the bottom cell of the first column comes first.
            let cell = (rows - 1 - index % rows) * columns + index / rows;
            let ([x, y, z, intensity], color) = read_point(line)?;
            if [x, y, z] != [0.0; 3] {
                points[cell] = Point3::new(x, y, z);
            }
            intensities[cell] = intensity;
            if let Some(color) = color {
                if colors.is_empty() {
                    colors = vec![[0; 3]; cells];
                }
                colors[cell] = color;
            }
        }
        Ok(Self { header, points, intensities, colors })
    }

    fn into_range(self) -> Result<RangeFile, Error> {
        let (columns, rows) = (self.header.columns, self.header.rows);
        // Constant intensities give no warning, because programs that do not measure intensities write a constant.
        let is_constant = self.intensities.windows(2).all(|pair| pair[0] == pair[1]);
        let notes = losses::range_warning((!is_constant).then_some("intensity").into_iter());
        let range =
            RangeImage::new(columns, rows, self.points).expect("a point was read for each cell");
        let range = match self.colors.is_empty() {
            true => range,
            false => range.with_colors(self.colors).expect("there is a color for each cell"),
        };
        let range = range.with_world_from_camera(pose(&self.header.transformation)?);
        let notes = notes.into_iter().collect();
        Ok(RangeFile { unit: Some(METER), notes, ..range.into() })
    }
}

/// Reads the points of all scans, in meters, each moved by the transformation of its scan. Also returns the number of points that are left
/// out because they are NaN or infinite, not counting holes.
///
/// The attribute `intensity` has the values in the file. If any scan has colors, the points get the attribute `color`, which is black for
/// scans without colors.
fn read_points(bytes: &[u8]) -> Result<(Points, usize), Error> {
    let (mut positions, mut intensities, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    let mut left_out = 0;
    for (number, bytes) in scans(bytes)?.into_iter().enumerate() {
        let scan = Scan::read(bytes).map_err(|error| in_scan(number, error))?;
        let rows = scan.header.transformation;
        let motion = Matrix4::from_fn(|row, column| rows[column][row]);
        for (cell, point) in scan.points.iter().enumerate() {
            let moved = motion.transform_point(point);
            if moved.coords.iter().any(|x| !x.is_finite()) {
                left_out += usize::from(!point.x.is_nan());
                continue;
            }
            positions.push(moved);
            intensities.push(scan.intensities[cell]);
            if !scan.colors.is_empty() {
                colors.resize(positions.len() - 1, [0; 3]);
                colors.push(scan.colors[cell]);
            }
        }
    }
    if positions.is_empty() {
        bail!("the file has no points");
    }
    if !colors.is_empty() {
        colors.resize(positions.len(), [0; 3]);
    }
    let mut points = Points::new(positions)?;
    if !colors.is_empty() {
        points = points.with_attribute("color", Attribute::Color(colors.into()))?;
    }
    Ok((points.with_attribute("intensity", Attribute::Number(intensities.into()))?, left_out))
}

/// Reads the points of all scans.
pub(super) struct PointsPtx;

impl FileReader for PointsPtx {
    type Value = Points;
    const EXTENSIONS: &'static [&'static str] = &["ptx"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::POINTS_READ;
    const SIZE: crate::SizeReader = Some(crate::size::rows);

    fn read(file: &InputFile<'_>) -> Result<Points, Error> {
        let (points, left_out) = read_points(file.bytes())?;
        finite::warn_left_out(file, left_out, "point");
        Ok(points)
    }
}

fn size(number: f64, line: usize) -> Result<usize, Error> {
    let is_index = 0.0 <= number && number <= u32::MAX.into() && number.fract() == 0.0;
    if !is_index {
        bail!("line {line}: `{number}` is not a valid value");
    }
    Ok(number as usize)
}

fn too_few_points(expected: usize, found: usize) -> Error {
    Error::new(format!("line 11: expected {expected} points, found {found}"))
}

fn value_error(line: usize, word: &[u8]) -> Error {
    Error::new(format!("line {line}: `{}` is not a valid value", excerpt(word)))
}

/// Reads the numbers of a line.
fn numbers((text, line): Line<'_>, expected: usize) -> Result<[f64; 4], Error> {
    let mut numbers = [0.0; 4];
    let mut found = 0;
    for word in words(text) {
        let number = parse(word).ok_or_else(|| value_error(line, word))?;
        if let Some(place) = numbers.get_mut(found) {
            *place = number;
        }
        found += 1;
    }
    if found == expected { Ok(numbers) } else { Err(count_error(line, expected, found)) }
}

/// Reads the line of a cell: x y z intensity, and red green blue if the cell has a color.
fn read_point((text, line): Line<'_>) -> Result<([f64; 4], Option<Rgb>), Error> {
    let mut words = words(text);
    let mut point = [0.0; 4];
    for (found, number) in point.iter_mut().enumerate() {
        let word = words.next().ok_or_else(|| count_error(line, 4, found))?;
        *number = parse_real(word).ok_or_else(|| value_error(line, word))?;
    }
    let mut color = [0; 3];
    let mut found = 0;
    for word in words {
        let channel = parse(word).ok_or_else(|| value_error(line, word))?;
        *color.get_mut(found).ok_or_else(|| count_error(line, 7, 8))? = channel;
        found += 1;
    }
    match found {
        0 => Ok((point, None)),
        3 => Ok((point, Some(color))),
        _ => Err(count_error(line, 7, 4 + found)),
    }
}

/// Converts a transformation in meters that multiplies row vectors to a pose in mm. Returns `None` for the identity.
fn pose(rows: &[[f64; 4]; 4]) -> Result<Option<Matrix4<f64>>, Error> {
    fn unit(row: usize) -> f64 {
        if row < 3 { METER } else { 1.0 }
    }
    let pose = Matrix4::from_fn(|row, column| {
        rows[column][row] * if column == 3 { unit(row) } else { 1.0 }
    });
    if pose == Matrix4::identity() {
        return Ok(None);
    }
    if !camera::is_rigid(&pose) {
        bail!(
            "line 7: the transformation is not a rotation and a translation: use `ReadPoints` instead, which applies it to the points"
        );
    }
    Ok(Some(pose))
}

/// Writes a range image as a PTX file in meters, with its colors and a constant intensity.
pub(super) struct RangePtx;

impl FileFormat for RangePtx {
    type Value = RangeImage;
    const EXTENSION: &'static str = "ptx";

    fn write(range: &RangeImage, name: &str) -> Result<Vec<NewFile>, Error> {
        check_single("cell", range.points())?;
        Ok(NewFile::single(name, encode(range)))
    }
}

fn encode(range: &RangeImage) -> Vec<u8> {
    let (width, height) = (range.width(), range.height());
    let pose = range.world_from_camera().copied().unwrap_or_else(Matrix4::identity);
    fn vector(column: usize, unit: f64, pose: &Matrix4<f64>) -> String {
        let [x, y, z] = [0, 1, 2].map(|row| pose[(row, column)] / unit);
        format!("{x} {y} {z}")
    }
    let [x, y, z, place] =
        [(0, 1.0), (1, 1.0), (2, 1.0), (3, METER)].map(|(k, m)| vector(k, m, &pose));
    let mut text =
        format!("{width}\n{height}\n{place}\n{x}\n{y}\n{z}\n{x} 0\n{y} 0\n{z} 0\n{place} 1\n");
    text.reserve(48 * range.points().len());
    for column in 0..width {
        for row in (0..height).rev() {
            let cell = row * width + column;
            match range.point(cell) {
                // The number is written in single precision, as the shortest text that reads as the same number.
                Some(point) => {
                    let [x, y, z] = [point.x, point.y, point.z].map(|x| (x / METER) as f32);
                    text.push_str(&format!("{x} {y} {z} 0.5"));
                }
                None => text.push_str("0 0 0 0.5"),
            }
            if let Some(colors) = range.colors() {
                let [red, green, blue] = colors[cell];
                text.push_str(&format!(" {red} {green} {blue}"));
            }
            text.push('\n');
        }
    }
    text.into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hostile;
    use crate::range_file::Axes;
    use crate::range_file::tests::assert_is_grid;

    const PLAIN: &[u8] = include_bytes!("../../tests/data/formats/norgb.ptx");
    const COLORED: &[u8] = include_bytes!("../../tests/data/formats/rgb.ptx");

    #[test]
    fn a_written_grid_is_read_back() {
        for (file, colored) in [(PLAIN, false), (COLORED, true)] {
            let range = read(file).unwrap().normalize(1.0, Axes::Camera).unwrap();
            let again = read(&encode(&range)).unwrap().normalize(1.0, Axes::Camera).unwrap();
            assert_is_grid(&again, colored, 1e-4);
        }
    }

    #[test]
    fn the_transformation_is_the_pose() {
        let text =
            "1\n1\n1 2 3\n1 0 0\n0 1 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n1 2 3 1\n0 0 5 0.5\n";
        let range = read(text.as_bytes()).unwrap().range;
        let pose = *range.world_from_camera().unwrap();
        let moved = pose.transform_point(&Point3::new(10.0, 0.0, 0.0));
        assert_eq!(moved, Point3::new(1000.0, 2010.0, 3000.0));
        let again = read(&encode(&range)).unwrap().range;
        assert_eq!(again.world_from_camera(), Some(&pose));
        let bent = text.replace("-1 0 0 0", "-2 0 0 0");
        assert_eq!(
            read(bent.as_bytes()).unwrap_err().to_string(),
            "line 7: the transformation is not a rotation and a translation: use `ReadPoints` instead, which applies it to the points"
        );
    }

    fn error(from: &str, to: &str) -> String {
        let text = String::from_utf8(COLORED.to_vec()).unwrap();
        assert!(text.contains(from));
        read(text.replacen(from, to, 1).as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn invalid_files_are_rejected_with_their_line() {
        assert_eq!(error("8\n6\n", "8\n7\n"), "line 11: expected 56 points, found 48");
        assert_eq!(error("8\n6\n", "7\n6\n"), "scan 1, line 1: expected 1 numbers, found 7");
        assert_eq!(error("0 0 0 1\n", "0 0 1\n"), "line 10: expected 4 numbers, found 3");
        assert_eq!(error("0 0 0.5", "0 z 0.5"), "line 13: `z` is not a valid value");
        assert_eq!(error(" 0 200 255", " 0 300 255"), "line 11: `300` is not a valid value");
        assert_eq!(error(" 0 200 255", " 0 200"), "line 11: expected 7 numbers, found 6");
        assert_eq!(error("8\n6\n", "8\n0.5\n"), "line 2: `0.5` is not a valid value");
        let huge = error("8\n6\n", "4000000\n4000000\n");
        assert!(huge.starts_with("line 11: expected 16000000000000 points"), "{huge}");
    }

    /// A scan of two cells, a point and a hole, moved along x.
    fn scan_at(x: f64, cell: &str) -> String {
        format!(
            "1\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n{x} 0 0 1\n{cell}\n0 0 0 0.5\n"
        )
    }

    #[test]
    fn points_of_all_scans_or_one_grid_are_read() {
        let text = [scan_at(0.0, "0 0 5 0.25"), scan_at(10.0, "1 0 5 0.75 9 8 7")].concat();
        let (points, left_out) = read_points(text.as_bytes()).unwrap();
        assert_eq!(
            points.positions()[..],
            [Point3::new(0.0, 0.0, 5.0), Point3::new(11.0, 0.0, 5.0)]
        );
        let intensities = Attribute::Number(vec![0.25, 0.75].into());
        assert_eq!(points.attributes().get("intensity"), Some(&intensities));
        assert_eq!(points.attributes().colors("color").unwrap()[..], [[0; 3], [9, 8, 7]]);
        assert_eq!(left_out, 0);
        assert_eq!(
            read(text.as_bytes()).unwrap_err().to_string(),
            "the file has 2 scans: choose one with `scan` of `ReadRange`, from 0 to 1, or read the points of all with `ReadPoints`"
        );
        let second = read(scan(text.as_bytes(), 1).unwrap()).unwrap().range;
        assert_eq!(second.point(1), Some(Point3::new(1.0, 0.0, 5.0)));
        assert_eq!(second.world_from_camera().unwrap()[(0, 3)], 10_000.0);
        assert_eq!(
            scan(text.as_bytes(), 2).unwrap_err().to_string(),
            "there is no scan 2: the file has 2 scans, counted from 0"
        );
        let cut = text.strip_suffix("0 0 0 0.5\n").unwrap();
        let cut = read_points(cut.as_bytes()).unwrap_err().to_string();
        assert_eq!(cut, "scan 1, line 11: expected 2 points, found 1");
    }

    #[test]
    fn a_grid_whose_intensities_differ_is_noted() {
        fn notes(second: &str) -> Vec<String> {
            let text = scan_at(0.0, "0 0 5 0.5").replace("0 0 0 0.5", second);
            read(text.as_bytes()).unwrap().notes
        }
        assert_eq!(notes("0 0 6 0.5"), [""; 0]);
        assert!(notes("0 0 6 0.25")[0].starts_with("`intensity` is left out"));
    }

    #[test]
    fn hostile_files_give_errors() {
        for file in [PLAIN, COLORED] {
            hostile::check_no_panic(file, |bytes| read(bytes).is_ok());
            hostile::check_no_panic(file, |bytes| read_points(bytes).is_ok());
        }
    }
}
