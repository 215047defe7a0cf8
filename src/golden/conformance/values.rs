//! The laws of value types. From the parts of a value (its columns and facts) an equal value can be created. Damaged parts cause an error,
//! never a panic.

use std::borrow::Cow;
use std::panic::{AssertUnwindSafe, catch_unwind};

use maquette_value::{
    AnyValue, FactValue, Hash, Items, Meaning, Part, Parts, PartsError, ValueType, ranges,
};

/// The maximum number of values of each type that are tested with damaged parts. More values would only repeat the reports.
const MAX_DAMAGED: usize = 6;

/// Checks a value type with its edge cases.
pub(super) fn check(kind: &ValueType, broken: &mut Vec<String>) {
    let Some(values) = unless_panic(|| kind.edge_cases()) else {
        broken.push(format!("making the hostile values of {} panics", kind.name));
        return;
    };
    let stride = values.len().div_ceil(MAX_DAMAGED).max(1);
    for (index, value) in values.iter().enumerate() {
        if check_value(value, broken) && index.is_multiple_of(stride) {
            check_damage(value, broken);
        }
    }
}

/// Checks one value. Returns true if it can be created again from its parts.
fn check_value(value: &AnyValue, broken: &mut Vec<String>) -> bool {
    fn law(law: &str, value: &AnyValue) -> String {
        format!("{}: {law}, with {value:?}", value.kind().name)
    }
    if unless_panic(|| (value.describe(), value.probe([0, 0]), value.show())).is_none() {
        broken.push(law("`describe`, `probe` or `show` panics", value));
    }
    let Some(parts) = unless_panic(|| value.parts()) else {
        broken.push(law("`parts` panics", value));
        return false;
    };
    if let Some(part) = parts
        .columns
        .iter()
        .find(|part| part.width == 0 || !part.items.len().is_multiple_of(part.width))
    {
        broken.push(law(&format!("the elements of its part `{}` are not whole", part.name), value));
        return false;
    }
    match rebuild(value, &parts) {
        RebuildResult::Nothing(PartsError::Never { .. }) => {}
        RebuildResult::Nothing(error) => {
            broken.push(law(&format!("its own parts make no value, because {error}"), value));
        }
        RebuildResult::Value(hash) if hash == value.hash() => return true,
        RebuildResult::Value(_) => broken.push(law("its own parts make another value", value)),
        RebuildResult::Panic => broken.push(law("`from_parts` panics on its own parts", value)),
    }
    false
}

/// The result of creating a value from its parts.
enum RebuildResult {
    Value(Hash),
    Nothing(PartsError),
    Panic,
}

fn rebuild(value: &AnyValue, parts: &Parts<'_>) -> RebuildResult {
    match unless_panic(|| value.kind().from_parts(parts)) {
        Some(Ok(made)) => RebuildResult::Value(made.hash()),
        Some(Err(error)) => RebuildResult::Nothing(error),
        None => RebuildResult::Panic,
    }
}

/// Returns the result of `make`, or `None` if it panics.
fn unless_panic<T>(make: impl FnOnce() -> T) -> Option<T> {
    catch_unwind(AssertUnwindSafe(make)).ok()
}

/// The result that `from_parts` must have for damaged parts.
#[derive(Clone, Copy, PartialEq)]
enum RequiredResult {
    /// `from_parts` may return any value or an error, but must not panic.
    Return,
    /// `from_parts` must return an error, or a value that differs from the original.
    Differ,
    /// `from_parts` must return an error.
    Fail,
}

