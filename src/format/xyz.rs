//! XYZ, points as text: one line per point, `x y z`, optionally followed by a color or a normal.

use std::io::{BufRead, BufReader};

use maquette_node::importers::{BlockFile, FileReader, InputFile, NotInBlocks, ReadBlocks};
use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::{Attribute, Points, RangeImage, Rgb};
use nalgebra::Point3;

use super::colors::{self, ColorRange};
use super::finite::{self, FiniteMask};
use super::losses;
use super::{check_single, count_error, excerpt, not_a_number, parse_real, precision_note, words};

/// Reads the points in an XYZ file.
///
/// All lines must have equally many numbers: a position, and further columns, which a header line may name (`//X,Y,Z,R,G,B` or
/// `x y z nx ny nz intensity`). Without names, three columns of integers from 0 to 255 become the attribute `color`, three columns of unit
/// length the attribute `normal`, and others the numbers `intensity`, `column_5` and so on; if there are six columns in total, they are a
/// position and a color or a normal. Numbers are separated by blanks, commas or semicolons. Empty lines, a first line with the number of
/// points, and text after `#` are ignored.
///
/// Points with NaN or infinite coordinates are left out.
///
/// Returns an error if a word is not a number, lines have different counts of numbers, or there is no point.
pub fn read(bytes: &[u8]) -> Result<Points, Error> {
    Ok(read_with_notes(bytes, None)?.0)
}

/// Reads points like [`read`]. Also returns warnings about data that are left out or ambiguous.
fn read_with_notes(
    bytes: &[u8],
    colors: Option<ColorRange>,
) -> Result<(Points, Vec<String>), Error> {
    let mut table = Table::default();
    // Very old programs end lines with CR alone.
    let end = if bytes.contains(&b'\n') { b'\n' } else { b'\r' };
    for (text, line) in bytes.split(|&byte| byte == end).zip(1..) {
        let end = text.iter().position(|&byte| byte == b'#').unwrap_or(text.len());
        table.read_line(&text[..end], line)?;
    }
    let mut notes = Vec::new();
    let count = table.count();
    if count == 0 {
        bail!("the file has no points");
    }
    if let Some(stated) = table.stated_count.filter(|stated| *stated != count as f64) {
        notes.push(format!("the first line states {stated} points, but there are {count}"));
    }
    let points = table.points(colors, &mut notes)?;
    Ok((points, notes))
}

/// Reads the points in blocks. Each block guesses the roles of the columns from its own lines. If all guesses agree, they are those of the
/// whole file; otherwise the blocks have different attributes, or there is a note.
fn read_blocks(
    file: &mut BlockFile<'_>,
    sink: &mut dyn FnMut(Points) -> Result<(), Error>,
) -> Result<(), Error> {
    let (colors, block_len) = (file.color_range, file.block_len);
    let mut lines = BufReader::new(&mut *file.content);
    let start = lines.fill_buf()?;
    if start.starts_with(BOM) || !start.contains(&b'\n') {
        return Err(NotInBlocks.into());
    }
    let (mut table, mut count, mut text) = (Table::default(), 0, Vec::new());
    for line in 1.. {
        text.clear();
        let is_end = lines.read_until(b'\n', &mut text)? == 0;
        let end = text.iter().position(|byte| b"\n#".contains(byte)).unwrap_or(text.len());
        table.read_line(&text[..end], line)?;
        if table.count() < block_len && !(is_end && table.count() > 0) {
            if is_end {
                break;
            }
            continue;
        }
        // With a given range, blocks of colors from 0 to 1 and from 0 to 255 would not be told apart.
        let is_ambiguous = colors.is_some() && table.names.is_empty() && table.columns > 3;
        let mut notes = Vec::new();
        let points = table.points(colors, &mut notes)?;
        if is_ambiguous || !notes.is_empty() {
            return Err(NotInBlocks.into());
        }
        count += table.count();
        table.numbers.clear();
        sink(points)?;
        if is_end {
            break;
        }
    }
    let is_stated = table.stated_count.is_none_or(|stated| stated == count as f64);
    if count > 0 && is_stated { Ok(()) } else { Err(NotInBlocks.into()) }
}

/// A byte order mark.
const BOM: &[u8] = b"\xef\xbb\xbf";

