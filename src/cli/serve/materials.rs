//! Materials of meshes, as the messages of `maquette serve` describe them.

use std::collections::BTreeMap;

use maquette_format::picture_file::{self, Kind};
use maquette_value::{Image, Map, MapKind, Material, Mesh, Transparency, Wrap};
use serde::{Deserialize, Serialize};

/// A material, in the form of the protocol of `maquette serve`.
#[derive(Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct MaterialMessage {
    name: String,
    /// Red, green, blue and opacity, from 0 to 1, in linear color space.
    base_color: [f64; 4],
    metallic: f64,
    roughness: f64,
    emissive: [f64; 3],
    transparency: Transparency,
    double_sided: bool,
    vertex_colors: bool,
    /// The texture maps, by the name of their kind.
    maps: BTreeMap<String, MapMessage>,
}

#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct MapMessage {
    /// The name of the file in the exchange folder that contains the map.
    file: String,
    /// The name of the original file from which the map was read.
    #[serde(default)]
    name: String,
    #[serde(default = "default_strength")]
    strength: f64,
    #[serde(default)]
    channel: Option<u8>,
    #[serde(default = "default_uv")]
    uv: String,
    #[serde(default)]
    wrap: [Wrap; 2],
}

fn default_strength() -> f64 {
    1.0
}

fn default_uv() -> String {
    "uv".to_owned()
}

/// Returns a copy of the mesh with these materials. `read` returns the content of a file in the exchange folder.
pub(super) fn with_materials(
    mesh: &Mesh,
    materials: &[MaterialMessage],
    read: impl Fn(&str) -> Result<Vec<u8>, String>,
) -> Result<Mesh, String> {
    let materials = materials.iter().map(|material| {
        let converted = material.to_material(&read);
        converted.map_err(|why| format!("the material `{}`: {why}", material.name))
    });
    Ok(mesh.clone().with_materials(materials.collect::<Result<Vec<_>, String>>()?))
}

impl Default for MaterialMessage {
    fn default() -> Self {
        let plain = Self::new(&Material::default(), |_, _| Ok(String::new()));
        plain.expect("a material without maps writes no file")
    }
}

impl MaterialMessage {
    /// Describes a material for a message. `keep` writes a map to a file with the given extension, and returns the name of the file.
    pub(super) fn new(
        material: &Material,
        mut keep: impl FnMut(&[u8], &'static str) -> Result<String, String>,
    ) -> Result<Self, String> {
        let maps = material.maps.iter().map(|(kind, map)| {
            let message = MapMessage {
                file: keep(&map.bytes, Kind::detect(&map.bytes).map_or("map", Kind::extension))?,
                name: map.file.clone(),
                strength: map.strength,
                channel: map.channel,
                uv: map.uv.clone(),
                wrap: map.wrap,
            };
            Ok((kind.name().to_owned(), message))
        });
        Ok(Self {
            name: material.name.clone(),
            base_color: material.base_color,
            metallic: material.metallic,
            roughness: material.roughness,
            emissive: material.emissive,
            transparency: material.transparency,
            double_sided: material.is_double_sided,
            vertex_colors: material.has_vertex_colors,
            maps: maps.collect::<Result<_, String>>()?,
        })
    }

    fn to_material(
        &self,
        read: impl Fn(&str) -> Result<Vec<u8>, String>,
    ) -> Result<Material, String> {
        let numbers = self.base_color.iter().chain(&self.emissive);
        let mut numbers = numbers.chain([&self.metallic, &self.roughness]);
        if let Some(number) = numbers.find(|number| !(0.0..=1.0).contains(*number)) {
            return Err(format!("expected numbers from 0 to 1, found {number}"));
        }
        let mut maps = BTreeMap::new();
        for (kind, map) in &self.maps {
            maps.insert(MapKind::from_name(kind.clone()), map.to_map(&read)?);
        }
        let [red, green, blue, _] = self.base_color;
        Ok(Material {
            name: self.name.clone(),
            picture: maps
                .get(&MapKind::BaseColor)
                .map(|map| -> Result<Image, String> {
                    let picture = picture_file::read(&map.bytes);
                    let picture = picture.map_err(|error| format!("{}: {error}", map.file))?;
                    Ok(picture.multiply([red, green, blue]))
                })
                .transpose()?,
            base_color: self.base_color,
            metallic: self.metallic,
            roughness: self.roughness,
            emissive: self.emissive,
            transparency: self.transparency,
            is_double_sided: self.double_sided,
            has_vertex_colors: self.vertex_colors,
            maps,
            ..Material::default()
        })
    }
}

impl MapMessage {
    fn to_map(&self, read: impl Fn(&str) -> Result<Vec<u8>, String>) -> Result<Map, String> {
        let bytes = read(&self.file)?;
        if Kind::detect(&bytes).is_none() {
            return Err(format!("expected a picture in {}", self.file));
        }
        if self.channel.is_some_and(|channel| channel > 2) || !self.strength.is_finite() {
            return Err("expected a channel from 0 to 2 and a finite strength of its maps".into());
        }
        Ok(Map {
            strength: self.strength,
            channel: self.channel,
            uv: self.uv.clone(),
            wrap: self.wrap,
            ..Map::new(&*self.name, bytes)
        })
    }
}
