//! What is kept of a value: a summary that people read in a diff, and its numbers as far as they are few.
//!
//! The summary has the value's hash and a mark that does not depend on order, so that both best verdicts need no numbers. The
//! numbers are rounded to a tenth of what may differ, written as differences of neighbors, and deflated. Where they take more
//! than [`MOST_BYTES`], only every n-th element is kept, and the summary's statistics vouch for the rest.

use std::path::Path;

use super::compare::{
    Comparison, Tolerance, Verdict, compare_meshes, compare_parts, different_facts, six,
    without_order,
};
use super::parts::{Class, Part, Parts};
use crate::format::png;
use crate::pack::NewFile;
use crate::render::{View, render};
use crate::value::{AnyValue, Attribute, Faces, Hash, Image, Mask, Mesh, Surface};

mod pack;
mod summary;

use pack::{FACES, MOST_BYTES, pack, unpack};
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

/// The files of a golden, by what follows its name.
pub(crate) fn files(
    value: &AnyValue,
    outputs: &[NewFile],
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
        let view = View { size: [240, 180], ..View::front() };
        let mesh = mesh_of(value).filter(|_| stride > 1);
        let look = mesh.and_then(|mesh| png::encode_rgb(&render(&mesh, &view)).ok());
        files.extend(look.map(|bytes| NewFile { name: ".view.png".into(), bytes }));
    }
    lines.sort_by(|a, b| a.label.cmp(&b.label));
    for line in lines {
        text += &format!("{:<28}  {}\n", line.label, line.text);
    }
    files.insert(0, NewFile { name: ".txt".into(), bytes: text.into_bytes() });
    files
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
    let file = |suffix: &str| std::fs::read(folder.join(format!("{name}{suffix}"))).ok();
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

    /// How far each vertex of a mesh is from where it was, judged by the nearest vertex in the list that was kept.
    pub(super) fn differences(&self, mesh: &Mesh) -> Option<Vec<f64>> {
        let position = self.parts.as_ref()?.column("position")?;
        if position.count != mesh.positions().len() {
            return None;
        }
        let distance = |place: usize| {
            let p = position.element(place);
            (mesh.positions()[place * position.stride] - nalgebra::Point3::new(p[0], p[1], p[2]))
                .norm()
        };
        let kept = Vec::from_iter((0..position.count.div_ceil(position.stride)).map(distance));
        Some((0..position.count).map(|vertex| kept[vertex / position.stride]).collect())
    }

    /// The mesh that was kept, if all of it was.
    pub(crate) fn mesh(&self) -> Option<Mesh> {
        let parts = self.parts.as_ref().filter(|_| self.line("type") == Some("Mesh"))?;
        if parts.columns.iter().any(|part| part.stride > 1) {
            return None;
        }
        let position = parts.column("position")?;
        let positions =
            position.numbers.chunks_exact(3).map(|p| nalgebra::Point3::new(p[0], p[1], p[2]));
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

    /// How a value, written to these files, differs from what was kept.
    pub(crate) fn compare(
        &self,
        value: &AnyValue,
        outputs: &[NewFile],
        tolerance: &Tolerance,
    ) -> Comparison {
        if self.line("hash") == Some(&value.hash().to_string()) {
            let mut reasons = Vec::new();
            for file in outputs {
                let text = format!("{} bytes, {}", file.bytes.len(), Hash::of(&file.bytes).short());
                match self.line(&format!("file {}", file.name)) {
                    Some(before) if before == text => {}
                    Some(before) => reasons.push(format!(
                        "the value is the same, but not its file {}: {before} -> {text}",
                        file.name
                    )),
                    None => reasons.push(format!("file {} is new", file.name)),
                }
            }
            let is_file = |label: &str| label.strip_prefix("file ").map(str::to_owned);
            let gone = self.lines.iter().filter_map(|(label, _)| is_file(label));
            let gone = gone.filter(|name| !outputs.iter().any(|file| file.name == *name));
            reasons.extend(gone.map(|name| format!("file {name} is gone")));
            return if reasons.is_empty() {
                Comparison::alike(Verdict::Identical)
            } else {
                Comparison::new(reasons, Vec::new())
            };
        }
        let mark = without_order(value).map(|mark| format!("{mark:032x}"));
        if mark.is_some() && self.line("hash without order") == mark.as_deref() {
            return Comparison::alike(Verdict::Reordered);
        }
        self.compare_numbers(value, tolerance)
    }

    fn compare_numbers(&self, value: &AnyValue, tolerance: &Tolerance) -> Comparison {
        let parts = Parts::of(value);
        let now = summary(value, parts.as_ref(), &[], tolerance);
        let mut reasons = self.changed_facts(&now, tolerance);
        let stride = self.stride();
        let comparison = match (&self.picture, picture_of(value), &self.parts, parts) {
            (Some(old), Some(new), _, _) => {
                let parts = |picture: &Image| {
                    Parts::of(&AnyValue::new(picture.clone())).unwrap_or_default()
                };
                let mut comparison =
                    compare_parts(&parts(old), &parts(&every(&new, stride)), tolerance);
                if stride > 1 {
                    let kept = format!(" (of every {stride}. pixel)");
                    comparison.reasons.iter_mut().for_each(|reason| *reason += &kept);
                }
                comparison
            }
            (_, _, Some(old), Some(mut new)) => match (self.mesh(), value.get::<Mesh>()) {
                (Some(old), Some(new)) => compare_meshes(
                    &old,
                    &new.clone().with_texture(None).with_creases([]),
                    tolerance,
                ),
                _ => {
                    let facts = new.facts.clone();
                    new.columns.retain(|part| {
                        !FACES.contains(&&part.name[..]) || old.column(&part.name).is_some()
                    });
                    compare_parts(&Parts { facts, ..old.clone() }, &new, tolerance)
                }
            },
            _ => Comparison::new(Vec::new(), Vec::new()),
        };
        let whole = stride == 1 && (self.parts.is_some() || self.picture.is_some());
        if !whole {
            reasons.extend(self.changed_numbers(&now));
        }
        // What an unordered comparison finds equal, and what was rounded away, is as it was.
        let mut reasons_of_all = reasons;
        for reason in comparison.reasons {
            if !reasons_of_all.contains(&reason) {
                reasons_of_all.push(reason);
            }
        }
        let verdict = if reasons_of_all.is_empty() { Verdict::Within } else { Verdict::Different };
        Comparison { verdict, reasons: reasons_of_all, measures: comparison.measures }
    }

    /// Counts and kinds that are not as they were.
    fn changed_facts(&self, now: &[Line], tolerance: &Tolerance) -> Vec<String> {
        const OWN: [&str; 4] = ["hash", "hash without order", "kept", "faces"];
        let by_itself = |label: &str| {
            OWN[..3].contains(&label) || label.starts_with("file ") || label.starts_with("needed ")
        };
        let is_number =
            |label: &str| now.iter().any(|line| line.label == label && line.slack.is_some());
        let about_faces = |label: &str| {
            [
                "vertices",
                "edges",
                "faces",
                "components",
                "Euler characteristic",
                "boundary edges",
                "non-manifold edges",
                "misoriented edges",
                "corners of a face",
            ]
            .contains(&label)
        };
        let lax = |label: &str| tolerance.remeshed && about_faces(label);
        let old = self.lines.iter().filter(|(label, text)| {
            // The numbers of a column that is gone are told with the column.
            !by_itself(label) && !is_number(label) && !lax(label) && !text.contains(" .. ")
        });
        let new = now
            .iter()
            .filter(|line| line.slack.is_none() && !by_itself(&line.label) && !lax(&line.label));
        let new: Vec<_> = new.map(|line| (line.label.clone(), line.text.clone())).collect();
        different_facts(&old.cloned().collect::<Vec<_>>(), &new)
    }

    /// Statistics that are not as they were.
    fn changed_numbers(&self, now: &[Line]) -> Vec<String> {
        let numbers = |text: &str| -> Vec<f64> {
            let words = text.split([' ', ',']).filter(|word| !word.is_empty());
            words.filter_map(|word| word.parse().ok()).collect()
        };
        let mut reasons = Vec::new();
        for Line { label, text, slack } in now {
            let (Some(slack), Some(before)) = (slack, self.line(label)) else { continue };
            let (old, new) = (numbers(before), numbers(text));
            // Six digits are kept of each number.
            let near = |(a, b): (&f64, &f64)| (a - b).abs() <= slack + 1e-5 * a.abs().max(b.abs());
            if old.len() != new.len() || !old.iter().zip(&new).all(near) {
                reasons.push(format!("{label}: {before} -> {text}"));
            }
        }
        reasons
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
