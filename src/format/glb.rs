//! GLB, the binary form of glTF 2.0: meshes for viewers and engines.
//!
//! Khronos Group, "glTF 2.0 Specification", 2.0.1 (2021). glTF uses meters, with y up and +z towards the viewer. So a root node scales the
//! mesh by 0.001, and rotates a mesh that has a capture frame (y down, z away) by 180 degrees about x. The stored positions are those of
//! the mesh.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::iter;

use maquette_node::importers::{FileReader, InputFile};
use maquette_node::pack::{Content, FileFormat, NewFile};
use maquette_node::provenance::{Signature, extras_of_glb, pad};
use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::{Attribute, Material, Mesh, MeshError};
use serde_json::{Value, json};

use super::losses;
use super::rows::{Table, concatenate};
use super::{check_mesh, mesh_precision_note};

mod accessor;
mod buffers;
mod gltf;
mod material;
mod material_writer;
mod read;
mod scene;
mod size;

use buffers::{Buffers, Vertices};
pub(crate) use gltf::MeshGltf;
use material_writer::MaterialWriter;
pub(crate) use material_writer::{is_extension, vertex_colors_equal_material};
pub use read::read;
use read::{companions, read_with_notes};

// The following constants are defined by the glTF specification.
const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const POINTS: u32 = 0;
const TRIANGLES: u32 = 4;
const LINEAR: u32 = 9729;
const LINEAR_MIPMAP_LINEAR: u32 = 9987;
const CLAMP_TO_EDGE: u32 = 33071;
const MIRRORED_REPEAT: u32 = 33648;
const REPEAT: u32 = 10497;

/// Writes a mesh with normals, and its materials or vertex colors.
pub(super) struct MeshGlb;

impl FileFormat for MeshGlb {
    type Value = Mesh;
    const EXTENSION: &'static str = "glb";
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::GLB;

    fn write(mesh: &Mesh, name: &str) -> Result<Vec<NewFile>, Error> {
        Ok(NewFile::single(name, encode(mesh)?))
    }

    fn content<'a>(
        mesh: &'a Mesh,
        signature: Option<&Signature>,
    ) -> Result<Option<Content<'a>>, Error> {
        content(mesh, signature).map(Some)
    }

    fn warnings(mesh: &Mesh) -> Vec<String> {
        mesh_precision_note(mesh)
            .into_iter()
            .chain(losses::mesh_warning(mesh, <Self as FileFormat>::FIDELITY))
            .chain(losses::flags_warning(mesh))
            .chain(losses::materials_warning(mesh, material_writer::is_redundant))
            .chain(material_writer::rounding_warnings(mesh))
            .collect()
    }
}

fn encode(mesh: &Mesh) -> Result<Vec<u8>, Error> {
    Ok(content(mesh, None)?.into_bytes())
}

