//! Compares the lists of kept and changed data with the results of the writers and readers.

use std::sync::Arc;

use maquette_node::importers::InputFile;
use maquette_node::pack::{Format, NewFile};
use maquette_node::{DataKind, Fidelity};
use maquette_value::{
    AnyValue, Attribute, CaptureFrame, Faces, Image, Map, MapKind, Material, Mesh, Points,
    Transparency, value_type,
};
use nalgebra::Point3;

use super::*;
use crate::{FORMATS, READERS};

/// Creates a quad beside a triangle, with texture coordinates if `with_uv` is true. The mesh is already at the position on the build plate
/// to which the 3MF writer would move it.
fn bare(with_uv: bool) -> Mesh {
    fn point(x: f64, y: f64) -> Point3<f64> {
        Point3::new(x, y, 0.0)
    }
    let positions = vec![point(0., 0.), point(1., 0.), point(1., 1.), point(0., 1.), point(2., 0.)];
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

/// Returns a mesh without data of this kind, the mesh with such data, and the name of the attribute that contains the data. Returns `None`
/// for kinds of data that every mesh has.
fn mesh_with(kind: DataKind) -> Option<(Mesh, Mesh, &'static str)> {
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

/// The part of one kind of a mesh's data that is preserved when the mesh is written and read.
#[derive(Debug, PartialEq)]
enum Remainder {
    All,
    Other,
    Nothing,
}

/// Returns the entries of an attribute, sorted. Each entry includes the positions of its vertex, face or corner.
fn entries(mesh: &Mesh, domain: usize, name: &str) -> Vec<String> {
    let attributes = [mesh.vertex(), mesh.face(), mesh.corner()][domain];
    let Some(attribute) = attributes.get(name) else { return Vec::new() };
    let vertices: Vec<String> =
        mesh.positions().iter().map(|point| format!("{:?}", point.coords.as_slice())).collect();
    let faces = mesh.faces().iter().map(|face| {
        face.iter().map(|&vertex| vertices[vertex as usize].clone()).collect::<Vec<_>>()
    });
    let elements: Vec<String> = match domain {
        0 => vertices.clone(),
        1 => faces.map(|face| face.concat()).collect(),
        // List corners without their faces, because writing may have cut faces into triangles.
        _ => faces.flatten().collect(),
    };
    let mut entries: Vec<_> = (0..)
        .zip(elements)
        .map(|(element, position)| format!("{position} {:?}", attribute.select(&[element])))
        .collect();
    entries.sort();
    entries.dedup();
    entries
}

/// Compares the data of `kind`, in the attribute `name`, before and after writing and reading.
fn remainder(kind: DataKind, before: &Mesh, after: &Mesh, name: &str) -> Remainder {
    match kind {
        Creases if after.creases().len() == 0 => return Remainder::Nothing,
        Creases => return Remainder::All,
        Materials => {
            // Remove the names of pictures, because writing may have changed them.
            fn nameless(mesh: &Mesh) -> Vec<Material> {
                let mut all = mesh.materials().to_vec();
                all.iter_mut().flat_map(|it| it.maps.values_mut()).for_each(|map| map.file.clear());
                all
            }
            let is_same = nameless(after) == nameless(before);
            let is_lost = after.materials().is_empty();
            return if is_same {
                Remainder::All
            } else if is_lost {
                Remainder::Nothing
            } else {
                Remainder::Other
            };
        }
        Pictures => {
            let is_same = after.texture() == before.texture();
            return if is_same { Remainder::All } else { Remainder::Nothing };
        }
        _ => {}
    }
    let domain = match kind {
        FaceColors | FaceAttributes => 1,
        CornerColors | CornerUv | CornerAttributes => 2,
        _ => 0,
    };
    // If all corners of a vertex have equal data, reading may have converted these to data of the vertex.
    let expected = entries(before, domain, name);
    if entries(after, domain, name) == expected
        || (domain == 0 && entries(after, 2, name) == expected)
    {
        return Remainder::All;
    }
    if (0..3).any(|other| !entries(after, other, name).is_empty()) {
        Remainder::Other
    } else {
        Remainder::Nothing
    }
}

fn write(format: &Format, value: impl Into<AnyValueOf>) -> Vec<NewFile> {
    format.write(&value.into().0, &format!("it.{}", format.extension)).unwrap()
}

/// Wraps an [`AnyValue`], so that conversions from other types can be implemented here.
struct AnyValueOf(AnyValue);

impl From<&Mesh> for AnyValueOf {
    fn from(mesh: &Mesh) -> Self {
        Self(AnyValue::new(mesh.clone()))
    }
}

fn fidelity(list: Fidelities, kind: DataKind) -> Option<Fidelity> {
    list.iter().find(|(listed, _)| *listed == kind).map(|(_, fidelity)| *fidelity)
}

/// Reads the mesh from written files. The first of them is the main file.
fn read(files: &[NewFile], ending: &str) -> Option<Mesh> {
    let reader = READERS.iter().find(|reader| {
        reader.kind() == value_type::<Mesh>() && reader.extensions.contains(&ending)
    })?;
    let read = reader.call(&InputFile::new(&files[0].name, &files[0].bytes, &|name: &str| {
        let found = files.iter().find(|file| file.name == name);
        found.map(|file| Arc::from(&file.bytes[..])).ok_or_else(|| format!("no {name}"))
    }));
    let read = read.unwrap();
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
    let written = written.map(|format| (format.extension, format.fidelity));
    for (name, list) in written.chain(read.map(|reader| (reader.extensions[0], reader.fidelity))) {
        assert!(fidelity(list, Positions).is_some(), "{name}");
        assert!(list.windows(2).all(|pair| pair[0].0 < pair[1].0), "{name}: {list:?}");
    }
}

#[test]
fn a_writer_writes_what_it_lists_and_nothing_of_what_it_loses() {
    let mut mismatches = Vec::new();
    for format in mesh_formats() {
        for kind in DataKind::ALL {
            let Some((without, with, _)) = mesh_with(kind) else { continue };
            let is_written = write(format, &without) != write(format, &with);
            // Some data are written only if the mesh has a picture.
            let listed = fidelity(format.fidelity, kind);
            let is_listed = listed.is_some_and(|listed| listed != Changed("only beside a picture"));
            // The normals in STL files are computed from the faces, so they do not count as written.
            let is_listed = is_listed && !(format.extension == "stl" && kind == Normals);
            if is_written != is_listed {
                mismatches.push(format!("{} {kind:?}: written {is_written}", format.extension));
            }
        }
    }
    assert!(mismatches.is_empty(), "{mismatches:#?}");
}

#[test]
fn a_round_trip_keeps_the_kinds_that_both_lists_name() {
    let mut mismatches = Vec::new();
    for format in mesh_formats() {
        let reader = READERS.iter().find(|reader| {
            reader.kind() == value_type::<Mesh>() && reader.extensions.contains(&format.extension)
        });
        let Some(reader) = reader else { continue };
        for kind in DataKind::ALL {
            let Some((_, mesh, name)) = mesh_with(kind) else { continue };
            let after = read(&write(format, &mesh), format.extension).unwrap();
            let is_kept = fidelity(format.fidelity, kind) == Some(Kept)
                && fidelity(reader.fidelity, kind).is_some();
            let left = remainder(kind, &mesh, &after, name);
            let is_lost = fidelity(reader.fidelity, kind).is_none();
            if (left == Remainder::All) != is_kept || (is_lost && left != Remainder::Nothing) {
                mismatches.push(format!("{} {kind:?}: {left:?} left", format.extension));
            }
        }
        let (before, after) =
            (bare(false), read(&write(format, &bare(false)), format.extension).unwrap());
        fn sorted_positions(mesh: &Mesh) -> Vec<String> {
            let mut positions: Vec<_> = mesh.positions().iter().map(|p| format!("{p:?}")).collect();
            positions.sort();
            positions
        }
        assert_eq!(sorted_positions(&before), sorted_positions(&after), "{}", format.extension);
        let is_same = before.faces().len() == after.faces().len();
        assert_eq!(is_same, fidelity(format.fidelity, Faces) == Some(Kept), "{}", format.extension);
    }
    assert!(mismatches.is_empty(), "{mismatches:#?}");
}

#[test]
fn a_file_has_the_unit_and_the_axis_that_its_format_lists() {
    let frame = CaptureFrame { camera: None, picture: [4, 3], depth: 5.0, world_from_camera: None };
    for format in mesh_formats() {
        let file = write(format, &bare(false)).swap_remove(0).bytes;
        let inside = match format.extension {
            "3mf" => crate::three_mf::tests::files(&file).remove(2).1,
            _ => file.clone(),
        };
        fn has(text: &str, inside: &[u8]) -> bool {
            String::from_utf8_lossy(inside).contains(text)
        }
        let has_unit =
            has("unit=\"millimeter\"", &inside) || has("\"scale\":[0.001,0.001,0.001]", &inside);
        let name = format.extension;
        assert_eq!(has_unit, fidelity(format.fidelity, Units).is_some(), "{name}");
        // A capture is upside down in the axes of its sensor, so it is rotated in every format; but only some formats define which axis
        // points up.
        let seen = bare(false).with_frame(Some(frame));
        assert_ne!(write(format, &seen).swap_remove(0).bytes, file, "{name}");
    }
}
