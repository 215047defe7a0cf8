//! Reads the materials of a GLB file.

use std::collections::{BTreeMap, HashMap};

use maquette_syntax::error::Error;
use maquette_value::{Column, Image, Map, MapKind, Material, Transparency, UvTransform, Wrap};
use percent_encoding::percent_decode_str;
use serde::Deserialize;
use serde_json::Value as Json;

use super::accessor::{Buffer, Document};
use super::read::{FindFile, extension_help};
use crate::picture_file;
use crate::picture_kind::Kind;

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct GltfMaterial {
    name: String,
    pbr_metallic_roughness: Shading,
    normal_texture: Option<TextureUse>,
    occlusion_texture: Option<TextureUse>,
    emissive_texture: Option<TextureUse>,
    emissive_factor: [f64; 3],
    alpha_mode: String,
    alpha_cutoff: Option<f64>,
    double_sided: bool,
    extensions: Extensions,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Shading {
    /// Red, green and blue in linear light, and opacity.
    base_color_factor: Option<[f64; 4]>,
    base_color_texture: Option<TextureUse>,
    metallic_factor: Option<f64>,
    roughness_factor: Option<f64>,
    metallic_roughness_texture: Option<TextureUse>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Extensions {
    #[serde(rename = "KHR_materials_pbrSpecularGlossiness")]
    glossiness: Option<Glossiness>,
    #[serde(flatten)]
    others: BTreeMap<String, Json>,
}

/// A material of the older specular-glossiness model.
#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Glossiness {
    diffuse_factor: Option<[f64; 4]>,
    diffuse_texture: Option<TextureUse>,
    glossiness_factor: Option<f64>,
    specular_glossiness_texture: Option<TextureUse>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct TextureUse {
    index: usize,
    #[serde(default)]
    tex_coord: usize,
    /// Present for normal maps only.
    scale: Option<f64>,
    /// Present for occlusion maps only.
    strength: Option<f64>,
    #[serde(default)]
    extensions: TextureUseExtensions,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct TextureUseExtensions {
    #[serde(rename = "KHR_texture_transform")]
    transform: Option<Transform>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Transform {
    offset: [f64; 2],
    rotation: f64,
    scale: [f64; 2],
    /// Replaces `tex_coord` of the texture use to which the transformation belongs.
    tex_coord: Option<usize>,
}

impl Default for Transform {
    fn default() -> Self {
        Self { offset: [0.0; 2], rotation: 0.0, scale: [1.0; 2], tex_coord: None }
    }
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Sampler {
    mag_filter: u32,
    min_filter: u32,
    wrap_s: u32,
    wrap_t: u32,
}

/// The index of a set of texture coordinates, and the transformation that is applied to the set.
pub(super) type CoordinateSet = (usize, UvTransform);

impl TextureUse {
    fn set(&self) -> CoordinateSet {
        let Transform { offset, rotation, scale, tex_coord } =
            self.extensions.transform.unwrap_or_default();
        (tex_coord.unwrap_or(self.tex_coord), UvTransform { offset, rotation, scale })
    }
}

/// Returns the attribute name for a set of texture coordinates.
pub(super) fn uv_name(set: usize) -> String {
    if set == 0 { "uv".to_owned() } else { format!("uv{set}") }
}

/// The appearance of the triangles in a primitive (a part of a glTF mesh).
#[derive(Clone)]
pub(super) struct Appearance {
    /// The index of the primitive's material.
    pub(super) material: u32,
    /// The factor, in linear light, by which the vertex colors are multiplied.
    pub(super) factor: [f64; 3],
    /// The sets of texture coordinates from which the attributes `uv`, `uv1`, .. are made.
    pub(super) sets: Vec<CoordinateSet>,
}

/// Collects the materials of the primitives.
pub(super) struct Materials<'a> {
    document: &'a Document,
    find: FindFile<'a>,
    pub(super) all: Vec<Material>,
    /// The appearances found so far. The key is the index of the material in the document, and true if the primitive has texture
    /// coordinates.
    known: HashMap<(Option<usize>, bool), Appearance>,
    files: HashMap<usize, Option<Column<u8>>>,
    /// Decoded pictures, each with the index of its image and the factor by which it was multiplied.
    pictures: Vec<(usize, [f64; 3], Option<Image>)>,
    /// The number of pixels that may still be decoded.
    pixels: usize,
    pub(super) notes: Vec<String>,
}

/// The maximum number of pixels that are decoded for one file. The limit is necessary because a small file may have many materials.
const MAX_PIXELS: usize = 1 << 28;

impl<'a> Materials<'a> {
    pub(super) fn new(document: &'a Document, find: FindFile<'a>) -> Self {
        Self {
            document,
            find,
            all: Vec::new(),
            known: HashMap::new(),
            files: HashMap::new(),
            pictures: Vec::new(),
            pixels: MAX_PIXELS,
            notes: Vec::new(),
        }
    }

    fn note(&mut self, note: impl Into<String>) {
        let note = note.into();
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }

    /// Returns the appearance of a primitive that has the material `index`.
    pub(super) fn appearance(
        &mut self,
        index: Option<usize>,
        has_uv: bool,
        buffer: &Buffer<'_>,
    ) -> Result<Appearance, Error> {
        let document = self.document;
        let found = index.and_then(|index| document.materials.get(index));
        let key = (index.filter(|_| found.is_some()), has_uv);
        if let Some(look) = self.known.get(&key) {
            return Ok(look.clone());
        }
        let (material, factor, sets) = match found {
            None => (default_gltf_material(), [1.0; 3], Vec::new()),
            Some(found) => self.material(found, has_uv, buffer)?,
        };
        // Equal materials are merged.
        let known = self.all.iter().position(|it| *it == material);
        let material = known.unwrap_or_else(|| {
            self.all.push(material);
            self.all.len() - 1
        });
        let look = Appearance { material: material as u32, factor, sets };
        self.known.insert(key, look.clone());
        Ok(look)
    }

    fn material(
        &mut self,
        from: &'a GltfMaterial,
        has_uv: bool,
        buffer: &Buffer<'_>,
    ) -> Result<(Material, [f64; 3], Vec<CoordinateSet>), Error> {
        let shading = &from.pbr_metallic_roughness;
        let (mut factor, mut base) =
            (shading.base_color_factor, shading.base_color_texture.as_ref());
        let mut roughness = shading.roughness_factor;
        let mut metallic = shading.metallic_factor;
        if let Some(glossiness) = &from.extensions.glossiness {
            if factor.is_none() && base.is_none() {
                (factor, base) = (glossiness.diffuse_factor, glossiness.diffuse_texture.as_ref());
                roughness = roughness.or(Some(1.0 - glossiness.glossiness_factor.unwrap_or(1.0)));
                metallic = metallic.or(Some(0.0));
            }
            if glossiness.specular_glossiness_texture.is_some() {
                self.note(
                    "the specular-glossiness picture is left out: save the material with metallic and roughness",
                );
            }
        }
        fn finite_or(number: f64, or: f64) -> f64 {
            if number.is_finite() { number } else { or }
        }
        let base_color = factor.unwrap_or([1.0; 4]).map(|channel| finite_or(channel, 1.0));
        let mut material = Material {
            name: from.name.clone(),
            base_color,
            metallic: finite_or(metallic.unwrap_or(1.0), 1.0),
            roughness: finite_or(roughness.unwrap_or(1.0), 1.0),
            emissive: from.emissive_factor.map(|channel| finite_or(channel, 0.0)),
            transparency: match &*from.alpha_mode {
                "MASK" => Transparency::Cutoff(finite_or(from.alpha_cutoff.unwrap_or(0.5), 0.5)),
                "BLEND" => Transparency::Blend,
                _ => Transparency::Opaque,
            },
            is_double_sided: from.double_sided,
            ..Material::default()
        };
        for (name, extension) in &from.extensions.others {
            let mut extension = extension.clone();
            if let Some(fields) = extension.as_object_mut() {
                let count = fields.len();
                fields.retain(|key, _| !key.ends_with("Texture"));
                if fields.len() < count {
                    self.note(format!("pictures of `{name}` are left out"));
                }
            }
            material.others.insert(name.clone(), extension.to_string());
        }
        let [red, green, blue, _] = base_color;
        let mut factor = [red, green, blue];
        let packed = shading.metallic_roughness_texture.as_ref();
        let uses = [
            (MapKind::BaseColor, base, None),
            (MapKind::Metallic, packed, Some(2)),
            (MapKind::Roughness, packed, Some(1)),
            (MapKind::Normal, from.normal_texture.as_ref(), None),
            (MapKind::Occlusion, from.occlusion_texture.as_ref(), Some(0)),
            (MapKind::Emissive, from.emissive_texture.as_ref(), None),
        ];
        let mut sets: Vec<CoordinateSet> = Vec::new();
        for (kind, texture, channel) in uses {
            let Some(texture) = texture.filter(|_| has_uv) else { continue };
            let Some((source, bytes)) = self.picture(texture, buffer)? else { continue };
            let set = texture.set();
            let set_index = sets.iter().position(|it| *it == set).unwrap_or_else(|| {
                sets.push(set);
                sets.len() - 1
            });
            if kind == MapKind::BaseColor {
                // The factor is multiplied into the picture, not into the vertex colors.
                let color = std::mem::replace(&mut factor, [1.0; 3]);
                material.picture = self.multiplied_picture(source, &bytes, color);
                if material.picture.is_none() {
                    continue;
                }
            }
            let image = &self.document.images[source];
            let file = match &image.uri {
                Some(uri) if !uri.starts_with("data:") => uri.rsplit('/').next().unwrap_or(uri),
                _ => &image.name,
            };
            let file = percent_decode_str(file).decode_utf8_lossy();
            let mut map = Map::new(file, bytes);
            map.channel = channel;
            let strength = texture.scale.or(texture.strength).unwrap_or(1.0);
            map.strength = finite_or(strength, 1.0);
            (map.uv, map.transform) = (uv_name(set_index), set.1);
            let sampler = self.document.textures[texture.index].sampler;
            let sampler = sampler.and_then(|sampler| self.document.samplers.get(sampler));
            if let Some(Sampler { mag_filter, min_filter, wrap_s, wrap_t }) = sampler {
                map.filters = [*mag_filter, *min_filter];
                map.wrap = [*wrap_s, *wrap_t].map(|wrap| match wrap {
                    super::CLAMP_TO_EDGE => Wrap::Clamp,
                    super::MIRRORED_REPEAT => Wrap::Mirror,
                    _ => Wrap::Repeat,
                });
            }
            material.maps.insert(kind, map);
        }
        Ok((material, factor, sets))
    }

    /// Returns the index and the bytes of a texture's image; `None` if the image cannot be loaded.
    fn picture(
        &mut self,
        texture: &TextureUse,
        buffer: &Buffer<'_>,
    ) -> Result<Option<(usize, Column<u8>)>, Error> {
        let document = self.document;
        let Some(found) = document.textures.get(texture.index) else { return Ok(None) };
        let Some(source) = found.picture() else {
            if let Some(name) = found.unread() {
                self.note(format!(
                    "a picture is left out: it requires `{name}`{}",
                    extension_help(name)
                ));
            }
            return Ok(None);
        };
        if let Some(known) = self.files.get(&source) {
            return Ok(known.clone().map(|bytes| (source, bytes)));
        }
        let Some(image) = document.images.get(source) else { return Ok(None) };
        let bytes = match (image.buffer_view, &image.uri) {
            (Some(view), _) => Some(buffer.view(view)?.bytes.to_vec()),
            (None, Some(uri)) => match (self.find)(uri) {
                Ok(bytes) => Some(bytes),
                Err(why) => {
                    self.note(format!("picture {source} is left out: {why}"));
                    None
                }
            },
            (None, None) => None,
        };
        let bytes = bytes.filter(|bytes| {
            let is_known = Kind::detect(bytes).is_some();
            if !is_known {
                let why = picture_file::read(bytes).err().map(|why| why.to_string());
                self.note(format!("picture {source} is left out: {}", why.unwrap_or_default()));
            }
            is_known
        });
        let bytes: Option<Column<u8>> = bytes.map(Into::into);
        self.files.insert(source, bytes.clone());
        Ok(bytes.map(|bytes| (source, bytes)))
    }

    /// Returns the picture multiplied by `factor`; `None` if the picture is damaged or exceeds the remaining number of pixels.
    fn multiplied_picture(
        &mut self,
        source: usize,
        bytes: &[u8],
        factor: [f64; 3],
    ) -> Option<Image> {
        let known = self
            .pictures
            .iter()
            .find(|(known_source, by, _)| (*known_source, *by) == (source, factor));
        if let Some((.., image)) = known {
            return image.clone();
        }
        let plain = self
            .pictures
            .iter()
            .find(|(known_source, by, _)| (*known_source, *by) == (source, [1.0; 3]));
        let plain = match plain {
            Some((.., image)) => image.clone(),
            None => match picture_file::read(bytes) {
                Ok(image) => Some(image),
                Err(why) => {
                    self.note(format!("picture {source} is left out: {why}"));
                    None
                }
            },
        };
        let image = plain.map(|image| image.multiply(factor));
        let image = image.filter(|image| match self.pixels.checked_sub(image.pixels().len()) {
            Some(left) => {
                self.pixels = left;
                true
            }
            None => {
                self.note(format!(
                    "some pictures are left out: together they have over {MAX_PIXELS} pixels"
                ));
                false
            }
        });
        self.pictures.push((source, factor, image.clone()));
        image
    }
}

/// The material of a primitive for which the file names no material.
fn default_gltf_material() -> Material {
    Material { metallic: 1.0, roughness: 1.0, is_double_sided: false, ..Material::default() }
}

/// Returns an empty list if the only material is a default material; otherwise returns `materials`.
pub(super) fn drop_default(materials: Vec<Material>) -> Vec<Material> {
    match &materials[..] {
        [only] if *only == Material::default() || *only == default_gltf_material() => Vec::new(),
        _ => materials,
    }
}
