//! XYZ, points as text: a line each, `x y z`, and a color or a normal behind.

use maquette_node::pack::{FileFormat, NewFile};
use maquette_node::reading::{FileReader, Reading};
use maquette_syntax::error;
use maquette_value::{Attribute, Points, PointsError, RangeImage, Rgb};
use nalgebra::Point3;
use thiserror::Error;

use super::finite::{self, Finite};
use super::{check_single, coarse, excerpt, real, words};

/// Why bytes are not points in an XYZ file.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum XyzError {
    /// A word that is no number.
    #[error("line {line}: `{text}` is not a number")]
    Number {
        /// The line, from 1.
        line: usize,
        /// The word.
        text: String,
    },
    /// A line with too many or too few numbers.
    #[error("line {line}: {found} numbers, where there must be {expected}")]
    Count {
        /// The line, from 1.
        line: usize,
        /// Numbers in it.
        found: usize,
        /// `3 or 6`, or how many the first line has.
        expected: &'static str,
    },
    /// Numbers of a language in which a comma stands for the point.
    #[error("line {line}: `{text}` has a decimal comma: write a point")]
    DecimalComma {
        /// The line, from 1.
        line: usize,
        /// The number.
        text: String,
    },
    /// Something else, or nothing.
    #[error("there is no point in the file")]
    Empty,
    /// Points that cannot be.
    #[error(transparent)]
    Points(#[from] PointsError),
}

/// The points in an XYZ file.
///
/// Every line has three numbers, or every line six. If the last three are whole numbers from 0 to 255 in all lines, they are
/// colors, attribute `color`; else normals, attribute `normal`. Blanks or commas part the numbers; empty lines and what follows a
/// `#` are passed over.
///
/// Points at no finite place are left out.
///
/// # Errors
/// If a word is no number, lines have other or different numbers of them, or there is no point.
pub fn read(bytes: &[u8]) -> Result<Points, XyzError> {
    Ok(read_finite(bytes)?.0)
}

/// The points in an XYZ file, and how many were left out.
fn read_finite(bytes: &[u8]) -> Result<(Points, usize), XyzError> {
    let mut positions = Vec::new();
    let mut extras: Vec<[f64; 3]> = Vec::new();
    for (text, line) in bytes.split(|&byte| byte == b'\n').zip(1..) {
        let end = text.iter().position(|&byte| byte == b'#').unwrap_or(text.len());
        let (numbers, found) = numbers(&text[..end], line)?;
        let [x, y, z, extra @ ..] = numbers;
        let colored = positions.len() == extras.len();
        match found {
            0 => continue,
            3 if positions.is_empty() || !colored => {}
            6 if colored => extras.push(extra),
            _ => {
                let expected = match (positions.is_empty(), colored) {
                    (true, _) => "3 or 6",
                    (false, true) => "6, as before",
                    (false, false) => "3, as before",
                };
                return Err(XyzError::Count { line, found, expected });
            }
        }
        positions.push(Point3::new(x, y, z));
    }
    if positions.is_empty() {
        return Err(XyzError::Empty);
    }
    let finite = Finite::of(&mut positions);
    let left_out = finite.n_left_out();
    let points = Points::new(positions)?;
    if extras.is_empty() {
        return Ok((finite.points(points), left_out));
    }
    let is_byte = |number: &f64| (0.0..=255.0).contains(number) && number.fract() == 0.0;
    if extras.as_flattened().iter().all(is_byte) {
        let colors = extras.iter().map(|color| color.map(|channel| channel as u8)).collect();
        let points = points.with_attribute("color", Attribute::Color(colors))?;
        return Ok((finite.points(points), left_out));
    }
    let points = points.with_attribute("normal", Attribute::Vector(extras.into()))?;
    Ok((finite.points(points), left_out))
}

/// The numbers of a line, at most six, and how many there are.
fn numbers(text: &[u8], line: usize) -> Result<([f64; 6], usize), XyzError> {
    let mut numbers = [0.0; 6];
    let mut found = 0;
    if let Some(word) = decimal_comma(text) {
        return Err(XyzError::DecimalComma { line, text: excerpt(word) });
    }
    let parts = text.split(|&byte| byte == b',').flat_map(words);
    for word in parts {
        let number = real(word).ok_or_else(|| XyzError::Number { line, text: excerpt(word) })?;
        if let Some(place) = numbers.get_mut(found) {
            *place = number;
        }
        found += 1;
    }
    Ok((numbers, found))
}

/// The first number with a comma in it, if blanks part as many numbers as a line has.
fn decimal_comma(text: &[u8]) -> Option<&[u8]> {
    if !text.contains(&b',') {
        return None;
    }
    let commas = |word: &[u8]| word.iter().filter(|&&byte| byte == b',').count();
    let is_number =
        |word: &[u8]| commas(word) <= 1 && !word.starts_with(b",") && !word.ends_with(b",");
    let is_line = matches!(words(text).count(), 3 | 6) && words(text).all(is_number);
    words(text).find(|word| is_line && commas(word) == 1)
}

/// Writes points with their colors, or else their normals.
pub(super) struct PointsXyz;

impl FileFormat for PointsXyz {
    type Value = Points;
    const ENDING: &'static str = "xyz";

    fn write(points: &Points, name: &str) -> Result<Vec<NewFile>, error::Error> {
        check_single("point", points.positions())?;
        let attributes = points.attributes();
        let (colors, normals) = (attributes.colors("color"), attributes.vectors("normal"));
        let lines = points.positions().iter().enumerate().map(|(index, point)| {
            let normal = normals.filter(|_| colors.is_none()).map(|normals| normals[index]);
            (*point, colors.map(|colors| colors[index]), normal)
        });
        Ok(NewFile::only(name, encode(points.positions(), lines)))
    }
}