/// Damages each part and each fact of a value, one at a time, and checks the result.
fn check_damage(value: &AnyValue, broken: &mut Vec<String>) {
    let parts = value.parts();
    let mut check_parts = |what: String, must: RequiredResult, damaged: &Parts<'_>| {
        let wrong = match (must, rebuild(value, damaged)) {
            (_, RebuildResult::Panic) => "panics",
            (RequiredResult::Fail, RebuildResult::Value(_)) => "is not an error",
            (RequiredResult::Differ, RebuildResult::Value(hash)) if hash == value.hash() => {
                "is not noticed"
            }
            _ => return,
        };
        broken.push(format!("{}: `from_parts` {wrong}: {what}, in {value:?}", value.kind().name));
    };
    if !parts.is_empty() {
        check_parts("no part at all".into(), RequiredResult::Fail, &Parts::default());
    }
    for index in 0..parts.facts.len() {
        let name = &parts.facts[index].name;
        let mut damaged = parts.clone();
        for size in [[usize::MAX; 2], [usize::MAX, 0], [1 << 40, 1 << 40]] {
            damaged.facts[index].value = FactValue::Size(size);
            check_parts(
                format!("the fact `{name}` says {size:?}"),
                RequiredResult::Return,
                &damaged,
            );
            damaged.facts[index].value = FactValue::Count(size[0]);
            check_parts(
                format!("the fact `{name}` says {}", size[0]),
                RequiredResult::Return,
                &damaged,
            );
        }
        damaged.facts.remove(index);
        check_parts(format!("the fact `{name}` is missing"), RequiredResult::Return, &damaged);
    }
    for (index, part) in parts.columns.iter().enumerate() {
        let name = &part.name;
        let replace_part = |part: Part<'static>| {
            let mut damaged = parts.clone();
            damaged.columns[index] = part;
            damaged
        };
        let part_with = |width: usize, numbers: Vec<f64>| Part {
            name: Cow::Owned(name.clone().into_owned()),
            width,
            items: Items::F64(numbers.into()),
            ..empty_part(part)
        };
        let mut missing = parts.clone();
        missing.columns.remove(index);
        check_parts(format!("the part `{name}` is missing"), RequiredResult::Return, &missing);
        let numbers = part.items.numbers().into_owned();
        let wider = replace_part(part_with(part.width + 1, numbers.clone()));
        check_parts(format!("the elements of `{name}` are longer"), RequiredResult::Differ, &wider);
        let flat = replace_part(part_with(0, numbers.clone()));
        check_parts(format!("the elements of `{name}` are empty"), RequiredResult::Fail, &flat);
        let mut longer = numbers.clone();
        longer.push(0.0);
        let longer = replace_part(part_with(part.width, longer));
        check_parts(format!("`{name}` is longer by a number"), RequiredResult::Differ, &longer);
        let (Some(last), whole) = (numbers.len().checked_sub(1), is_whole(part)) else { continue };
        let shorter = replace_part(part_with(part.width, numbers[..last].to_vec()));
        check_parts(format!("`{name}` is shorter by a number"), RequiredResult::Differ, &shorter);
        for at in [0, last] {
            let most = ranges(&numbers, 1)[0].map_or(0.0, |range| range.max);
            for (wrong, is_whole) in
                [(f64::NAN, false), (-1.0, false), (0.5, false), (1e300, false), (most + 1.0, true)]
            {
                let mut numbers = numbers.clone();
                numbers[at] = wrong;
                let must =
                    if whole && !is_whole { RequiredResult::Fail } else { RequiredResult::Return };
                let damaged = replace_part(part_with(part.width, numbers));
                check_parts(format!("number {at} of `{name}` is {wrong}"), must, &damaged);
            }
        }
    }
}

/// Returns true if all numbers of a part are whole numbers of at most 32 bits.
fn is_whole(part: &Part<'_>) -> bool {
    let is_small = !matches!(part.items, Items::F64(_) | Items::F32(_));
    is_small && matches!(part.meaning, Meaning::Level | Meaning::Index | Meaning::Exact)
}

