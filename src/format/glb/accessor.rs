//! The document of a GLB file, and the numbers that its accessors find in the buffer.

use std::array;
use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::Value;

use super::material::{GltfMaterial, Sampler};
use super::read::GlbReadError;

/// The document: what is read of it.
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
    /// Column by column; in place of the other three.
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
    /// Its picture; of those that only some programs read, the one that is read here.
    pub(super) fn picture(&self) -> Option<usize> {
        let webp = self.extensions.get("EXT_texture_webp").and_then(|it| it["source"].as_u64());
        self.source.or(webp.map(|source| source as usize))
    }

    /// The extension that has its picture in a form that is not read.
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

/// Entries in place of some of an accessor.
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
    /// Of indices alone.
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

/// How a number is stored.
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
    /// By the number of the specification.
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

    /// The number at the start of some bytes, and the largest that it can be if it is whole.
    fn read(self, bytes: &[u8]) -> (f64, f64) {
        fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
            *bytes.first_chunk().expect("the bounds of an accessor are checked")
        }
        match self {
            Self::I8 => (i8::from_le_bytes(first(bytes)).into(), 127.0),
            Self::U8 => (u8::from_le_bytes(first(bytes)).into(), 255.0),
            Self::I16 => (i16::from_le_bytes(first(bytes)).into(), 32767.0),
            Self::U16 => (u16::from_le_bytes(first(bytes)).into(), 65535.0),
            Self::U32 => (u32::from_le_bytes(first(bytes)).into(), u32::MAX.into()),
            Self::F32 => (f32::from_le_bytes(first(bytes)).into(), 1.0),
        }
    }
}

/// A piece of the buffer.
pub(super) struct View<'a> {
    pub(super) bytes: &'a [u8],
    stride: Option<usize>,
}

/// How many numbers are read for each byte of the file before it is refused. A number takes one byte or more, in most files four:
/// a part may still be shown some sixteen times.
const MOST_PER_BYTE: usize = 4;

/// The bytes behind the document. Parts that share them are counted, so that no small file makes a huge mesh.
pub(super) struct Buffer<'a> {
    document: &'a Document,
    bytes: &'a [u8],
    /// Numbers that may still be read.
    left: usize,
}

impl<'a> Buffer<'a> {
    pub(super) fn new(document: &'a Document, bytes: &'a [u8], file: usize) -> Self {
        Self { document, bytes, left: file.saturating_mul(MOST_PER_BYTE) }
    }

