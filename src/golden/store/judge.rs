//! Compares a value with a golden. The value is equal, reordered, within the tolerance, or different. For a different value, the position
//! of the largest difference is found.
//!
//! Every stored entry is compared. The stored numbers are rounded, so each measured difference has an error, which is far below the
//! tolerance. Rounding never lets a value pass that would fail with exact numbers. A difference below the error does not count.

use maquette_value::{AnyValue, Image, Mesh};

use super::pack::{StoredColumn, StoredNumbers, mark};
use super::summary::{Line, SKETCH, summary};
use super::{
    FILE_LABEL, FORM, Golden, KEPT_FOR, REASON_LABEL, WrittenFile, picture_of, sample_picture,
};
use crate::compare::{
    Comparison, Measure, Rounding, Tolerance, Verdict, allowed_difference, compare_columns,
    compare_meshes, compare_parts, different_facts, explicit_limit, in_unit, measure, unit,
    unordered_hash,
};
use crate::parts::{CORNERS, Class, GoldenColumn, GoldenParts, SIDES};
use crate::sketch::Sketch;

/// The message about a changed value whose golden was written by an earlier version of the program, in its format.
const OF_EARLIER_FORM: &str = "the value has changed, and its golden has an earlier format, which cannot tell by how much: \
     bless it (--bless) with the old graph, or check the result and bless that";

impl Golden {
    /// Compares a value with the golden. `outputs` describes the files to which the value was written.
    pub(crate) fn compare(
        &self,
        value: &AnyValue,
        outputs: &[WrittenFile],
        tolerance: &Tolerance,
    ) -> Comparison {
        if self.line("hash") == Some(&value.hash().to_string()) {
            let reasons = self.changed_files(outputs);
            return if reasons.is_empty() {
                Comparison::from_verdict(Verdict::Identical)
            } else {
                Comparison::new(reasons, Vec::new())
            };
        }
        let mark = unordered_hash(value).map(|mark| format!("{mark:032x}"));
        if mark.is_some() && self.line("hash without order") == mark.as_deref() {
            return Comparison::from_verdict(Verdict::Reordered);
        }
        if self.has_earlier_form() {
            return Comparison::new(vec![OF_EARLIER_FORM.into()], Vec::new());
        }
        self.compare_numbers(value, tolerance)
    }

    fn changed_files(&self, outputs: &[WrittenFile]) -> Vec<String> {
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
        let parts = GoldenParts::from_value(value);
        let now = summary(value, parts.as_ref(), &[], tolerance);
        let mut reasons = self.changed_facts(&now, tolerance);
        let Some(parts) = parts else {
            if reasons.is_empty() {
                reasons.push(NOTHING_COMPARED.into());
            }
            return Comparison::new(reasons, Vec::new());
        };
        let same: Vec<_> = parts
            .columns
            .iter()
            .map(|part| self.sketch(part) == Some(Sketch::compute(&part.numbers)))
            .collect();
        let (found, mut measures) = self.measure(value, &parts, &same, tolerance);
        reasons.extend(found);
        if !reasons.is_empty() && !tolerance.remeshed {
            // The differences of faces already show that the mesh is different. So remove messages about surfaces that are within the
            // tolerance.
            for measure in measures.iter_mut().filter(|m| m.name.starts_with("surface,")) {
                if measure.max - measure.error <= measure.allowed {
                    measure.failure.clear();
                }
            }
        }
        if self.stride() > 1 {
            // Skip the ranges of columns without a tolerance of their own, which are compared by sums over all of their numbers (sketches).
            reasons.extend(self.changed_numbers(now.iter().filter(|line| {
                let column = line
                    .text
                    .contains(" .. ")
                    .then(|| parts.columns.iter().find(|part| line.label.starts_with(&part.name)));
                column.flatten().is_none_or(|part| is_lax(part, tolerance))
            })));
        }
        if same.iter().all(|same| *same) && reasons.is_empty() {
            reasons.push(NOTHING_COMPARED.into());
        }
        Comparison::new(reasons, measures)
    }

