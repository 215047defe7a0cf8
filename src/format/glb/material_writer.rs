//! Writes the materials of a mesh to a GLB file.

use std::collections::BTreeSet;

use maquette_syntax::error::Error;
use maquette_value::{
    Attribute, Column, Map, MapKind, Material, Mesh, Rgb, Transparency, UvTransform, Wrap,
};
use serde_json::{Value, json};

use super::{
    Buffers, CLAMP_TO_EDGE, LINEAR, LINEAR_MIPMAP_LINEAR, MIRRORED_REPEAT, REPEAT, Vertices,
};
use crate::picture_kind::Kind;
use crate::rows::Table;
use crate::{picture_file, png};

/// The materials of a document with their textures, samplers and images.
#[derive(Default)]
pub(super) struct MaterialWriter {
    pub(super) materials: Vec<Value>,
    samplers: Vec<Value>,
    textures: Vec<Value>,
    images: Vec<Value>,
    /// The bytes of each image.
    files: Vec<Column<u8>>,
    extensions: BTreeSet<String>,
    required: BTreeSet<String>,
}

/// The maps that have a separate texture, with their glTF keys.
const KEYS: [(MapKind, &str); 4] = [
    (MapKind::BaseColor, "baseColorTexture"),
    (MapKind::Normal, "normalTexture"),
    (MapKind::Occlusion, "occlusionTexture"),
    (MapKind::Emissive, "emissiveTexture"),
];

impl MaterialWriter {
    /// Adds a material. `sets` lists the attributes with texture coordinates in the order of the file. If the vertices have colors
    /// (`colors` is true), these replace the base color.
    pub(super) fn add(
        &mut self,
        material: &Material,
        sets: &[String],
        colors: bool,
        file: &mut Buffers<'_>,
    ) -> Result<(), Error> {
        let mut shading = json!({});
        for (key, factor) in
            [("metallicFactor", material.metallic), ("roughnessFactor", material.roughness)]
        {
            if factor != 1.0 {
                shading[key] = factor.into();
            }
        }
        let mut color = material.base_color;
        if colors && material.picture.is_none() {
            color[..3].fill(1.0);
        }
        if color != [1.0; 4] {
            shading["baseColorFactor"] = json!(color);
        }
        let mut made = json!({});
        let mut packed = pack_metallic_roughness(&material.maps)?;
        for (kind, key) in KEYS {
            let Some(map) = material.maps.get(&kind) else { continue };
            let Some(texture) = self.texture(map, sets, file)? else { continue };
            match kind {
                MapKind::BaseColor => shading[key] = texture,
                _ => made[key] = texture,
            }
            let strength = if kind == MapKind::Normal { "scale" } else { "strength" };
            if map.strength != 1.0 && kind != MapKind::BaseColor {
                made[key][strength] = map.strength.into();
            }
        }
        if let Some(map) = packed.take()
            && let Some(texture) = self.texture(&map, sets, file)?
        {
            shading["metallicRoughnessTexture"] = texture;
        }
        // The picture was not read from a file, so it is encoded here.
        if let Some(picture) = &material.picture
            && !material.maps.contains_key(&MapKind::BaseColor)
            && sets.first().is_some_and(|set| set == "uv")
        {
            let mut map = Map::new("", png::encode_rgb(picture)?);
            map.wrap = [Wrap::Clamp; 2];
            map.filters = [LINEAR, LINEAR_MIPMAP_LINEAR];
            shading["baseColorTexture"] = self.texture(&map, sets, file)?.unwrap_or_default();
        }
        made["pbrMetallicRoughness"] = shading;
        if material.is_double_sided {
            made["doubleSided"] = true.into();
        }
        if !material.name.is_empty() {
            made["name"] = material.name.clone().into();
        }
        if material.emissive != [0.0; 3] {
            made["emissiveFactor"] = json!(material.emissive);
        }
        match material.transparency {
            Transparency::Opaque => {}
            Transparency::Blend => made["alphaMode"] = "BLEND".into(),
            Transparency::Cutoff(cutoff) => {
                made["alphaMode"] = "MASK".into();
                made["alphaCutoff"] = cutoff.into();
            }
        }
        for (name, words) in material.others.iter().filter(|(name, _)| is_extension(name)) {
            if let Ok(extension) = serde_json::from_str::<Value>(words) {
                made["extensions"][name] = extension;
                self.extensions.insert(name.clone());
            }
        }
        self.materials.push(made);
        Ok(())
    }

