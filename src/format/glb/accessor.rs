//! The JSON document of a GLB file, and the numbers that its accessors refer to in the buffer.

use std::array;
use std::collections::BTreeMap;

use maquette_syntax::bail;
use maquette_syntax::error::Error;
use serde::Deserialize;
use serde_json::Value;

use super::material::{GltfMaterial, Sampler};
use super::read::{extension_error, part_error};

/// The parts of the JSON document that are read.
#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Document {
    pub(super) scene: Option<usize>,
    pub(super) scenes: Vec<Scene>,
    pub(super) nodes: Vec<Node>,
    pub(super) meshes: Vec<GltfMesh>,
    pub(super) materials: Vec<GltfMaterial>,
    pub(super) textures: Vec<Texture>,
    pub(super) samplers: Vec<Sampler>,
    pub(super) images: Vec<Picture>,
    pub(super) buffers: Vec<Picture>,
    pub(super) extensions_required: Vec<String>,
    pub(super) animations: Vec<Value>,
    extensions_used: Vec<String>,
    accessors: Vec<Accessor>,
    buffer_views: Vec<BufferView>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Scene {
    pub(super) nodes: Vec<usize>,
}

#[derive(Deserialize)]
#[serde(default)]
pub(super) struct Node {
    pub(super) children: Vec<usize>,
    pub(super) mesh: Option<usize>,
    pub(super) skin: Option<usize>,
    pub(super) extensions: BTreeMap<String, Value>,
    /// A matrix, stored column by column. It replaces translation, rotation and scale.
    pub(super) matrix: Option<[f64; 16]>,
    pub(super) translation: [f64; 3],
    /// A quaternion: x, y, z, w.
    pub(super) rotation: [f64; 4],
    pub(super) scale: [f64; 3],
}

impl Default for Node {
    fn default() -> Self {
        Self {
            children: Vec::new(),
            mesh: None,
            skin: None,
            extensions: BTreeMap::new(),
            matrix: None,
            translation: [0.0; 3],
            rotation: [0.0, 0.0, 0.0, 1.0],
            scale: [1.0; 3],
        }
    }
}

