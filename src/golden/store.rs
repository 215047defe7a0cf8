//! What is kept of a value: a summary that people read in a diff, and its numbers as far as they are few.
//!
//! The summary has the value's hash and a mark that does not depend on order, so that both best verdicts need no numbers; a
//! sketch of each column finds the least change of any number. The numbers themselves show where a value differs: they are
//! rounded, written as differences of neighbors, and deflated. Where they take more than [`MOST_BYTES`], only every n-th element
//! is kept.

use std::path::Path;

use nalgebra::Point3;
use rayon::prelude::*;

use super::compare::{Tolerance, distances_of, six};
use super::parts::{Class, Part, Parts};
use crate::format::png;
use crate::pack::NewFile;
use crate::render::{View, render};
use crate::value::{
    AnyValue, Attribute, ControlNet, Faces, Hash, Image, KnotVector, Mask, Mesh, Surface,
};

mod judge;
mod pack;
mod summary;

use pack::{MOST_BYTES, pack, unpack};
use summary::{Line, exact, summary};

/// What was kept of a value.
#[derive(Clone, Debug, Default)]
pub(crate) struct Golden {
    pub(crate) lines: Vec<(String, String)>,
    parts: Option<Parts>,
    picture: Option<Image>,
    /// A mesh as it looked, where it cannot be made again of its numbers.
    view: Option<Image>,
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
        let content = format!("{} bytes, {}", file.bytes.len(), Hash::of(&file.bytes).short());
        Self { name: file.name.clone(), content }
    }

    /// The files in as many lines.
    pub(crate) fn note(files: &[Self]) -> Vec<u8> {
        let line = |file: &Self| format!("{}\t{}\n", file.content, file.name);
        files.iter().map(line).collect::<String>().into_bytes()
    }

    pub(crate) fn read(note: &[u8]) -> Option<Vec<Self>> {
        let file = |line: &str| {
            let (content, name) = line.split_once('\t')?;
            Some(Self { name: name.to_owned(), content: content.to_owned() })
        };
        std::str::from_utf8(note).ok()?.lines().map(file).collect()
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
    let parts = Parts::of(value);
    let mut lines = summary(value, parts.as_ref(), outputs, tolerance);
    lines
        .extend(needed.iter().map(|(name, needed)| exact(&format!("needed {name}"), six(*needed))));
    if let Some(picture) = picture_of(value) {
        let (stride, bytes) = small_picture(&picture);
        lines.push(exact("kept", format!("every {stride}. pixel")));
        files.push(NewFile { name: ".png".into(), bytes });
    } else if let Some(parts) = &parts {
        let (stride, bytes) = pack(parts, tolerance);
        lines.push(exact("kept", format!("every {stride}. element")));
        files.push(NewFile { name: ".bin".into(), bytes });
        let view = View { size: [160, 120], ..View::front() };
        let mesh = mesh_of(value).filter(|_| stride > 1);
        let look = mesh.and_then(|mesh| png::encode_rgb(&render(&mesh, &view)).ok());
        files.extend(look.map(|bytes| NewFile { name: ".view.png".into(), bytes }));
    }
    lines.sort_by(|a, b| a.label.cmp(&b.label));
    for Line { label, text: fact, .. } in lines {
        text += &line(&label, &fact);
    }
    files.insert(0, NewFile { name: ".txt".into(), bytes: text.into_bytes() });
    files
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

/// A mesh, or a surface as one.
pub(crate) fn mesh_of(value: &AnyValue) -> Option<Mesh> {
    let surface = || value.get::<Surface>()?.tessellate(0, 0).ok();
    value.get::<Mesh>().cloned().or_else(surface)
}

/// Pictures and masks are kept as pictures.
pub(crate) fn picture_of(value: &AnyValue) -> Option<Image> {
    if let Some(mask) = value.get::<Mask>() {
        let gray = mask.pixels().iter().map(|&inside| [255 * inside; 3]);
        return Image::new(mask.width(), mask.height(), gray.collect::<Vec<_>>()).ok();
    }
    value.get::<Image>().cloned()
}

/// Every n-th pixel of every n-th row.
pub(super) fn every(picture: &Image, stride: usize) -> Image {
    let (columns, rows) =
        ((0..picture.width()).step_by(stride), (0..picture.height()).step_by(stride));
    let size = [columns.len(), rows.len()];
    let pixels = rows.flat_map(|row| columns.clone().map(move |column| picture.at([column, row])));
    Image::new(size[0], size[1], pixels.collect::<Vec<_>>()).expect("a pixel for each place")
}

fn small_picture(picture: &Image) -> (usize, Vec<u8>) {
    for stride in 1.. {
        // A picture without pixels is no PNG.
        let bytes = png::encode_rgb(&every(picture, stride)).unwrap_or_default();
        if bytes.len() <= MOST_BYTES {
            return (stride, bytes);
        }
    }
    (1, Vec::new())
}

/// Why a golden cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum NoGolden {
    Missing,
    Damaged(String),
}

