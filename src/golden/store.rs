//! What is kept of a value: a summary that people read in a diff, and all of its numbers.
//!
//! The summary has the value's hash and a mark that does not depend on order, so that both best verdicts need no numbers; a
//! sketch of each column tells whether any number of it changed. The numbers judge how far a value differs, and where: every
//! entry is kept, however many there are, rounded far below what is allowed. What an author finds too large is kept in part by
//! `keep: Sampled(..)` in the test file; then every verdict that needs numbers says what share of them was looked at.

use std::path::Path;
use std::sync::OnceLock;

use maquette_engine::distances::distances_of;
use maquette_engine::six::six;
use maquette_format::png;
use maquette_node::pack::NewFile;
use maquette_render::{View, render};
use maquette_syntax::{CONFLICT, conflict_line};
use maquette_value::parallel::*;
use maquette_value::plain;
use maquette_value::{
    AnyValue, Attribute, ControlNet, Faces, Hash, Image, Items, KnotVector, Meaning, Mesh, On, Rgb,
    Surface,
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

use pack::{EARLIER, Kept, pack, unpack};
use summary::{Line, exact, summary};

/// What was kept of a value. Its numbers and pictures are looked into when they are needed.
#[derive(Clone, Debug, Default)]
pub struct Golden {
    pub(crate) lines: Vec<(String, String)>,
    bin: Option<Vec<u8>>,
    png: Option<Vec<u8>>,
    view: Option<Vec<u8>>,
    kept: OnceLock<Option<Kept>>,
    picture: OnceLock<Option<Image>>,
}

/// A file that a value was written to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Written {
    name: String,
    /// Its length and hash.
    content: String,
}

impl Written {
    pub(crate) fn of(file: &NewFile) -> Self {
        Self { name: file.name.clone(), content: content(&file.bytes) }
    }

    /// The files in as many lines.
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

/// The files of a golden, by what follows its name.
pub(crate) fn files(
    value: &AnyValue,
    outputs: &[Written],
    needed: &[(String, f64)],
    tolerance: &Tolerance,
) -> Vec<NewFile> {
    let mut files = Vec::new();
    let mut text = String::new();
    let parts = GoldenParts::of(value);
    let mut lines = summary(value, parts.as_ref(), outputs, tolerance);
    lines
        .extend(needed.iter().map(|(name, needed)| exact(&format!("needed {name}"), six(*needed))));
    let stride = tolerance.keep.stride();
    if let Some(picture) = picture_of(value) {
        // A picture without pixels is no PNG.
        let bytes = png::encode_rgb(&every(&picture, stride)).unwrap_or_default();
        files.push(NewFile { name: ".png".into(), bytes });
    } else if let Some(parts) = &parts {
        files.push(NewFile { name: ".bin".into(), bytes: pack(parts, tolerance, stride) });
        let view = View { size: [160, 120], ..View::front() };
        // All of a mesh shows how it looked.
        let mesh = (stride > 1).then(|| value.as_mesh()).flatten();
        let look = mesh.and_then(|mesh| png::encode_rgb(&render(&mesh, &view)).ok());
        files.extend(look.map(|bytes| NewFile { name: ".view.png".into(), bytes }));
    }
    lines.push(exact(FORM, THIS_FORM));
    if !files.is_empty() {
        let kept = if stride > 1 { format!("every {stride}. entry") } else { "every entry".into() };
        lines.push(exact("kept", kept));
        lines.push(exact(KEPT_FOR, bounds(tolerance)));
    }
    lines.extend(files.iter().map(|file| exact(&kept_in(&file.name), content(&file.bytes))));
    lines.sort_by(|a, b| a.label.cmp(&b.label));
    for Line { label, text: fact, .. } in lines {
        text += &line(&label, &fact);
    }
    files.insert(0, NewFile { name: ".txt".into(), bytes: text.into_bytes() });
    files
}

/// The line that says by which rules a golden is written.
const FORM: &str = "form";
const THIS_FORM: &str = "2";

/// The line that says what differences the numbers can judge.
const KEPT_FOR: &str = "kept for";

/// Begins the lines of a golden's other files.
const KEPT_IN: &str = "kept in ";

/// The label of the line that names a file of a golden, by what follows the golden's name.
pub(crate) fn kept_in(suffix: &str) -> String {
    format!("{KEPT_IN}{suffix}")
}

/// The length and the hash of a file.
fn content(bytes: &[u8]) -> String {
    format!("{} bytes, {}", bytes.len(), Hash::of(bytes).short())
}

/// What is allowed, in words.
fn bounds(tolerance: &Tolerance) -> String {
    let means = [("rms", tolerance.rms), ("p99", tolerance.p99)];
    let means = means.into_iter().filter_map(|(name, most)| Some((name, most?)));
    let all = tolerance.limits().chain(means).map(|(name, most)| format!("{name} {most}"));
    let all = Vec::from_iter(all);
    if all.is_empty() { "what is allowed where nothing is said".into() } else { all.join(", ") }
}

/// Begins the line that says why a golden is as it is.
const BECAUSE: &str = "accepted because";

/// The line of a summary that says why the golden was accepted; none if there is no reason to give.
pub(crate) fn because(why: &[String]) -> String {
    if why.is_empty() { String::new() } else { line(BECAUSE, &why.join("; ")) }
}

fn line(label: &str, text: &str) -> String {
    format!("{label:<28}  {text}\n")
}

/// What is nothing but colors of pixels, or flags of pixels, is kept as a picture.
pub(crate) fn picture_of(value: &AnyValue) -> Option<Image> {
    let parts = value.parts();
    let mut compared = parts.columns.iter().filter(|part| !part.aside);
    let (Some(part), None) = (compared.next(), compared.next()) else { return None };
    let pixels: Vec<Rgb> = match (part.on, part.meaning, part.width, &part.items) {
        (On::Pixel, Meaning::Level, 3, Items::U8(_)) => part.colors().ok()?,
        (On::Pixel, Meaning::Exact, 1, Items::U8(_)) => {
            part.small(1).ok()?.into_iter().map(|inside| [255 * inside; 3]).collect()
        }
        _ => return None,
    };
    let [width, height] = parts.size().ok()?;
    Image::new(width, height, pixels).ok()
}

/// Every n-th pixel of every n-th row.
pub(crate) fn every(picture: &Image, stride: usize) -> Image {
    let (columns, rows) =
        ((0..picture.width()).step_by(stride), (0..picture.height()).step_by(stride));
    let size = [columns.len(), rows.len()];
    let pixels = rows.flat_map(|row| columns.clone().map(move |column| picture.at([column, row])));
    Image::new(size[0], size[1], pixels.collect::<Vec<_>>()).expect("a pixel for each place")
}

/// Why a golden cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NoGolden {
    Missing,
    Damaged(String),
}

