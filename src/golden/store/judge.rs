//! A value beside what was kept of one: the same, the same but reordered, near enough, or different and where.
//!
//! What was kept is rounded, and of large values only some: it shows where a value differs and by how much. Whether it
//! differs at all is decided by the sketch of each column, unless the test file allows some difference.

use super::pack::FACES;
use super::summary::{Line, SKETCH, summary};
use super::{BECAUSE, Golden, Written, every, picture_of};
use crate::golden::compare::{
    Comparison, Measure, Tolerance, Verdict, allowed, compare_meshes, compare_parts,
    different_facts, given, in_unit, judge, measure, unit, without_order,
};
use crate::golden::parts::{Class, Part, Parts};
use crate::golden::sketch::Sketch;
use crate::value::{AnyValue, Image, Mask, Mesh};

/// How far what was kept may be from what was there, as a share of the diagonal: ten times what rounding does.
const KEPT_SHARE: f64 = 2e-5;

/// The same for normals, in degrees.
const KEPT_ANGLE: f64 = 0.5;

impl Golden {
    /// How a value, written to these files, differs from what was kept.
    pub(crate) fn compare(
        &self,
        value: &AnyValue,
        outputs: &[Written],
        tolerance: &Tolerance,
    ) -> Comparison {
        if self.line("hash") == Some(&value.hash().to_string()) {
            let reasons = self.changed_files(outputs);
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

    fn changed_files(&self, outputs: &[Written]) -> Vec<String> {
        let mut reasons = Vec::new();
        for file in outputs {
            let text = &file.content;
            match self.line(&format!("file {}", file.name)) {
                Some(before) if before == *text => {}
                Some(before) => reasons.push(format!(
                    "the value is the same, but not its file {}: {before} -> {text}",
                    file.name
                )),
                None => reasons.push(format!("file {} is new", file.name)),
            }
        }
        let files = self.lines.iter().filter_map(|(label, _)| label.strip_prefix("file "));
        let gone = files.filter(|name| !outputs.iter().any(|file| file.name == *name));
        reasons.extend(gone.map(|name| format!("file {name} is gone")));
        reasons
    }

    fn compare_numbers(&self, value: &AnyValue, tolerance: &Tolerance) -> Comparison {
        let parts = Parts::of(value);
        let now = summary(value, parts.as_ref(), &[], tolerance);
        let mut reasons = self.changed_facts(&now, tolerance);
        let Comparison { reasons: told, mut measures, .. } =
            self.compare_kept(value, parts.as_ref(), tolerance);
        // Measures are judged again below.
        let of_measure = |reason: &String| measures.iter().any(|m| m.broken == *reason);
        reasons.extend(told.iter().filter(|reason| !of_measure(reason)).cloned());
        let by_surface = measures.iter().any(|m| m.name.starts_with("surface,"));
        let decided = match parts.as_ref().filter(|_| !by_surface) {
            Some(parts) => self.judge_by_sketches(parts, tolerance, &mut measures),
            None => Vec::new(),
        };
        reasons.extend(measures.iter().filter(|m| !m.broken.is_empty()).map(|m| m.broken.clone()));
        let whole = self.stride() == 1 && (self.parts.is_some() || self.picture.is_some());
        if !whole {
            // The range of a column says nothing more where its sketch has spoken.
            let of_decided = |line: &&Line| {
                line.text.contains(" .. ")
                    && decided.iter().any(|name| line.label.starts_with(name))
            };
            reasons.extend(self.changed_numbers(now.iter().filter(|line| !of_decided(line))));
        }
        let same = |part: &Part| self.sketch(part) == Some(Sketch::of(&part.numbers));
        let nothing = parts.is_none_or(|parts| parts.columns.iter().all(same));
        if reasons.is_empty() && nothing {
            reasons.push("its hash is another one, but nothing that is compared".into());
        }
        let mut distinct = Vec::new();
        for reason in reasons {
            if !distinct.contains(&reason) {
                distinct.push(reason);
            }
        }
        let verdict = if distinct.is_empty() { Verdict::Within } else { Verdict::Different };
        Comparison { verdict, reasons: distinct, measures }
    }

    /// Compares with what was kept, which is rounded: some difference is always allowed.
    fn compare_kept(
        &self,
        value: &AnyValue,
        parts: Option<&Parts>,
        tolerance: &Tolerance,
    ) -> Comparison {
        let tolerance = &Tolerance {
            share: Some(KEPT_SHARE),
            normals: tolerance.normals.or(Some(KEPT_ANGLE)),
            ..tolerance.clone()
        };
        if let (Some(old), Some(new)) = (&self.picture, picture_of(value)) {
            let stride = self.stride();
            let is_mask = value.get::<Mask>().is_some();
            let parts = |picture: Image| {
                let value = if is_mask { mask_of(&picture) } else { AnyValue::new(picture) };
                Parts::of(&value).unwrap_or_default()
            };
            let (old, new) = (parts(old.clone()), parts(every(&new, stride)));
            let mut comparison = compare_parts(&old, &new, tolerance);
            if stride > 1 {
                let kept = format!(" (of every {stride}. pixel)");
                comparison.measures.iter_mut().for_each(|measure| measure.worst += &kept);
            }
            return comparison;
        }
        let (Some(old), Some(new)) = (&self.parts, parts) else {
            return Comparison::new(Vec::new(), Vec::new());
        };
        let same_faces = FACES.iter().all(|name| old.column(name) == new.column(name));
        if let (false, Some(old), Some(new)) = (same_faces, self.mesh(), value.get::<Mesh>()) {
            let new = new.clone().with_texture(None).with_creases([]).with_frame(None);
            return compare_meshes(&old, &new, tolerance);
        }
        let is_kept =
            |part: &&Part| !FACES.contains(&&part.name[..]) || old.column(&part.name).is_some();
        let new =
            Parts { columns: new.columns.iter().filter(is_kept).cloned().collect(), ..new.clone() };
        compare_parts(&Parts { facts: new.facts.clone(), ..old.clone() }, &new, tolerance)
    }

    /// Decides on the columns of which nothing may differ but the last digits; gives their names.
    fn judge_by_sketches(
        &self,
        parts: &Parts,
        tolerance: &Tolerance,
        measures: &mut Vec<Measure>,
    ) -> Vec<String> {
        let mut decided = Vec::new();
        for part in &parts.columns {
            let by_share = matches!(part.class, Class::Level | Class::Exact);
            let lax = given(part, tolerance).is_some_and(|most| most > 0.0)
                || (by_share && tolerance.differing > 0.0);
            let kept = self.parts.as_ref().and_then(|parts| parts.column(&part.name));
            let other_count = kept.is_some_and(|kept| kept.count != part.count);
            let sketch = self.sketch(part).filter(|_| !lax && !other_count);
            let Some(sketch) = sketch else { continue };
            let apart = sketch.apart(&Sketch::of(&part.numbers));
            let apart = if part.class == Class::Normal { apart.to_degrees() } else { apart };
            let index = measures.iter().position(|measure| measure.name == part.name);
            let index = index.unwrap_or_else(|| {
                measures.push(measure(&part.name, &[], unit(part.class), 0.0));
                measures.len() - 1
            });
            let measure = &mut measures[index];
            let seen = !measure.broken.is_empty();
            measure.broken.clear();
            measure.allowed = allowed(part, tolerance);
            if apart > measure.allowed && seen {
                judge(measure, part.class, tolerance);
            } else {
                // What was kept differs by its rounding alone.
                measure.max = apart;
                measure.rms = apart / (part.count.max(1) as f64).sqrt();
                measure.p99 = measure.p99.min(apart);
                measure.worst.clear();
            }
            if apart > measure.allowed && measure.broken.is_empty() {
                let name = &part.name;
                measure.broken = match part.class {
                    Class::Exact | Class::Level => {
                        format!("`{name}` differs where nothing was kept")
                    }
                    _ => format!(
                        "`{name}` differs by up to {}, where nothing was kept or by less than was",
                        in_unit(apart, measure.unit)
                    ),
                };
            }
            decided.push(part.name.clone());
        }
        decided
    }

    fn sketch(&self, part: &Part) -> Option<Sketch> {
        self.line(&format!("{SKETCH}{}", part.name)).and_then(Sketch::read)
    }

    /// Counts and kinds that are not as they were.
    fn changed_facts(&self, now: &[Line], tolerance: &Tolerance) -> Vec<String> {
        const OWN: [&str; 4] = ["hash", "hash without order", "kept", BECAUSE];
        let by_itself = |label: &str| {
            OWN.contains(&label)
                || ["file ", "needed ", SKETCH].iter().any(|start| label.starts_with(start))
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
    fn changed_numbers<'a>(&self, now: impl Iterator<Item = &'a Line>) -> Vec<String> {
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

/// A mask that was kept as a picture.
fn mask_of(picture: &Image) -> AnyValue {
    let inside = picture.pixels().iter().map(|pixel| u8::from(pixel[0] > 127)).collect();
    let mask = Mask::new(picture.width(), picture.height(), inside);
    AnyValue::new(mask.expect("a mark for each pixel"))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix4, Point3};

    use super::*;
    use crate::golden::store::{files, read};
    use crate::value::{CaptureFrame, ControlNet, Faces, KnotVector, Surface};

    /// What is kept of a value.
    fn kept(value: &AnyValue) -> Golden {
        let folder = tempfile::tempdir().unwrap();
        for file in files(value, &[], &[], &Tolerance::default()) {
            std::fs::write(folder.path().join(format!("x{}", file.name)), file.bytes).unwrap();
        }
        read(folder.path(), "x").unwrap()
    }

    fn compare(old: &AnyValue, new: &AnyValue) -> Comparison {
        kept(old).compare(new, &[], &Tolerance::default())
    }

    /// A sheet so rough that only some of it is kept.
    fn rough() -> Mesh {
        let at = |k: u32| {
            // Pseudo-random: the output function of MurmurHash3 (Appleby, 2011).
            let mixed = (k ^ k >> 16).wrapping_mul(0x85eb_ca6b);
            let mixed = (mixed ^ mixed >> 13).wrapping_mul(0xc2b2_ae35);
            let rough = f64::from((mixed ^ mixed >> 16) >> 20) / 4096.0;
            Point3::new(f64::from(k % 120) + rough, f64::from(k / 120), 3.0 * rough)
        };
        let quads = (0..119).flat_map(|row| (0..119).map(move |column| row * 120 + column));
        let faces = quads.flat_map(|a| [[a, a + 1, a + 120], [a + 1, a + 121, a + 120]]);
        Mesh::new((0..14_400).map(at).collect::<Vec<_>>(), Faces::triangles(faces.collect()))
            .unwrap()
    }

    fn moved(mesh: &Mesh, vertex: usize, by: f64) -> AnyValue {
        let mut positions = mesh.positions().to_vec();
        positions[vertex].z += by;
        AnyValue::new(mesh.with_positions(positions).unwrap())
    }

    #[test]
    fn a_micrometer_at_one_vertex_is_seen_even_if_it_was_not_kept() {
        let mesh = rough();
        let old = AnyValue::new(mesh.clone());
        assert!(kept(&old).stride() > 1);
        let comparison = compare(&old, &moved(&mesh, 7, 1e-3));
        assert_eq!(comparison.verdict, Verdict::Different);
        assert!(comparison.reasons[0].contains("where nothing was kept"), "{comparison:?}");
        // The last digit is forgiven.
        assert_eq!(compare(&old, &moved(&mesh, 7, 1e-12)).verdict, Verdict::Within);
    }

    #[test]
    fn the_kept_ones_tell_where() {
        let mesh = rough();
        let stride = kept(&AnyValue::new(mesh.clone())).stride();
        let comparison = compare(&AnyValue::new(mesh.clone()), &moved(&mesh, 100 * stride, 0.5));
        let worst = format!("worst at entry {}:", 100 * stride);
        assert!(comparison.reasons.iter().any(|why| why.contains(&worst)), "{comparison:?}");
    }

    #[test]
    fn another_diagonal_is_another_mesh() {
        let mesh = rough();
        let mut faces = mesh.faces().as_triangles().unwrap().to_vec();
        let ([a, b, d], [_, c, _]) = (faces[500], faces[501]);
        (faces[500], faces[501]) = ([a, b, c], [a, c, d]);
        let other = Mesh::new(mesh.positions().to_vec(), Faces::triangles(faces)).unwrap();
        let comparison = compare(&AnyValue::new(mesh), &AnyValue::new(other));
        assert!(comparison.reasons.iter().any(|why| why.contains("`corners`")), "{comparison:?}");
    }

    #[test]
    fn one_pixel_is_seen() {
        let mask = |pixel| {
            let pixels = (0..10_000).map(|k| u8::from(k == pixel)).collect();
            AnyValue::new(Mask::new(100, 100, pixels).unwrap())
        };
        let comparison = compare(&mask(17), &mask(18));
        assert_eq!(comparison.verdict, Verdict::Different);
        assert_eq!(comparison.reasons.len(), 1, "{comparison:?}");
        assert!(comparison.reasons[0].contains("worst at column 18, row 0"), "{comparison:?}");
    }

    #[test]
    fn what_no_column_holds_is_not_overlooked() {
        let frame = |z: f64| CaptureFrame {
            camera: None,
            picture: [4, 3],
            depth: 5.0,
            world_from_camera: Some(Matrix4::identity() * z),
        };
        let mesh = |z| AnyValue::new(rough().with_frame(Some(frame(z))));
        let comparison = compare(&mesh(1.0), &mesh(2.0));
        assert_eq!(comparison.verdict, Verdict::Different, "{comparison:?}");
    }

    #[test]
    fn a_kept_surface_is_a_mesh_again() {
        let at = |k: usize| Point3::new((k % 4) as f64, (k / 4) as f64, (k * k % 5) as f64);
        let net = ControlNet::new(3, 4, (0..12).map(at).collect::<Vec<_>>()).unwrap();
        let knots = |n| KnotVector::uniform(n, 3).unwrap();
        let surface = Surface::new(net, knots(3), knots(4)).unwrap();
        let mesh = surface.tessellate(0, 0).unwrap();
        assert_eq!(kept(&AnyValue::new(surface)).mesh().unwrap(), mesh);
    }
}