    /// Returns the differences between the value and the golden: reasons for the verdict `Different`, and the measures.
    fn measure(
        &self,
        value: &AnyValue,
        parts: &GoldenParts,
        same: &[bool],
        tolerance: &Tolerance,
    ) -> (Vec<String>, Vec<Measure>) {
        if let (Some(old), Some(new)) = (self.picture(), picture_of(value)) {
            return self.measure_picture(old, &new, parts, tolerance);
        }
        let Some(stored) = self.numbers() else {
            return (vec!["nothing was stored that it could be compared with".into()], Vec::new());
        };
        let other_faces = [SIDES, CORNERS]
            .iter()
            .any(|name| stored.numbers(name) != parts.column(name).map(|part| &part.numbers[..]));
        if let (true, Some(old), Some(new)) =
            (other_faces || tolerance.remeshed, self.mesh(), value.get::<Mesh>())
        {
            let bare = new.clone().with_creases([]).expect("an empty list of creases is valid");
            let new = bare.with_texture(None).with_frame(None);
            let surfaces = compare_meshes(&old, &new, tolerance, &|name| {
                stored.column(name).map_or(0.0, |column| column.precision.error)
            });
            let mut reasons = surfaces.reasons;
            reasons.retain(|reason| surfaces.measures.iter().all(|m| m.failure != *reason));
            return (reasons, surfaces.measures);
        }
        let mut reasons = Vec::new();
        let mut measures = Vec::new();
        for (part, same) in parts.columns.iter().zip(same) {
            match stored.column(&part.name) {
                None if part.is_faces && self.stride() > 1 => {
                    if !same {
                        reasons.push(format!(
                            "`{}` differs in entries that were not stored",
                            part.name
                        ));
                    }
                }
                None => reasons.push(format!("`{}` is new", part.name)),
                Some(old) if old.part.count != part.count || old.part.width != part.width => {
                    fn size(part: &GoldenColumn) -> String {
                        format!("{} x {}", part.count, part.width)
                    }
                    let (before, now) = (size(&old.part), size(part));
                    reasons.push(format!("`{}`: {before} entries became {now}", part.name));
                }
                Some(_) if *same => {
                    let limit = allowed_difference(part, tolerance);
                    measures.push(measure(&part.name, &[], part.class, limit));
                }
                Some(old) => measures.push(self.measure_column(old, part, stored, tolerance)),
            }
        }
        let gone = stored.columns.iter().filter(|column| parts.column(&column.part.name).is_none());
        reasons.extend(gone.map(|column| format!("`{}` is gone", column.part.name)));
        (reasons, measures)
    }

    fn measure_picture(
        &self,
        old: &Image,
        new: &Image,
        parts: &GoldenParts,
        tolerance: &Tolerance,
    ) -> (Vec<String>, Vec<Measure>) {
        let stride = self.stride();
        let (old, some) =
            (picture_parts(old, parts), picture_parts(&sample_picture(new, stride), parts));
        let mut measures = compare_parts(&old, &some, tolerance).measures;
        if stride > 1 {
            let n_new = new.pixels().len().max(1) as f64;
            for measure in &mut measures {
                measure.worst += &format!(" (of every {stride}. pixel)");
                measure.compared_fraction =
                    some.columns.first().map_or(1.0, |part| part.count as f64 / n_new);
            }
        }
        let nothing_seen = measures.iter().all(|measure| measure.max == 0.0);
        let lax =
            [tolerance.differing, tolerance.level, tolerance.relative].iter().any(|it| *it > 0.0);
        let reasons = (stride > 1 && nothing_seen && !lax)
            .then(|| "the picture differs in pixels that were not stored".to_owned());
        (reasons.into_iter().collect(), measures)
    }

