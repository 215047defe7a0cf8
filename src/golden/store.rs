//! Goldens: accepted values of outputs. A golden consists of a summary, which people read in a diff, and of all numbers of the value.
//!
//! The summary contains the hash of the value, and a hash that does not depend on the order of elements. So the two best verdicts
//! (identical and reordered) need no numbers. A sketch of each column shows if any of its numbers has changed. The numbers show where a
//! value differs, and by how much. All entries are stored, rounded far below the tolerance. If the test file contains `keep: Sampled(..)`,
//! only some entries are stored. Then every verdict that needs numbers states which fraction of the entries was compared.

use std::path::Path;
use std::sync::OnceLock;

use maquette_engine::digits::six_digits;
use maquette_engine::distances::distances_of;
use maquette_format::png;
use maquette_node::pack::NewFile;
use maquette_render::{View, render};
use maquette_syntax::{CONFLICT_MESSAGE, conflict_line};
use maquette_value::fs;
use maquette_value::parallel::*;
use maquette_value::{
    AnyValue, Attribute, ControlNet, ElementKind, Faces, Hash, Image, Items, KnotVector, Meaning,
    Mesh, Rgb, Surface,
};
use nalgebra::Point3;

use super::compare::Tolerance;
use super::parts::{Class, GoldenColumn, GoldenParts};

mod judge;
#[cfg(test)]
mod mutations;
mod pack;
mod precision;
mod summary;

use pack::{StoredNumbers, is_earlier, pack, unpack};
use summary::{Line, exact, summary};

/// A golden: the accepted value of an output. Its numbers and pictures are decoded only when they are needed.
#[derive(Clone, Debug, Default)]
pub struct Golden {
    pub(crate) lines: Vec<(String, String)>,
    bin: Option<Vec<u8>>,
    png: Option<Vec<u8>>,
    view: Option<Vec<u8>>,
    numbers: OnceLock<Option<StoredNumbers>>,
    picture: OnceLock<Option<Image>>,
}

/// A file to which a value was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct WrittenFile {
    name: String,
    /// The length and the hash of the file's content, as text.
    content: String,
}

impl WrittenFile {
    pub(crate) fn from_file(file: &NewFile) -> Self {
        Self { name: file.name.clone(), content: content(&file.bytes) }
    }

    /// Returns a description of some files, with one line per file.
    pub(crate) fn note(files: &[Self]) -> Vec<u8> {
        files
            .iter()
            .map(|file| format!("{}\t{}\n", file.content, file.name))
            .collect::<String>()
            .into_bytes()
    }

    pub(crate) fn read(note: &[u8]) -> Option<Vec<Self>> {
        std::str::from_utf8(note)
            .ok()?
            .lines()
            .map(|line| {
                let (content, name) = line.split_once('\t')?;
                Some(Self { name: name.to_owned(), content: content.to_owned() })
            })
            .collect()
    }
}

/// Returns the files of a golden. The name of each file is a suffix, which is appended to the golden's name.
pub(crate) fn files(
    value: &AnyValue,
    outputs: &[WrittenFile],
    needed: &[(String, f64)],
    tolerance: &Tolerance,
) -> Vec<NewFile> {
    let mut files = Vec::new();
    let mut text = String::new();
    let parts = GoldenParts::from_value(value);
    let mut lines = summary(value, parts.as_ref(), outputs, tolerance);
    lines.extend(
        needed.iter().map(|(name, needed)| exact(&format!("needed {name}"), six_digits(*needed))),
    );
    let stride = tolerance.keep.stride();
    if let Some(picture) = picture_of(value) {
        // Use an empty file for a picture without pixels, because it cannot be encoded as PNG.
        let bytes = png::encode_rgb(&sample_picture(&picture, stride)).unwrap_or_default();
        files.push(NewFile { name: ".png".into(), bytes });
    } else if let Some(parts) = &parts {
        files.push(NewFile { name: ".bin".into(), bytes: pack(parts, tolerance, stride) });
        let view = View { size: [160, 120], ..View::front() };
        // Store a rendered picture only if the mesh is stored in part. A picture of a whole mesh can be rendered when it is needed.
        let mesh = (stride > 1).then(|| value.as_mesh()).flatten();
        let look = mesh.and_then(|mesh| png::encode_rgb(&render(&mesh, &view)).ok());
        files.extend(look.map(|bytes| NewFile { name: ".view.png".into(), bytes }));
    }
    lines.push(exact(FORM, THIS_FORM));
    if !files.is_empty() {
        let stored =
            if stride > 1 { format!("every {stride}. entry") } else { "every entry".into() };
        lines.push(exact("kept", stored));
        lines.push(exact(KEPT_FOR, bounds(tolerance)));
    }
    lines.extend(files.iter().map(|file| exact(&file_label(&file.name), content(&file.bytes))));
    lines.sort_by(|a, b| a.label.cmp(&b.label));
    for Line { label, text: fact, .. } in lines {
        text += &line(&label, &fact);
    }
    files.insert(0, NewFile { name: ".txt".into(), bytes: text.into_bytes() });
    files
}