fn content<'a>(mesh: &'a Mesh, signature: Option<&Signature>) -> Result<Content<'a>, Error> {
    if mesh.positions().is_empty() {
        bail!("a mesh without vertices cannot be written as GLB");
    }
    check_mesh(mesh)?;
    let mut file = Buffers::default();
    let (mut primitives, mut writer, mut known_normals) =
        (Vec::new(), MaterialWriter::default(), None);
    let unknown = [Material::default()];
    let materials = if mesh.materials().is_empty() { &unknown } else { &mesh.materials()[..] };
    let mut part_materials = Vec::new();
    for (index, (number, part)) in parts(mesh)?.into_iter().enumerate() {
        let material = &materials[number as usize];
        let vertices = Vertices::new(&part);
        let mut attributes = json!({ "POSITION": file.positions(&vertices) });
        if !part.faces().is_empty() {
            let (accessor, normals) = file.normals(&vertices);
            attributes["NORMAL"] = accessor.into();
            known_normals = normals;
        }
        let sets = material_writer::coordinate_sets(&vertices);
        for (set_index, set) in sets.iter().enumerate() {
            let transform = material_writer::uv_transform(material, set);
            attributes[format!("TEXCOORD_{set_index}")] = file.uv(&vertices, set, transform).into();
        }
        let has_picture = material.picture.is_some() && sets.first().is_some_and(|set| set == "uv");
        let has_colors = vertices.has_colors()
            && match has_picture {
                true => material.has_vertex_colors,
                false => material.is_plain() || !vertex_colors_equal_material(mesh, number),
            };
        if has_colors {
            attributes["COLOR_0"] = file.colors(&vertices).into();
        }
        for (name, attribute) in vertices.custom_attributes() {
            let prefix = if name.starts_with('_') { "" } else { "_" };
            attributes[format!("{prefix}{name}")] =
                file.custom_attribute(&vertices, name, attribute).into();
        }
        let mut primitive = json!({ "attributes": attributes, "material": index, "mode": POINTS });
        if !part.faces().is_empty() {
            primitive["mode"] = TRIANGLES.into();
            primitive["indices"] = file.triangles(vertices).into();
        }
        primitives.push(primitive);
        part_materials.push((material, sets, has_colors));
    }
    if primitives.len() > 1 {
        known_normals = None;
    }
    // Pictures are stored after all other data.
    for (material, sets, has_colors) in part_materials {
        writer.add(material, &sets, has_colors, &mut file)?;
    }
    let mut root = json!({ "name": "root", "children": [1], "scale": [0.001, 0.001, 0.001] });
    if mesh.frame().is_some() {
        // The quaternion x, y, z, w of a rotation by 180 degrees about x.
        root["rotation"] = json!([1.0, 0.0, 0.0, 0.0]);
    }
    let length = file.length;
    file.align();
    let mut document = json!({
        "asset": { "version": "2.0", "generator": "maquette" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [root, { "name": "mesh", "mesh": 0 }],
        "meshes": [{ "primitives": primitives }],
        "materials": [],
        "accessors": file.accessors,
        "bufferViews": file.views,
        "buffers": [{ "byteLength": length }],
    });
    writer.finish(&mut document);
    if let Some(extras) = signature.and_then(|signature| extras_of_glb(&signature.words)) {
        document["asset"]["extras"] = extras;
    }
    let text = document.to_string();
    let text = if signature.is_some() { pad(text) } else { text };
    let head = Table::from_bytes(head(text, file.length)?);
    Ok(concatenate(iter::once(head).chain(file.tables).collect()).with_cached_data(known_normals))
}

/// Splits the mesh by material. Each part is returned with the index of its material.
fn parts(mesh: &Mesh) -> Result<Vec<(u32, Cow<'_, Mesh>)>, MeshError> {
    let Some(numbers) = mesh.face_materials() else { return Ok(vec![(0, Cow::Borrowed(mesh))]) };
    let mut faces: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (face, &number) in (0..).zip(numbers.iter()) {
        faces.entry(mesh.resolve_material(number)).or_default().push(face);
    }
    if faces.len() == 1 {
        return Ok(faces.into_keys().map(|number| (number, Cow::Borrowed(mesh))).collect());
    }
    // At the border between two parts, both parts use the normals of the whole mesh.
    let has_normals = mesh.vertex().vectors("normal").or(mesh.corner().vectors("normal")).is_some();
    let mesh_with_normals = match has_normals {
        true => Cow::Borrowed(mesh),
        false => {
            let normals = mesh.vertex_normals().into_iter().map(Into::into);
            Cow::Owned(mesh.clone().with_vertex("normal", Attribute::Vector(normals.collect()))?)
        }
    };
    Ok(faces
        .into_iter()
        .map(|(number, faces): (u32, Vec<u32>)| {
            (number, Cow::Owned(mesh_with_normals.select(&faces)))
        })
        .collect())
}

/// Packs the document and its buffer into a GLB file.
fn container(document: &Value, mut buffer: Vec<u8>) -> Result<Vec<u8>, Error> {
    buffer.resize(buffer.len().next_multiple_of(4), 0);
    let mut bytes = head(document.to_string(), buffer.len())?;
    bytes.append(&mut buffer);
    Ok(bytes)
}