    /// Measures the differences of a column that has changed.
    fn measure_column(
        &self,
        old: &StoredColumn,
        new: &GoldenColumn,
        stored: &StoredNumbers,
        tolerance: &Tolerance,
    ) -> Measure {
        let fine = old.with_last_digits(new);
        let has_moved = old.precision.last.is_some() && fine.is_none();
        let (numbers, step, error) = match (&fine, old.precision.last) {
            (Some(fine), Some(last)) => (fine, last.step, last.error),
            _ => (&old.part, old.precision.step, old.precision.error),
        };
        // Flags and colors are whole numbers, which are stored without rounding.
        let rounding = if error > 0.0 {
            Rounding { max_number_error: step / 2.0, error }
        } else {
            Rounding::NONE
        };
        let mut measure = compare_columns(numbers, new, stored.row, tolerance, rounding);
        let limit = measure.allowed;
        let reach = old.precision.last.map_or(0.0, |last| last.reach(new.width));
        let is_sure = measure.counted_max - measure.error > limit;
        let is_forgiven = tolerance.relative > 0.0 && measure.counted_max <= limit;
        if !measure.is_by_fraction
            && !is_sure
            && !is_forgiven
            && (limit == 0.0 && error > 0.0 || has_moved && limit < reach)
        {
            measure.failure = format!(
                "`{}` differs by more than {}, which is allowed, but nowhere by more than {}",
                new.name,
                in_unit(limit, measure.unit),
                in_unit(measure.max + measure.error, measure.unit)
            );
        }
        if old.part.stride > 1 && !is_lax(new, tolerance) && !is_sure {
            self.judge_by_sums(new, &mut measure);
        }
        measure
    }

    /// Compares a column by sums over all of its numbers (its sketch). This is used if only some of the numbers were stored and the test
    /// file sets no tolerance for the column.
    fn judge_by_sums(&self, part: &GoldenColumn, measure: &mut Measure) {
        let Some(sketch) = self.sketch(part) else { return };
        let distance = sketch.distance(&Sketch::compute(&part.numbers));
        let distance = if part.class == Class::Normal { distance.to_degrees() } else { distance };
        let name = &part.name;
        if distance <= measure.allowed && !measure.is_by_fraction {
            measure.failure.clear();
        } else if measure.failure.is_empty() {
            measure.failure = match part.class {
                Class::Exact | Class::Level => {
                    format!("`{name}` differs in entries that were not stored")
                }
                class => {
                    let distance = in_unit(distance, unit(class));
                    format!("`{name}` differs by up to {distance} in entries that were not stored")
                }
            };
        }
    }

    fn sketch(&self, part: &GoldenColumn) -> Option<Sketch> {
        self.line(&format!("{SKETCH}{}", part.name)).and_then(Sketch::read)
    }

    /// Describes the counts and kinds that have changed.
    fn changed_facts(&self, now: &[Line], tolerance: &Tolerance) -> Vec<String> {
        const SEPARATE_LABELS: [&str; 6] =
            ["hash", "hash without order", FORM, "kept", KEPT_FOR, REASON_LABEL];
        fn is_judged_separately(label: &str) -> bool {
            SEPARATE_LABELS.contains(&label)
                || ["file ", "needed ", FILE_LABEL, SKETCH]
                    .iter()
                    .any(|start| label.starts_with(start))
        }
        fn is_about_faces(label: &str) -> bool {
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
        }
        let old = self.lines.iter().filter(|(label, text)| {
            let is_number = now.iter().any(|line| line.label == *label && line.tolerance.is_some());
            // Ignore the lines about the range of a column. If the column is missing, that is reported elsewhere.
            let may_differ = tolerance.remeshed && is_about_faces(label);
            !is_judged_separately(label) && !is_number && !may_differ && !text.contains(" .. ")
        });
        let new = now.iter().filter(|line| {
            line.tolerance.is_none()
                && !is_judged_separately(&line.label)
                && !(tolerance.remeshed && is_about_faces(&line.label))
        });
        let new: Vec<_> = new.map(|line| (line.label.clone(), line.text.clone())).collect();
        different_facts(&old.cloned().collect::<Vec<_>>(), &new)
    }

