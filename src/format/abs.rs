//! ABS, the text files of Minolta range finders (VIVID 910): a grid of flags, and the x, y and z of all its cells.
//!
//! The format has y up and z towards the sensor; the upper row comes first. Its unit is not said; the sensor's is mm.

use maquette_value::RangeImage;
use nalgebra::Point3;
use thiserror::Error;

use super::range_file::{Axes, RangeFile};
use super::{excerpt, parse, words};

/// Why bytes are not a range grid in an ABS file.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum AbsError {
    /// A line of the header that says something else.
    #[error("line {line}: `{text}`, where there must be `{wanted}`")]
    Header {
        /// The line, from 1.
        line: usize,
        /// What is there.
        text: String,
        /// What must be there.
        wanted: &'static str,
    },
    /// A size that is 0 or cannot be counted.
    #[error("a grid of {rows} rows and {columns} columns is empty, or too large for any file")]
    Size {
        /// Rows.
        rows: usize,
        /// Columns.
        columns: usize,
    },
    /// Fewer numbers than the header promises.
    #[error("line {line}: {found} numbers follow, where there must be {expected}")]
    CutOff {
        /// The line behind the header, from 1.
        line: usize,
        /// Numbers that are there, or that could be.
        found: usize,
        /// A flag and three coordinates for each cell.
        expected: usize,
    },
    /// A word that is no number.
    #[error("line {line}: `{text}` is not a number")]
    Number {
        /// The line, from 1.
        line: usize,
        /// The word.
        text: String,
    },
}

/// The range grid in an ABS file. A cell is invalid if its flag is 0.
///
/// # Errors
/// If the bytes are not an ABS file, or it ends too early.
pub fn read(bytes: &[u8]) -> Result<RangeFile, AbsError> {
    let mut lines = bytes.split(|&byte| byte == b'\n').zip(1..);
    let rows = count(lines.next(), "rows", "<number> rows")?;
    let columns = count(lines.next(), "columns", "<number> columns")?;
    if let Some((text, line)) = lines.next().filter(|(text, _)| !text.starts_with(b"pixels")) {
        let wanted = "pixels (flag X Y Z):";
        return Err(AbsError::Header { line, text: excerpt(text), wanted });
    }
    let cells = rows.checked_mul(columns).filter(|&cells| cells > 0);
    let cells = cells.ok_or(AbsError::Size { rows, columns })?;
    let expected = cells.saturating_mul(4);
    // Each number takes a digit and a blank, though the last blank may be missing.
    if bytes.len().div_ceil(2) < expected {
        return Err(AbsError::CutOff { line: 4, found: bytes.len() / 2, expected });
    }
    let mut numbers = Vec::with_capacity(expected);
    for (text, line) in lines {
        for word in words(text).take(expected - numbers.len()) {
            let number: Option<f32> = parse(word);
            numbers.push(number.ok_or_else(|| AbsError::Number { line, text: excerpt(word) })?);
        }
    }
    if numbers.len() < expected {
        return Err(AbsError::CutOff { line: 4, found: numbers.len(), expected });
    }
    fn number(column: usize, cell: usize, numbers: &[f32], cells: usize) -> f64 {
        f64::from(numbers[column * cells + cell])
    }
    let points = (0..cells)
        .map(|cell| match number(0, cell, &numbers, cells) {
            0.0 => Point3::new(f64::NAN, f64::NAN, f64::NAN),
            _ => Point3::new(
                number(1, cell, &numbers, cells),
                number(2, cell, &numbers, cells),
                number(3, cell, &numbers, cells),
            ),
        })
        .collect();
    let range = RangeImage::new(columns, rows, points).expect("a point was read for each cell");
    Ok(RangeFile { axes: Some(Axes::YUp), ..range.into() })
}

/// The number in a line `6 rows`.
fn count(
    line: Option<(&[u8], usize)>,
    word: &str,
    wanted: &'static str,
) -> Result<usize, AbsError> {
    let (text, line) = line.unwrap_or_default();
    let mut words = words(text);
    let count = words.next().and_then(parse);
    let named = words.next() == Some(word.as_bytes()) && words.next().is_none();
    count.filter(|_| named).ok_or_else(|| AbsError::Header {
        line: line.max(1),
        text: excerpt(text),
        wanted,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hostile;

    const FILE: &[u8] = include_bytes!("../../tests/data/formats/minolta.abs");

    fn error(from: &str, to: &str) -> String {
        let text = String::from_utf8(FILE.to_vec()).unwrap();
        assert!(text.contains(from));
        read(text.replacen(from, to, 1).as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn a_line_may_end_as_on_other_systems() {
        let text = String::from_utf8(FILE.to_vec()).unwrap().replace('\n', "\r\n");
        assert_eq!(read(text.as_bytes()).unwrap().range.n_valid(), 43);
    }

    #[test]
    fn files_that_lie_are_refused_with_their_line() {
        assert_eq!(
            error("6 rows", "six rows"),
            "line 1: `six rows`, where there must be `<number> rows`"
        );
        assert_eq!(
            error("8 columns", "8 rows"),
            "line 2: `8 rows`, where there must be `<number> columns`"
        );
        assert_eq!(
            error("pixels", "points"),
            "line 3: `points (flag X Y Z):`, where there must be `pixels (flag X Y Z):`"
        );
        assert_eq!(
            error("6 rows", "7 rows"),
            "line 4: 192 numbers follow, where there must be 224"
        );
        assert_eq!(error("25.5", "x25.5"), "line 5: `-x25.500000` is not a number");
        assert_eq!(
            error("6 rows", "0 rows"),
            "a grid of 0 rows and 8 columns is empty, or too large for any file"
        );
        let huge = error("6 rows", "1000000000000 rows");
        assert!(huge.ends_with("where there must be 32000000000000"), "{huge}");
    }

    #[test]
    fn hostile_files_give_errors() {
        hostile::survive(FILE, |bytes| read(bytes).is_ok());
    }
}
