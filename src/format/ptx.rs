//! PTX, the text files of Leica scanners: grids of points, column by column, the lowest point of each first; meters.
//!
//! Each scan has a header of ten lines: columns, rows, the scanner's position and its axes (four lines), and a transformation of four rows
//! that multiplies row vectors. Then a line for each cell: x y z intensity, and red green blue where there are colors; x = y = z = 0 is
//! a hole. The coordinates are the scanner's; here they are taken as x right, y down, z away from it, like all others whose file
//! does not say how they lie. Points are read of all scans, each moved by its transformation; a range grid is one scan.

use maquette_node::pack::{FileFormat, NewFile};
use maquette_node::reading::{FileReader, Reading};
use maquette_syntax::error;
use maquette_value::{Attribute, Points, PointsError, RangeImage, Rgb};
use nalgebra::{Matrix4, Point3};
use thiserror::Error;

use super::left_out;
use super::range_file::RangeFile;
use super::{camera, check_single, excerpt, finite, parse, real, words};

/// Why bytes are not a range grid in a PTX file.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PtxError {
    /// A line with too many or too few words.
    #[error("line {line}: {found} numbers, where there must be {expected}")]
    Count {
        /// The line, from 1.
        line: usize,
        /// Numbers in it.
        found: usize,
        /// Numbers that there must be.
        expected: usize,
    },
    /// A word that is no number.
    #[error("line {line}: `{text}` is not a possible value")]
    Value {
        /// The line, from 1.
        line: usize,
        /// The word.
        text: String,
    },
    /// A transformation that is no rigid motion.
    #[error(
        "line {line}: the transformation is no rigid motion, a rotation and a translation: `ReadPoints` applies it to the points"
    )]
    Pose {
        /// Its first line, from 1.
        line: usize,
    },
    /// A size that is 0 or cannot be counted.
    #[error(
        "line {line}: a grid of {columns} columns and {rows} rows is empty, or too large for any file"
    )]
    Size {
        /// The line, from 1.
        line: usize,
        /// Columns.
        columns: usize,
        /// Rows.
        rows: usize,
    },
    /// Fewer lines of points than the header promises.
    #[error("line {line}: {found} points follow, where there must be {expected}")]
    TooFew {
        /// Where the points begin: the line, from 1.
        line: usize,
        /// Points that are there, or that could be.
        found: usize,
        /// Points that the header promises.
        expected: usize,
    },
    /// Several scans, of which none was chosen.
    #[error(
        "the file has {scans} scans: choose one with `scan` of `ReadRange`, from 0 to {}, or read the points of all with `ReadPoints`", scans - 1
    )]
    Several {
        /// Their number.
        scans: usize,
    },
    /// A scan that is not there.
    #[error("there is no scan {scan}: the file has {scans}, counted from 0")]
    NoScan {
        /// The scan, from 0.
        scan: usize,
        /// Their number.
        scans: usize,
    },
    /// A scan behind the first one that is wrong.
    #[error("scan {scan}, {error}")]
    InScan {
        /// The scan, from 0; its lines are counted from its own first one.
        scan: usize,
        /// What is wrong.
        error: Box<Self>,
    },
    /// No point at all.
    #[error("there is no point in the file")]
    Empty,
    /// Points that cannot be.
    #[error(transparent)]
    Points(#[from] PointsError),
}

/// Millimeters in the unit of the format.
const METER: f64 = 1000.0;

/// The range grid in a PTX file of one scan, in meters; the transformation becomes its pose, unless it moves nothing.
///
/// # Errors
/// If the bytes are not a PTX file, it ends too early, or holds several scans.
pub fn read(bytes: &[u8]) -> Result<RangeFile, PtxError> {
    match scans(bytes)?[..] {
        [only] => Scan::read(only)?.into_range(),
        ref scans => Err(PtxError::Several { scans: scans.len() }),
    }
}