    /// The bytes of a view.
    pub(super) fn view(&self, index: usize) -> Result<View<'a>, GlbReadError> {
        fn wrong(what: &'static str, index: usize) -> GlbReadError {
            GlbReadError::Part { part: "bufferView", index, what }
        }
        let view = self.document.buffer_views.get(index).ok_or(wrong("does not exist", index))?;
        if let Some(name) = view.extensions.keys().find(|name| name.contains("compression")) {
            return Err(GlbReadError::Extension { name: name.clone() });
        }
        if view.buffer != 0 {
            return Err(wrong("is in another file", index));
        }
        let end = view.byte_offset.checked_add(view.byte_length);
        let bytes = end.and_then(|end| self.bytes.get(view.byte_offset..end));
        let bytes = bytes.ok_or(wrong("is not inside the buffer", index))?;
        Ok(View { bytes, stride: view.byte_stride })
    }

    /// The type of an accessor's entries, whether its numbers are whole ones, and whether they are normalized; none if it does not exist.
    pub(super) fn kind(&self, index: usize) -> Option<(&'a str, bool, bool)> {
        let accessor = self.document.accessors.get(index)?;
        let is_whole = !matches!(Component::new(accessor.component_type)?, Component::F32);
        Some((&accessor.kind, is_whole, accessor.normalized))
    }

    /// The entries of an accessor, the first N components of each, normalized if they are marked so.
    pub(super) fn rows<const N: usize>(
        &mut self,
        index: usize,
    ) -> Result<Vec<[f64; N]>, GlbReadError> {
        fn wrong(what: &'static str, index: usize) -> GlbReadError {
            GlbReadError::Part { part: "accessor", index, what }
        }
        let document = self.document;
        let accessor = document.accessors.get(index).ok_or(wrong("does not exist", index))?;
        let components = match &*accessor.kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => return Err(wrong("is of a type that is not read", index)),
        };
        if components < N {
            return Err(wrong("has too few components", index));
        }
        let component = Component::new(accessor.component_type);
        let component = component.ok_or(wrong("has components of an unknown type", index))?;
        let size = components * component.size();
        let packed = document.extensions_used.iter().find(|name| name.contains("compression"));
        let entries = match accessor.buffer_view {
            None if packed.is_some() && accessor.sparse.is_none() => {
                return Err(GlbReadError::Extension { name: packed.cloned().unwrap_or_default() });
            }
            None => None,
            Some(view) => Some(
                self.entries(view, accessor.byte_offset, size, accessor.count)?
                    .ok_or(wrong("is longer than its part of the buffer", index))?,
            ),
        };
        let numbers = accessor.count.saturating_mul(N);
        self.left = self
            .left
            .checked_sub(numbers)
            .ok_or(GlbReadError::Repetition { most: MOST_PER_BYTE })?;
        fn number(
            bytes: &[u8],
            at: usize,
            component: &Component,
            accessor_normalized: bool,
        ) -> f64 {
            let (number, largest) = component.read(&bytes[at..]);
            if accessor_normalized { (number / largest).max(-1.0) } else { number }
        }
        let row = |row| {
            array::from_fn(|k| number(row, k * component.size(), &component, accessor.normalized))
        };
        // Without bytes all of it is zero.
        let mut rows =
            entries.map_or(vec![[0.0; N]; accessor.count], |rows| rows.map(row).collect());
        if let Some(Sparse { count, indices, values }) = &accessor.sparse {
            let of_index = indices.component_type.and_then(Component::new);
            let of_index = of_index.ok_or(wrong("has sparse indices of an unknown type", index))?;
            fn broken(index: usize) -> GlbReadError {
                wrong("has sparse entries outside of the buffer", index)
            }
            let places =
                self.entries(indices.buffer_view, indices.byte_offset, of_index.size(), *count);
            let values = self.entries(values.buffer_view, values.byte_offset, size, *count)?;
            for (place, value) in places?.ok_or(broken(index))?.zip(values.ok_or(broken(index))?) {
                let entry = rows.get_mut(of_index.read(place).0 as usize);
                *entry.ok_or(wrong("has a sparse entry behind its end", index))? = row(value);
            }
        }
        Ok(rows)
    }

    /// So many entries of this size in a view, from this byte on; none if they are not inside of it or lie on each other.
    fn entries(
        &self,
        view: usize,
        offset: usize,
        size: usize,
        count: usize,
    ) -> Result<Option<impl Iterator<Item = &'a [u8]> + use<'a>>, GlbReadError> {
        let View { bytes, stride } = self.view(view)?;
        let stride = stride.unwrap_or(size);
        let last = count.saturating_sub(1).saturating_mul(stride);
        let end = offset.saturating_add(last).saturating_add(size);
        let is_inside = count == 0 || end <= bytes.len();
        Ok((size <= stride && is_inside)
            .then(|| (0..count).map(move |k| &bytes[offset + k * stride..][..size])))
    }

    /// The corners that an accessor lists, each below `count`.
    pub(super) fn indices(&mut self, index: usize, count: usize) -> Result<Vec<u32>, GlbReadError> {
        let rows = self.rows::<1>(index)?;
        let valid =
            |&[corner]: &[f64; 1]| 0.0 <= corner && corner < count as f64 && corner.fract() == 0.0;
        if !rows.iter().all(valid) {
            let what = "names a vertex that is not there";
            return Err(GlbReadError::Part { part: "accessor", index, what });
        }
        Ok(rows.into_iter().map(|[corner]| corner as u32).collect())
    }
}
