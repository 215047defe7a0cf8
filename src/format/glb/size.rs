//! The size of the mesh in a GLB file, from its JSON.

use maquette_node::{Certainty, FileHead, ValueSize};
use serde_json::Value as Json;

/// The maximum length of the JSON in bytes.
const MAX_JSON: u32 = 16 << 20;

/// Returns the size of the mesh in a GLB file: the sum of those that its nodes show. It is a guess if there are pictures, whose sizes are
/// not known.
pub(super) fn mesh(head: &FileHead<'_>) -> Option<ValueSize> {
    /// The position in bytes of the JSON, after the headers of the file and of its first chunk.
    const START: u64 = 20;
    let length = u32::from_le_bytes(*head.start.get(12..)?.first_chunk()?);
    if !head.start.starts_with(b"glTF") || length > MAX_JSON {
        return None;
    }
    let document: Json = serde_json::from_slice(&head.read_at(START, length as usize)?).ok()?;
    let nodes = document["nodes"].as_array()?.iter().filter_map(|node| node["mesh"].as_u64());
    let none = ValueSize::mesh(0.0, 0.0, 0.0).at_most(Certainty::Predicted);
    let size = nodes.fold(none, |sum, mesh| sum.plus(mesh_size(&document, mesh)));
    let is_guess = document["images"].as_array().is_some_and(|images| !images.is_empty());
    Some(if is_guess { size.at_most(Certainty::Guess) } else { size })
}

/// Returns the size of a mesh of the document, without parts that are not triangles.
fn mesh_size(document: &Json, mesh: u64) -> ValueSize {
    const TRIANGLES: u64 = 4;
    fn count(accessor: &Json, document: &Json) -> Option<f64> {
        let accessor = usize::try_from(accessor.as_u64()?).ok()?;
        document["accessors"][accessor]["count"].as_f64()
    }
    let primitives = usize::try_from(mesh).ok().map(|mesh| &document["meshes"][mesh]["primitives"]);
    let primitives = primitives.and_then(Json::as_array).into_iter().flatten();
    let sizes = primitives
        .filter(|part| part["mode"].as_u64().unwrap_or(TRIANGLES) == TRIANGLES)
        .filter_map(|part| {
            let vertices = count(&part["attributes"]["POSITION"], document)?;
            let corners = count(&part["indices"], document).unwrap_or(vertices);
            let others = part["attributes"].as_object().map_or(0, |it| it.len().saturating_sub(1));
            // A normal has 24 bytes, a pair of texture coordinates 16 and a color 3.
            let attributes = 16.0 * others as f64 * vertices;
            Some(ValueSize::mesh(vertices, corners / 3.0, corners).with_more_bytes(attributes))
        });
    sizes.fold(ValueSize::mesh(0.0, 0.0, 0.0), ValueSize::plus)
}
