//! The materials of a mesh as a GLB file has them.

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

/// Materials of a document, and the pictures on them.
#[derive(Default)]
pub(super) struct Looks {
    pub(super) materials: Vec<Value>,
    samplers: Vec<Value>,
    textures: Vec<Value>,
    images: Vec<Value>,
    /// What the images are made of.
    files: Vec<Column<u8>>,
    extensions: BTreeSet<String>,
    required: BTreeSet<String>,
}

/// How a map is written: kinds of glTF, with their keys, and whether a material or its shading has them.
const KEYS: [(MapKind, &str); 4] = [
    (MapKind::BaseColor, "baseColorTexture"),
    (MapKind::Normal, "normalTexture"),
    (MapKind::Occlusion, "occlusionTexture"),
    (MapKind::Emissive, "emissiveTexture"),
];

impl Looks {
    /// Adds a material; `sets` has the attributes of texture coordinates in the order of the file. Where `colors` says so, the color is
    /// that of the vertices.
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
        let mut packed = packed(&material.maps)?;
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
        // A picture that comes from no file.
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

    /// The use of a map; none if the mesh no longer has its texture coordinates.
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
        let mut texture = json!({ "sampler": place(&mut self.samplers, sampler), "source": image });
        if self.images[image]["mimeType"] == "image/webp" {
            let extension = json!({ "EXT_texture_webp": { "source": image } });
            texture = json!({ "sampler": texture["sampler"], "extensions": extension });
            for extensions in [&mut self.extensions, &mut self.required] {
                extensions.insert("EXT_texture_webp".to_owned());
            }
        }
        let mut of = json!({ "index": place(&mut self.textures, texture) });
        if set > 0 {
            of["texCoord"] = set.into();
        }
        let UvTransform { offset, rotation, scale } = map.transform;
        if map.transform != UvTransform::default() && map.transform.can_be_undone() {
            let mut transform = json!({ "offset": offset, "scale": scale });
            if rotation != 0.0 {
                transform["rotation"] = rotation.into();
            }
            of["extensions"]["KHR_texture_transform"] = transform;
            self.extensions.insert("KHR_texture_transform".to_owned());
        }
        Ok(Some(of))
    }

    /// The picture of a map, each once: as it is in its file, or as PNG if glTF does not know its format.
    fn image(&mut self, map: &Map, file: &mut Buffers<'_>) -> Result<usize, Error> {
        let known = self.files.iter().position(|known| known.hash() == map.bytes.hash());
        if let Some(known) = known {
            return Ok(known);
        }
        let (kind, bytes) = match Kind::of(&map.bytes) {
            Some(Kind::Png) => ("image/png", map.bytes.clone()),
            Some(Kind::Jpeg) => ("image/jpeg", map.bytes.clone()),
            Some(Kind::WebP) => ("image/webp", map.bytes.clone()),
            _ => ("image/png", png::encode_rgb(&picture_file::read(&map.bytes)?)?.into()),
        };
        let view = file.view(Table::of_shared(bytes), None);
        let mut image = json!({ "bufferView": view, "mimeType": kind });
        if !map.file.is_empty() {
            image["name"] = map.file.clone().into();
        }
        self.images.push(image);
        self.files.push(map.bytes.clone());
        Ok(self.images.len() - 1)
    }

    /// Puts all of it into the document.
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

/// Whether what only one format knows is an extension of glTF.
pub(crate) fn is_extension(name: &str) -> bool {
    let vendor = name.split('_').next().unwrap_or_default();
    vendor.len() >= 2 && vendor.chars().all(|letter| letter.is_ascii_uppercase())
}

/// Whether something that one format knows is an extension of glTF, or a statement of MTL without which nothing is lost: how light was
/// computed, the shine that has become roughness, a color beside a picture, and what exporters write for any material.
pub(super) fn says_nothing_more(name: &str, words: &str) -> bool {
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

/// The place of an item in a list, added if it is not there.
fn place(all: &mut Vec<Value>, item: Value) -> usize {
    all.iter().position(|known| *known == item).unwrap_or_else(|| {
        all.push(item);
        all.len() - 1
    })
}

/// The picture with the metal in blue and the roughness in green: that of both maps if they have it so, else one made of them.
fn packed(maps: &std::collections::BTreeMap<MapKind, Map>) -> Result<Option<Map>, Error> {
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
    fn level(of: &Option<(maquette_value::Image, u8)>, uv: [f64; 2]) -> u8 {
        match of {
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

/// Whether the colors of vertices or corners are those of a material without a picture.
pub(crate) fn has_own_color(mesh: &Mesh, number: u32) -> bool {
    let color = mesh.materials()[number as usize].color();
    let all = mesh.face_materials();
    fn is_of(face: usize, all: &Option<&Column<u32>>, number: u32, mesh: &Mesh) -> bool {
        all.is_none_or(|all| mesh.known_material(all[face]) == number)
    }
    let (vertices, corners) = (mesh.vertex().colors("color"), mesh.corner().colors("color"));
    mesh.faces().iter().enumerate().filter(|(face, _)| is_of(*face, &all, number, mesh)).all(
        |(face, of)| match (vertices, corners) {
            (Some(colors), _) => of.iter().all(|&vertex| colors[vertex as usize] == color),
            (None, Some(colors)) => {
                let first = mesh.faces().first_corner(face);
                colors[first..first + of.len()].iter().all(|it| *it == color)
            }
            (None, None) => false,
        },
    )
}

/// How the texture coordinates of an attribute were moved on their way from a file, by the materials that use it.
pub(super) fn transform_of(material: &Material, uv: &str) -> UvTransform {
    let map = material.maps.values().find(|map| map.uv == uv);
    map.map(|map| map.transform).filter(UvTransform::can_be_undone).unwrap_or_default()
}

/// The attributes of texture coordinates: `uv`, then `uv1`, `uv2`, ..
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

/// A warning about whole numbers of vertices and corners that single precision rounds.
pub(super) fn rounded(mesh: &Mesh) -> Vec<String> {
    const EXACT: u32 = 1 << 24;
    let all = mesh.vertex().iter().chain(mesh.corner().iter());
    fn is_large(attribute: &Attribute) -> bool {
        matches!(attribute, Attribute::Index(all) if all.iter().any(|&x| x > EXACT))
    }
    let names = all.filter(|(_, attribute)| is_large(attribute)).map(|(name, _)| {
        format!("`{name}` has numbers over {EXACT}, which are rounded: glTF has no larger whole numbers on vertices")
    });
    names.collect()
}
