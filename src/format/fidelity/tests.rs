//! The lists beside what writers write and readers find in it.

use std::sync::Arc;

use maquette_node::pack::{Format, NewFile};
use maquette_node::reading::Reading;
use maquette_node::{DataKind, Fidelity};
use maquette_value::{
    AnyValue, Attribute, CaptureFrame, Faces, Image, Map, MapKind, Material, Mesh, Points,
    Transparency, value_type,
};
use nalgebra::Point3;

use super::*;
use crate::{FORMATS, READERS};

/// A quad beside a triangle, with texture coordinates if `with_uv`. It is where a 3MF file would move it: on the plate.
fn bare(with_uv: bool) -> Mesh {
    fn at(x: f64, y: f64) -> Point3<f64> {
        Point3::new(x, y, 0.0)
    }
    let positions = vec![at(0., 0.), at(1., 0.), at(1., 1.), at(0., 1.), at(2., 0.)];
    let faces = Faces::polygons(&[4, 3], vec![0, 1, 2, 3, 1, 4, 2]).unwrap();
    let mesh = Mesh::new(positions, faces).unwrap();
    if with_uv { mesh.with_vertex("uv", pairs(5)).unwrap() } else { mesh }
}

fn pairs(count: u8) -> Attribute {
    Attribute::Pair((0..count).map(|k| [f64::from(k) / 8.0, 0.25]).collect())
}

fn colors(count: u8) -> Attribute {
    Attribute::Color((0..count).map(|k| [10 + 40 * k, 255 - k, k]).collect())
}

fn numbers(count: u8) -> Attribute {
    Attribute::Number((0..count).map(|k| f64::from(k) * 0.5 - 1.0).collect())
}

fn normals() -> Attribute {
    Attribute::Vector(
        (0..5)
            .map(|k: u8| if k.is_multiple_of(2) { [0.0, 1.0, 0.0] } else { [1.0, 0.0, 0.0] })
            .collect(),
    )
}

/// The mesh with data of a kind, and the attribute that has it; none for kinds of which a mesh has nothing to vary.
fn with(kind: DataKind) -> Option<(Mesh, Mesh, &'static str)> {
    let (plain, on_uv) = (bare(false), bare(true));
    let mesh = plain.clone();
    let (mesh, name) = match kind {
        Normals => (mesh.with_vertex("normal", normals()).unwrap(), "normal"),
        VertexColors => (mesh.with_vertex("color", colors(5)).unwrap(), "color"),
        FaceColors => (mesh.with_face("color", colors(2)).unwrap(), "color"),
        CornerColors => (mesh.with_corner("color", colors(7)).unwrap(), "color"),
        VertexUv => (on_uv, "uv"),
        CornerUv => (mesh.with_corner("uv", pairs(7)).unwrap(), "uv"),
        VertexAttributes => (mesh.with_vertex("weight", numbers(5)).unwrap(), "weight"),
        FaceAttributes => (mesh.with_face("weight", numbers(2)).unwrap(), "weight"),
        CornerAttributes => (mesh.with_corner("weight", numbers(7)).unwrap(), "weight"),
        Creases => (mesh.with_creases([([0, 1], 2.5)]).unwrap(), ""),
        Pictures => {
            let picture = Image::new(2, 1, vec![[255, 0, 0], [0, 0, 255]]).unwrap();
            return Some((on_uv.clone(), on_uv.with_texture(Some(picture)), ""));
        }
        Materials => {
            let normals = Image::new(1, 1, vec![[128, 128, 255]]).unwrap();
            let map = Map::new("bumps.png", crate::png::encode_rgb(&normals).unwrap());
            let material = Material {
                name: "skin".to_owned(),
                base_color: [0.5, 0.25, 1.0, 0.5],
                roughness: 0.5,
                maps: [(MapKind::Normal, map)].into(),
                transparency: Transparency::Blend,
                ..Material::default()
            };
            return Some((on_uv.clone(), on_uv.with_materials([material]), ""));
        }
        Positions | Faces | Units | UpAxis => return None,
    };
    Some((plain, mesh, name))
}