/// The meaning of one or three columns after the coordinates.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Role {
    Color,
    Normal,
    Number(String),
}

/// All numbers of a file, line by line.
#[derive(Default)]
struct Table {
    numbers: Vec<f64>,
    /// The number of columns.
    columns: usize,
    /// The column names in a header line, in lower case.
    names: Vec<String>,
    /// The number of points, if the first line of the file states it.
    stated_count: Option<f64>,
}

impl Table {
    fn read_line(&mut self, text: &[u8], line: usize) -> Result<(), Error> {
        let is_first = self.columns == 0;
        if is_first && self.names.is_empty() {
            self.names = names(text).unwrap_or_default();
            if !self.names.is_empty() {
                return Ok(());
            }
        }
        let before = self.numbers.len();
        read_numbers(text, line, &mut self.numbers)?;
        let found = self.numbers.len() - before;
        match found {
            0 => {}
            1 if is_first && self.stated_count.is_none() => self.stated_count = self.numbers.pop(),
            3.. if is_first => self.columns = found,
            _ if found == self.columns => {}
            _ => {
                return Err(match self.columns {
                    0 => count_error(line, "at least 3", found),
                    columns => count_error(line, columns, found),
                });
            }
        }
        Ok(())
    }

    /// The number of lines with numbers.
    fn count(&self) -> usize {
        self.numbers.len() / self.columns.max(1)
    }

    /// Returns the points with finite coordinates. Adds warnings to `notes`.
    fn points(&self, colors: Option<ColorRange>, notes: &mut Vec<String>) -> Result<Points, Error> {
        let roles = self.roles(notes);
        let mut places = self.triples(0);
        let finite = FiniteMask::clear_non_finite(&mut places);
        notes.extend(finite::left_out_note(finite.n_left_out(), "point"));
        let mut points = Points::new(places)?;
        for (role, at) in roles {
            let (name, attribute) = match role {
                Role::Color => {
                    let channels = self.triples(at);
                    let all = channels.iter().flat_map(|color| color.iter().copied());
                    let are_whole = all.clone().all(|channel| channel.fract() == 0.0);
                    let range = colors::decide(colors, all, are_whole, ColorRange::To255, notes);
                    (
                        "color".to_owned(),
                        Attribute::Color(
                            channels
                                .iter()
                                .map(|color| {
                                    [color.x, color.y, color.z].map(|x| colors::byte(range, x))
                                })
                                .collect(),
                        ),
                    )
                }
                Role::Normal => {
                    let mut normals: Vec<_> =
                        self.triples(at).iter().map(|n| [n.x, n.y, n.z]).collect();
                    notes.extend(finite::replace_non_finite(
                        &mut normals,
                        "normal",
                        "point",
                        |k| finite.contains(k),
                    ));
                    ("normal".to_owned(), Attribute::Vector(normals.into()))
                }
                Role::Number(name) => (name, Attribute::Number(self.column(at).collect())),
            };
            points = points.with_attribute(&name, attribute)?;
        }
        Ok(finite.points(points))
    }

    fn column(&self, at: usize) -> impl Iterator<Item = f64> {
        self.numbers.iter().skip(at).step_by(self.columns).copied()
    }

    fn triples(&self, at: usize) -> Vec<Point3<f64>> {
        let lines = self.numbers.chunks_exact(self.columns);
        lines.map(|line| Point3::new(line[at], line[at + 1], line[at + 2])).collect()
    }

