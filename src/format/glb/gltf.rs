//! Reads glTF files whose buffers and pictures are other files or data URIs, by converting them to GLB.
//!
//! Because of this conversion, glTF and GLB files share one reader.

use std::collections::HashMap;

use base64::Engine as _;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use maquette_node::importers::{FileReader, InputFile};
use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::Mesh;
use percent_encoding::percent_decode_str;
use serde_json::{Value as Json, json};

use super::container;
use super::read::{document_error, read_with_notes};

/// The decoder of Base64: RFC 4648, section 4. Padding may be missing, and trailing bits are ignored.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::RequireNone)
        .with_decode_allow_trailing_bits(true),
);

/// Reads a mesh with its materials from a glTF file.
pub(crate) struct MeshGltf;

impl FileReader for MeshGltf {
    type Value = Mesh;
    const EXTENSIONS: &'static [&'static str] = &["gltf"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::GLB_READ;

    fn read(file: &InputFile<'_>) -> Result<Mesh, Error> {
        let document: Result<Json, _> = serde_json::from_slice(file.bytes());
        read_document(document.map_err(|error| document_error(&error))?, &[], file)
    }

    const COMPANIONS: Option<fn(&InputFile<'_>)> = Some(|file| {
        let document: Json = serde_json::from_slice(file.bytes()).unwrap_or_default();
        for part in list(&document, "buffers").iter().chain(list(&document, "images")) {
            let _ = part["uri"].as_str().map(|uri| content(uri, file));
        }
    });
}

/// Reads a document. `embedded` is the content of the document's first buffer if this buffer has no URI.
pub(super) fn read_document(
    mut document: Json,
    embedded: &[u8],
    file: &InputFile<'_>,
) -> Result<Mesh, Error> {
    let (mut bytes, mut starts) = (Vec::new(), Vec::new());
    // If several buffers name the same file, it is loaded once.
    let mut known: HashMap<&str, (usize, usize)> = HashMap::new();
    for (index, buffer) in list(&document, "buffers").iter().enumerate() {
        let (start, found) = match buffer["uri"].as_str() {
            None if index == 0 && !embedded.is_empty() => {
                (append_aligned(&mut bytes, embedded), embedded.len())
            }
            None => bail!("buffer {index}: it has no URI"),
            Some(uri) if known.contains_key(uri) => known[uri],
            Some(uri) => {
                let content = content(uri, file)
                    .map_err(|why| Error::new(format!("buffer {index}: {why}")))?;
                *known.entry(uri).or_insert((append_aligned(&mut bytes, &content), content.len()))
            }
        };
        let expected = buffer["byteLength"].as_u64().unwrap_or(0);
        if (found as u64) < expected {
            bail!("buffer {index} has {found} bytes, but it should have {expected}");
        }
        starts.push(start);
    }
    for view in parts(&mut document, "bufferViews") {
        // A view that refers to a missing buffer is not changed; the reader reports the error.
        let start = view["buffer"].as_u64().and_then(|index| starts.get(index as usize));
        if let Some(start) = start {
            let offset = view["byteOffset"].as_u64().unwrap_or(0);
            view["byteOffset"] = offset.saturating_add(*start as u64).into();
            view["buffer"] = 0.into();
        }
    }
    let length = bytes.len();
    // If the document is not a JSON object, the reader reports the error.
    if let Some(fields) = document.as_object_mut() {
        fields.insert("buffers".into(), json!([{ "byteLength": length }]));
    }
    let Ok(file_bytes) = container(&document, bytes) else {
        bail!(
            "the buffers and pictures have {length} bytes together, more than the maximum of 4 GiB"
        );
    };
    let (mesh, notes) = read_with_notes(&file_bytes, &|uri| content(uri, file))?;
    notes.into_iter().for_each(|note| file.warn(note));
    Ok(mesh)
}

fn list<'d>(document: &'d Json, name: &str) -> &'d [Json] {
    document[name].as_array().map_or(&[], |parts| parts)
}

fn parts<'d>(document: &'d mut Json, name: &str) -> &'d mut [Json] {
    document.get_mut(name).and_then(Json::as_array_mut).map_or(&mut [], |parts| parts)
}

/// Appends bytes, aligned to 8 bytes. Returns the offset at which they begin.
fn append_aligned(bytes: &mut Vec<u8>, more: &[u8]) -> usize {
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    let start = bytes.len();
    bytes.extend_from_slice(more);
    start
}