    /// Adds the texture of a map. Returns `None` if the mesh has no texture coordinates for the map.
    fn texture(
        &mut self,
        map: &Map,
        sets: &[String],
        file: &mut Buffers<'_>,
    ) -> Result<Option<Value>, Error> {
        let Some(set) = sets.iter().position(|set| *set == map.uv) else { return Ok(None) };
        let image = self.image(map, file)?;
        let wrap = map.wrap.map(|wrap| match wrap {
            Wrap::Repeat => REPEAT,
            Wrap::Mirror => MIRRORED_REPEAT,
            Wrap::Clamp => CLAMP_TO_EDGE,
        });
        let mut sampler = json!({});
        for (key, filter) in ["magFilter", "minFilter"].into_iter().zip(map.filters) {
            if filter != 0 {
                sampler[key] = filter.into();
            }
        }
        sampler["wrapS"] = wrap[0].into();
        sampler["wrapT"] = wrap[1].into();
        let mut texture =
            json!({ "sampler": insert_once(&mut self.samplers, sampler), "source": image });
        if self.images[image]["mimeType"] == "image/webp" {
            let extension = json!({ "EXT_texture_webp": { "source": image } });
            texture = json!({ "sampler": texture["sampler"], "extensions": extension });
            for extensions in [&mut self.extensions, &mut self.required] {
                extensions.insert("EXT_texture_webp".to_owned());
            }
        }
        let mut reference = json!({ "index": insert_once(&mut self.textures, texture) });
        if set > 0 {
            reference["texCoord"] = set.into();
        }
        let UvTransform { offset, rotation, scale } = map.transform;
        if map.transform != UvTransform::default() && map.transform.is_invertible() {
            let mut transform = json!({ "offset": offset, "scale": scale });
            if rotation != 0.0 {
                transform["rotation"] = rotation.into();
            }
            reference["extensions"]["KHR_texture_transform"] = transform;
            self.extensions.insert("KHR_texture_transform".to_owned());
        }
        Ok(Some(reference))
    }

    /// Adds the picture of a map unless it has been added before. The file is stored unchanged, or converted to PNG if glTF does not
    /// support its format.
    fn image(&mut self, map: &Map, file: &mut Buffers<'_>) -> Result<usize, Error> {
        let known = self.files.iter().position(|known| known.hash() == map.bytes.hash());
        if let Some(known) = known {
            return Ok(known);
        }
        let (kind, bytes) = match Kind::detect(&map.bytes) {
            Some(Kind::Png) => ("image/png", map.bytes.clone()),
            Some(Kind::Jpeg) => ("image/jpeg", map.bytes.clone()),
            Some(Kind::WebP) => ("image/webp", map.bytes.clone()),
            _ => ("image/png", png::encode_rgb(&picture_file::read(&map.bytes)?)?.into()),
        };
        let view = file.view(Table::from_shared(bytes), None);
        let mut image = json!({ "bufferView": view, "mimeType": kind });
        if !map.file.is_empty() {
            image["name"] = map.file.clone().into();
        }
        self.images.push(image);
        self.files.push(map.bytes.clone());
        Ok(self.images.len() - 1)
    }

    /// Writes the collected materials, textures, samplers and images into the document.
    pub(super) fn finish(self, document: &mut Value) {
        document["materials"] = self.materials.into();
        if !self.images.is_empty() {
            document["images"] = self.images.into();
            document["samplers"] = self.samplers.into();
            document["textures"] = self.textures.into();
        }
        for (key, names) in
            [("extensionsUsed", self.extensions), ("extensionsRequired", self.required)]
        {
            if !names.is_empty() {
                document[key] = json!(names);
            }
        }
    }
}

/// Returns true if `name` is a glTF extension: it begins with an upper-case vendor prefix.
pub(crate) fn is_extension(name: &str) -> bool {
    let vendor = name.split('_').next().unwrap_or_default();
    vendor.len() >= 2 && vendor.chars().all(|letter| letter.is_ascii_uppercase())
}

/// Returns true if `name` is a glTF extension, or an MTL statement without further information. Such statements are the illumination model,
/// the shininess that was converted to roughness, a color beside a picture, and values that exporters write for every material.
pub(super) fn is_redundant(name: &str, words: &str) -> bool {
    let numbers = words.split_whitespace().map(|word| word.parse::<f64>().ok());
    let numbers = numbers.collect::<Option<Vec<f64>>>().unwrap_or_default();
    is_extension(name)
        || match name {
            "Ka" | "Kd" | "Ns" | "illum" => true,
            "Ks" => [[0.0; 3], [0.5; 3]].iter().any(|usual| numbers == usual),
            "Ni" => [1.0, 1.45, 1.5].iter().any(|usual| numbers == [*usual]),
            "Tf" => numbers == [1.0; 3],
            _ => false,
        }
}

/// Returns the index of an item in a list. Adds the item if it is missing.
fn insert_once(all: &mut Vec<Value>, item: Value) -> usize {
    all.iter().position(|known| *known == item).unwrap_or_else(|| {
        all.push(item);
        all.len() - 1
    })
}