/// Returns the bytes before the buffer: a header of 12 bytes, a chunk header of 8 bytes, the document padded to a multiple of 4 bytes, and
/// the chunk header of the buffer. The length of the buffer must be a multiple of 4.
fn head(document: String, buffer: usize) -> Result<Vec<u8>, Error> {
    let mut text = document.into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let size = 12 + 8 + text.len() + 8 + buffer;
    let Ok(total) = u32::try_from(size) else {
        bail!("{size} bytes are more than the 4 GiB of a GLB file");
    };
    fn number(number: usize) -> [u8; 4] {
        (number as u32).to_le_bytes()
    }
    let mut bytes = [&b"glTF"[..], &number(2), &total.to_le_bytes()].concat();
    bytes.extend([&number(text.len())[..], b"JSON", &text, &number(buffer), b"BIN\0"].concat());
    Ok(bytes)
}

impl FileReader for MeshGlb {
    type Value = Mesh;
    const EXTENSIONS: &'static [&'static str] = &["glb"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::GLB_READ;
    const SIZE: crate::SizeReader = Some(size::mesh);

    fn read(file: &InputFile<'_>) -> Result<Mesh, Error> {
        if let Some((document, embedded)) = read::with_linked_buffers(file.bytes()) {
            return gltf::read_document(document, embedded, file);
        }
        let (mesh, notes) = read_with_notes(file.bytes(), &|uri| gltf::content(uri, file))?;
        notes.into_iter().for_each(|note| file.warn(note));
        Ok(mesh)
    }

    const COMPANIONS: Option<fn(&InputFile<'_>)> = Some(|file| {
        companions(file.bytes()).iter().for_each(|uri| drop(gltf::content(uri, file)));
    });
}

#[cfg(test)]
mod tests {
    use maquette_value::{Attribute, CaptureFrame, Faces, Image};
    use nalgebra::Point3;

    use super::super::rows::floats;
    use super::*;

    /// Creates a quad beside a triangle.
    fn mesh() -> Mesh {
        fn point(x: f64, y: f64) -> Point3<f64> {
            Point3::new(x, y, 0.25)
        }
        let positions =
            vec![point(0., 0.), point(1., 0.), point(1., 1.), point(0., 1.), point(2., 0.)];
        let faces = Faces::polygons(&[4, 3], vec![0, 1, 2, 3, 1, 4, 2]).unwrap();
        Mesh::new(positions, faces).unwrap()
    }

    fn uv(count: u32) -> Attribute {
        Attribute::Pair((0..count).map(|i| [f64::from(i) / 8.0, 0.25]).collect())
    }

    /// Splits a file into its document and its buffer, and checks the structure of the file.
    fn parts(mesh: &Mesh) -> (Value, Vec<u8>) {
        let bytes = encode(mesh).unwrap();
        fn number(at: usize, bytes: &[u8]) -> usize {
            u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
        }
        assert_eq!(
            (&bytes[..4], number(4, &bytes), number(8, &bytes)),
            (&b"glTF"[..], 2, bytes.len())
        );
        let length = number(12, &bytes);
        assert_eq!((&bytes[16..20], length % 4), (&b"JSON"[..], 0));
        let document: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
        let binary = &bytes[20 + length..];
        assert_eq!((&binary[4..8], binary.len() % 4), (&b"BIN\0"[..], 0));
        assert_eq!(number(20 + length, &bytes), binary.len() - 8);
        for view in document["bufferViews"].as_array().unwrap() {
            let [offset, length] =
                ["byteOffset", "byteLength"].map(|key| view[key].as_u64().unwrap());
            assert_eq!(offset % 4, 0);
            assert!(offset + length <= document["buffers"][0]["byteLength"].as_u64().unwrap());
        }
        (document, binary[8..].to_vec())
    }

