//! Reads GLB: triangles, points, and what vertices carry.

use maquette_value::{Mesh, MeshError};
use serde_json::Value as Json;
use thiserror::Error;

use super::accessor::{Buffer, Document};
use super::scene::Scene;

/// Why bytes are not a mesh in a GLB file.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum GlbReadError {
    /// Something else, or a file that ends too early.
    #[error("byte {byte}: {what}")]
    Container {
        /// The byte, from 0.
        byte: usize,
        /// What is wrong.
        what: &'static str,
    },
    /// A document that is not glTF.
    #[error("line {line}, column {column} of the file's JSON: {reason}")]
    Document {
        /// The line, from 1.
        line: usize,
        /// The column, from 1.
        column: usize,
        /// What the parser says.
        reason: String,
    },
    /// An extension without which the file cannot be understood.
    #[error("the file needs `{name}`, which is not read{}", way_out(name))]
    Extension {
        /// The extension's name.
        name: String,
    },
    /// A part of the document that contradicts another, the buffer, or the specification.
    #[error("{part} {index} {what}")]
    Part {
        /// `accessor`, `node` and so on.
        part: &'static str,
        /// Its number, from 0.
        index: usize,
        /// What is wrong with it.
        what: &'static str,
    },
    /// Parts that use one piece of the buffer so often that a small file makes a huge mesh.
    #[error(
        "the file shows the same so often that its mesh would have over {most} numbers for each of its bytes"
    )]
    Repetition {
        /// Numbers per byte that are read.
        most: usize,
    },
    /// No vertex.
    #[error("there is no vertex in the file")]
    Empty,
    /// Vertices and faces that make no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

/// The mesh in a GLB file: all triangles and points of its scene, in mm, y up.
///
/// The nodes' motions are applied. Vertices at the same place, bit by bit, become one, since glTF splits them where texture
/// coordinates or normals differ; these become attributes of corners where they do. `NORMAL` becomes `normal`, `COLOR_0`, times the color of
/// a material without a picture, `color`, `_NAME` the attribute `NAME`; parts without them have zeros and white. Materials are kept with their pictures. The
/// texture coordinates of the picture of color become `uv`, others `uv1`, `uv2` and so on, moved as their pictures say. Pictures in other files are
/// left out, and so are lines, skins, morphs and animations.
///
/// # Errors
/// If the bytes are not a GLB file of version 2, it contradicts itself, or needs an extension that is not known.
pub fn read(bytes: &[u8]) -> Result<Mesh, GlbReadError> {
    read_noted(bytes, &|_| Err("pictures in other files are not read".to_owned()))
        .map(|(mesh, _)| mesh)
}

/// Finds a picture that a document names, or says why not.
pub(super) type Find<'a> = &'a dyn Fn(&str) -> Result<Vec<u8>, String>;

/// The same, with pictures in other files, and what the user should know of what is left out or understood in one of several ways.
pub(super) fn read_noted(
    bytes: &[u8],
    find: Find<'_>,
) -> Result<(Mesh, Vec<String>), GlbReadError> {
    let (document, buffer) = container(bytes)?;
    let mut scene = Scene::new(&document, Buffer::new(&document, buffer, bytes.len()), find);
    scene.collect()?;
    scene.finish()
}

/// What helps who has a file that needs an extension.
pub(super) fn way_out(extension: &str) -> &'static str {
    match extension {
        "KHR_draco_mesh_compression" | "EXT_meshopt_compression" | "KHR_meshopt_compression" => {
            ": save it without compression, for instance by Blender or `gltf-transform`"
        }
        "KHR_texture_basisu" => ": save it with pictures in PNG, JPEG or WebP",
        _ => ": save it without, for instance by Blender",
    }
}

/// The pictures and buffers in other files that a GLB file names.
pub(super) fn companions(bytes: &[u8]) -> Vec<String> {
    let document = container(bytes).map(|(document, _)| document).unwrap_or_default();
    let parts = document.images.into_iter().chain(document.buffers);
    parts.filter_map(|part| part.uri).collect()
}

/// The document of a GLB file that names buffers elsewhere, in other files or as text in itself, and its own buffer.
pub(super) fn with_linked_buffers(bytes: &[u8]) -> Option<(Json, &[u8])> {
    let (text, own) = chunks(bytes).ok()?;
    // Most files link nothing, and their document is parsed once.
    text.windows(5).find(|five| five == b"\"uri\"")?;
    let document: Json = serde_json::from_slice(text).ok()?;
    let is_linked = document["buffers"].as_array()?.iter().any(|buffer| buffer["uri"].is_string());
    is_linked.then_some((document, own))
}