/// The golden of this name in a folder.
pub(crate) fn read(folder: &Path, name: &str) -> Result<Golden, NoGolden> {
    let file = |suffix: &str| crate::plain::read(&folder.join(format!("{name}{suffix}"))).ok();
    let damaged = |suffix: &str| NoGolden::Damaged(format!("{name}{suffix} is damaged"));
    let text = file(".txt").ok_or(NoGolden::Missing)?;
    let text = String::from_utf8(text).map_err(|_| damaged(".txt"))?;
    let line = |line: &str| {
        let (label, text) = line.split_once("  ").unwrap_or((line, ""));
        (label.to_owned(), text.trim().to_owned())
    };
    let parts = match file(".bin") {
        Some(bytes) => Some(unpack(&bytes).ok_or_else(|| damaged(".bin"))?),
        None => None,
    };
    let picture = |suffix: &str| match file(suffix) {
        Some(bytes) if !bytes.is_empty() => {
            png::read(&bytes).map(Some).map_err(|_| damaged(suffix))
        }
        _ => Ok(None),
    };
    let (picture, view) = (picture(".png")?, picture(".view.png")?);
    Ok(Golden { lines: text.lines().map(line).collect(), parts, picture, view })
}

impl Golden {
    pub(crate) fn line(&self, label: &str) -> Option<&str> {
        self.lines.iter().find(|(name, _)| name == label).map(|(_, text)| &text[..])
    }

    /// The largest differences that were ever accepted, by what was measured.
    pub(crate) fn needed(&self) -> Vec<(String, f64)> {
        let needed = |(label, text): &(String, String)| {
            Some((label.strip_prefix("needed ")?.to_owned(), text.parse().ok()?))
        };
        self.lines.iter().filter_map(needed).collect()
    }

    fn stride(&self) -> usize {
        let words = self.line("kept").and_then(|text| text.split(['.', ' ']).nth(1)?.parse().ok());
        words.unwrap_or(1)
    }

    /// The picture that was kept, as it is or as every n-th pixel.
    pub(crate) fn picture(&self) -> Option<&Image> {
        self.picture.as_ref().or(self.view.as_ref())
    }

    /// The numbers that were kept.
    pub(super) fn parts(&self) -> Option<&Parts> {
        self.parts.as_ref()
    }

    /// How far each vertex of a mesh is from where it was, judged by the vertex that was kept nearest to it: in the list if this
    /// is as long as it was, else in space.
    pub(super) fn differences(&self, mesh: &Mesh) -> Option<Vec<f64>> {
        let position = self.parts.as_ref()?.column("position")?;
        let kept: Vec<Point3<f64>> =
            position.numbers.chunks_exact(3).map(|p| Point3::new(p[0], p[1], p[2])).collect();
        if position.count == mesh.positions().len() {
            let now = mesh.positions().iter().step_by(position.stride);
            let far: Vec<f64> = now.zip(&kept).map(|(now, was)| (now - was).norm()).collect();
            return Some((0..position.count).map(|k| far[k / position.stride]).collect());
        }
        let far = distances_of(&kept, mesh);
        let nearest = |vertex: &Point3<f64>| {
            let distance_sq = |k: &usize| (kept[*k] - vertex).norm_squared();
            let nearest = (0..kept.len()).min_by(|a, b| distance_sq(a).total_cmp(&distance_sq(b)));
            nearest.map_or(f64::INFINITY, |k| far[k])
        };
        Some(mesh.positions().par_iter().map(nearest).collect())
    }

    /// The mesh that was kept, or the surface as one, if all of it was.
    pub(crate) fn mesh(&self) -> Option<Mesh> {
        let parts = self.parts.as_ref()?;
        if parts.columns.iter().any(|part| part.stride > 1) {
            return None;
        }
        match self.line("type")? {
            "Mesh" => Self::kept_mesh(parts),
            "Surface" => self.kept_surface(parts)?.tessellate(0, 0).ok(),
            _ => None,
        }
    }

    fn kept_surface(&self, parts: &Parts) -> Option<Surface> {
        let column = |name: &str| parts.column(name).map(|part| &part.numbers[..]);
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

    fn kept_mesh(parts: &Parts) -> Option<Mesh> {
        let position = parts.column("position")?;
        let positions = position.numbers.chunks_exact(3).map(|p| Point3::new(p[0], p[1], p[2]));
        let corners = parts.column("corners")?;
        let vertices: Vec<u32> = corners.numbers.iter().map(|&x| x as u32).collect();
        let faces = match parts.column("sides") {
            Some(sides) => Faces::polygons(
                &Vec::from_iter(sides.numbers.iter().map(|&x| x as usize)),
                vertices,
            ),
            None => Faces::uniform(corners.width, vertices),
        };
        let mut mesh = Mesh::new(positions.collect::<Vec<_>>(), faces.ok()?).ok()?;
        for part in &parts.columns {
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

fn attribute(part: &Part) -> Option<Attribute> {
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