/// Returns a copy of a part without its numbers.
fn empty_part(part: &Part<'_>) -> Part<'static> {
    Part {
        name: Cow::Borrowed(""),
        element_kind: part.element_kind,
        meaning: part.meaning,
        width: part.width,
        items: Items::F64(Cow::Borrowed(&[])),
        is_hidden: part.is_hidden,
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::{
        Attribute, CaptureFrame, Chart, Contour, ControlNet, Curve, Direction, ElementKind, Faces,
        Image, KnotVector, MATERIAL_ATTRIBUTE, Map, MapKind, Material, Mesh, Pinhole, Points,
        RangeImage, Region, Registration, Surface, TYPES, Transparency, Wrap,
    };
    use nalgebra::{Matrix4, Point3};

    use super::*;

    const CAMERA: Pinhole = Pinhole { focal: [1400.0, 1390.0], center: [99.5, 98.0] };

    fn frame() -> CaptureFrame {
        CaptureFrame {
            camera: Some(CAMERA),
            picture: [400, 300],
            depth: 733.0,
            world_from_camera: Some(Matrix4::identity() * 2.0),
        }
    }

    fn points(count: usize) -> Vec<Point3<f64>> {
        (0..count).map(|k| Point3::new(k as f64, (k * k) as f64 / 7.0, 0.1)).collect()
    }

    fn mesh() -> Mesh {
        let faces = Faces::polygons(&[4, 3], vec![0, 1, 2, 3, 1, 4, 2]).unwrap();
        let texture = Image::new(2, 1, vec![[1, 2, 3], [4, 5, 6]]).unwrap();
        let mesh = Mesh::new(points(5), faces).unwrap();
        let mesh = mesh.with_vertex("uv", Attribute::Pair(vec![[0.25, 0.5]; 5].into())).unwrap();
        let mesh = mesh.with_vertex("color", Attribute::Color(vec![[9, 8, 7]; 5].into())).unwrap();
        let mesh = mesh.with_vertex("filled", Attribute::Flag(vec![1; 5].into())).unwrap();
        // Give the attributes the names of other parts of a mesh.
        let mesh = mesh.with_vertex("sides", Attribute::Index(vec![7; 5].into())).unwrap();
        let mesh =
            mesh.with_vertex("position", Attribute::Vector(vec![[0.5; 3]; 5].into())).unwrap();
        let mesh = mesh.with_vertex("frame", Attribute::Number(vec![2.5; 5].into())).unwrap();
        let normals = Attribute::Vector(vec![[0.0, 0.0, 1.0]; 7].into());
        let mesh = mesh.with_corner("normal", normals).unwrap();
        let mesh = mesh.with_face("area", Attribute::Number(vec![1.5; 2].into())).unwrap();
        let mesh = mesh.with_creases([([0, 1], 2.0), ([1, 2], f64::INFINITY)]).unwrap();
        mesh.with_texture(Some(texture.with_camera(Some(CAMERA)))).with_frame(Some(frame()))
    }

    /// A mesh with two materials, one of them with a picture file.
    fn mesh_with_materials() -> Mesh {
        let base = Map { wrap: [Wrap::Mirror, Wrap::Clamp], ..Map::new("a.png", vec![1, 2, 3]) };
        let skin = Material {
            name: "skin".to_owned(),
            transparency: Transparency::Cutoff(0.25),
            maps: [
                (MapKind::BaseColor, base),
                (MapKind::Other("map_Ks".into()), Map::new("", vec![])),
            ]
            .into(),
            others: [("illum".to_owned(), "2".to_owned())].into(),
            ..mesh().materials()[0].clone()
        };
        let numbers = Attribute::Index(vec![1, 0].into());
        mesh()
            .with_face(MATERIAL_ATTRIBUTE, numbers)
            .unwrap()
            .with_materials([skin, Material::default()])
    }

    fn net() -> ControlNet {
        let chart = Chart {
            grid: [20, 10],
            cells: vec![3, 199].into(),
            coordinates: vec![[0.5, 1.5]; 2].into(),
        };
        let net = ControlNet::new(3, 4, points(12)).unwrap();
        let net = net.with_points(points(13)[1..].to_vec()).unwrap();
        let net = net.with_weights((0..12).map(f64::from).collect()).unwrap();
        let net = net.with_fixed((0..12).map(|k| k % 2).collect()).unwrap();
        let net = net.with_interpolated((0..12).map(|k| k / 3 % 2).collect()).unwrap();
        let net = net.with_rim_distances((0..12).map(|k| f64::from(k) - 5.5).collect()).unwrap();
        net.with_chart(chart).with_frame(Some(frame()))
    }

    fn ordinary() -> Vec<AnyValue> {
        fn knots(n: usize) -> KnotVector {
            KnotVector::uniform(n, 3).unwrap()
        }
        let range = RangeImage::new(4, 3, points(12)).unwrap();
        let range = range.with_filled((0..12).map(|k| k % 2).collect()).unwrap();
        let range = range.with_joined((0..12).collect()).unwrap();
        let range = range.with_colors(vec![[1, 2, 3]; 12]).unwrap().with_camera(Some(CAMERA));
        let range = range.with_registration(Registration::corners([4, 3], [80, 60]));
        let range = range.with_world_from_camera(Some(Matrix4::identity()));
        let contours = vec![
            Contour { hole: false, cells: vec![1, 2, 5], rim: vec![[0.4, -0.3], [2.4, 1.2]] },
            Contour { hole: true, cells: vec![2], rim: Vec::new() },
        ];
        let cells = vec![1, 2, 5];
        let region = Region::new(3, 2, cells, points(3), vec![0, 1, 0], contours).unwrap();
        let cloud = Points::new(points(4)).unwrap();
        let cloud = cloud.with_attribute("normal", Attribute::Vector(vec![[0.6; 3]; 4].into()));
        let image = Image::new(2, 1, vec![[1, 2, 3]; 2]).unwrap().with_camera(Some(CAMERA));
        vec![
            AnyValue::new(mesh()),
            AnyValue::new(mesh_with_materials()),
            AnyValue::new(net()),
            AnyValue::new(Surface::new(net(), knots(3), knots(4)).unwrap()),
            AnyValue::new(range),
            AnyValue::new(region),
            AnyValue::new(cloud.unwrap()),
            AnyValue::new(image),
            AnyValue::new(Curve::polyline(points(5), true).unwrap()),
            AnyValue::new(Curve::rational(points(4), vec![0.5; 4], knots(4)).unwrap()),
            AnyValue::new(Direction::mean([0.1, 0.2, 0.3].into()).unwrap()),
        ]
    }

    #[test]
    fn the_values_of_the_engine_keep_the_laws() {
        let mut broken = Vec::new();
        TYPES.iter().for_each(|kind| check(kind, &mut broken));
        for value in ordinary() {
            assert!(check_value(&value, &mut broken), "{broken:?}");
            check_damage(&value, &mut broken);
        }
        assert!(broken.is_empty(), "{} laws are broken:\n{}", broken.len(), broken.join("\n"));
    }

    #[test]
    fn every_type_of_the_engine_has_edge_cases_with_parts() {
        for kind in TYPES {
            let values = kind.edge_cases();
            assert!(!values.is_empty(), "{}", kind.name);
            assert!(values.iter().all(|value| !value.parts().columns.is_empty()), "{}", kind.name);
            assert!(values.iter().any(|value| !value.show().is_empty()), "{}", kind.name);
        }
    }

    /// Returns the error that occurs if a mesh is created with this wrong number in the part `name`.
    fn error(name: &str, number: f64) -> String {
        let value = AnyValue::new(mesh());
        let mut parts = value.parts();
        let part = parts.columns.iter_mut().find(|part| part.name == name).unwrap();
        let mut numbers = part.items.numbers().into_owned();
        numbers[1] = number;
        part.items = numbers.into();
        value.kind().from_parts(&parts).unwrap_err().to_string()
    }

    #[test]
    fn errors_name_the_part() {
        assert_eq!(error("position", f64::NAN), "the position of vertex 0 is not finite");
        assert_eq!(error("corners", 9.0), "face 0 refers to vertex 9, but there are only 5");
        let whole =
            "number 1 of the part `corners` is 0.5, expected a whole number from 0 to 4294967295";
        assert_eq!(error("corners", 0.5), whole);
        assert_eq!(
            error("corner normal", f64::NAN),
            "attribute `normal` of corner 0 is not finite"
        );
        assert_eq!(
            error("color", 256.0),
            "number 1 of the part `color` is 256, expected a whole number from 0 to 255"
        );
    }

    #[test]
    fn a_mesh_can_be_created_from_two_arrays() {
        let mut parts = Parts::default();
        let positions = vec![0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        parts.push("position", ElementKind::Vertex, Meaning::Position, 3, positions);
        let kind = maquette_value::value_type::<Mesh>();
        assert_eq!(
            kind.from_parts(&parts).unwrap_err().to_string(),
            "the part `corners` is missing"
        );
        parts.push("corners", ElementKind::Face, Meaning::Index, 3, vec![0u32, 1, 2]);
        assert_eq!(kind.from_parts(&parts).unwrap().get::<Mesh>().unwrap().faces().len(), 1);
    }
}