/// The two chunks: the text of the document, and the buffer that may be missing.
fn chunks(bytes: &[u8]) -> Result<(&[u8], &[u8]), GlbReadError> {
    fn wrong(byte: usize, what: &'static str) -> GlbReadError {
        GlbReadError::Container { byte, what }
    }
    fn number(at: usize, bytes: &[u8]) -> Option<usize> {
        let number = bytes.get(at..).and_then(|rest| rest.first_chunk());
        number.map(|number| u32::from_le_bytes(*number) as usize)
    }
    if !bytes.starts_with(b"glTF") {
        return Err(wrong(0, "this is not a GLB file"));
    }
    if number(4, bytes) != Some(2) {
        return Err(wrong(4, "this is not version 2 of GLB"));
    }
    let chunk = |at: usize, kind: &[u8; 4]| {
        let length = number(at, bytes).filter(|_| bytes.get(at + 4..at + 8) == Some(&kind[..]));
        let length =
            length.ok_or(wrong(at, "there is no chunk of the kind that must stand here"))?;
        let end = (at + 8).saturating_add(length);
        bytes.get(at + 8..end).ok_or(wrong(at, "the chunk is longer than the rest of the file"))
    };
    let text = chunk(12, b"JSON")?;
    // Some programs pad it with zeros in place of spaces.
    let end = text.iter().rposition(|&byte| byte != 0).map_or(0, |last| last + 1);
    let next = 20 + text.len();
    let buffer = if next < bytes.len() { chunk(next, b"BIN\0")? } else { &[] };
    Ok((&text[..end], buffer))
}