/// What is left of data.
#[derive(Debug, PartialEq)]
enum Left {
    All,
    Other,
    Nothing,
}

/// An attribute, element by element, each by what tells it from others.
fn entries(mesh: &Mesh, domain: usize, name: &str) -> Vec<String> {
    let attributes = [mesh.vertex(), mesh.face(), mesh.corner()][domain];
    let Some(attribute) = attributes.get(name) else { return Vec::new() };
    let place = |vertex: usize| format!("{:?}", mesh.positions()[vertex].coords.as_slice());
    let faces = || {
        mesh.faces().iter().map(|face| face.iter().map(|&v| place(v as usize)).collect::<Vec<_>>())
    };
    let elements: Vec<String> = match domain {
        0 => (0..mesh.positions().len()).map(place).collect(),
        1 => faces().map(|face| face.concat()).collect(),
        // Faces may be cut into triangles.
        _ => faces().flatten().collect(),
    };
    let of =
        |(element, at): (usize, String)| format!("{at} {:?}", attribute.select(&[element as u32]));
    let mut entries: Vec<_> = elements.into_iter().enumerate().map(of).collect();
    entries.sort();
    entries.dedup();
    entries
}

/// What is left of the attribute `name` of `before` in `after`.
fn left(kind: DataKind, before: &Mesh, after: &Mesh, name: &str) -> Left {
    match kind {
        Creases if after.creases().len() == 0 => return Left::Nothing,
        Creases => return Left::All,
        Materials => {
            // Pictures may get other names.
            fn nameless(mesh: &Mesh) -> Vec<Material> {
                let mut all = mesh.materials().to_vec();
                all.iter_mut().flat_map(|it| it.maps.values_mut()).for_each(|map| map.file.clear());
                all
            }
            let is_same = nameless(after) == nameless(before);
            let is_lost = after.materials().is_empty();
            return if is_same {
                Left::All
            } else if is_lost {
                Left::Nothing
            } else {
                Left::Other
            };
        }
        Pictures => {
            let is_same = after.texture() == before.texture();
            return if is_same { Left::All } else { Left::Nothing };
        }
        _ => {}
    }
    let domain = match kind {
        FaceColors | FaceAttributes => 1,
        CornerColors | CornerUv | CornerAttributes => 2,
        _ => 0,
    };
    fn all(domain: usize, after: &Mesh, name: &str) -> Vec<String> {
        entries(after, domain, name)
    }
    // A vertex has what all its corners have.
    let is_same = |other: usize| all(other, after, name) == entries(before, domain, name);
    if is_same(domain) || (domain == 0 && is_same(2)) {
        return Left::All;
    }
    if (0..3).any(|other| !all(other, after, name).is_empty()) {
        Left::Other
    } else {
        Left::Nothing
    }
}

fn write(format: &Format, value: impl Into<AnyValueOf>) -> Vec<NewFile> {
    format.write(&value.into().0, &format!("it.{}", format.ending)).unwrap()
}

/// A value of any type.
struct AnyValueOf(AnyValue);

impl From<&Mesh> for AnyValueOf {
    fn from(mesh: &Mesh) -> Self {
        Self(AnyValue::new(mesh.clone()))
    }
}

fn fidelity(list: Fidelities, kind: DataKind) -> Option<Fidelity> {
    list.iter().find(|(listed, _)| *listed == kind).map(|(_, fidelity)| *fidelity)
}

/// The mesh in files, the first of which is read.
fn read(files: &[NewFile], ending: &str) -> Option<Mesh> {
    let reader = READERS
        .iter()
        .find(|reader| reader.kind() == value_type::<Mesh>() && reader.endings.contains(&ending))?;
    let beside = |name: &str| {
        let found = files.iter().find(|file| file.name == name);
        found.map(|file| Arc::from(&file.bytes[..])).ok_or_else(|| format!("no {name}"))
    };
    let read = reader.call(&Reading::new(&files[0].name, &files[0].bytes, &beside)).unwrap();
    read.get::<Mesh>().cloned()
}

fn mesh_formats() -> impl Iterator<Item = &'static Format> {
    FORMATS.iter().filter(|format| (format.kind)() == value_type::<Mesh>())
}

