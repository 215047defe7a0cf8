//! PTX, the text files of Leica scanners: a grid of points, column by column, the lowest point of each first; meters.
//!
//! A header of ten lines: columns, rows, the scanner's place and its axes (four lines), and a transformation of four rows that
//! multiplies row vectors. Then a line for each cell: x y z intensity, and red green blue where there are colors; x = y = z = 0 is
//! a hole. The coordinates are the scanner's; here they are taken as x right, y down, z away from it, like all others whose file
//! does not say how they lie. One grid is read: a file of several scans is refused.

use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::error;
use maquette_value::{RangeImage, Rgb};
use nalgebra::{Matrix4, Point3};
use thiserror::Error;

use super::range_file::{RangeFile, Rows};
use super::{camera, check_single, excerpt, parse, real, words};

/// Why bytes are not a range grid in a PTX file.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
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
    #[error("line {line}: the transformation is no rigid motion, a rotation and a translation")]
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
    /// Another scan behind the first one.
    #[error(
        "line {line}: the file goes on behind the last point: of several scans in one file save each as a file of its own"
    )]
    Several {
        /// The line, from 1.
        line: usize,
    },
}

/// Millimeters in the unit of the format.
const METER: f64 = 1000.0;

/// The range grid in a PTX file, in meters; the transformation becomes its pose, unless it moves nothing.
///
/// # Errors
/// If the bytes are not a PTX file, it ends too early, or holds several scans.
pub fn read(bytes: &[u8]) -> Result<RangeFile, PtxError> {
    let lines = bytes.split(|&byte| byte == b'\n').zip(1..);
    let mut lines = lines.filter(|(text, _)| words(text).next().is_some());
    let mut header = |expected: usize| numbers(lines.next().unwrap_or_default(), expected);
    let [columns, rows] = [header(1)?, header(1)?].map(|size| size[0]);
    for _ in 0..4 {
        header(3)?;
    }
    let transformation = [header(4)?, header(4)?, header(4)?, header(4)?];
    let [columns, rows] = [size(columns, 1)?, size(rows, 2)?];
    let cells = columns.checked_mul(rows).filter(|&cells| cells > 0);
    let cells = cells.ok_or(PtxError::Size { line: 1, columns, rows })?;
    // A line has four numbers of a digit and a blank each.
    if bytes.len() / 8 < cells {
        return Err(PtxError::TooFew { line: 11, found: bytes.len() / 8, expected: cells });
    }
    let nowhere = Point3::new(f64::NAN, f64::NAN, f64::NAN);
    let mut points = vec![nowhere; cells];
    let mut colors: Vec<Rgb> = Vec::new();
    for index in 0..cells {
        let too_few = || PtxError::TooFew { line: 11, found: index, expected: cells };
        let line = lines.next().ok_or_else(too_few)?;
        // The lowest cell of the first column comes first.
        let cell = (rows - 1 - index % rows) * columns + index / rows;
        let (point, color) = read_point(line)?;
        if point != Point3::origin() {
            points[cell] = point;
        }
        if let Some(color) = color {
            if colors.is_empty() {
                colors = vec![[0; 3]; cells];
            }
            colors[cell] = color;
        }
    }
    if let Some((_, line)) = lines.next() {
        return Err(PtxError::Several { line });
    }
    let range = RangeImage::new(columns, rows, points).expect("a point was read for each cell");
    let range = match colors.is_empty() {
        true => range,
        false => range.with_colors(colors).expect("there is a color for each cell"),
    };
    let range = range.with_world_from_camera(pose(&transformation)?);
    Ok(RangeFile { range, unit: Some(METER), axes: None, rows: Rows::TopFirst })
}

fn size(number: f64, line: usize) -> Result<usize, PtxError> {
    let whole = 0.0 <= number && number <= u32::MAX.into() && number.fract() == 0.0;
    let wrong = || PtxError::Value { line, text: number.to_string() };
    if whole { Ok(number as usize) } else { Err(wrong()) }
}

/// The numbers of a line.
fn numbers((text, line): (&[u8], usize), expected: usize) -> Result<[f64; 4], PtxError> {
    let mut numbers = [0.0; 4];
    let mut found = 0;
    for word in words(text) {
        let value = || PtxError::Value { line, text: excerpt(word) };
        let number = parse(word).ok_or_else(value)?;
        if let Some(place) = numbers.get_mut(found) {
            *place = number;
        }
        found += 1;
    }
    if found == expected { Ok(numbers) } else { Err(PtxError::Count { line, found, expected }) }
}

/// A cell: x y z intensity, and red green blue if it has a color.
fn read_point((text, line): (&[u8], usize)) -> Result<(Point3<f64>, Option<Rgb>), PtxError> {
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
    let point = Point3::new(place[0], place[1], place[2]);
    match found {
        0 => Ok((point, None)),
        3 => Ok((point, Some(color))),
        _ => Err(PtxError::Count { line, found: 4 + found, expected: 7 }),
    }
}

/// The pose in mm, of a transformation in meters that multiplies row vectors; none if it moves nothing.
fn pose(rows: &[[f64; 4]; 4]) -> Result<Option<Matrix4<f64>>, PtxError> {
    let unit = |row: usize| if row < 3 { METER } else { 1.0 };
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
    let vector = |column: usize, unit: f64| {
        let [x, y, z] = [0, 1, 2].map(|row| pose[(row, column)] / unit);
        format!("{x} {y} {z}")
    };
    let [x, y, z, place] = [(0, 1.0), (1, 1.0), (2, 1.0), (3, METER)].map(|(k, m)| vector(k, m));
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
        let several = "line 53: the file goes on behind the last point: of several scans in one file save each as a file of its own";
        assert_eq!(error("8\n6\n", "7\n6\n"), several);
        assert_eq!(error("0 0 0 1\n", "0 0 1\n"), "line 10: 3 numbers, where there must be 4");
        assert_eq!(error("0 0 0.5", "0 z 0.5"), "line 13: `z` is not a possible value");
        assert_eq!(error(" 0 200 255", " 0 300 255"), "line 11: `300` is not a possible value");
        assert_eq!(error(" 0 200 255", " 0 200"), "line 11: 6 numbers, where there must be 7");
        assert_eq!(error("8\n6\n", "8\n0.5\n"), "line 2: `0.5` is not a possible value");
        let huge = error("8\n6\n", "4000000\n4000000\n");
        assert!(huge.ends_with("where there must be 16000000000000"), "{huge}");
    }

    #[test]
    fn hostile_files_give_errors() {
        for file in [PLAIN, COLORED] {
            hostile::survive(file, |bytes| read(bytes).is_ok());
        }
    }
}