    /// Describes the numbers in the summary that have changed.
    fn changed_numbers<'a>(&self, now: impl Iterator<Item = &'a Line>) -> Vec<String> {
        fn numbers(text: &str) -> Vec<f64> {
            let words = text.split([' ', ',']).filter(|word| !word.is_empty());
            words.filter_map(|word| word.parse().ok()).collect()
        }
        let mut reasons = Vec::new();
        for Line { label, text, tolerance: slack } in now {
            let (Some(slack), Some(before)) = (slack, self.line(label)) else { continue };
            let (old, new) = (numbers(before), numbers(text));
            // The summary rounds numbers to six digits, so the last digit may differ.
            if old.len() != new.len()
                || !old.iter().zip(&new).all(|(a, b): (&f64, &f64)| {
                    (a - b).abs() <= slack + 1e-5 * a.abs().max(b.abs())
                })
            {
                reasons.push(format!("{label}: {before} -> {text}"));
            }
        }
        reasons
    }
}

/// The reason for the verdict `Different` if the hash of the value has changed, but everything that is compared is equal.
const NOTHING_COMPARED: &str = "its hash has changed, but nothing that is compared";

/// Returns true if the tolerance sets a limit for a column that allows some difference.
fn is_lax(part: &GoldenColumn, tolerance: &Tolerance) -> bool {
    let by_share = matches!(part.class, Class::Level | Class::Exact);
    explicit_limit(part, tolerance).is_some_and(|limit| limit > 0.0)
        || (by_share && tolerance.differing > 0.0)
        || (matches!(part.class, Class::Level | Class::Number) && tolerance.relative > 0.0)
}

impl StoredColumn {
    /// Restores the old numbers of a column with their last digits. Of all numbers with the stored last digits, the old number is assumed
    /// to be the one nearest to the new number. Returns `None` if no last digits were stored, or if a number has moved so far that this is
    /// wrong.
    fn with_last_digits(&self, new: &GoldenColumn) -> Option<GoldenColumn> {
        let last = self.precision.last?;
        let many = 1i64 << last.bits;
        let width = self.part.width;
        let mut wholes = Vec::with_capacity(self.part.numbers.len());
        let mut numbers = Vec::with_capacity(self.part.numbers.len());
        for (place, &was) in self.part.numbers.iter().enumerate() {
            let element = place / width;
            if self.odd[element] {
                let bits = if was.is_nan() { f64::NAN } else { was }.to_bits();
                wholes.push(bits as i64);
                numbers.push(was);
                continue;
            }
            let now = new.element(element * self.part.stride)[place % width] / last.step;
            if now.is_nan() || now.abs() >= 9e15 {
                return None;
            }
            let digit = i64::from(self.digits[place]);
            let whole = ((now - digit as f64) / many as f64).round() as i64 * many + digit;
            wholes.push(whole);
            numbers.push(whole as f64 * last.step);
        }
        let part = GoldenColumn { numbers, ..self.part.clone() };
        (mark(wholes.into_iter()) == self.mark).then_some(part)
    }
}