#[test]
fn every_format_of_meshes_and_points_says_what_it_keeps_and_each_kind_once() {
    let kinds = [value_type::<Mesh>(), value_type::<Points>()];
    let written = FORMATS.iter().filter(|it| kinds.contains(&(it.kind)()));
    let read = READERS.iter().filter(|it| kinds.contains(&it.kind()));
    let written = written.map(|format| (format.ending, format.fidelity));
    for (name, list) in written.chain(read.map(|reader| (reader.endings[0], reader.fidelity))) {
        assert!(fidelity(list, Positions).is_some(), "{name}");
        assert!(list.windows(2).all(|pair| pair[0].0 < pair[1].0), "{name}: {list:?}");
    }
}

#[test]
fn a_writer_writes_what_it_lists_and_nothing_of_what_it_loses() {
    let mut wrong = Vec::new();
    for format in mesh_formats() {
        for kind in DataKind::ALL {
            let Some((without, with, _)) = with(kind) else { continue };
            let is_written = write(format, &without) != write(format, &with);
            // Some is only written beside a picture.
            let told = fidelity(format.fidelity, kind);
            let is_listed = told.is_some_and(|told| told != Changed("only beside a picture"));
            // Normals of faces are computed, whatever a mesh has.
            let is_listed = is_listed && !(format.ending == "stl" && kind == Normals);
            if is_written != is_listed {
                wrong.push(format!("{} {kind:?}: written {is_written}", format.ending));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn what_is_written_and_read_is_there_as_both_say() {
    let mut wrong = Vec::new();
    for format in mesh_formats() {
        let reader = READERS.iter().find(|reader| {
            reader.kind() == value_type::<Mesh>() && reader.endings.contains(&format.ending)
        });
        let Some(reader) = reader else { continue };
        for kind in DataKind::ALL {
            let Some((_, mesh, name)) = with(kind) else { continue };
            let after = read(&write(format, &mesh), format.ending).unwrap();
            let is_kept = fidelity(format.fidelity, kind) == Some(Kept)
                && fidelity(reader.fidelity, kind).is_some();
            let left = left(kind, &mesh, &after, name);
            let is_lost = fidelity(reader.fidelity, kind).is_none();
            if (left == Left::All) != is_kept || (is_lost && left != Left::Nothing) {
                wrong.push(format!("{} {kind:?}: {left:?} left", format.ending));
            }
        }
        let (before, after) =
            (bare(false), read(&write(format, &bare(false)), format.ending).unwrap());
        fn sorted(mesh: &Mesh) -> Vec<String> {
            let mut places: Vec<_> = mesh.positions().iter().map(|p| format!("{p:?}")).collect();
            places.sort();
            places
        }
        assert_eq!(sorted(&before), sorted(&after), "{}", format.ending);
        let is_same = before.faces().len() == after.faces().len();
        assert_eq!(is_same, fidelity(format.fidelity, Faces) == Some(Kept), "{}", format.ending);
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn a_file_has_the_unit_and_the_axis_that_its_format_lists() {
    let frame = CaptureFrame { camera: None, picture: [4, 3], depth: 5.0, world_from_camera: None };
    for format in mesh_formats() {
        let file = write(format, &bare(false)).swap_remove(0).bytes;
        let inside = match format.ending {
            "3mf" => crate::three_mf::tests::files(&file).remove(2).1,
            _ => file.clone(),
        };
        fn has(text: &str, inside: &[u8]) -> bool {
            String::from_utf8_lossy(inside).contains(text)
        }
        let has_unit =
            has("unit=\"millimeter\"", &inside) || has("\"scale\":[0.001,0.001,0.001]", &inside);
        let name = format.ending;
        assert_eq!(has_unit, fidelity(format.fidelity, Units).is_some(), "{name}");
        // What a sensor sees upside down is turned, in all of them; only some have an axis that is known to point upwards.
        let seen = bare(false).with_frame(Some(frame));
        assert_ne!(write(format, &seen).swap_remove(0).bytes, file, "{name}");
    }
}