/// The golden of this name in a folder.
pub(crate) fn read(folder: &Path, name: &str) -> Result<Golden, NoGolden> {
    fn file(suffix: &str, name: &str, folder: &Path) -> Option<Vec<u8>> {
        plain::read(&folder.join(format!("{name}{suffix}"))).ok()
    }
    fn damaged(suffix: &str, name: &str) -> NoGolden {
        NoGolden::Damaged(format!("{name}{suffix} is damaged"))
    }
    // Which of both is wrong cannot be told.
    fn unlike(suffix: &str, name: &str) -> NoGolden {
        NoGolden::Damaged(format!("{name}{suffix} is not what {name}.txt says of it"))
    }
    fn gone(suffix: &str, name: &str) -> NoGolden {
        NoGolden::Damaged(format!("{name}{suffix} is gone"))
    }
    let text = file(".txt", name, folder).ok_or(NoGolden::Missing)?;
    let text = plain::text_of(text);
    let text = text.map_err(|error| NoGolden::Damaged(format!("{name}.txt: {error}")))?;
    if let Some(line) = conflict_line(&text) {
        let message = format!("{name}.txt, line {line}: {CONFLICT}");
        return Err(NoGolden::Damaged(message));
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
            match (golden.line(&kept_in(suffix)), bytes.as_deref().map(content)) {
                (Some(_), None) => return Err(gone(suffix, name)),
                (was, is) if was != is.as_deref() => return Err(unlike(suffix, name)),
                _ => {}
            }
        }
    } else if bin.1.as_ref().is_some_and(|bytes| !bytes.starts_with(EARLIER)) {
        return Err(damaged(".bin", name));
    }
    Ok(Golden { bin: bin.1, png: png.1, view: view.1, ..golden })
}

impl Golden {
    pub(crate) fn line(&self, label: &str) -> Option<&str> {
        self.lines.iter().find(|(name, _)| name == label).map(|(_, text)| &text[..])
    }

    /// The largest differences that were ever accepted, by what was measured.
    pub(crate) fn needed(&self) -> Vec<(String, f64)> {
        self.lines
            .iter()
            .filter_map(|(label, text)| {
                Some((label.strip_prefix("needed ")?.to_owned(), text.parse().ok()?))
            })
            .collect()
    }

    /// Whether it was written by an earlier program, whose numbers are not enough to judge by.
    pub(crate) fn is_earlier(&self) -> bool {
        self.line(FORM) != Some(THIS_FORM)
    }