/// The label of the summary line that contains the version of the golden's format.
const FORM: &str = "form";
const THIS_FORM: &str = "2";

/// The label of the summary line that contains the tolerances for which the golden was stored. The stored numbers are rounded only so far
/// that they suffice for these tolerances.
const KEPT_FOR: &str = "kept for";

/// The start of the labels of the summary lines that describe other files of the golden, as in `kept in .bin`.
const FILE_LABEL: &str = "kept in ";

/// Returns the label of the summary line about another file of the golden, such as `kept in .bin` for the file with the suffix `.bin`.
pub(crate) fn file_label(suffix: &str) -> String {
    format!("{FILE_LABEL}{suffix}")
}

/// Describes the content of a file by its length and its hash.
fn content(bytes: &[u8]) -> String {
    format!("{} bytes, {}", bytes.len(), Hash::compute(bytes).short())
}

/// Formats the limits of a tolerance.
fn bounds(tolerance: &Tolerance) -> String {
    let means = [("rms", tolerance.rms), ("p99", tolerance.p99)];
    let means = means.into_iter().filter_map(|(name, limit)| Some((name, limit?)));
    let all = tolerance.limits().chain(means).map(|(name, limit)| format!("{name} {limit}"));
    let all = Vec::from_iter(all);
    if all.is_empty() { "what is allowed where nothing is said".into() } else { all.join(", ") }
}

/// The label of the summary line that contains the reasons for accepting the golden.
const REASON_LABEL: &str = "accepted because";

/// Returns the summary line with the reasons `why` for accepting a golden. Without reasons, returns an empty text.
pub(crate) fn reason_line(why: &[String]) -> String {
    if why.is_empty() { String::new() } else { line(REASON_LABEL, &why.join("; ")) }
}

fn line(label: &str, text: &str) -> String {
    format!("{label:<28}  {text}\n")
}

/// Returns the value as a picture if it consists only of colors or flags of pixels. A golden stores such a value as a picture.
pub(crate) fn picture_of(value: &AnyValue) -> Option<Image> {
    let parts = value.parts();
    let mut compared = parts.columns.iter().filter(|part| !part.is_hidden);
    let (Some(part), None) = (compared.next(), compared.next()) else { return None };
    let pixels: Vec<Rgb> = match (part.element_kind, part.meaning, part.width, &part.items) {
        (ElementKind::Pixel, Meaning::Level, 3, Items::U8(_)) => part.colors().ok()?,
        (ElementKind::Pixel, Meaning::Exact, 1, Items::U8(_)) => {
            part.to_u8(1).ok()?.into_iter().map(|inside| [255 * inside; 3]).collect()
        }
        _ => return None,
    };
    let [width, height] = parts.size().ok()?;
    Image::new(width, height, pixels).ok()
}

/// Returns a picture that contains every `stride`-th pixel of every `stride`-th row.
pub(crate) fn sample_picture(picture: &Image, stride: usize) -> Image {
    let (columns, rows) =
        ((0..picture.width()).step_by(stride), (0..picture.height()).step_by(stride));
    let size = [columns.len(), rows.len()];
    let pixels =
        rows.flat_map(|row| columns.clone().map(move |column| picture.pixel([column, row])));
    Image::new(size[0], size[1], pixels.collect::<Vec<_>>()).expect("one pixel per position")
}

/// The reason why a golden cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum GoldenError {
    Missing,
    Damaged(String),
}

