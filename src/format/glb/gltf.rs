//! Reads glTF whose buffers and pictures are files of their own, or stand in the document as text: as the GLB file that says the same.
//!
//! So glTF of several files and GLB files have one reader.

use std::collections::HashMap;

use base64::Engine as _;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use maquette_node::reading::{FileReader, Reading};
use maquette_syntax::error;
use maquette_value::Mesh;
use percent_encoding::percent_decode_str;
use serde_json::{Value as Json, json};
use thiserror::Error;

use super::read::read_noted;
use super::{GlbReadError, container};

/// As RFC 4648, section 4, has it; the signs at its end may be missing, and what is over in its last bits is no fault.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::RequireNone)
        .with_decode_allow_trailing_bits(true),
);

/// Why bytes are not a mesh in a glTF file.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum GltfError {
    /// A buffer that cannot be had.
    #[error("buffer {index}: {why}")]
    Buffer {
        /// Its number, from 0.
        index: usize,
        /// Why not.
        why: String,
    },
    /// A buffer with fewer bytes than the document says.
    #[error("buffer {index} has {found} bytes, but it should have {expected}")]
    Short {
        /// Its number, from 0.
        index: usize,
        /// Bytes that are there.
        found: usize,
        /// Bytes that the document says.
        expected: u64,
    },
    /// More than a GLB file may have.
    #[error("the buffers and pictures have {bytes} bytes together: more than 4 GiB are not read")]
    TooLarge {
        /// Bytes that they have.
        bytes: usize,
    },
    /// What is wrong with the document, or with what it makes of the buffers.
    #[error(transparent)]
    Glb(#[from] GlbReadError),
}

/// Reads a mesh and its picture.
pub(crate) struct MeshGltf;

impl FileReader for MeshGltf {
    type Value = Mesh;
    const ENDINGS: &'static [&'static str] = &["gltf"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::GLB_READ;

    fn read(file: &Reading<'_>) -> Result<Mesh, error::Error> {
        Ok(read_gltf(file)?)
    }

    const COMPANIONS: Option<fn(&Reading<'_>)> = Some(|file| {
        let document: Json = serde_json::from_slice(file.bytes()).unwrap_or_default();
        for part in list(&document, "buffers").iter().chain(list(&document, "images")) {
            let _ = part["uri"].as_str().map(|uri| content(uri, file));
        }
    });
}

fn read_gltf(file: &Reading<'_>) -> Result<Mesh, GltfError> {
    let document = serde_json::from_slice(file.bytes()).map_err(|error| {
        let (line, column) = (error.line(), error.column());
        GlbReadError::Document { line, column, reason: error.to_string() }
    })?;
    read_document(document, &[], file)
}

/// Reads a document whose first buffer is `own` if it names no other.
pub(super) fn read_document(
    mut document: Json,
    own: &[u8],
    file: &Reading<'_>,
) -> Result<Mesh, GltfError> {
    let (mut bytes, mut starts) = (Vec::new(), Vec::new());
    // A file may be named any number of times, and is read once.
    let mut known: HashMap<&str, (usize, usize)> = HashMap::new();
    for (index, buffer) in list(&document, "buffers").iter().enumerate() {
        let refused = |why| GltfError::Buffer { index, why };
        let (start, found) = match buffer["uri"].as_str() {
            None if index == 0 && !own.is_empty() => (appended(&mut bytes, own), own.len()),
            None => return Err(refused("it names no file".to_owned())),
            Some(uri) if known.contains_key(uri) => known[uri],
            Some(uri) => {
                let content = content(uri, file).map_err(refused)?;
                *known.entry(uri).or_insert((appended(&mut bytes, &content), content.len()))
            }
        };
        let expected = buffer["byteLength"].as_u64().unwrap_or(0);
        if (found as u64) < expected {
            return Err(GltfError::Short { index, found, expected });
        }
        starts.push(start);
    }
    for view in parts(&mut document, "bufferViews") {
        // A buffer that is not there stays one, for the error.
        let start = view["buffer"].as_u64().and_then(|index| starts.get(index as usize));
        if let Some(start) = start {
            let offset = view["byteOffset"].as_u64().unwrap_or(0);
            view["byteOffset"] = offset.saturating_add(*start as u64).into();
            view["buffer"] = 0.into();
        }
    }
    let length = bytes.len();
    // What is no document has no fields, and the reader says so.
    if let Some(fields) = document.as_object_mut() {
        fields.insert("buffers".into(), json!([{ "byteLength": length }]));
    }
    let whole = container(&document, bytes).map_err(|_| GltfError::TooLarge { bytes: length })?;
    let (mesh, notes) = read_noted(&whole, &|uri| content(uri, file))?;
    notes.into_iter().for_each(|note| file.doubt(note));
    Ok(mesh)
}

fn list<'d>(document: &'d Json, name: &str) -> &'d [Json] {
    document[name].as_array().map_or(&[], |parts| parts)
}

fn parts<'d>(document: &'d mut Json, name: &str) -> &'d mut [Json] {
    document.get_mut(name).and_then(Json::as_array_mut).map_or(&mut [], |parts| parts)
}

/// Puts bytes behind others, where any number may begin, and says where.
fn appended(bytes: &mut Vec<u8>, more: &[u8]) -> usize {
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    let start = bytes.len();
    bytes.extend_from_slice(more);
    start
}

