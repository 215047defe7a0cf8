//! Reads GLB: triangles, points and the attributes of vertices.

use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::Mesh;
use serde_json::Value as Json;

use super::accessor::{Buffer, Document};
use super::scene::Scene;

/// Reads the triangles and points of the scene of a GLB file as a mesh, in mm, y up.
///
/// The transformations of the nodes are applied. glTF duplicates vertices where texture coordinates or normals differ; vertices with
/// bitwise equal positions are merged here, and data that differ become attributes of corners. `NORMAL` becomes `normal`. `COLOR_0`,
/// multiplied by the color of a material without a picture, becomes `color`. `_NAME` becomes the attribute `NAME`. Parts of the mesh that
/// lack such data get zeros, or white. Materials are kept with their pictures. The texture coordinates of the color picture become `uv`,
/// others `uv1`, `uv2` and so on, with the transformation of their picture applied. Pictures in other files are left out, and so are lines,
/// skins, morph targets and animations.
///
/// Returns an error if the bytes are not a GLB file of version 2, the file contradicts itself, or it needs an unknown extension.
pub fn read(bytes: &[u8]) -> Result<Mesh, Error> {
    read_with_notes(bytes, &|_| Err("pictures in other files are not read".to_owned()))
        .map(|(mesh, _)| mesh)
}

/// Loads a file that a document names, or returns the reason why the file cannot be loaded.
pub(super) type FindFile<'a> = &'a dyn Fn(&str) -> Result<Vec<u8>, String>;

/// Reads a mesh like [`read`], but also pictures in other files. Returns warnings about data that are left out or ambiguous, too.
pub(super) fn read_with_notes(
    bytes: &[u8],
    find: FindFile<'_>,
) -> Result<(Mesh, Vec<String>), Error> {
    let (document, buffer) = container(bytes)?;
    let mut scene = Scene::new(&document, Buffer::new(&document, buffer, bytes.len()), find);
    scene.collect()?;
    scene.finish()
}

/// Returns the error that a part of the document contradicts another part, the buffer or the specification. `part` is the kind of the part,
/// such as `accessor`, and `index` its index, from 0.
pub(super) fn part_error(part: &str, index: usize, problem: &str) -> Error {
    Error::new(format!("{part} {index} {problem}"))
}

/// Returns the error that a required extension is not supported.
pub(super) fn extension_error(name: &str) -> Error {
    let help = extension_help(name);
    Error::new(format!("the file requires `{name}`, which is not supported{help}"))
}

/// Returns the error that the document is not glTF.
pub(super) fn document_error(error: &serde_json::Error) -> Error {
    let (line, column) = (error.line(), error.column());
    Error::new(format!("line {line}, column {column} of the file's JSON: {error}"))
}

/// Returns the help text for a file that needs the extension.
pub(super) fn extension_help(extension: &str) -> &'static str {
    match extension {
        "KHR_draco_mesh_compression" | "EXT_meshopt_compression" | "KHR_meshopt_compression" => {
            ": save it without compression, for instance with Blender or `gltf-transform`"
        }
        "KHR_texture_basisu" => ": save it with pictures in PNG, JPEG or WebP",
        _ => ": save it without the extension, for instance with Blender",
    }
}

/// Returns the other files to which a GLB file refers: pictures and buffers.
pub(super) fn companions(bytes: &[u8]) -> Vec<String> {
    let document = container(bytes).map(|(document, _)| document).unwrap_or_default();
    let parts = document.images.into_iter().chain(document.buffers);
    parts.filter_map(|part| part.uri).collect()
}

/// Returns the document and the buffer of a GLB file if the document refers to buffers in other files or in data URIs; else `None`.
pub(super) fn with_linked_buffers(bytes: &[u8]) -> Option<(Json, &[u8])> {
    let (text, embedded) = chunks(bytes).ok()?;
    // Most files have no URIs. This test avoids parsing their document twice.
    text.windows(5).find(|five| five == b"\"uri\"")?;
    let document: Json = serde_json::from_slice(text).ok()?;
    let is_linked = document["buffers"].as_array()?.iter().any(|buffer| buffer["uri"].is_string());
    is_linked.then_some((document, embedded))
}

/// Returns the two chunks of a file: the text of the document, and the buffer. The buffer is empty if it is missing.
fn chunks(bytes: &[u8]) -> Result<(&[u8], &[u8]), Error> {
    fn number(at: usize, bytes: &[u8]) -> Option<usize> {
        let number = bytes.get(at..).and_then(|rest| rest.first_chunk());
        number.map(|number| u32::from_le_bytes(*number) as usize)
    }
    if !bytes.starts_with(b"glTF") {
        bail!("byte 0: this is not a GLB file");
    }
    if number(4, bytes) != Some(2) {
        bail!("byte 4: this is not version 2 of GLB");
    }
    let chunk = |at: usize, kind: &[u8; 4]| {
        let length = number(at, bytes).filter(|_| bytes.get(at + 4..at + 8) == Some(&kind[..]));
        let Some(length) = length else { bail!("byte {at}: expected another kind of chunk") };
        let Some(chunk) = bytes.get(at + 8..(at + 8).saturating_add(length)) else {
            bail!("byte {at}: the chunk is longer than the rest of the file");
        };
        Ok(chunk)
    };
    let text = chunk(12, b"JSON")?;
    // Some programs pad the text with zeros instead of spaces.
    let end = text.iter().rposition(|&byte| byte != 0).map_or(0, |last| last + 1);
    let next = 20 + text.len();
    let buffer = if next < bytes.len() { chunk(next, b"BIN\0")? } else { &[] };
    Ok((&text[..end], buffer))
}