/// Reads the golden with the name `name` from a folder of goldens.
pub(crate) fn read(folder: &Path, name: &str) -> Result<Golden, GoldenError> {
    fn file(suffix: &str, name: &str, folder: &Path) -> Option<Vec<u8>> {
        fs::read(&folder.join(format!("{name}{suffix}"))).ok()
    }
    fn damaged_error(suffix: &str, name: &str) -> GoldenError {
        GoldenError::Damaged(format!("{name}{suffix} is damaged"))
    }
    // A file of the golden and its `.txt` file contradict each other. It is unknown which of the two is wrong.
    fn mismatch_error(suffix: &str, name: &str) -> GoldenError {
        GoldenError::Damaged(format!("{name}{suffix} is not what {name}.txt says of it"))
    }
    fn missing_error(suffix: &str, name: &str) -> GoldenError {
        GoldenError::Damaged(format!("{name}{suffix} is gone"))
    }
    let text = file(".txt", name, folder).ok_or(GoldenError::Missing)?;
    let text = fs::decode_utf8(text);
    let text = text.map_err(|error| GoldenError::Damaged(format!("{name}.txt: {error}")))?;
    if let Some(line) = conflict_line(&text) {
        let message = format!("{name}.txt, line {line}: {CONFLICT_MESSAGE}");
        return Err(GoldenError::Damaged(message));
    }
    let [bin, png, view] =
        [".bin", ".png", ".view.png"].map(|suffix| (suffix, file(suffix, name, folder)));
    let golden = Golden {
        lines: text
            .lines()
            .map(|line| {
                let (label, text) = line.split_once("  ").unwrap_or((line, ""));
                (label.to_owned(), text.trim().to_owned())
            })
            .collect(),
        ..Golden::default()
    };
    if golden.line(FORM) == Some(THIS_FORM) {
        for (suffix, bytes) in [&bin, &png, &view] {
            match (golden.line(&file_label(suffix)), bytes.as_deref().map(content)) {
                (Some(_), None) => return Err(missing_error(suffix, name)),
                (was, is) if was != is.as_deref() => return Err(mismatch_error(suffix, name)),
                _ => {}
            }
        }
    } else if bin.1.as_ref().is_some_and(|bytes| !is_earlier(bytes)) {
        return Err(damaged_error(".bin", name));
    }
    Ok(Golden { bin: bin.1, png: png.1, view: view.1, ..golden })
}

impl Golden {
    pub(crate) fn line(&self, label: &str) -> Option<&str> {
        self.lines.iter().find(|(name, _)| name == label).map(|(_, text)| &text[..])
    }

    /// Returns the largest difference that was ever accepted for each measure, with the name of the measure.
    pub(crate) fn accepted_differences(&self) -> Vec<(String, f64)> {
        self.lines
            .iter()
            .filter_map(|(label, text)| {
                Some((label.strip_prefix("needed ")?.to_owned(), text.parse().ok()?))
            })
            .collect()
    }

    /// Returns true if an earlier version of the program wrote the golden in a format whose numbers cannot be compared with a value.
    pub(crate) fn has_earlier_form(&self) -> bool {
        self.line(FORM) != Some(THIS_FORM) || self.bin.as_deref().is_some_and(is_earlier)
    }

