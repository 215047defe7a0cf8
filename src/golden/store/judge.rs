//! A value beside what was kept of one: the same, the same but reordered, near enough, or different and where.
//!
//! Every entry is compared. Numbers were kept rounded, so each difference is known up to an error that is far below the tolerance: rounding
//! makes no value pass that would fail otherwise, and a difference within the error does not count.

use maquette_value::{AnyValue, Image, Mesh};

use super::pack::{Column, Kept, mark};
use super::summary::{Line, SKETCH, summary};
use super::{BECAUSE, FORM, Golden, KEPT_FOR, KEPT_IN, Written, every, picture_of};
use crate::compare::{
    Comparison, Measure, Rounding, Tolerance, Verdict, allowed, compare_columns, compare_meshes,
    compare_parts, different_facts, given, in_unit, measure, unit, without_order,
};
use crate::parts::{CORNERS, Class, GoldenColumn, GoldenParts, SIDES};
use crate::sketch::Sketch;

/// What is said of a golden that an earlier program wrote.
const OF_EARLIER_FORM: &str = "the value is another one, and its golden is of an earlier form, which cannot judge by how much: \
     accept it anew (--bless) with the graph as it was, or look at the result and bless that";

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
        if self.is_earlier() {
            return Comparison::new(vec![OF_EARLIER_FORM.into()], Vec::new());
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
        let parts = GoldenParts::of(value);
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
            .map(|part| self.sketch(part) == Some(Sketch::of(&part.numbers)))
            .collect();
        let (told, mut measures) = self.measure(value, &parts, &same, tolerance);
        reasons.extend(told);
        if !reasons.is_empty() && !tolerance.remeshed {
            // It is known to be another mesh by its faces; that its surface is within the tolerance is not worth a line.
            let is_near =
                |m: &&mut Measure| m.name.starts_with("surface,") && m.max - m.error <= m.allowed;
            measures.iter_mut().filter(is_near).for_each(|m| m.broken.clear());
        }
        if self.stride() > 1 {
            // Where sums over all numbers of a column were judged, its range tells nothing more.
            fn lax(name: &str, parts: &GoldenParts, tolerance: &Tolerance) -> bool {
                parts.column(name).is_some_and(|part| is_lax(part, tolerance))
            }
            reasons.extend(self.changed_numbers(now.iter().filter(|line| {
                let column = line
                    .text
                    .contains(" .. ")
                    .then(|| parts.columns.iter().find(|part| line.label.starts_with(&part.name)));
                column.flatten().is_none_or(|part| lax(&part.name, &parts, tolerance))
            })));
        }
        if same.iter().all(|same| *same) && reasons.is_empty() {
            reasons.push(NOTHING_COMPARED.into());
        }
        Comparison::new(reasons, measures)
    }

    /// How far the value is from what was kept, and what else is to be said.
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
        let Some(kept) = self.kept() else {
            return (vec!["nothing was kept by which it could be judged".into()], Vec::new());
        };
        let other_faces = [SIDES, CORNERS]
            .iter()
            .any(|name| kept.numbers(name) != parts.column(name).map(|part| &part.numbers[..]));
        if let (true, Some(old), Some(new)) =
            (other_faces || tolerance.remeshed, self.mesh(), value.get::<Mesh>())
        {
            let bare = new.clone().with_creases([]).expect("no crease is none too many");
            let new = bare.with_texture(None).with_frame(None);
            let off = |name: &str| kept.column(name).map_or(0.0, |column| column.precision.error);
            let surfaces = compare_meshes(&old, &new, tolerance, &off);
            let of_measure =
                |reason: &&String| surfaces.measures.iter().any(|m| m.broken == **reason);
            let told = surfaces.reasons.iter().filter(|reason| !of_measure(reason));
            return (told.cloned().collect(), surfaces.measures);
        }
        let mut told = Vec::new();
        let mut measures = Vec::new();
        for (part, same) in parts.columns.iter().zip(same) {
            match kept.column(&part.name) {
                None if part.faces && self.stride() > 1 => {
                    if !same {
                        told.push(format!("`{}` differs where nothing was kept", part.name));
                    }
                }
                None => told.push(format!("`{}` is new", part.name)),
                Some(old) if old.part.count != part.count || old.part.width != part.width => {
                    fn size(part: &GoldenColumn) -> String {
                        format!("{} x {}", part.count, part.width)
                    }
                    let (before, now) = (size(&old.part), size(part));
                    told.push(format!("`{}`: {before} entries became {now}", part.name));
                }
                Some(_) if *same => {
                    let most = allowed(part, tolerance);
                    measures.push(measure(&part.name, &[], part.class, most));
                }
                Some(old) => measures.push(self.measure_column(old, part, kept, tolerance)),
            }
        }
        let gone = kept.columns.iter().filter(|column| parts.column(&column.part.name).is_none());
        told.extend(gone.map(|column| format!("`{}` is gone", column.part.name)));
        (told, measures)
    }

    fn measure_picture(
        &self,
        old: &Image,
        new: &Image,
        parts: &GoldenParts,
        tolerance: &Tolerance,
    ) -> (Vec<String>, Vec<Measure>) {
        let stride = self.stride();
        let (old, some) = (as_kept(old, parts), as_kept(&every(new, stride), parts));
        let mut measures = compare_parts(&old, &some, tolerance).measures;
        if stride > 1 {
            let n_new = new.pixels().len().max(1) as f64;
            for measure in &mut measures {
                measure.worst += &format!(" (of every {stride}. pixel)");
                measure.seen = some.columns.first().map_or(1.0, |part| part.count as f64 / n_new);
            }
        }
        let nothing_seen = measures.iter().all(|measure| measure.max == 0.0);
        let lax =
            [tolerance.differing, tolerance.level, tolerance.relative].iter().any(|it| *it > 0.0);
        let told = (stride > 1 && nothing_seen && !lax)
            .then(|| "the picture differs where nothing was kept".to_owned());
        (told.into_iter().collect(), measures)
    }

    /// How far a column, some number of which is another one, is from what it was.
    fn measure_column(
        &self,
        old: &Column,
        new: &GoldenColumn,
        kept: &Kept,
        tolerance: &Tolerance,
    ) -> Measure {
        let fine = old.with_last_digits(new);
        let has_moved = old.precision.last.is_some() && fine.is_none();
        let (numbers, step, error) = match (&fine, old.precision.last) {
            (Some(fine), Some(last)) => (fine, last.step, last.error),
            _ => (&old.part, old.precision.step, old.precision.error),
        };
        // Numbers that are equal or not, and colors, are whole: they are what they were.
        let rounding =
            if error > 0.0 { Rounding { half: step / 2.0, error } } else { Rounding::NONE };
        let mut measure = compare_columns(numbers, new, kept.row, tolerance, rounding);
        let most = measure.allowed;
        let reach = old.precision.last.map_or(0.0, |last| last.reach(new.width));
        let is_sure = measure.counted - measure.error > most;
        let is_forgiven = tolerance.relative > 0.0 && measure.counted <= most;
        if !measure.by_share
            && !is_sure
            && !is_forgiven
            && (most == 0.0 && error > 0.0 || has_moved && most < reach)
        {
            fn written(x: f64, measure_unit: &str) -> String {
                in_unit(x, measure_unit)
            }
            measure.broken = format!(
                "`{}` differs by more than {}, which is allowed, but nowhere by more than {}",
                new.name,
                written(most, measure.unit),
                written(measure.max + measure.error, measure.unit)
            );
        }
        if old.part.stride > 1 && !is_lax(new, tolerance) && !is_sure {
            self.judge_by_sums(new, &mut measure);
        }
        measure
    }

    /// Decides on a column of which only some numbers were kept, and which may differ in the last digits alone.
    fn judge_by_sums(&self, part: &GoldenColumn, measure: &mut Measure) {
        let Some(sketch) = self.sketch(part) else { return };
        let apart = sketch.apart(&Sketch::of(&part.numbers));
        let apart = if part.class == Class::Normal { apart.to_degrees() } else { apart };
        let name = &part.name;
        if apart <= measure.allowed && !measure.by_share {
            measure.broken.clear();
        } else if measure.broken.is_empty() {
            measure.broken = match part.class {
                Class::Exact | Class::Level => format!("`{name}` differs where nothing was kept"),
                class => {
                    let apart = in_unit(apart, unit(class));
                    format!("`{name}` differs by up to {apart}, where nothing was kept")
                }
            };
        }
    }

    fn sketch(&self, part: &GoldenColumn) -> Option<Sketch> {
        self.line(&format!("{SKETCH}{}", part.name)).and_then(Sketch::read)
    }

    /// Counts and kinds that are not as they were.
    fn changed_facts(&self, now: &[Line], tolerance: &Tolerance) -> Vec<String> {
        const OWN: [&str; 6] = ["hash", "hash without order", FORM, "kept", KEPT_FOR, BECAUSE];
        fn by_itself(label: &str) -> bool {
            OWN.contains(&label)
                || ["file ", "needed ", KEPT_IN, SKETCH]
                    .iter()
                    .any(|start| label.starts_with(start))
        }
        let is_number =
            |label: &str| now.iter().any(|line| line.label == label && line.slack.is_some());
        fn about_faces(label: &str) -> bool {
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
        fn lax(label: &str, tolerance_remeshed: bool) -> bool {
            tolerance_remeshed && about_faces(label)
        }
        let old = self.lines.iter().filter(|(label, text)| {
            // A column that is gone is reported as a whole, without its numbers.
            !by_itself(label)
                && !is_number(label)
                && !lax(label, tolerance.remeshed)
                && !text.contains(" .. ")
        });
        let new = now.iter().filter(|line| {
            line.slack.is_none() && !by_itself(&line.label) && !lax(&line.label, tolerance.remeshed)
        });
        let new: Vec<_> = new.map(|line| (line.label.clone(), line.text.clone())).collect();
        different_facts(&old.cloned().collect::<Vec<_>>(), &new)
    }

    /// Statistics that are not as they were.
    fn changed_numbers<'a>(&self, now: impl Iterator<Item = &'a Line>) -> Vec<String> {
        fn numbers(text: &str) -> Vec<f64> {
            let words = text.split([' ', ',']).filter(|word| !word.is_empty());
            words.filter_map(|word| word.parse().ok()).collect()
        }
        let mut reasons = Vec::new();
        for Line { label, text, slack } in now {
            let (Some(slack), Some(before)) = (slack, self.line(label)) else { continue };
            let (old, new) = (numbers(before), numbers(text));
            // Six digits are kept of each number.
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

/// The reason where the hash differs, but nothing that is compared.
const NOTHING_COMPARED: &str = "its hash is another one, but nothing that is compared";

/// Whether a test file allows some difference of a column.
fn is_lax(part: &GoldenColumn, tolerance: &Tolerance) -> bool {
    let by_share = matches!(part.class, Class::Level | Class::Exact);
    given(part, tolerance).is_some_and(|most| most > 0.0)
        || (by_share && tolerance.differing > 0.0)
        || (matches!(part.class, Class::Level | Class::Number) && tolerance.relative > 0.0)
}

impl Column {
    /// The old numbers to their last digits: those with the digits that were kept that are nearest to the new ones. None if no
    /// digits were kept, or if some number is another one, because it moved too far.
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

/// The parts of a value that was kept as a picture, by those of one of its type.
fn as_kept(picture: &Image, like: &GoldenParts) -> GoldenParts {
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
        CaptureFrame, Column, ControlNet, Encoder, Faces, KnotVector, Mask, Meaning, On, Parts,
        Summary, Surface, Value,
    };
    use nalgebra::{Matrix4, Point3};

    use super::*;
    use crate::compare::Keep;
    use crate::store::{files, read};

    /// What is kept of a value.
    fn kept(value: &AnyValue) -> Golden {
        kept_by(value, &Tolerance::default())
    }

    fn kept_by(value: &AnyValue, tolerance: &Tolerance) -> Golden {
        let folder = tempfile::tempdir().unwrap();
        for file in files(value, &[], &[], tolerance) {
            std::fs::write(folder.path().join(format!("x{}", file.name)), file.bytes).unwrap();
        }
        read(folder.path(), "x").unwrap()
    }

    fn compare(old: &AnyValue, new: &AnyValue) -> Comparison {
        kept(old).compare(new, &[], &Tolerance::default())
    }

    /// A sheet so rough that only some of it is kept.
    fn rough() -> Mesh {
        let quads = (0..119).flat_map(|row| (0..119).map(move |column| row * 120 + column));
        let faces = quads.flat_map(|a| [[a, a + 1, a + 120], [a + 1, a + 121, a + 120]]);
        Mesh::new(
            (0..14_400)
                .map(|k: u32| {
                    // Pseudo-random: the output function of MurmurHash3 (Appleby, 2011).
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

    fn moved(mesh: &Mesh, vertex: usize, by: f64) -> AnyValue {
        let mut positions = mesh.positions().to_vec();
        positions[vertex].z += by;
        AnyValue::new(mesh.with_positions(positions).unwrap())
    }

    /// A tolerance with which only some of a value is kept.
    fn sampled() -> Tolerance {
        Tolerance { keep: Keep::Sampled { every: 9 }, ..Tolerance::default() }
    }

    #[test]
    fn a_micrometer_at_one_vertex_is_seen_even_if_it_was_not_kept() {
        let mesh = rough();
        let old = AnyValue::new(mesh.clone());
        let golden = kept_by(&old, &sampled());
        let comparison = golden.compare(&moved(&mesh, 7, 1e-3), &[], &sampled());
        assert_eq!(comparison.verdict, Verdict::Different);
        assert!(comparison.reasons[0].contains("where nothing was kept"), "{comparison:?}");
        assert!((comparison.seen() - 1.0 / 9.0).abs() < 1e-3, "{comparison:?}");
        // The last digit is forgiven.
        let last = golden.compare(&moved(&mesh, 7, 1e-12), &[], &sampled());
        assert_eq!(last.verdict, Verdict::Within, "{last:?}");
    }

    #[test]
    fn the_kept_ones_tell_where() {
        let mesh = rough();
        let golden = kept_by(&AnyValue::new(mesh.clone()), &sampled());
        let comparison = golden.compare(&moved(&mesh, 900, 0.5), &[], &sampled());
        assert!(comparison.reasons[0].contains("worst at entry 900:"), "{comparison:?}");
    }

    #[test]
    fn what_was_kept_for_a_wide_bound_does_not_judge_a_narrow_one() {
        let mesh = rough();
        let wide = Tolerance { rms: Some(1e-4), ..Tolerance::default() };
        let narrow = Tolerance { rms: Some(1e-7), ..Tolerance::default() };
        let golden = kept_by(&AnyValue::new(mesh.clone()), &wide);
        assert!(golden.outdated(&narrow).is_some() && golden.outdated(&wide).is_none());
        let judged =
            |by: f64| golden.compare(&moved(&mesh, 7, by), &[], &narrow).reasons.join("; ");
        assert!(judged(1e-7).contains("too roughly to judge"), "{}", judged(1e-7));
        assert!(judged(1.0).contains("differs by 0.00833333 mm (rms)"), "{}", judged(1.0));
    }

    #[test]
    fn a_golden_of_an_earlier_form_says_so_and_how_to_accept_it_anew() {
        let mesh = rough();
        let value = AnyValue::new(mesh.clone());
        let mut golden = kept(&value);
        golden.lines.retain(|(label, _)| label != FORM);
        assert_eq!(golden.compare(&value, &[], &Tolerance::default()).verdict, Verdict::Identical);
        assert!(golden.outdated(&Tolerance::default()).is_some());
        let told = golden.compare(&moved(&mesh, 7, 1e-12), &[], &Tolerance::default());
        assert!(told.reasons[0].contains("earlier form") && told.reasons[0].contains("--bless"));
    }

    #[test]
    fn a_surface_is_measured_on_both_sides_although_its_faces_are_others() {
        let mesh = rough();
        fn lax(max: f64) -> Tolerance {
            Tolerance { remeshed: true, max: Some(max), ..Tolerance::default() }
        }
        let golden = kept_by(&AnyValue::new(mesh.clone()), &lax(0.5));
        // One vertex is pulled out, and a face is split there.
        fn changed(by: f64, mesh: &Mesh) -> AnyValue {
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
        let far = golden.compare(&changed(40.0, &mesh), &[], &lax(0.5));
        assert!(far.reasons[0].contains("surface, new to old"), "{far:?}");
        assert_eq!(golden.compare(&changed(0.3, &mesh), &[], &lax(0.5)).verdict, Verdict::Within);
    }

    #[test]
    fn another_diagonal_is_another_mesh() {
        let mesh = rough();
        let mut faces = mesh.faces().as_triangles().unwrap().to_vec();
        let ([a, b, d], [_, c, _]) = (faces[500], faces[501]);
        (faces[500], faces[501]) = ([a, b, c], [a, c, d]);
        let other = Mesh::new(mesh.positions().to_vec(), Faces::triangles(faces)).unwrap();
        let comparison = compare(&AnyValue::new(mesh), &AnyValue::new(other));
        fn told(what: &str, comparison_reasons: &[String]) -> bool {
            comparison_reasons.iter().any(|why| why.starts_with(what))
        }
        assert!(told("2 faces join other vertices", &comparison.reasons), "{comparison:?}");
        assert!(
            told("`surface, old to new` differs by 0.2", &comparison.reasons),
            "{comparison:?}"
        );
    }

    #[test]
    fn one_pixel_is_seen() {
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
    fn what_no_column_holds_is_not_overlooked() {
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
    fn a_kept_surface_is_a_mesh_again() {
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
        assert_eq!(kept(&AnyValue::new(surface)).mesh().unwrap(), mesh);
    }

    /// Bends of a sheet of metal, whose columns are called as those of a mesh.
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
            parts.push("sides", On::Entry, Meaning::Number, 1, &self.0[..]);
            parts.push("corners", On::Entry, Meaning::Number, 1, &self.0[..]);
            parts
        }
    }

    #[test]
    fn columns_that_are_only_called_like_faces_are_numbers() {
        fn bends(first: f64) -> AnyValue {
            AnyValue::new(Bends(vec![first, -7.25, 1e9].into()))
        }
        for tolerance in [Tolerance::default(), sampled()] {
            let golden = kept_by(&bends(0.5), &tolerance);
            let column = &golden.kept().unwrap().column("corners").unwrap().part;
            assert_eq!((column.faces, column.count), (false, 3));
            assert!((column.numbers[1] + 7.25).abs() < 1e-3, "{column:?}");
            fn verdict(value: AnyValue, golden: &Golden, tolerance: &Tolerance) -> Verdict {
                golden.compare(&value, &[], tolerance).verdict
            }
            assert_eq!(verdict(bends(0.5), &golden, &tolerance), Verdict::Identical);
            assert_eq!(verdict(bends(1e8), &golden, &tolerance), Verdict::Different);
        }
    }
}