/// Parses the document. Returns it with the buffer, which is empty if it is missing.
fn container(bytes: &[u8]) -> Result<(Document, &[u8]), Error> {
    let (text, buffer) = chunks(bytes)?;
    let document: Document =
        serde_json::from_slice(text).map_err(|error| document_error(&error))?;
    // The following extensions are accepted because they do not change the positions.
    let known = [
        "KHR_materials_unlit",
        "KHR_mesh_quantization",
        "KHR_texture_transform",
        "KHR_materials_pbrSpecularGlossiness",
        "EXT_texture_webp",
    ];
    if let Some(name) = document.extensions_required.iter().find(|name| !known.contains(&&***name))
    {
        return Err(extension_error(name));
    }
    Ok((document, buffer))
}

#[cfg(test)]
mod tests {
    use maquette_value::{Attribute, CaptureFrame, Faces, Image};
    use nalgebra::Point3;
    use serde_json::{Value, json};

    use super::super::{container as written, encode};
    use super::*;
    use crate::hostile;

    /// Creates a quad beside a triangle, with texture coordinates that differ at one vertex.
    fn mesh() -> Mesh {
        fn point(x: f64, y: f64) -> Point3<f64> {
            Point3::new(x, y, 0.25)
        }
        let positions =
            vec![point(0., 0.), point(1., 0.), point(1., 1.), point(0., 1.), point(2., 0.)];
        let faces = Faces::triangles(vec![[0, 1, 2], [0, 2, 3], [1, 4, 2]]);
        let uv = (0..9).map(|k| [f64::from(k) / 16.0, 0.25]).collect();
        let colors = vec![[255, 0, 128], [1, 2, 3], [250, 128, 7], [90, 91, 92], [13, 0, 255]];
        let mesh = Mesh::new(positions, faces).unwrap();
        let mesh = mesh.with_vertex("color", Attribute::Color(colors.into())).unwrap();
        mesh.with_corner("uv", Attribute::Pair(uv)).unwrap()
    }

    fn assert_near(a: &Mesh, b: &Mesh) {
        assert_eq!(a.faces(), b.faces());
        for (a, b) in a.positions().iter().zip(&**b.positions()) {
            assert!((a - b).norm() < 1e-12, "{a} {b}");
        }
    }

    #[test]
    fn a_written_mesh_is_read_back() {
        let mesh = mesh();
        let again = read(&encode(&mesh).unwrap()).unwrap();
        assert_near(&again, &mesh);
        assert_eq!(again.corner().pairs("uv"), mesh.corner().pairs("uv"));
        assert_eq!(again.vertex().colors("color"), mesh.vertex().colors("color"));
        assert_eq!(again.vertex().vectors("normal").unwrap()[..], [[0.0, 0.0, 1.0]; 5]);
        let image = Image::new(2, 1, vec![[9, 8, 7], [1, 2, 3]]).unwrap();
        let textured = read(&encode(&mesh.with_texture(Some(image.clone()))).unwrap()).unwrap();
        assert_eq!(textured.texture(), Some(&image));
    }

    #[test]
    fn a_capture_comes_back_upright() {
        let frame =
            CaptureFrame { camera: None, picture: [2, 2], depth: 700.0, world_from_camera: None };
        let upright = read(&encode(&mesh().with_frame(Some(frame))).unwrap()).unwrap();
        let turned = mesh().positions().iter().map(|p| Point3::new(p.x, -p.y, -p.z)).collect();
        assert_near(&upright, &mesh().with_positions(turned).unwrap());
        assert!(upright.vertex().vectors("normal").unwrap()[0][2] < -0.99);
    }

    #[test]
    fn files_of_other_programs_are_read() {
        let colored = include_bytes!("../../../tests/data/formats/colored.glb");
        let mesh = read(colored).unwrap();
        assert_eq!((mesh.positions().len(), mesh.faces().len()), (4, 4));
        assert!((mesh.positions()[1] - Point3::new(2000.0, 2000.0, 3000.0)).norm() < 1e-9);
        let colors = mesh.vertex().colors("color").unwrap();
        assert_eq!(colors[..3], [[255, 0, 0], [0, 255, 0], [0, 0, 255]]);
        let textured = include_bytes!("../../../tests/data/formats/textured.glb");
        let mesh = read(textured).unwrap();
        assert_eq!(mesh.texture().unwrap().pixel([0, 0]), [255, 0, 0]);
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        assert_eq!(mesh.vertex().pairs("uv").unwrap()[..], corners);
    }