    /// Returns the reason why the golden should be stored again even if the value has not changed, or `None`.
    pub(crate) fn outdated_reason(&self, tolerance: &Tolerance) -> Option<&'static str> {
        if self.has_earlier_form() {
            return Some("has an earlier format, which cannot measure a difference");
        }
        self.line("kept")?;
        if self.stride() != tolerance.keep.stride() {
            return Some("does not store what `keep` in the test file says");
        }
        let other = self.line(KEPT_FOR) != Some(&bounds(tolerance));
        other.then_some("was stored for other tolerances")
    }

    /// Returns the reasons that were given when the golden was accepted.
    pub fn reasons(&self) -> Vec<String> {
        self.line(REASON_LABEL).map(str::to_owned).into_iter().collect()
    }

    fn stride(&self) -> usize {
        let words = self.line("kept").and_then(|text| text.split(['.', ' ']).nth(1)?.parse().ok());
        words.unwrap_or(1)
    }

    /// Returns the stored picture, which may contain only every n-th pixel. For a mesh that was stored only in part, this is its rendered
    /// picture.
    pub(crate) fn picture(&self) -> Option<&Image> {
        self.picture
            .get_or_init(|| png::read(self.png.as_ref().or(self.view.as_ref())?).ok())
            .as_ref()
    }

    /// Returns the stored numbers of the golden. Returns `None` if it has none, or if they are damaged or in an earlier format.
    pub(crate) fn numbers(&self) -> Option<&StoredNumbers> {
        self.numbers
            .get_or_init(|| unpack(self.bin.as_ref().filter(|_| !self.has_earlier_form())?))
            .as_ref()
    }

    /// Returns how far each vertex of `mesh` has moved, estimated from the stored vertices. `None` if no positions are stored.
    ///
    /// If the number of vertices has not changed, the result for a vertex is the move of the stored vertex with the same or the next lower
    /// index. Otherwise it is the distance of the nearest stored vertex from `mesh`.
    pub(crate) fn differences(&self, mesh: &Mesh) -> Option<Vec<f64>> {
        let position = &self.numbers()?.column("position")?.part;
        let stored: Vec<Point3<f64>> =
            position.numbers.chunks_exact(3).map(|p| Point3::new(p[0], p[1], p[2])).collect();
        if position.count == mesh.positions().len() {
            let now = mesh.positions().iter().step_by(position.stride);
            let far: Vec<f64> = now.zip(&stored).map(|(now, was)| (now - was).norm()).collect();
            return Some((0..position.count).map(|k| far[k / position.stride]).collect());
        }
        let far = distances_of(&stored, mesh);
        Some(
            mesh.positions()
                .par_iter()
                .map(|vertex| {
                    fn distance_sq(k: &usize, stored: &[Point3<f64>], vertex: &Point3<f64>) -> f64 {
                        (stored[*k] - vertex).norm_squared()
                    }
                    let nearest = (0..stored.len()).min_by(|a, b| {
                        distance_sq(a, &stored, vertex).total_cmp(&distance_sq(b, &stored, vertex))
                    });
                    nearest.map_or(f64::INFINITY, |k| far[k])
                })
                .collect(),
        )
    }

    /// Returns the stored mesh, or the stored surface as a mesh. Returns `None` if only a part of it was stored.
    pub(crate) fn mesh(&self) -> Option<Mesh> {
        let stored = self.numbers().filter(|_| self.stride() == 1)?;
        match self.line("type")? {
            "Mesh" => Self::stored_mesh(stored),
            "Surface" => self.stored_surface(stored)?.tessellate(0, 0).ok(),
            _ => None,
        }
    }

    fn stored_surface(&self, stored: &StoredNumbers) -> Option<Surface> {
        let (rows, columns) = self.line("control points")?.split_once(" x ")?;
        let size = [rows, columns].map(|count| count.parse().unwrap_or(0));
        let net = ControlNet::new(size[0], size[1], stored.points("base")?).ok()?;
        let net = net.with_points(stored.points("point")?).ok()?;
        let net = net.with_weights(stored.numbers("weight")?.to_vec()).ok()?;
        Surface::new(
            net,
            self.stored_knots(stored, "knots u")?,
            self.stored_knots(stored, "knots v")?,
        )
        .ok()
    }

    fn stored_knots(&self, stored: &StoredNumbers, name: &str) -> Option<KnotVector> {
        let degree = self.line(&format!("degree of {name}"))?.parse().ok()?;
        KnotVector::new(degree, stored.numbers(name)?.to_vec()).ok()
    }

    fn stored_mesh(stored: &StoredNumbers) -> Option<Mesh> {
        let positions = stored.points("position")?;
        let corners = &stored.column("corners")?.part;
        let vertices: Vec<u32> = corners.numbers.iter().map(|&x| x as u32).collect();
        let faces = match stored.numbers("sides") {
            Some(sides) => {
                Faces::polygons(&sides.iter().map(|&x| x as usize).collect::<Vec<_>>(), vertices)
            }
            None => Faces::uniform(corners.width, vertices),
        };
        let mut mesh = Mesh::new(positions, faces.ok()?).ok()?;
        for part in stored.columns.iter().map(|column| &column.part) {
            if ["frame", "position", "corners", "sides", "creases"].contains(&&part.name[..]) {
                continue;
            }
            let attribute = attribute(part)?;
            mesh = if let Some(name) = part.name.strip_prefix("corner ") {
                mesh.with_corner(name, attribute).ok()?
            } else if let Some(name) = part.name.strip_prefix("face ") {
                mesh.with_face(name, attribute).ok()?
            } else {
                mesh.with_vertex(&part.name, attribute).ok()?
            };
        }
        Some(mesh)
    }
}

fn attribute(part: &GoldenColumn) -> Option<Attribute> {
    let numbers = &part.numbers;
    Some(match (part.class, part.width) {
        (Class::Exact, 1) => Attribute::Index(numbers.iter().map(|&x| x as u32).collect()),
        (Class::Level, 3) => Attribute::Color(
            numbers.chunks_exact(3).map(|c| [c[0] as u8, c[1] as u8, c[2] as u8]).collect(),
        ),
        (_, 1) => Attribute::Number(numbers.iter().copied().collect()),
        (_, 2) => Attribute::Pair(numbers.chunks_exact(2).map(|p| [p[0], p[1]]).collect()),
        (_, 3) => Attribute::Vector(numbers.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect()),
        _ => return None,
    })
}
