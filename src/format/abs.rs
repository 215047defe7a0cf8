//! ABS, the text files of Minolta range finders (VIVID 910): a grid of flags, followed by the x, the y and the z coordinates of all cells.
//!
//! y points up and z towards the sensor; the top row comes first. The format does not state its unit; the sensor writes mm.

use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::RangeImage;
use nalgebra::Point3;

use super::range_file::{Axes, RangeFile};
use super::{count_error, excerpt, not_a_number, parse, words};

/// Reads the range grid in an ABS file. A cell is invalid if its flag is 0.
///
/// Returns an error if the bytes are not an ABS file, or the file is truncated.
pub fn read(bytes: &[u8]) -> Result<RangeFile, Error> {
    let mut lines = bytes.split(|&byte| byte == b'\n').zip(1..);
    let rows = count(lines.next(), "rows")?;
    let columns = count(lines.next(), "columns")?;
    if let Some((text, line)) = lines.next().filter(|(text, _)| !text.starts_with(b"pixels")) {
        return Err(header_error(line, "pixels (flag X Y Z):", text));
    }
    let Some(cells) = rows.checked_mul(columns).filter(|&cells| cells > 0) else {
        bail!("the grid of {rows} rows and {columns} columns is empty or too large");
    };
    let expected = cells.saturating_mul(4);
    // Reject a file that is too short: each number takes at least a digit and a blank, and only the blank after the last number may be
    // missing.
    if bytes.len().div_ceil(2) < expected {
        return Err(count_error(4, expected, bytes.len() / 2));
    }
    let mut numbers = Vec::with_capacity(expected);
    for (text, line) in lines {
        for word in words(text).take(expected - numbers.len()) {
            let number: Option<f32> = parse(word);
            numbers.push(number.ok_or_else(|| not_a_number(line, word))?);
        }
    }
    if numbers.len() < expected {
        return Err(count_error(4, expected, numbers.len()));
    }
    let [flags, x, y, z] = [0, 1, 2, 3].map(|column| &numbers[column * cells..][..cells]);
    let points = (0..cells)
        .map(|cell| match flags[cell] {
            0.0 => Point3::new(f64::NAN, f64::NAN, f64::NAN),
            _ => Point3::new(x[cell], y[cell], z[cell]).map(f64::from),
        })
        .collect();
    let range = RangeImage::new(columns, rows, points).expect("a point was read for each cell");
    Ok(RangeFile { axes: Some(Axes::YUp), ..range.into() })
}

/// Reads the number in a line such as `6 rows`.
fn count(line: Option<(&[u8], usize)>, word: &str) -> Result<usize, Error> {
    let (text, line) = line.unwrap_or_default();
    let mut words = words(text);
    let count = words.next().and_then(parse);
    let is_named = words.next() == Some(word.as_bytes()) && words.next().is_none();
    let header_error = || header_error(line.max(1), &format!("<number> {word}"), text);
    count.filter(|_| is_named).ok_or_else(header_error)
}

fn header_error(line: usize, wanted: &str, text: &[u8]) -> Error {
    Error::new(format!("line {line}: expected `{wanted}`, found `{}`", excerpt(text)))
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
    fn lines_may_end_with_crlf() {
        let text = String::from_utf8(FILE.to_vec()).unwrap().replace('\n', "\r\n");
        assert_eq!(read(text.as_bytes()).unwrap().range.n_valid(), 43);
    }

    #[test]
    fn invalid_files_are_rejected_with_their_line() {
        assert_eq!(
            error("6 rows", "six rows"),
            "line 1: expected `<number> rows`, found `six rows`"
        );
        assert_eq!(
            error("8 columns", "8 rows"),
            "line 2: expected `<number> columns`, found `8 rows`"
        );
        assert_eq!(
            error("pixels", "points"),
            "line 3: expected `pixels (flag X Y Z):`, found `points (flag X Y Z):`"
        );
        assert_eq!(error("6 rows", "7 rows"), "line 4: expected 224 numbers, found 192");
        assert_eq!(error("25.5", "x25.5"), "line 5: `-x25.500000` is not a number");
        assert_eq!(
            error("6 rows", "0 rows"),
            "the grid of 0 rows and 8 columns is empty or too large"
        );
        let huge = error("6 rows", "1000000000000 rows");
        assert!(huge.starts_with("line 4: expected 32000000000000 numbers"), "{huge}");
    }

    #[test]
    fn hostile_files_give_errors() {
        hostile::check_no_panic(FILE, |bytes| read(bytes).is_ok());
    }
}