    /// Whether another golden of the same value would keep it otherwise, in words.
    pub(crate) fn outdated(&self, tolerance: &Tolerance) -> Option<&'static str> {
        if self.is_earlier() {
            return Some("is of an earlier form, which cannot judge a difference");
        }
        self.line("kept")?;
        if self.stride() != tolerance.keep.stride() {
            return Some("does not keep what the test file says");
        }
        let other = self.line(KEPT_FOR) != Some(&bounds(tolerance));
        other.then_some("was kept for other tolerances")
    }

    /// Why it was accepted.
    pub fn because(&self) -> Vec<String> {
        self.line(BECAUSE).map(str::to_owned).into_iter().collect()
    }

    fn stride(&self) -> usize {
        let words = self.line("kept").and_then(|text| text.split(['.', ' ']).nth(1)?.parse().ok());
        words.unwrap_or(1)
    }

    /// The picture that was kept, as it is or as every n-th pixel, or how a mesh looked of which only some was kept.
    pub(crate) fn picture(&self) -> Option<&Image> {
        self.picture
            .get_or_init(|| png::read(self.png.as_ref().or(self.view.as_ref())?).ok())
            .as_ref()
    }

    /// The numbers that were kept.
    pub(crate) fn kept(&self) -> Option<&Kept> {
        self.kept.get_or_init(|| unpack(self.bin.as_ref().filter(|_| !self.is_earlier())?)).as_ref()
    }

    /// How far each vertex of a mesh is from where it was, judged by the vertex that was kept nearest to it: in the list if this
    /// is as long as it was, else in space.
    pub(crate) fn differences(&self, mesh: &Mesh) -> Option<Vec<f64>> {
        let position = &self.kept()?.column("position")?.part;
        let kept: Vec<Point3<f64>> =
            position.numbers.chunks_exact(3).map(|p| Point3::new(p[0], p[1], p[2])).collect();
        if position.count == mesh.positions().len() {
            let now = mesh.positions().iter().step_by(position.stride);
            let far: Vec<f64> = now.zip(&kept).map(|(now, was)| (now - was).norm()).collect();
            return Some((0..position.count).map(|k| far[k / position.stride]).collect());
        }
        let far = distances_of(&kept, mesh);
        Some(
            mesh.positions()
                .par_iter()
                .map(|vertex| {
                    fn distance_sq(k: &usize, kept: &[Point3<f64>], vertex: &Point3<f64>) -> f64 {
                        (kept[*k] - vertex).norm_squared()
                    }
                    let nearest = (0..kept.len()).min_by(|a, b| {
                        distance_sq(a, &kept, vertex).total_cmp(&distance_sq(b, &kept, vertex))
                    });
                    nearest.map_or(f64::INFINITY, |k| far[k])
                })
                .collect(),
        )
    }

    /// The mesh that was kept, or the surface as one, if all of it was.
    pub(crate) fn mesh(&self) -> Option<Mesh> {
        let kept = self.kept().filter(|_| self.stride() == 1)?;
        match self.line("type")? {
            "Mesh" => Self::kept_mesh(kept),
            "Surface" => self.kept_surface(kept)?.tessellate(0, 0).ok(),
            _ => None,
        }
    }

    fn kept_surface(&self, kept: &Kept) -> Option<Surface> {
        let column = |name: &str| kept.numbers(name);
        let places = |name: &str| {
            let places = column(name)?.chunks_exact(3).map(|p| Point3::new(p[0], p[1], p[2]));
            Some(places.collect::<Vec<_>>())
        };
        let knots = |name: &str| {
            let degree = self.line(&format!("degree of {name}"))?.parse().ok()?;
            KnotVector::new(degree, column(name)?.to_vec()).ok()
        };
        let (rows, columns) = self.line("control points")?.split_once(" x ")?;
        let size = [rows, columns].map(|count| count.parse().unwrap_or(0));
        let net = ControlNet::new(size[0], size[1], places("base")?).ok()?;
        let net = net.with_points(places("point")?).ok()?;
        let net = net.with_weights(column("weight")?.to_vec()).ok()?;
        Surface::new(net, knots("knots u")?, knots("knots v")?).ok()
    }

    fn kept_mesh(kept: &Kept) -> Option<Mesh> {
        let position = kept.numbers("position")?;
        let positions = position.chunks_exact(3).map(|p| Point3::new(p[0], p[1], p[2]));
        let corners = &kept.column("corners")?.part;
        let vertices: Vec<u32> = corners.numbers.iter().map(|&x| x as u32).collect();
        let faces = match kept.numbers("sides") {
            Some(sides) => {
                Faces::polygons(&sides.iter().map(|&x| x as usize).collect::<Vec<_>>(), vertices)
            }
            None => Faces::uniform(corners.width, vertices),
        };
        let mut mesh = Mesh::new(positions.collect::<Vec<_>>(), faces.ok()?).ok()?;
        for part in kept.columns.iter().map(|column| &column.part) {
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