/// Loads the content of a URI in a document: a file beside the document, or a data URI.
pub(super) fn content(uri: &str, file: &InputFile<'_>) -> Result<Vec<u8>, String> {
    match uri.strip_prefix("data:") {
        Some(data) => {
            let (_, text) = data.split_once(";base64,").ok_or("its data URI is not base64")?;
            BASE64
                .decode(text.trim_end_matches('='))
                .map_err(|_| "its data URI is not valid base64".to_owned())
        }
        None => Ok(file.companion(&percent_decode_str(uri).decode_utf8_lossy())?.to_vec()),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use maquette_value::{Attribute, Faces, Image};
    use nalgebra::Point3;

    use super::*;
    use crate::glb::read;
    use crate::{data_uri, png};

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

    /// Splits a GLB file into its document and its buffer.
    fn split(glb: &[u8]) -> (Json, Vec<u8>) {
        let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
        let document = serde_json::from_slice(&glb[20..20 + length]).unwrap();
        (document, glb[28 + length..].to_vec())
    }

    fn read_with(document: &Json, files: &[(&str, &[u8])]) -> Result<Mesh, String> {
        let text = document.to_string();
        let read = MeshGltf::read(&InputFile::new("a.gltf", text.as_bytes(), &|name: &str| {
            let found = files.iter().find(|(known, _)| *known == name);
            found.map(|(_, bytes)| Arc::from(*bytes)).ok_or(format!("{name} is not there"))
        }));
        read.map_err(|error| error.to_string())
    }

    #[test]
    fn buffers_and_pictures_in_files_or_data_uris_read_as_in_one_file() {
        let glb = crate::glb::encode(&mesh()).unwrap();
        let (mut document, buffer) = split(&glb);
        document["images"][0]["name"] = "my color.png".into();
        let named = container(&document, buffer.clone()).unwrap();
        let (expected_mesh, nameless) = (read(&named).unwrap(), read(&glb).unwrap());
        document["buffers"][0]["uri"] = "my%20mesh.bin".into();
        let picture = png::encode_rgb(mesh().texture().unwrap()).unwrap();
        document["images"] = json!([{ "uri": "my%20color.png" }]);
        let files = [("my mesh.bin", &buffer[..]), ("my color.png", &picture[..])];
        assert_eq!(read_with(&document, &files), Ok(expected_mesh.clone()));
        document["images"][0]["uri"] = data_uri("image/png", &picture).into();
        document["buffers"][0]["uri"] = data_uri("application/octet-stream", &buffer).into();
        assert_eq!(read_with(&document, &[]), Ok(nameless.clone()));
        // Each part of the mesh may be in a separate buffer.
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
    fn missing_files_give_errors() {
        let (mut document, buffer) = split(&crate::glb::encode(&mesh()).unwrap());
        assert_eq!(read_with(&document, &[]), Err("buffer 0: it has no URI".into()));
        document["buffers"][0]["uri"] = "a.bin".into();
        assert_eq!(read_with(&document, &[]), Err("buffer 0: a.bin is not there".into()));
        let short = read_with(&document, &[("a.bin", &buffer[..9])]).unwrap_err();
        assert!(short.starts_with("buffer 0 has 9 bytes, but it should have "), "{short}");
        document["images"] = json!([{ "uri": "gone.png" }]);
        let bare = read_with(&document, &[("a.bin", &buffer)]).unwrap();
        assert!(bare.texture().is_none());
        document["buffers"][0]["uri"] = "data:;base64,?".into();
        assert!(read_with(&document, &[]).unwrap_err().contains("not valid base64"));
        assert!(read_with(&json!([1]), &[]).is_err());
    }

    /// Open3D writes GLB files with data URIs.
    #[test]
    fn a_glb_file_with_a_data_uri_is_read() {
        let glb = crate::glb::encode(&mesh()).unwrap();
        let (mut document, buffer) = split(&glb);
        document["buffers"][0]["uri"] = data_uri("application/octet-stream", &buffer).into();
        let linked = container(&document, Vec::new()).unwrap();
        let file = InputFile::standalone("a.glb", &linked);
        assert_eq!(crate::read::<Mesh>(&file).unwrap(), read(&glb).unwrap());
    }
}