/// The bytes of one scan of a PTX file, from 0: a PTX file of its own.
///
/// # Errors
/// If the bytes are not a PTX file, or it has no such scan.
pub fn scan(bytes: &[u8], scan: usize) -> Result<&[u8], PtxError> {
    let scans = scans(bytes)?;
    scans.get(scan).copied().ok_or(PtxError::NoScan { scan, scans: scans.len() })
}

/// The bytes of each scan, as the headers tell. The last one may be cut off.
fn scans(bytes: &[u8]) -> Result<Vec<&[u8]>, PtxError> {
    let mut scans = Vec::new();
    let mut rest = bytes;
    loop {
        let wrong = |error| match scans.len() {
            0 => error,
            scan => PtxError::InScan { scan, error: Box::new(error) },
        };
        let lines = Header::read(&mut lines(rest)).map_err(wrong)?.cells().map_err(wrong)?;
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
        let (own, behind) = rest.split_at(length);
        scans.push(own);
        if !behind.split(|&byte| byte == b'\n').any(is_full) {
            return Ok(scans);
        }
        rest = behind;
    }
}

type Line<'a> = (&'a [u8], usize);

/// The lines that are not empty, with their numbers.
fn lines(bytes: &[u8]) -> impl Iterator<Item = Line<'_>> {
    let lines = bytes.split(|&byte| byte == b'\n').zip(1..);
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

    fn read<'a>(lines: &mut impl Iterator<Item = Line<'a>>) -> Result<Self, PtxError> {
        let mut next = |expected: usize| numbers(lines.next().unwrap_or_default(), expected);
        let [columns, rows] = [next(1)?, next(1)?].map(|size| size[0]);
        for _ in 0..4 {
            next(3)?;
        }
        let transformation = [next(4)?, next(4)?, next(4)?, next(4)?];
        Ok(Self { columns: size(columns, 1)?, rows: size(rows, 2)?, transformation })
    }

    fn cells(&self) -> Result<usize, PtxError> {
        let Self { columns, rows, .. } = *self;
        let cells = columns.checked_mul(rows).filter(|&cells| cells > 0);
        cells.ok_or(PtxError::Size { line: 1, columns, rows })
    }
}

/// One scan, cell by cell, row by row from the top.
struct Scan {
    header: Header,
    /// NaN in holes.
    points: Vec<Point3<f64>>,
    intensities: Vec<f64>,
    /// Empty if there are none.
    colors: Vec<Rgb>,
}