    /// Returns the bytes to which an accessor refers.
    fn data<'a>((document, buffer): &'a (Value, Vec<u8>), accessor: &Value) -> &'a [u8] {
        let accessor = &document["accessors"][accessor.as_u64().unwrap() as usize];
        let view = &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let [offset, length] = ["byteOffset", "byteLength"].map(|key| view[key].as_u64().unwrap());
        &buffer[offset as usize..][..length as usize]
    }

    #[test]
    fn polygons_become_fans() {
        let parts = parts(&mesh());
        let primitive = &parts.0["meshes"][0]["primitives"][0];
        let expected = [[0, 1, 2], [0, 2, 3], [1, 4, 2]].as_flattened().iter();
        let expected: Vec<_> = expected.flat_map(|index: &u32| index.to_le_bytes()).collect();
        assert_eq!(data(&parts, &primitive["indices"]), expected);
        let accessor = &parts.0["accessors"][0];
        assert_eq!(accessor["min"], json!([0.0, 0.0, 0.25]));
        assert_eq!(accessor["max"], json!([2.0, 1.0, 0.25]));
    }

    #[test]
    fn a_capture_is_rotated_upright_and_all_meshes_are_scaled_to_meters() {
        let plain = parts(&mesh()).0;
        assert_eq!(plain["nodes"][0]["scale"], json!([0.001, 0.001, 0.001]));
        assert_eq!(plain["nodes"][0]["rotation"], Value::Null);
        let frame =
            CaptureFrame { camera: None, picture: [2, 2], depth: 700.0, world_from_camera: None };
        let captured = parts(&mesh().with_frame(Some(frame))).0;
        assert_eq!(captured["nodes"][0]["rotation"], json!([1.0, 0.0, 0.0, 0.0]));
    }

    #[test]
    fn corners_with_different_texture_coordinates_become_vertices() {
        let image = Image::new(2, 2, vec![[9; 3]; 4]).unwrap();
        let mesh = mesh().with_corner("uv", uv(7)).unwrap().with_texture(Some(image.clone()));
        let parts = parts(&mesh);
        let primitive = &parts.0["meshes"][0]["primitives"][0];
        let expected = [0, 1, 2, 0, 2, 3, 4, 5, 6];
        let expected: Vec<_> =
            expected.iter().flat_map(|index: &u32| index.to_le_bytes()).collect();
        assert_eq!(data(&parts, &primitive["indices"]), expected);
        let coordinates = data(&parts, &primitive["attributes"]["TEXCOORD_0"]);
        assert_eq!(coordinates[8..16], *floats([0.125, 0.75]).as_flattened());
        let view = parts.0["bufferViews"].as_array().unwrap().last().unwrap();
        let picture = &parts.1[view["byteOffset"].as_u64().unwrap() as usize..];
        assert_eq!(crate::png::read(picture).unwrap(), image);
    }

    #[test]
    fn colors_are_linear_and_a_texture_replaces_them() {
        let colors = Attribute::Color(vec![[255, 0, 128]; 5].into());
        let mesh = mesh().with_vertex("color", colors).unwrap();
        let colored = parts(&mesh);
        let accessor = &colored.0["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"];
        // 128 in sRGB is 0.2158605 in linear light.
        let expected = [65535, 0, 14146, 65535].map(u16::to_le_bytes);
        assert_eq!(data(&colored, accessor)[..8], *expected.as_flattened());
        let image = Image::new(1, 1, vec![[9; 3]]).unwrap();
        let textured = mesh.with_vertex("uv", uv(5)).unwrap().with_texture(Some(image));
        let textured = parts(&textured).0;
        assert_eq!(textured["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"], Value::Null);
        assert_eq!(textured["textures"], json!([{ "sampler": 0, "source": 0 }]));
    }

    #[test]
    fn a_mesh_without_faces_is_points() {
        let mesh = Mesh::new(vec![Point3::origin()], Faces::triangles(vec![])).unwrap();
        let document = parts(&mesh).0;
        let primitive = &document["meshes"][0]["primitives"][0];
        assert_eq!((&primitive["mode"], &primitive["indices"]), (&json!(0), &Value::Null));
    }

    #[test]
    fn a_mesh_without_vertices_is_rejected() {
        fn no_faces() -> Faces {
            Faces::triangles(vec![])
        }
        let empty = Mesh::new(vec![], no_faces()).unwrap();
        let error = encode(&empty).unwrap_err().to_string();
        assert_eq!(error, "a mesh without vertices cannot be written as GLB");
    }
}