    /// Returns the roles of the columns after the coordinates, each with its first column.
    fn roles(&self, notes: &mut Vec<String>) -> Vec<(Role, usize)> {
        if !self.names.is_empty() && self.names.len() != self.columns {
            let (names, columns) = (self.names.len(), self.columns);
            notes.push(format!("the names in the first line are ignored: there are {names} names, but {columns} columns"));
        } else if !self.names.is_empty() {
            return self.named_roles();
        }
        let mut roles = Vec::new();
        let mut at = 3;
        while at < self.columns {
            fn has(role: &Role, roles: &[(Role, usize)]) -> bool {
                roles.iter().any(|(known, _)| known == role)
            }
            let role = match self.columns - at {
                3.. => self.guess(at).filter(|role| !has(role, &roles)),
                _ => None,
            };
            // If a color is guessed among four remaining columns, the first column is an intensity, unless the last one is an opacity.
            let role = role.filter(|role| {
                (self.columns - at) % 3 != 1
                    || self.guess(at + 1).as_ref() != Some(role)
                    || self.is_opacity(at + 3)
            });
            let role = role.unwrap_or_else(|| {
                let is_first = !roles.iter().any(|(role, _)| matches!(role, Role::Number(_)));
                Role::Number(if is_first {
                    "intensity".to_owned()
                } else {
                    format!("column_{}", at + 1)
                })
            });
            let width = if matches!(role, Role::Number(_)) { 1 } else { 3 };
            roles.push((role, at));
            at += width;
        }
        if self.columns == 6 && !matches!(roles[..], [_]) {
            roles = vec![(Role::Normal, 3)];
        }
        if !matches!(self.columns, 3 | 6) {
            let names = roles.iter().map(|(role, _)| match role {
                Role::Color => "color",
                Role::Normal => "normal",
                Role::Number(name) => name,
            });
            let names = names.collect::<Vec<_>>().join(", ");
            notes.push(format!("the columns after the coordinates are read as {names}; if that is wrong, add a first line of names such as `x y z intensity r g b`"));
        }
        roles
    }

    /// Returns true if all numbers in a column equal the maximum of a color's range: 1 or 255.
    fn is_opacity(&self, at: usize) -> bool {
        let mut column = self.column(at);
        let first = column.next().unwrap_or_default();
        [1.0, 255.0].contains(&first) && column.all(|number| number == first)
    }

    /// Guesses the meaning of three columns: a color, a normal, or `None`.
    fn guess(&self, at: usize) -> Option<Role> {
        let lines = || self.numbers.chunks_exact(self.columns).map(|line| &line[at..at + 3]);
        fn length(line: &[f64]) -> f64 {
            line.iter().map(|x| x * x).sum::<f64>().sqrt()
        }
        if lines().all(|line| {
            line.iter().any(|x| !x.is_finite())
                || (length(line) - 1.0).abs() < 0.01
                || length(line) == 0.0
        }) && lines().any(|line| length(line) > 0.5)
        {
            return Some(Role::Normal);
        }
        let mut finite = lines().flatten().filter(|x| x.is_finite());
        let mut again = finite.clone();
        let is_color = finite.all(|x| (0.0..=255.0).contains(x) && x.fract() == 0.0)
            || again.all(|x| (0.0..=1.0).contains(x));
        is_color.then_some(Role::Color)
    }

    /// Returns true if the three columns that begin at `at` have names from the three given lists.
    fn has_names(&self, at: usize, names: [&[&str]; 3]) -> bool {
        (0..3).all(|k| self.names.get(at + k).is_some_and(|name| names[k].contains(&&**name)))
    }

    /// Determines the roles of the columns from their names.
    fn named_roles(&self) -> Vec<(Role, usize)> {
        const COLOR: [&[&str]; 3] = [&["r", "red"], &["g", "green"], &["b", "blue"]];
        const NORMAL: [&[&str]; 3] =
            [&["nx", "normal_x"], &["ny", "normal_y"], &["nz", "normal_z"]];
        let mut roles = Vec::new();
        let mut at = 3;
        while at < self.columns {
            let role = if self.has_names(at, COLOR) {
                Role::Color
            } else if self.has_names(at, NORMAL) {
                Role::Normal
            } else {
                Role::Number(match &*self.names[at] {
                    "i" => "intensity".to_owned(),
                    name => name.to_owned(),
                })
            };
            let width = if matches!(role, Role::Number(_)) { 1 } else { 3 };
            roles.push((role, at));
            at += width;
        }
        // If two columns have the same name, the later one is renamed.
        for k in 0..roles.len() {
            let (role, at) = &roles[k];
            if roles[..k].iter().any(|(known, _)| known == role) && matches!(role, Role::Number(_))
            {
                roles[k] = (Role::Number(format!("column_{}", at + 1)), *at);
            }
        }
        roles
    }
}