impl Scan {
    fn read(bytes: &[u8]) -> Result<Self, PtxError> {
        let mut lines = lines(bytes);
        let header = Header::read(&mut lines)?;
        let (columns, rows, cells) = (header.columns, header.rows, header.cells()?);
        // A line has four numbers of a digit and a blank each.
        if bytes.len() / 8 < cells {
            return Err(PtxError::TooFew { line: 11, found: bytes.len() / 8, expected: cells });
        }
        let nowhere = Point3::new(f64::NAN, f64::NAN, f64::NAN);
        let mut points = vec![nowhere; cells];
        let mut intensities = vec![0.0; cells];
        let mut colors: Vec<Rgb> = Vec::new();
        for index in 0..cells {
            let line = lines.next().ok_or_else(|| PtxError::TooFew {
                line: 11,
                found: index,
                expected: cells,
            })?;
            // The lowest cell of the first column comes first.
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

    fn into_range(self) -> Result<RangeFile, PtxError> {
        let (columns, rows) = (self.header.columns, self.header.rows);
        // Programs without intensities write one number everywhere.
        let is_constant = self.intensities.windows(2).all(|pair| pair[0] == pair[1]);
        let notes = left_out::of_range((!is_constant).then_some("intensity").into_iter());
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

/// The points of all scans, in meters, each moved by its transformation, and how many places that are not holes are NaN or infinite.
///
/// The attribute `intensity` is as in the file; if a scan has colors, `color` has them, black where there is none.
fn read_points(bytes: &[u8]) -> Result<(Points, usize), PtxError> {
    let (mut places, mut intensities, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    let mut left_out = 0;
    for (number, bytes) in scans(bytes)?.into_iter().enumerate() {
        let scan = Scan::read(bytes).map_err(|error| match number {
            0 => error,
            scan => PtxError::InScan { scan, error: Box::new(error) },
        })?;
        let rows = scan.header.transformation;
        let motion = Matrix4::from_fn(|row, column| rows[column][row]);
        for (cell, point) in scan.points.iter().enumerate() {
            let moved = motion.transform_point(point);
            if moved.coords.iter().any(|x| !x.is_finite()) {
                left_out += usize::from(!point.x.is_nan());
                continue;
            }
            places.push(moved);
            intensities.push(scan.intensities[cell]);
            if !scan.colors.is_empty() {
                colors.resize(places.len() - 1, [0; 3]);
                colors.push(scan.colors[cell]);
            }
        }
    }
    if places.is_empty() {
        return Err(PtxError::Empty);
    }
    if !colors.is_empty() {
        colors.resize(places.len(), [0; 3]);
    }
    let mut points = Points::new(places)?;
    if !colors.is_empty() {
        points = points.with_attribute("color", Attribute::Color(colors.into()))?;
    }
    Ok((points.with_attribute("intensity", Attribute::Number(intensities.into()))?, left_out))
}

/// Reads the points of all scans.
pub(super) struct PointsPtx;

impl FileReader for PointsPtx {
    type Value = Points;
    const ENDINGS: &'static [&'static str] = &["ptx"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::POINTS_READ;

    fn read(file: &Reading<'_>) -> Result<Points, error::Error> {
        let (points, left_out) = read_points(file.bytes())?;
        finite::tell(file, left_out, "point");
        Ok(points)
    }
}

fn size(number: f64, line: usize) -> Result<usize, PtxError> {
    let whole = 0.0 <= number && number <= u32::MAX.into() && number.fract() == 0.0;
    fn wrong(line: usize, number: f64) -> PtxError {
        PtxError::Value { line, text: number.to_string() }
    }
    if whole { Ok(number as usize) } else { Err(wrong(line, number)) }
}

/// The numbers of a line.
fn numbers((text, line): Line<'_>, expected: usize) -> Result<[f64; 4], PtxError> {
    let mut numbers = [0.0; 4];
    let mut found = 0;
    for word in words(text) {
        let number = parse(word).ok_or_else(|| PtxError::Value { line, text: excerpt(word) })?;
        if let Some(place) = numbers.get_mut(found) {
            *place = number;
        }
        found += 1;
    }
    if found == expected { Ok(numbers) } else { Err(PtxError::Count { line, found, expected }) }
}

/// A cell: x y z intensity, and red green blue if it has a color.
fn read_point((text, line): Line<'_>) -> Result<([f64; 4], Option<Rgb>), PtxError> {
    let mut words = words(text);
    let mut place = [0.0; 4];
    for (found, number) in place.iter_mut().enumerate() {
        let word = words.next().ok_or(PtxError::Count { line, found, expected: 4 })?;
        *number = real(word).ok_or_else(|| PtxError::Value { line, text: excerpt(word) })?;
    }
    let mut color = [0; 3];
    let mut found = 0;
    for word in words {
        let channel = parse(word).ok_or_else(|| PtxError::Value { line, text: excerpt(word) })?;
        *color.get_mut(found).ok_or(PtxError::Count { line, found: 8, expected: 7 })? = channel;
        found += 1;
    }
    match found {
        0 => Ok((place, None)),
        3 => Ok((place, Some(color))),
        _ => Err(PtxError::Count { line, found: 4 + found, expected: 7 }),
    }
}

/// The pose in mm, of a transformation in meters that multiplies row vectors; none if it moves nothing.
fn pose(rows: &[[f64; 4]; 4]) -> Result<Option<Matrix4<f64>>, PtxError> {
    fn unit(row: usize) -> f64 {
        if row < 3 { METER } else { 1.0 }
    }
    let pose = Matrix4::from_fn(|row, column| {
        rows[column][row] * if column == 3 { unit(row) } else { 1.0 }
    });
    if pose == Matrix4::identity() {
        return Ok(None);
    }
    if camera::is_rigid(&pose) { Ok(Some(pose)) } else { Err(PtxError::Pose { line: 7 }) }
}

/// Writes a range image as a PTX file: meters, with its colors, or an intensity alone.
pub(super) struct RangePtx;

impl FileFormat for RangePtx {
    type Value = RangeImage;
    const ENDING: &'static str = "ptx";

    fn write(range: &RangeImage, name: &str) -> Result<Vec<NewFile>, error::Error> {
        check_single("cell", range.points())?;
        Ok(NewFile::only(name, encode(range)))
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
                // Single precision, like all files of points; the shortest text that reads as the same.
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
    use crate::range_file::tests::is_grid;

    const PLAIN: &[u8] = include_bytes!("../../tests/data/formats/norgb.ptx");
    const COLORED: &[u8] = include_bytes!("../../tests/data/formats/rgb.ptx");

    #[test]
    fn a_grid_that_was_written_reads_the_same() {
        for (file, colored) in [(PLAIN, false), (COLORED, true)] {
            let range = read(file).unwrap().normalize(1.0, Axes::Camera).unwrap();
            let again = read(&encode(&range)).unwrap().normalize(1.0, Axes::Camera).unwrap();
            is_grid(&again, colored, 1e-4);
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
        assert_eq!(read(bent.as_bytes()).unwrap_err(), PtxError::Pose { line: 7 });
    }

    fn error(from: &str, to: &str) -> String {
        let text = String::from_utf8(COLORED.to_vec()).unwrap();
        assert!(text.contains(from));
        read(text.replacen(from, to, 1).as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn files_that_lie_are_refused_with_their_line() {
        assert_eq!(error("8\n6\n", "8\n7\n"), "line 11: 48 points follow, where there must be 56");
        assert_eq!(error("8\n6\n", "7\n6\n"), "scan 1, line 1: 7 numbers, where there must be 1");
        assert_eq!(error("0 0 0 1\n", "0 0 1\n"), "line 10: 3 numbers, where there must be 4");
        assert_eq!(error("0 0 0.5", "0 z 0.5"), "line 13: `z` is not a possible value");
        assert_eq!(error(" 0 200 255", " 0 300 255"), "line 11: `300` is not a possible value");
        assert_eq!(error(" 0 200 255", " 0 200"), "line 11: 6 numbers, where there must be 7");
        assert_eq!(error("8\n6\n", "8\n0.5\n"), "line 2: `0.5` is not a possible value");
        let huge = error("8\n6\n", "4000000\n4000000\n");
        assert!(huge.ends_with("where there must be 16000000000000"), "{huge}");
    }

    /// A scan of two cells, a point and a hole, that is moved along x.
    fn scan_at(x: f64, cell: &str) -> String {
        format!(
            "1\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n{x} 0 0 1\n{cell}\n0 0 0 0.5\n"
        )
    }

    #[test]
    fn of_several_scans_all_points_are_read_or_one_grid() {
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
        assert_eq!(read(text.as_bytes()).unwrap_err(), PtxError::Several { scans: 2 });
        let second = read(scan(text.as_bytes(), 1).unwrap()).unwrap().range;
        assert_eq!(second.point(1), Some(Point3::new(1.0, 0.0, 5.0)));
        assert_eq!(second.world_from_camera().unwrap()[(0, 3)], 10_000.0);
        assert_eq!(scan(text.as_bytes(), 2), Err(PtxError::NoScan { scan: 2, scans: 2 }));
        let cut = text.strip_suffix("0 0 0 0.5\n").unwrap();
        let cut = read_points(cut.as_bytes()).unwrap_err().to_string();
        assert_eq!(cut, "scan 1, line 11: 1 points follow, where there must be 2");
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
            hostile::survive(file, |bytes| read(bytes).is_ok());
            hostile::survive(file, |bytes| read_points(bytes).is_ok());
        }
    }
}