/// Writes the points of the valid cells of a range image, with their colors.
pub(super) struct RangeXyz;

impl FileFormat for RangeXyz {
    type Value = RangeImage;
    const ENDING: &'static str = "xyz";

    fn write(range: &RangeImage, name: &str) -> Result<Vec<NewFile>, error::Error> {
        check_single("cell", range.points())?;
        let lines = (0..range.points().len()).filter_map(|cell| {
            Some((range.point(cell)?, range.colors().map(|colors| colors[cell]), None))
        });
        Ok(NewFile::only(name, encode(range.points(), lines)))
    }
}

fn encode(
    all: &[Point3<f64>],
    lines: impl Iterator<Item = (Point3<f64>, Option<Rgb>, Option<[f64; 3]>)>,
) -> Vec<u8> {
    let mut text = String::new();
    let is_far = coarse(all).is_some();
    for (point, color, normal) in lines {
        // Single precision, like all files of points, unless that would move them; the shortest text that reads as the same.
        let [x, y, z] = [point.x, point.y, point.z];
        match is_far {
            true => text.push_str(&format!("{x} {y} {z}")),
            false => text.push_str(&format!("{} {} {}", x as f32, y as f32, z as f32)),
        }
        if let Some([red, green, blue]) = color {
            text.push_str(&format!(" {red} {green} {blue}"));
        }
        if let Some(normal) = normal {
            let [x, y, z] = normal.map(|x| x as f32);
            text.push_str(&format!(" {x} {y} {z}"));
        }
        text.push('\n');
    }
    text.into_bytes()
}

impl FileReader for PointsXyz {
    type Value = Points;
    const ENDINGS: &'static [&'static str] = &["xyz"];

    fn read(file: &Reading<'_>) -> Result<Points, error::Error> {
        let (points, left_out) = read_finite(file.bytes())?;
        finite::tell(file, left_out, "point");
        Ok(points)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hostile;

    const FILE: &[u8] = include_bytes!("../../tests/data/formats/points.xyz");

    #[test]
    fn a_line_is_a_point_and_its_color() {
        let points = read(FILE).unwrap();
        assert_eq!(points.positions().len(), 43);
        assert_eq!(points.positions()[1], Point3::new(-15.075, -25.125, 100.5));
        assert_eq!(points.attributes().colors("color").unwrap()[1], [60, 0, 215]);
        let written = PointsXyz::write(&points, "a.xyz").unwrap().remove(0).bytes;
        assert_eq!(read(&written).unwrap().attributes(), points.attributes());
    }

    #[test]
    fn numbers_that_are_no_colors_are_normals() {
        let points = read(b"# x, y, z\n1,2, 3,0,0,1\r\n\n4 5 6\t0 0.5 0 # the last\n").unwrap();
        let normals = [[0.0, 0.0, 1.0], [0.0, 0.5, 0.0]];
        assert_eq!(points.attributes().vectors("normal").unwrap()[..], normals);
        let written = PointsXyz::write(&points, "a.xyz").unwrap().remove(0).bytes;
        assert_eq!(read(&written).unwrap(), points);
    }

    #[test]
    fn places_of_a_survey_keep_their_digits() {
        let places =
            vec![Point3::new(503_123_456.75, 4.5, 0.125), Point3::new(503_123_460.5, 0.0, 1.0)];
        let points = Points::new(places.clone()).unwrap();
        let bytes = PointsXyz::write(&points, "a.xyz").unwrap().remove(0).bytes;
        assert_eq!(read(&bytes).unwrap().positions().to_vec(), places);
    }

    #[test]
    fn a_range_image_becomes_its_valid_points() {
        let points = vec![Point3::new(f64::NAN, 0., 1.), Point3::new(1., 2., 3.5)];
        let range = RangeImage::new(2, 1, points).unwrap();
        let bytes = RangeXyz::write(&range, "a.xyz").unwrap().remove(0).bytes;
        assert_eq!(bytes, b"1 2 3.5\n");
    }

    #[test]
    fn points_that_are_nowhere_are_left_out_and_told_of() {
        let file = Reading::alone("a.xyz", b"1 2 3 0 0 255\nnan nan nan 0 9 0\n4 5 inf 1 0 0\n");
        let points = PointsXyz::read(&file).unwrap();
        assert_eq!(points.positions()[..], [Point3::new(1.0, 2.0, 3.0)]);
        assert_eq!(points.attributes().colors("color").unwrap()[..], [[0, 0, 255]]);
        assert_eq!(file.doubts(), ["2 points are left out: a coordinate is NaN or infinite"]);
    }

    #[test]
    fn files_that_lie_are_refused_with_their_line() {
        let error = |text: &str| read(text.as_bytes()).unwrap_err().to_string();
        assert_eq!(error("1 2\n"), "line 1: 2 numbers, where there must be 3 or 6");
        assert_eq!(
            error("1 2 3\n1 2 3 4 5 6\n"),
            "line 2: 6 numbers, where there must be 3, as before"
        );
        assert_eq!(
            error("1 2 3 4 5 6\n1 2 3\n"),
            "line 2: 3 numbers, where there must be 6, as before"
        );
        assert_eq!(error("1 2 c\n"), "line 1: `c` is not a number");
        assert_eq!(error("# nothing\n"), "there is no point in the file");
        let comma = "line 2: `2,5` has a decimal comma: write a point";
        assert_eq!(error("1 2 3\n1 2,5 3\n"), comma);
    }

    #[test]
    fn hostile_files_give_errors() {
        hostile::survive(FILE, read);
    }
}