/// Returns the names in a header line, in lower case; `None` if the line does not begin with the names of the coordinates.
fn names(text: &[u8]) -> Option<Vec<String>> {
    let text = text.trim_ascii();
    let text = text.strip_prefix(b"//").unwrap_or(text);
    let parts = text.split(|&byte| matches!(byte, b',' | b';')).flat_map(words);
    let names: Vec<_> = parts
        .map(|word| {
            word.iter()
                .map(|byte| {
                    if byte.is_ascii_alphanumeric() {
                        char::from(byte.to_ascii_lowercase())
                    } else {
                        '_'
                    }
                })
                .collect::<String>()
        })
        .collect();
    names.get(..3).is_some_and(|three| three == ["x", "y", "z"]).then_some(names)
}

/// Appends the numbers of a line to `numbers`.
fn read_numbers(text: &[u8], line: usize, numbers: &mut Vec<f64>) -> Result<(), Error> {
    // If numbers are separated by semicolons, a comma is a decimal comma.
    let has_semicolons = text.contains(&b';');
    let commas = has_semicolons.then(|| {
        text.iter().map(|&byte| if byte == b',' { b'.' } else { byte }).collect::<Vec<_>>()
    });
    let text = commas.as_deref().unwrap_or(text);
    if let Some(word) = decimal_comma(text) {
        let word = excerpt(word);
        bail!("line {line}: `{word}` has a decimal comma: use a point instead");
    }
    let separator = if has_semicolons { b';' } else { b',' };
    for word in text.split(|&byte| byte == separator).flat_map(words) {
        numbers.push(parse_real(word).ok_or_else(|| not_a_number(line, word))?);
    }
    Ok(())
}

/// Returns the first number with a decimal comma, if the line has 3 or 6 words separated by blanks.
fn decimal_comma(text: &[u8]) -> Option<&[u8]> {
    if !text.contains(&b',') {
        return None;
    }
    fn commas(word: &[u8]) -> usize {
        word.iter().filter(|&&byte| byte == b',').count()
    }
    fn is_number(word: &[u8]) -> bool {
        commas(word) <= 1 && !word.starts_with(b",") && !word.ends_with(b",")
    }
    let is_line = matches!(words(text).count(), 3 | 6) && words(text).all(is_number);
    words(text).find(|word| is_line && commas(word) == 1)
}

/// Writes points with their colors, or with their normals if they have no colors.
pub(super) struct PointsXyz;

impl FileFormat for PointsXyz {
    type Value = Points;
    const EXTENSION: &'static str = "xyz";
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::POINTS_XYZ;

    fn write(points: &Points, name: &str) -> Result<Vec<NewFile>, Error> {
        check_single("point", points.positions())?;
        let attributes = points.attributes();
        let (colors, normals) = (attributes.colors("color"), attributes.vectors("normal"));
        let lines = points.positions().iter().enumerate().map(|(index, point)| {
            let normal = normals.filter(|_| colors.is_none()).map(|normals| normals[index]);
            (*point, colors.map(|colors| colors[index]), normal)
        });
        Ok(NewFile::single(name, encode(points.positions(), lines)))
    }

    fn warnings(points: &Points) -> Vec<String> {
        let has_colors = points.attributes().colors("color").is_some();
        let held = if has_colors { "color" } else { "normal" };
        losses::points_warning(points, &[held]).into_iter().collect()
    }
}

/// Writes the points of the valid cells of a range image, with their colors.
pub(super) struct RangeXyz;

impl FileFormat for RangeXyz {
    type Value = RangeImage;
    const EXTENSION: &'static str = "xyz";

    fn write(range: &RangeImage, name: &str) -> Result<Vec<NewFile>, Error> {
        check_single("cell", range.points())?;
        let lines = (0..range.points().len()).filter_map(|cell| {
            Some((range.point(cell)?, range.colors().map(|colors| colors[cell]), None))
        });
        Ok(NewFile::single(name, encode(range.points(), lines)))
    }
}