/// Converts a picture that a golden stores to the parts of a value. `like` contains the parts of any value of the same type.
fn picture_parts(picture: &Image, like: &GoldenParts) -> GoldenParts {
    GoldenParts {
        facts: Vec::new(),
        columns: like
            .columns
            .iter()
            .map(|part| {
                let pixels = picture.pixels();
                let numbers = match part.class {
                    Class::Exact => {
                        pixels.iter().map(|pixel| f64::from(u8::from(pixel[0] > 127))).collect()
                    }
                    _ => pixels.as_flattened().iter().map(|&level| f64::from(level)).collect(),
                };
                GoldenColumn::new(&part.name, part.class, part.width, numbers)
            })
            .collect(),
        row: Some(picture.width()),
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::{
        CaptureFrame, Column, ControlNet, ElementKind, Encoder, Faces, KnotVector, Mask, Meaning,
        Parts, Summary, Surface, Value,
    };
    use nalgebra::{Matrix4, Point3};

    use super::*;
    use crate::compare::Keep;
    use crate::store::{files, read};

    /// Stores a value as a golden, and returns the golden.
    fn golden_of(value: &AnyValue) -> Golden {
        golden_with(value, &Tolerance::default())
    }

    fn golden_with(value: &AnyValue, tolerance: &Tolerance) -> Golden {
        let folder = tempfile::tempdir().unwrap();
        for file in files(value, &[], &[], tolerance) {
            std::fs::write(folder.path().join(format!("x{}", file.name)), file.bytes).unwrap();
        }
        read(folder.path(), "x").unwrap()
    }

    fn compare(old: &AnyValue, new: &AnyValue) -> Comparison {
        golden_of(old).compare(new, &[], &Tolerance::default())
    }

    /// Creates a mesh of a rough sheet that has so many vertices that a golden with `keep: Sampled(..)` stores only some of them.
    fn rough() -> Mesh {
        let quads = (0..119).flat_map(|row| (0..119).map(move |column| row * 120 + column));
        let faces = quads.flat_map(|a| [[a, a + 1, a + 120], [a + 1, a + 121, a + 120]]);
        Mesh::new(
            (0..14_400)
                .map(|k: u32| {
                    // Pseudorandom numbers: the finalizer of MurmurHash3 (Appleby, 2011).
                    let mixed = (k ^ k >> 16).wrapping_mul(0x85eb_ca6b);
                    let mixed = (mixed ^ mixed >> 13).wrapping_mul(0xc2b2_ae35);
                    let rough = f64::from((mixed ^ mixed >> 16) >> 20) / 4096.0;
                    Point3::new(f64::from(k % 120) + rough, f64::from(k / 120), 3.0 * rough)
                })
                .collect::<Vec<_>>(),
            Faces::triangles(faces.collect()),
        )
        .unwrap()
    }

    fn move_vertex(mesh: &Mesh, vertex: usize, by: f64) -> AnyValue {
        let mut positions = mesh.positions().to_vec();
        positions[vertex].z += by;
        AnyValue::new(mesh.with_positions(positions).unwrap())
    }

    /// Returns a tolerance for which a golden stores only every ninth entry.
    fn sampled_tolerance() -> Tolerance {
        Tolerance { keep: Keep::Sampled { every: 9 }, ..Tolerance::default() }
    }

    #[test]
    fn a_change_of_a_vertex_that_is_not_stored_is_detected() {
        let mesh = rough();
        let old = AnyValue::new(mesh.clone());
        let golden = golden_with(&old, &sampled_tolerance());
        let comparison = golden.compare(&move_vertex(&mesh, 7, 1e-3), &[], &sampled_tolerance());
        assert_eq!(comparison.verdict, Verdict::Different);
        assert!(
            comparison.reasons[0].contains("in entries that were not stored"),
            "{comparison:?}"
        );
        assert!((comparison.compared_fraction() - 1.0 / 9.0).abs() < 1e-3, "{comparison:?}");
        // A difference in the last digits of a number is allowed.
        let last = golden.compare(&move_vertex(&mesh, 7, 1e-12), &[], &sampled_tolerance());
        assert_eq!(last.verdict, Verdict::Within, "{last:?}");
    }

    #[test]
    fn stored_entries_tell_the_position() {
        let mesh = rough();
        let golden = golden_with(&AnyValue::new(mesh.clone()), &sampled_tolerance());
        let comparison = golden.compare(&move_vertex(&mesh, 900, 0.5), &[], &sampled_tolerance());
        assert!(comparison.reasons[0].contains("worst at entry 900:"), "{comparison:?}");
    }

    #[test]
    fn numbers_stored_for_a_wide_limit_cannot_check_a_narrow_one() {
        let mesh = rough();
        let wide = Tolerance { rms: Some(1e-4), ..Tolerance::default() };
        let narrow = Tolerance { rms: Some(1e-7), ..Tolerance::default() };
        let golden = golden_with(&AnyValue::new(mesh.clone()), &wide);
        assert!(
            golden.outdated_reason(&narrow).is_some() && golden.outdated_reason(&wide).is_none()
        );
        for (by, expected) in
            [(1e-7, "too coarse to check"), (1.0, "differs by 0.00833333 mm (rms)")]
        {
            let reasons = golden.compare(&move_vertex(&mesh, 7, by), &[], &narrow).reasons;
            assert!(reasons.join("; ").contains(expected), "{reasons:?}");
        }
    }

    #[test]
    fn an_earlier_golden_format_is_reported_with_a_way_out() {
        let mesh = rough();
        let value = AnyValue::new(mesh.clone());
        let mut without_form = golden_of(&value);
        without_form.lines.retain(|(label, _)| label != FORM);
        let other_bytes = Golden { bin: Some(b"golden2\n".into()), ..golden_of(&value) };
        for golden in [without_form, other_bytes] {
            let verdict = golden.compare(&value, &[], &Tolerance::default()).verdict;
            assert_eq!(verdict, Verdict::Identical);
            assert!(golden.outdated_reason(&Tolerance::default()).is_some());
            let moved = move_vertex(&mesh, 7, 1e-12);
            let reason = &golden.compare(&moved, &[], &Tolerance::default()).reasons[0];
            assert!(reason.contains("earlier format") && reason.contains("--bless"), "{reason}");
        }
    }

    #[test]
    fn surfaces_with_other_faces_are_measured_in_both_directions() {
        let mesh = rough();
        fn lax(max: f64) -> Tolerance {
            Tolerance { remeshed: true, max: Some(max), ..Tolerance::default() }
        }
        let golden = golden_with(&AnyValue::new(mesh.clone()), &lax(0.5));
        // Adds a vertex in the middle of a face, moved by `by` along the normal of the face.
        fn split_face(by: f64, mesh: &Mesh) -> AnyValue {
            let mut positions = mesh.positions().to_vec();
            let mut faces = mesh.faces().as_triangles().unwrap().to_vec();
            let [a, b, c] = faces[7000];
            let corners = [a, b, c].map(|vertex| positions[vertex as usize]);
            let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).normalize();
            let middle = (corners[0].coords + corners[1].coords + corners[2].coords) / 3.0;
            let new = positions.len() as u32;
            positions.push(Point3::from(middle + normal * by));
            faces[7000] = [a, b, new];
            faces.extend([[b, c, new], [c, a, new]]);
            AnyValue::new(Mesh::new(positions, Faces::triangles(faces)).unwrap())
        }
        let far = golden.compare(&split_face(40.0, &mesh), &[], &lax(0.5));
        assert!(far.reasons[0].contains("surface, new to old"), "{far:?}");
        assert_eq!(
            golden.compare(&split_face(0.3, &mesh), &[], &lax(0.5)).verdict,
            Verdict::Within
        );
    }

    #[test]
    fn another_diagonal_is_a_different_mesh() {
        let mesh = rough();
        let mut faces = mesh.faces().as_triangles().unwrap().to_vec();
        let ([a, b, d], [_, c, _]) = (faces[500], faces[501]);
        (faces[500], faces[501]) = ([a, b, c], [a, c, d]);
        let other = Mesh::new(mesh.positions().to_vec(), Faces::triangles(faces)).unwrap();
        let comparison = compare(&AnyValue::new(mesh), &AnyValue::new(other));
        fn has_reason(what: &str, reasons: &[String]) -> bool {
            reasons.iter().any(|why| why.starts_with(what))
        }
        assert!(has_reason("2 faces have other vertices", &comparison.reasons), "{comparison:?}");
        assert!(
            has_reason("`surface, old to new` differs by 0.2", &comparison.reasons),
            "{comparison:?}"
        );
    }

    #[test]
    fn one_changed_pixel_is_detected() {
        fn mask(pixel: i32) -> AnyValue {
            let pixels = (0..10_000).map(|k| u8::from(k == pixel)).collect();
            AnyValue::new(Mask::new(100, 100, pixels).unwrap())
        }
        let comparison = compare(&mask(17), &mask(18));
        assert_eq!(comparison.verdict, Verdict::Different);
        assert_eq!(comparison.reasons.len(), 1, "{comparison:?}");
        assert!(comparison.reasons[0].contains("worst at column 18, row 0"), "{comparison:?}");
    }

    #[test]
    fn changes_outside_of_columns_are_detected() {
        fn frame(z: f64) -> CaptureFrame {
            CaptureFrame {
                camera: None,
                picture: [4, 3],
                depth: 5.0,
                world_from_camera: Some(Matrix4::identity() * z),
            }
        }
        fn mesh(z: f64) -> AnyValue {
            AnyValue::new(rough().with_frame(Some(frame(z))))
        }
        let comparison = compare(&mesh(1.0), &mesh(2.0));
        assert_eq!(comparison.verdict, Verdict::Different, "{comparison:?}");
    }

    #[test]
    fn a_stored_surface_can_be_restored_as_a_mesh() {
        let net = ControlNet::new(
            3,
            4,
            (0..12)
                .map(|k: usize| Point3::new((k % 4) as f64, (k / 4) as f64, (k * k % 5) as f64))
                .collect::<Vec<_>>(),
        )
        .unwrap();
        fn knots(n: usize) -> KnotVector {
            KnotVector::uniform(n, 3).unwrap()
        }
        let surface = Surface::new(net, knots(3), knots(4)).unwrap();
        let mesh = surface.tessellate(0, 0).unwrap();
        assert_eq!(golden_of(&AnyValue::new(surface)).mesh().unwrap(), mesh);
    }

    /// A value type whose columns have the same names as columns of a mesh.
    #[derive(Clone)]
    struct Bends(Column<f64>);

    impl Value for Bends {
        const NAME: &'static str = "Bends";

        fn encode(&self, to: &mut Encoder) {
            to.column(&self.0);
        }

        fn size(&self) -> usize {
            self.0.size()
        }

        fn describe(&self) -> Summary {
            Summary::default()
        }

        fn parts(&self) -> Parts<'_> {
            let mut parts = Parts::default();
            parts.push("sides", ElementKind::Entry, Meaning::Number, 1, &self.0[..]);
            parts.push("corners", ElementKind::Entry, Meaning::Number, 1, &self.0[..]);
            parts
        }
    }

    #[test]
    fn columns_with_the_names_of_faces_may_be_numbers() {
        fn bends(first: f64) -> AnyValue {
            AnyValue::new(Bends(vec![first, -7.25, 1e9].into()))
        }
        for tolerance in [Tolerance::default(), sampled_tolerance()] {
            let golden = golden_with(&bends(0.5), &tolerance);
            let column = &golden.numbers().unwrap().column("corners").unwrap().part;
            assert_eq!((column.is_faces, column.count), (false, 3));
            assert!((column.numbers[1] + 7.25).abs() < 1e-3, "{column:?}");
            fn verdict(value: AnyValue, golden: &Golden, tolerance: &Tolerance) -> Verdict {
                golden.compare(&value, &[], tolerance).verdict
            }
            assert_eq!(verdict(bends(0.5), &golden, &tolerance), Verdict::Identical);
            assert_eq!(verdict(bends(1e8), &golden, &tolerance), Verdict::Different);
        }
    }
}