/// Returns a picture with metallic in the blue and roughness in the green channel: the picture that both maps share, or a new one made from
/// both.
fn pack_metallic_roughness(
    maps: &std::collections::BTreeMap<MapKind, Map>,
) -> Result<Option<Map>, Error> {
    let [metal, rough] = [MapKind::Metallic, MapKind::Roughness].map(|kind| maps.get(&kind));
    fn is_packed(map: &Map, channel: u8) -> bool {
        map.channel == Some(channel)
    }
    match (metal, rough) {
        (None, None) => return Ok(None),
        (Some(metal), Some(rough))
            if metal.bytes.hash() == rough.bytes.hash()
                && is_packed(metal, 2)
                && is_packed(rough, 1) =>
        {
            return Ok(Some(metal.clone()));
        }
        _ => {}
    }
    fn read(map: Option<&Map>) -> Result<Option<(maquette_value::Image, u8)>, Error> {
        map.map(|map| Ok::<_, Error>((picture_file::read(&map.bytes)?, map.channel.unwrap_or(0))))
            .transpose()
    }
    let (metal_picture, rough_picture) = (read(metal)?, read(rough)?);
    let pictures = [&metal_picture, &rough_picture];
    let largest = pictures.into_iter().flatten().max_by_key(|(picture, _)| picture.pixels().len());
    let Some((largest, _)) = largest else { return Ok(None) };
    let (width, height) = (largest.width(), largest.height());
    fn level(map: &Option<(maquette_value::Image, u8)>, uv: [f64; 2]) -> u8 {
        match map {
            Some((picture, channel)) => picture.sample(uv)[usize::from(*channel)].round() as u8,
            None => 255,
        }
    }
    let pixels = (0..width * height).map(|pixel| {
        let uv = [
            ((pixel % width) as f64 + 0.5) / width as f64,
            1.0 - ((pixel / width) as f64 + 0.5) / height as f64,
        ];
        [255, level(&rough_picture, uv), level(&metal_picture, uv)]
    });
    let picture = maquette_value::Image::new(width, height, pixels.collect::<Vec<Rgb>>())?;
    let like = rough.or(metal).expect("one of them is there");
    Ok(Some(Map { file: String::new(), bytes: png::encode_rgb(&picture)?.into(), ..like.clone() }))
}

/// Returns true if all vertices or corners of a material have the color of the material.
pub(crate) fn vertex_colors_equal_material(mesh: &Mesh, number: u32) -> bool {
    let color = mesh.materials()[number as usize].color();
    let numbers = mesh.face_materials();
    let (vertices, corners) = (mesh.vertex().colors("color"), mesh.corner().colors("color"));
    let mut faces = mesh.faces().iter().enumerate().filter(|(face, _)| {
        numbers.is_none_or(|numbers| mesh.resolve_material(numbers[*face]) == number)
    });
    faces.all(|(face, face_vertices)| match (vertices, corners) {
        (Some(colors), _) => face_vertices.iter().all(|&vertex| colors[vertex as usize] == color),
        (None, Some(colors)) => {
            let first = mesh.faces().first_corner(face);
            colors[first..first + face_vertices.len()].iter().all(|it| *it == color)
        }
        (None, None) => false,
    })
}

/// Returns the transformation that a material's maps apply to the texture coordinates `uv`.
pub(super) fn uv_transform(material: &Material, uv: &str) -> UvTransform {
    let map = material.maps.values().find(|map| map.uv == uv);
    map.map(|map| map.transform).filter(UvTransform::is_invertible).unwrap_or_default()
}

/// Returns the names of the attributes with texture coordinates: `uv`, then `uv1`, `uv2`, ..
pub(super) fn coordinate_sets(vertices: &Vertices<'_>) -> Vec<String> {
    let mut sets: Vec<_> = vertices
        .pairs_names()
        .filter_map(|name| {
            let number = name.strip_prefix("uv")?;
            let number = if number.is_empty() { 0 } else { number.parse::<u32>().ok()? };
            Some((number, name.to_owned()))
        })
        .collect();
    sets.sort();
    sets.dedup();
    sets.into_iter().map(|(_, name)| name).collect()
}

/// Returns warnings about integers of vertices and corners that are rounded to single precision.
pub(super) fn rounding_warnings(mesh: &Mesh) -> Vec<String> {
    const EXACT: u32 = 1 << 24;
    let all = mesh.vertex().iter().chain(mesh.corner().iter());
    fn is_large(attribute: &Attribute) -> bool {
        matches!(attribute, Attribute::Index(all) if all.iter().any(|&x| x > EXACT))
    }
    let names = all.filter(|(_, attribute)| is_large(attribute)).map(|(name, _)| {
        format!("`{name}` has integers over {EXACT}, which are rounded: glTF stores integers of vertices in single precision")
    });
    names.collect()
}