#[derive(Deserialize)]
pub(super) struct GltfMesh {
    pub(super) primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
pub(super) struct Primitive {
    pub(super) attributes: BTreeMap<String, usize>,
    pub(super) indices: Option<usize>,
    pub(super) material: Option<usize>,
    #[serde(default = "triangles")]
    pub(super) mode: u32,
    #[serde(default)]
    pub(super) targets: Vec<Value>,
    #[serde(default)]
    pub(super) extensions: BTreeMap<String, Value>,
}

fn triangles() -> u32 {
    4
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Texture {
    source: Option<usize>,
    pub(super) sampler: Option<usize>,
    extensions: BTreeMap<String, Value>,
}

impl Texture {
    /// Returns the index of the texture's image, which is given either directly or through the WebP extension.
    pub(super) fn picture(&self) -> Option<usize> {
        let webp = self.extensions.get("EXT_texture_webp").and_then(|it| it["source"].as_u64());
        self.source.or(webp.map(|source| source as usize))
    }

    /// Returns the name of the extension that refers to the image, if the image is in a format that is not supported.
    pub(super) fn unread(&self) -> Option<&str> {
        self.picture()
            .is_none()
            .then(|| self.extensions.keys().next().map(|name| &**name))
            .flatten()
    }
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Picture {
    pub(super) buffer_view: Option<usize>,
    pub(super) uri: Option<String>,
    pub(super) name: String,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: usize,
    component_type: u32,
    #[serde(default)]
    normalized: bool,
    count: usize,
    #[serde(rename = "type")]
    kind: String,
    sparse: Option<Sparse>,
}

/// Replacements for some entries of an accessor.
#[derive(Deserialize)]
struct Sparse {
    count: usize,
    indices: Piece,
    values: Piece,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Piece {
    buffer_view: usize,
    #[serde(default)]
    byte_offset: usize,
    /// The storage type of the numbers. Only the piece with the indices has one.
    component_type: Option<u32>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct BufferView {
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
    #[serde(default)]
    extensions: BTreeMap<String, Value>,
}

/// The storage type of a number.
#[derive(Clone, Copy)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    /// Returns the type for a number that the specification defines.
    fn new(number: u32) -> Option<Self> {
        Some(match number {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// Returns the number at the start of `bytes`, and the maximum of its type if that is an integer type (1 for floats).
    fn read(self, bytes: &[u8]) -> (f64, f64) {
        fn first_bytes<const N: usize>(bytes: &[u8]) -> [u8; N] {
            *bytes.first_chunk().expect("the bounds of an accessor are checked")
        }
        match self {
            Self::I8 => (i8::from_le_bytes(first_bytes(bytes)).into(), 127.0),
            Self::U8 => (u8::from_le_bytes(first_bytes(bytes)).into(), 255.0),
            Self::I16 => (i16::from_le_bytes(first_bytes(bytes)).into(), 32767.0),
            Self::U16 => (u16::from_le_bytes(first_bytes(bytes)).into(), 65535.0),
            Self::U32 => (u32::from_le_bytes(first_bytes(bytes)).into(), u32::MAX.into()),
            Self::F32 => (f32::from_le_bytes(first_bytes(bytes)).into(), 1.0),
        }
    }
}

/// A range of the buffer.
pub(super) struct View<'a> {
    pub(super) bytes: &'a [u8],
    stride: Option<usize>,
}

/// The maximum count of numbers that are read per byte of the file; it ensures that a small file cannot make a huge mesh. A number takes at
/// least one byte and mostly four, so each part of the buffer may be used about sixteen times.
const MAX_NUMBERS_PER_BYTE: usize = 4;

/// The binary buffer. It counts the numbers that are read, so that a small file in which many parts share bytes cannot make a huge mesh.
pub(super) struct Buffer<'a> {
    document: &'a Document,
    bytes: &'a [u8],
    /// The count of numbers that may still be read.
    remaining: usize,
}

impl<'a> Buffer<'a> {
    pub(super) fn new(document: &'a Document, bytes: &'a [u8], file: usize) -> Self {
        Self { document, bytes, remaining: file.saturating_mul(MAX_NUMBERS_PER_BYTE) }
    }

    /// Returns the bytes of a buffer view.
    pub(super) fn view(&self, index: usize) -> Result<View<'a>, Error> {
        let view_error = |problem| part_error("bufferView", index, problem);
        let view = self.document.buffer_views.get(index);
        let view = view.ok_or_else(|| view_error("does not exist"))?;
        if let Some(name) = view.extensions.keys().find(|name| name.contains("compression")) {
            return Err(extension_error(name));
        }
        if view.buffer != 0 {
            return Err(view_error("is in another file"));
        }
        let end = view.byte_offset.checked_add(view.byte_length);
        let bytes = end.and_then(|end| self.bytes.get(view.byte_offset..end));
        let bytes = bytes.ok_or_else(|| view_error("is not inside the buffer"))?;
        Ok(View { bytes, stride: view.byte_stride })
    }

    /// Returns the type of an accessor's entries, true if its numbers are integers, and true if they are normalized. Returns `None` if the
    /// accessor does not exist.
    pub(super) fn kind(&self, index: usize) -> Option<(&'a str, bool, bool)> {
        let accessor = self.document.accessors.get(index)?;
        let is_whole = !matches!(Component::new(accessor.component_type)?, Component::F32);
        Some((&accessor.kind, is_whole, accessor.normalized))
    }

    /// Reads the first N components of each entry of an accessor. Integers are normalized if the accessor requires it.
    pub(super) fn rows<const N: usize>(&mut self, index: usize) -> Result<Vec<[f64; N]>, Error> {
        let accessor_error = |problem| part_error("accessor", index, problem);
        let document = self.document;
        let accessor =
            document.accessors.get(index).ok_or_else(|| accessor_error("does not exist"))?;
        let components = match &*accessor.kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => return Err(accessor_error("has a type that is not supported")),
        };
        if components < N {
            return Err(accessor_error("has too few components"));
        }
        let component = Component::new(accessor.component_type);
        let component =
            component.ok_or_else(|| accessor_error("has components of an unknown type"))?;
        let size = components * component.size();
        let packed = document.extensions_used.iter().find(|name| name.contains("compression"));
        let entries = match accessor.buffer_view {
            None if packed.is_some() && accessor.sparse.is_none() => {
                return Err(extension_error(packed.map_or("", |name| name)));
            }
            None => None,
            Some(view) => Some(
                self.entries(view, accessor.byte_offset, size, accessor.count)?
                    .ok_or_else(|| accessor_error("is longer than its part of the buffer"))?,
            ),
        };
        let numbers = accessor.count.saturating_mul(N);
        let Some(remaining) = self.remaining.checked_sub(numbers) else {
            bail!(
                "the file reuses its data so often that the mesh would have over {MAX_NUMBERS_PER_BYTE} numbers per byte of the file"
            );
        };
        self.remaining = remaining;
        let row = |bytes: &[u8]| {
            array::from_fn(|k| {
                let (number, largest) = component.read(&bytes[k * component.size()..]);
                if accessor.normalized { (number / largest).max(-1.0) } else { number }
            })
        };
        // An accessor without a buffer view consists of zeros.
        let mut rows =
            entries.map_or(vec![[0.0; N]; accessor.count], |rows| rows.map(row).collect());
        if let Some(Sparse { count, indices, values }) = &accessor.sparse {
            let of_index = indices.component_type.and_then(Component::new);
            let of_index =
                of_index.ok_or_else(|| accessor_error("has sparse indices of an unknown type"))?;
            let outside = || accessor_error("has sparse entries outside the buffer");
            let sparse_indices =
                self.entries(indices.buffer_view, indices.byte_offset, of_index.size(), *count);
            let values = self.entries(values.buffer_view, values.byte_offset, size, *count)?;
            for (sparse_index, value) in
                sparse_indices?.ok_or_else(outside)?.zip(values.ok_or_else(outside)?)
            {
                let entry = rows.get_mut(of_index.read(sparse_index).0 as usize);
                *entry.ok_or_else(|| accessor_error("has a sparse entry after its end"))? =
                    row(value);
            }
        }
        Ok(rows)
    }

    /// Returns `count` entries of `size` bytes in a buffer view, beginning at `offset`. Returns `None` if they are not inside the view or
    /// overlap.
    fn entries(
        &self,
        view: usize,
        offset: usize,
        size: usize,
        count: usize,
    ) -> Result<Option<impl Iterator<Item = &'a [u8]> + use<'a>>, Error> {
        let View { bytes, stride } = self.view(view)?;
        let stride = stride.unwrap_or(size);
        let last = count.saturating_sub(1).saturating_mul(stride);
        let end = offset.saturating_add(last).saturating_add(size);
        let is_inside = count == 0 || end <= bytes.len();
        Ok((size <= stride && is_inside)
            .then(|| (0..count).map(move |k| &bytes[offset + k * stride..][..size])))
    }

    /// Reads the vertex indices of an accessor, all of which must be less than `count`.
    pub(super) fn indices(&mut self, index: usize, count: usize) -> Result<Vec<u32>, Error> {
        let rows = self.rows::<1>(index)?;
        if !rows
            .iter()
            .all(|&[corner]| 0.0 <= corner && corner < count as f64 && corner.fract() == 0.0)
        {
            return Err(part_error("accessor", index, "refers to a vertex that does not exist"));
        }
        Ok(rows.into_iter().map(|[corner]| corner as u32).collect())
    }
}