fn encode(
    all: &[Point3<f64>],
    lines: impl Iterator<Item = (Point3<f64>, Option<Rgb>, Option<[f64; 3]>)>,
) -> Vec<u8> {
    let mut text = String::new();
    let is_far = precision_note(all).is_some();
    for (point, color, normal) in lines {
        // Numbers are written in single precision unless that would move the points, as the shortest text that reads as the same number.
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
    const BLOCKS: Option<ReadBlocks> = Some(read_blocks);
    const EXTENSIONS: &'static [&'static str] = &["xyz", "xyzn", "xyzrgb", "xyzi", "pts", "asc"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::POINTS_READ;
    const SIZE: crate::SizeReader = Some(crate::size::rows);

    fn read(file: &InputFile<'_>) -> Result<Points, Error> {
        let (points, notes) = read_with_notes(file.bytes(), file.color_range())?;
        notes.into_iter().for_each(|note| file.warn(note));
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
    fn unit_vectors_are_normals() {
        let points = read(b"# x, y, z\n1,2, 3,0,0,1\r\n\n4 5 6\t0 0.6 0.8 # the last\n").unwrap();
        let normals = [[0.0, 0.0, 1.0], [0.0, 0.6, 0.8]];
        assert_eq!(points.attributes().vectors("normal").unwrap()[..], normals);
        let written = PointsXyz::write(&points, "a.xyz").unwrap().remove(0).bytes;
        assert_eq!(read(&written).unwrap(), points);
    }

    #[test]
    fn coordinates_of_a_survey_keep_their_digits() {
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
    fn roles_of_columns_follow_from_names_or_numbers() {
        fn read_names(text: &str) -> (String, usize) {
            let (points, notes) = read_with_notes(text.as_bytes(), None).unwrap();
            let names = points.attributes().iter().map(|(name, _)| name.to_owned());
            (names.collect::<Vec<_>>().join(" "), notes.len())
        }
        for (text, names, notes) in [
            ("0 0 0 0.5 255 0 0\n1 0 0 0.25 10 200 30\n", "color intensity", 1),
            ("0 0 0 255 0 0 0.5\n1 0 0 10 200 30 0.25\n", "color intensity", 1),
            ("0 0 0 12 255 0 0\n1 0 0 13 10 200 30\n", "color intensity", 1),
            ("0 0 0 255 0 0 0 0.6 0.8\n1 0 0 10 200 30 0 0 1\n", "color normal", 1),
            ("0 0 0 100\n1 0 0 101\n", "intensity", 1),
            ("0 0 0 0.5 7.5\n1 0 0 101 8\n", "column_5 intensity", 1),
            ("//X,Y,Z,R,G,B\n0,0,0,255,0,0\n", "color", 0),
            ("x;y;z;r;g;b\n0;0;0;255;0;0\n", "color", 0),
            ("X Y Z Nx Ny Nz Scalar_field\n0 0 0 1 2 3 4\n", "normal scalar_field", 0),
            ("2\n0 0 0 255 0 0\n1 0 0 10 200 30\n", "color", 0),
            ("3\n0 0 0\n1 0 0\n", "", 1),
            ("0,5;0,25;1\n1;2;3,5\n", "", 0),
        ] {
            assert_eq!(read_names(text), (names.to_owned(), notes), "{text}");
        }
    }

    #[test]
    fn points_that_are_not_finite_are_left_out_with_a_warning() {
        let file =
            InputFile::standalone("a.xyz", b"1 2 3 0 0 255\nnan nan nan 0 9 0\n4 5 inf 1 0 0\n");
        let points = PointsXyz::read(&file).unwrap();
        assert_eq!(points.positions()[..], [Point3::new(1.0, 2.0, 3.0)]);
        assert_eq!(points.attributes().colors("color").unwrap()[..], [[0, 0, 255]]);
        assert_eq!(file.warnings(), ["2 points are left out: a coordinate is NaN or infinite"]);
    }

    #[test]
    fn invalid_files_are_rejected_with_their_line() {
        fn error(text: &str) -> String {
            read(text.as_bytes()).unwrap_err().to_string()
        }
        assert_eq!(error("1 2\n"), "line 1: expected at least 3 numbers, found 2");
        assert_eq!(error("1 2 3\n1 2 3 4 5 6\n"), "line 2: expected 3 numbers, found 6");
        assert_eq!(error("1 2 3 4 5 6\n1 2 3\n"), "line 2: expected 6 numbers, found 3");
        assert_eq!(error("1 2 c\n"), "line 1: `c` is not a number");
        assert_eq!(error("# nothing\n"), "the file has no points");
        let comma = "line 2: `2,5` has a decimal comma: use a point instead";
        assert_eq!(error("1 2 3\n1 2,5 3\n"), comma);
    }

    #[test]
    fn hostile_files_give_errors() {
        hostile::check_no_panic(FILE, read);
    }
}