/// What a URI of a document stands for: a file beside it, or the bytes themselves.
pub(super) fn content(uri: &str, file: &Reading<'_>) -> Result<Vec<u8>, String> {
    match uri.strip_prefix("data:") {
        Some(data) => {
            let (_, text) = data.split_once(";base64,").ok_or("its bytes are not in base64")?;
            BASE64
                .decode(text.trim_end_matches('='))
                .map_err(|_| "its text is no base64".to_owned())
        }
        None => Ok(file.companion(&percent_decode_str(uri).decode_utf8_lossy())?.to_vec()),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use base64::prelude::BASE64_STANDARD;
    use maquette_value::{Attribute, Faces, Image};
    use nalgebra::Point3;

    use super::*;
    use crate::glb::read;
    use crate::png;

    fn mesh() -> Mesh {
        let positions = vec![Point3::origin(), Point3::new(1., 0., 0.), Point3::new(0., 1., 0.)];
        Mesh::new(positions, Faces::triangles(vec![[0, 1, 2]]))
            .and_then(|mesh| {
                let uv = vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
                mesh.with_vertex("uv", Attribute::Pair(uv.into()))
            })
            .unwrap()
            .with_texture(Some(Image::new(2, 1, vec![[255, 0, 0], [0, 0, 255]]).unwrap()))
    }

    /// The document and the buffer of a GLB file.
    fn split(glb: &[u8]) -> (Json, Vec<u8>) {
        let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
        let document = serde_json::from_slice(&glb[20..20 + length]).unwrap();
        (document, glb[28 + length..].to_vec())
    }

    fn read_with(document: &Json, files: &[(&str, &[u8])]) -> Result<Mesh, String> {
        let text = document.to_string();
        let beside = |name: &str| {
            let found = files.iter().find(|(known, _)| *known == name);
            found.map(|(_, bytes)| Arc::from(*bytes)).ok_or(format!("{name} is not there"))
        };
        let file = Reading::new("a.gltf", text.as_bytes(), &beside);
        read_gltf(&file).map_err(|error| error.to_string())
    }

    #[test]
    fn buffers_and_pictures_in_files_and_in_the_text_are_as_in_one_file() {
        let glb = crate::glb::encode(&mesh()).unwrap();
        let (mut document, buffer) = split(&glb);
        document["images"][0]["name"] = "my color.png".into();
        let named = container(&document, buffer.clone()).unwrap();
        let (whole, nameless) = (read(&named).unwrap(), read(&glb).unwrap());
        document["buffers"][0]["uri"] = "my%20mesh.bin".into();
        let picture = png::encode_rgb(mesh().texture().unwrap()).unwrap();
        document["images"] = json!([{ "uri": "my%20color.png" }]);
        let files = [("my mesh.bin", &buffer[..]), ("my color.png", &picture[..])];
        assert_eq!(read_with(&document, &files), Ok(whole.clone()));
        document["images"][0]["uri"] =
            format!("data:image/png;base64,{}", BASE64_STANDARD.encode(&picture)).into();
        document["buffers"][0]["uri"] =
            format!("data:application/octet-stream;base64,{}", BASE64_STANDARD.encode(&buffer))
                .into();
        assert_eq!(read_with(&document, &[]), Ok(nameless.clone()));
        // Each part of the mesh may be in a buffer of its own.
        let half = buffer.len() / 2 / 8 * 8;
        let views = document["bufferViews"].as_array().unwrap().len();
        document["buffers"] = json!([
            { "byteLength": buffer.len(), "uri": "all.bin" },
            { "byteLength": buffer.len() - half, "uri": "half.bin" },
        ]);
        for view in 0..views {
            let offset = document["bufferViews"][view]["byteOffset"].as_u64().unwrap_or(0);
            if offset >= half as u64 {
                document["bufferViews"][view]["byteOffset"] = (offset - half as u64).into();
                document["bufferViews"][view]["buffer"] = 1.into();
            }
        }
        let files = [("all.bin", &buffer[..]), ("half.bin", &buffer[half..])];
        assert_eq!(read_with(&document, &files), Ok(nameless));
    }

    #[test]
    fn what_is_missing_is_told() {
        let (mut document, buffer) = split(&crate::glb::encode(&mesh()).unwrap());
        assert_eq!(read_with(&document, &[]), Err("buffer 0: it names no file".into()));
        document["buffers"][0]["uri"] = "a.bin".into();
        assert_eq!(read_with(&document, &[]), Err("buffer 0: a.bin is not there".into()));
        let short = read_with(&document, &[("a.bin", &buffer[..9])]).unwrap_err();
        assert!(short.starts_with("buffer 0 has 9 bytes, but it should have "), "{short}");
        document["images"] = json!([{ "uri": "gone.png" }]);
        let bare = read_with(&document, &[("a.bin", &buffer)]).unwrap();
        assert!(bare.texture().is_none());
        document["buffers"][0]["uri"] = "data:;base64,?".into();
        assert!(read_with(&document, &[]).unwrap_err().contains("no base64"));
        assert!(read_with(&json!([1]), &[]).is_err());
    }

    /// As Open3D writes it.
    #[test]
    fn a_glb_file_whose_buffer_is_a_text_in_it_is_read() {
        let glb = crate::glb::encode(&mesh()).unwrap();
        let (mut document, buffer) = split(&glb);
        let text = BASE64_STANDARD.encode(&buffer);
        document["buffers"][0]["uri"] =
            format!("data:application/octet-stream;base64,{text}").into();
        let linked = container(&document, Vec::new()).unwrap();
        let file = Reading::alone("a.glb", &linked);
        assert_eq!(crate::read::<Mesh>(&file).unwrap(), read(&glb).unwrap());
    }
}