    #[test]
    fn coincident_points_are_not_merged() {
        let points = Mesh::new(vec![Point3::origin(); 3], Faces::triangles(vec![])).unwrap();
        assert_eq!(read(&encode(&points).unwrap()).unwrap().positions().len(), 3);
    }

    /// Changes the document of a file by `change`, and reads the file.
    fn with_document(change: impl FnOnce(&mut Value)) -> Result<Mesh, Error> {
        let bytes = encode(&mesh()).unwrap();
        let length = u32::from_le_bytes(*bytes[12..].first_chunk().unwrap()) as usize;
        let mut document: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
        change(&mut document);
        let buffer = bytes[20 + length + 8..].to_vec();
        read(&written(&document, buffer).unwrap())
    }

    #[test]
    fn node_transformations_are_applied() {
        let moved = with_document(|document| {
            document["nodes"][0]["translation"] = json!([1.0, 0.0, 0.0]);
            document["nodes"][1]["scale"] = json!([-1.0, 1.0, 2.0]);
        });
        let moved = moved.unwrap();
        let position = moved.positions()[1];
        assert!((position - Point3::new(999.0, 0.0, 0.5)).norm() < 1e-12, "{position}");
        // When the mesh is mirrored, its faces must stay oriented outwards.
        assert!(moved.area_vector(moved.faces().face(0)).z > 0.0);
        assert!((moved.vertex().vectors("normal").unwrap()[0][2] - 1.0).abs() < 1e-12);
        let matrix = with_document(|document| {
            let matrix = [0., 1., 0., 0., -1., 0., 0., 0., 0., 0., 1., 0., 0., 0., 5., 1.];
            document["nodes"][1]["matrix"] = json!(matrix);
        });
        let position = matrix.unwrap().positions()[1];
        assert!((position - Point3::new(0.0, 1.0, 5.25)).norm() < 1e-12, "{position}");
    }

    #[test]
    fn invalid_documents_are_rejected() {
        fn error(change: fn(&mut Value)) -> String {
            with_document(change).unwrap_err().to_string()
        }
        assert_eq!(error(|d| d["nodes"][1]["children"] = json!([0])), "node 0 has two parents");
        assert_eq!(error(|d| d["nodes"][0]["children"] = json!([9])), "node 9 does not exist");
        assert_eq!(error(|d| d["nodes"][1]["mesh"] = json!(1)), "mesh 1 does not exist");
        assert_eq!(
            error(|d| d["accessors"][0]["count"] = json!(1_000_000)),
            "accessor 0 is longer than its part of the buffer"
        );
        assert_eq!(
            error(|d| d["bufferViews"][0]["byteLength"] = json!(u64::MAX)),
            "bufferView 0 is not inside the buffer"
        );
        fn sparse(index: u32, count: usize) -> Value {
            let indices = json!({ "bufferView": 0, "componentType": index });
            json!({ "count": count, "indices": indices, "values": { "bufferView": 0 } })
        }
        fn with_sparse(sparse: Value) -> String {
            with_document(|d| d["accessors"][0]["sparse"] = sparse).unwrap_err().to_string()
        }
        assert_eq!(with_sparse(sparse(1, 1)), "accessor 0 has sparse indices of an unknown type");
        assert_eq!(
            with_sparse(sparse(5121, 999)),
            "accessor 0 has sparse entries outside the buffer"
        );
        let message = with_sparse(sparse(5125, 3));
        assert_eq!(message, "accessor 0 has a sparse entry after its end");
        assert_eq!(
            error(|d| d["extensionsRequired"] = json!(["KHR_draco_mesh_compression"])),
            "the file requires `KHR_draco_mesh_compression`, which is not supported: save it without compression, for instance with Blender or \
             `gltf-transform`"
        );
        let repeated = error(|d| {
            // The small document in this test uses the mesh thousands of times.
            d["meshes"][0]["primitives"][0]["attributes"] = json!({ "POSITION": 0 });
            let primitive = d["meshes"][0]["primitives"][0].clone();
            d["meshes"][0]["primitives"] = Value::from(vec![primitive; 20]);
            d["nodes"] = (0..2000).map(|_| json!({ "mesh": 0 })).collect();
            d["scenes"] = json!([]);
        });
        assert!(repeated.contains("over 4 numbers per byte"), "{repeated}");
        let bytes = encode(&mesh()).unwrap();
        let text = "byte 12: the chunk is longer than the rest of the file";
        assert_eq!(read(&bytes[..100]).unwrap_err().to_string(), text);
        assert_eq!(read(b"glTg").unwrap_err().to_string(), "byte 0: this is not a GLB file");
    }

    #[test]
    fn hostile_files_give_errors() {
        let image = Image::new(2, 1, vec![[9, 8, 7], [1, 2, 3]]).unwrap();
        hostile::check_no_panic(&encode(&mesh().with_texture(Some(image))).unwrap(), read);
    }
}