/// The document, and the buffer that may be missing.
fn container(bytes: &[u8]) -> Result<(Document, &[u8]), GlbReadError> {
    let (text, buffer) = chunks(bytes)?;
    let document: Document = serde_json::from_slice(text).map_err(|error| {
        let (line, column) = (error.line(), error.column());
        GlbReadError::Document { line, column, reason: error.to_string() }
    })?;
    // What the positions mean is the same with these and without.
    let known = [
        "KHR_materials_unlit",
        "KHR_mesh_quantization",
        "KHR_texture_transform",
        "KHR_materials_pbrSpecularGlossiness",
        "EXT_texture_webp",
    ];
    if let Some(name) = document.extensions_required.iter().find(|name| !known.contains(&&***name))
    {
        return Err(GlbReadError::Extension { name: name.clone() });
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

    /// A quad beside a triangle, with texture coordinates that differ at a vertex.
    fn mesh() -> Mesh {
        fn at(x: f64, y: f64) -> Point3<f64> {
            Point3::new(x, y, 0.25)
        }
        let positions = vec![at(0., 0.), at(1., 0.), at(1., 1.), at(0., 1.), at(2., 0.)];
        let faces = Faces::triangles(vec![[0, 1, 2], [0, 2, 3], [1, 4, 2]]);
        let uv = (0..9).map(|k| [f64::from(k) / 16.0, 0.25]).collect();
        let colors = vec![[255, 0, 128], [1, 2, 3], [250, 128, 7], [90, 91, 92], [13, 0, 255]];
        let mesh = Mesh::new(positions, faces).unwrap();
        let mesh = mesh.with_vertex("color", Attribute::Color(colors.into())).unwrap();
        mesh.with_corner("uv", Attribute::Pair(uv)).unwrap()
    }

    fn near(a: &Mesh, b: &Mesh) {
        assert_eq!(a.faces(), b.faces());
        for (a, b) in a.positions().iter().zip(&**b.positions()) {
            assert!((a - b).norm() < 1e-12, "{a} {b}");
        }
    }

    #[test]
    fn a_mesh_that_was_written_reads_the_same() {
        let mesh = mesh();
        let again = read(&encode(&mesh).unwrap()).unwrap();
        near(&again, &mesh);
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
        near(&upright, &mesh().with_positions(turned).unwrap());
        assert!(upright.vertex().vectors("normal").unwrap()[0][2] < -0.99);
    }

    #[test]
    fn files_of_others_read() {
        let colored = include_bytes!("../../../tests/data/formats/colored.glb");
        let mesh = read(colored).unwrap();
        assert_eq!((mesh.positions().len(), mesh.faces().len()), (4, 4));
        assert!((mesh.positions()[1] - Point3::new(2000.0, 2000.0, 3000.0)).norm() < 1e-9);
        let colors = mesh.vertex().colors("color").unwrap();
        assert_eq!(colors[..3], [[255, 0, 0], [0, 255, 0], [0, 0, 255]]);
        let textured = include_bytes!("../../../tests/data/formats/textured.glb");
        let mesh = read(textured).unwrap();
        assert_eq!(mesh.texture().unwrap().at([0, 0]), [255, 0, 0]);
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        assert_eq!(mesh.vertex().pairs("uv").unwrap()[..], corners);
    }

    #[test]
    fn points_stay_apart() {
        let points = Mesh::new(vec![Point3::origin(); 3], Faces::triangles(vec![])).unwrap();
        assert_eq!(read(&encode(&points).unwrap()).unwrap().positions().len(), 3);
    }

    /// A file with another document around the same buffer.
    fn with_document(change: impl FnOnce(&mut Value)) -> Result<Mesh, GlbReadError> {
        let bytes = encode(&mesh()).unwrap();
        let length = u32::from_le_bytes(*bytes[12..].first_chunk().unwrap()) as usize;
        let mut document: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
        change(&mut document);
        let buffer = bytes[20 + length + 8..].to_vec();
        read(&written(&document, buffer).unwrap())
    }

    #[test]
    fn nodes_move_and_mirror_what_hangs_on_them() {
        let moved = with_document(|document| {
            document["nodes"][0]["translation"] = json!([1.0, 0.0, 0.0]);
            document["nodes"][1]["scale"] = json!([-1.0, 1.0, 2.0]);
        });
        let moved = moved.unwrap();
        let place = moved.positions()[1];
        assert!((place - Point3::new(999.0, 0.0, 0.5)).norm() < 1e-12, "{place}");
        // The outside stays outside.
        assert!(moved.area_vector(moved.faces().face(0)).z > 0.0);
        assert!((moved.vertex().vectors("normal").unwrap()[0][2] - 1.0).abs() < 1e-12);
        let matrix = with_document(|document| {
            let matrix = [0., 1., 0., 0., -1., 0., 0., 0., 0., 0., 1., 0., 0., 0., 5., 1.];
            document["nodes"][1]["matrix"] = json!(matrix);
        });
        let place = matrix.unwrap().positions()[1];
        assert!((place - Point3::new(0.0, 1.0, 5.25)).norm() < 1e-12, "{place}");
    }

    #[test]
    fn documents_that_lie_are_refused() {
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
            "accessor 0 has sparse entries outside of the buffer"
        );
        let behind = with_sparse(sparse(5125, 3));
        assert_eq!(behind, "accessor 0 has a sparse entry behind its end");
        assert_eq!(
            error(|d| d["extensionsRequired"] = json!(["KHR_draco_mesh_compression"])),
            "the file needs `KHR_draco_mesh_compression`, which is not read: save it without compression, for instance by Blender or \
             `gltf-transform`"
        );
        let repeated = error(|d| {
            // A small document shows the mesh some thousand times.
            d["meshes"][0]["primitives"][0]["attributes"] = json!({ "POSITION": 0 });
            let primitive = d["meshes"][0]["primitives"][0].clone();
            d["meshes"][0]["primitives"] = Value::from(vec![primitive; 20]);
            d["nodes"] = (0..2000).map(|_| json!({ "mesh": 0 })).collect();
            d["scenes"] = json!([]);
        });
        assert!(repeated.contains("over 4 numbers for each of its bytes"), "{repeated}");
        let bytes = encode(&mesh()).unwrap();
        let text = "byte 12: the chunk is longer than the rest of the file";
        assert_eq!(read(&bytes[..100]).unwrap_err().to_string(), text);
        assert_eq!(read(b"glTg").unwrap_err().to_string(), "byte 0: this is not a GLB file");
    }

    #[test]
    fn hostile_files_give_errors() {
        let image = Image::new(2, 1, vec![[9, 8, 7], [1, 2, 3]]).unwrap();
        hostile::survive(&encode(&mesh().with_texture(Some(image))).unwrap(), read);
    }
}
