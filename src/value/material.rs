//! Materials: colors, textures and reflection of faces.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::content::Content;
use super::{Column, DecodeError, Decoder, Encoder, Image, Rgb, Value, srgb_from_linear};

/// The material of faces. Its fields are those of the metallic-roughness model of the Khronos Group, "glTF 2.0 Specification" (2021),
/// sections 3.9 and 5.19, plus the additional statements of MTL files.
///
/// All numbers are finite. Colors are linear in light, from 0 to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// The name of the material; empty if it has none.
    pub name: String,
    /// The texture that viewers show, in 8-bit sRGB: the picture of the map [`MapKind::BaseColor`], multiplied by
    /// [`base_color`](Self::base_color).
    pub picture: Option<Image>,
    /// The base color: red, green, blue and opacity. It is multiplied with the picture.
    pub base_color: [f64; 4],
    /// The metalness, from 0 (like plastic) to 1 (like metal). It is multiplied with the metalness map.
    pub metallic: f64,
    /// The roughness, from 0 (smooth) to 1 (rough). It is multiplied with the roughness map.
    pub roughness: f64,
    /// The emitted light: red, green, blue. It is multiplied with the map of emitted light.
    pub emissive: [f64; 3],
    /// The effect of opacity on visibility.
    pub transparency: Transparency,
    /// True if faces are visible from both sides.
    pub is_double_sided: bool,
    /// True if the colors of vertices are multiplied with the picture. Without a picture the colors of vertices are used alone.
    pub has_vertex_colors: bool,
    /// The textures as they are stored in files.
    pub maps: BTreeMap<MapKind, Map>,
    /// Data that only one file format has, by name: extensions of glTF as JSON, and statements of MTL as their text.
    pub others: BTreeMap<String, String>,
}

/// The effect of opacity on visibility.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Transparency {
    /// Opacity is ignored.
    Opaque,
    /// A surface is invisible where its opacity is less than this threshold, and fully visible elsewhere.
    Cutoff(f64),
    /// The background shows through in proportion to the opacity.
    Blend,
}

/// The surface property that a texture describes.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum MapKind {
    /// The color, in sRGB, and the opacity.
    BaseColor,
    /// The emitted light, in sRGB.
    Emissive,
    /// The metalness, in one channel of the texture.
    Metallic,
    /// The normals, in tangent space.
    Normal,
    /// The ambient occlusion, in one channel of the texture.
    Occlusion,
    /// The roughness, in one channel of the texture.
    Roughness,
    /// The surface property of an MTL statement such as `map_Ks`.
    Other(String),
}

/// A texture of a material, as it is stored in a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// The name of the texture's file, without folders; empty if it has none.
    pub file: String,
    /// The content of the texture's file, as bytes.
    pub bytes: Column<u8>,
    /// The strength of a normal map or occlusion map, usually 1.
    pub strength: f64,
    /// The only channel that is used, from 0 (red) to 2 (blue). `None` if all channels are used.
    pub channel: Option<u8>,
    /// The name of the vertex or corner attribute that holds the texture coordinates.
    pub uv: String,
    /// The transform from the texture coordinates in the file to those of the mesh.
    pub transform: UvTransform,
    /// The continuation of the texture beyond its border, in u and v.
    pub wrap: [Wrap; 2],
    /// The filters for magnification and minification, as the numbers of glTF. 0 if the file does not give them.
    pub filters: [u32; 2],
}

/// The continuation of a texture beyond its border.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Wrap {
    /// The texture is repeated beyond its border.
    #[default]
    Repeat,
    /// The texture is mirrored at its border.
    Mirror,
    /// Beyond its border the texture has the color of the nearest border point.
    Clamp,
}

/// A transform of texture coordinates, in which (0, 0) is the upper left corner. It scales, then rotates (radians, counterclockwise), then
/// translates (Khronos Group, "KHR_texture_transform").
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UvTransform {
    /// The translation, applied last.
    pub offset: [f64; 2],
    /// The rotation in radians.
    pub rotation: f64,
    /// The scale, applied first.
    pub scale: [f64; 2],
}

impl Default for UvTransform {
    fn default() -> Self {
        Self { offset: [0.0; 2], rotation: 0.0, scale: [1.0; 2] }
    }
}

impl UvTransform {
    /// Transforms a pair of texture coordinates.
    #[must_use]
    pub fn apply(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = (libm::sin(self.rotation), libm::cos(self.rotation));
        let [u, v] = [u * self.scale[0], v * self.scale[1]];
        [cos * u + sin * v + self.offset[0], cos * v - sin * u + self.offset[1]]
    }

    /// Applies the inverse transform to a pair of texture coordinates.
    #[must_use]
    pub fn apply_inverse(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = (libm::sin(self.rotation), libm::cos(self.rotation));
        let [u, v] = [u - self.offset[0], v - self.offset[1]];
        [(cos * u - sin * v) / self.scale[0], (sin * u + cos * v) / self.scale[1]]
    }

    /// Returns true if the inverse transform exists.
    #[must_use]
    pub fn is_invertible(&self) -> bool {
        self.scale.iter().all(|scale| scale.abs() > 1e-12)
    }
}

impl Default for Material {
    /// The material of meshes that have none: rough, not metallic, visible from both sides.
    fn default() -> Self {
        Self {
            name: String::new(),
            picture: None,
            base_color: [1.0; 4],
            metallic: 0.0,
            roughness: 0.9,
            emissive: [0.0; 3],
            transparency: Transparency::Opaque,
            is_double_sided: true,
            has_vertex_colors: false,
            maps: BTreeMap::new(),
            others: BTreeMap::new(),
        }
    }
}

impl Material {
    /// A default material that shows this picture.
    #[must_use]
    pub fn from_picture(picture: Image) -> Self {
        Self { picture: Some(picture), ..Self::default() }
    }

    /// Returns true if the material equals the default, except for the picture.
    #[must_use]
    pub fn is_plain(&self) -> bool {
        Self { picture: None, ..self.clone() } == Self::default()
    }

    /// The picture, unless it has no pixels.
    #[must_use]
    pub fn non_empty_picture(&self) -> Option<&Image> {
        self.picture.as_ref().filter(|picture| !picture.pixels().is_empty())
    }

    /// The base color in 8-bit sRGB, which is used where the material has no picture.
    #[must_use]
    pub fn color(&self) -> Rgb {
        let [red, green, blue, _] = self.base_color;
        [red, green, blue].map(srgb_from_linear)
    }

    /// The continuation of the material's picture beyond the border, in u and v.
    #[must_use]
    pub fn wrap(&self) -> [Wrap; 2] {
        self.maps.get(&MapKind::BaseColor).map_or([Wrap::Clamp; 2], |map| map.wrap)
    }

    /// Returns the color of the material's picture at a texture coordinate, or white if the material has no picture. (0, 0) is the lower
    /// left corner, as in [`Image::sample`]. Coordinates outside of the picture follow the wrap mode of the texture map. At the border, no
    /// texels of the opposite side are mixed in.
    #[must_use]
    pub fn sample(&self, uv: [f64; 2]) -> [f64; 3] {
        self.non_empty_picture()
            .map_or([255.0; 3], |picture| picture.sample(Wrap::wrap_uv(self.wrap(), uv)))
    }

    fn encode(&self, to: &mut Encoder) {
        let (kind, cutoff) = match self.transparency {
            Transparency::Opaque => (0, 0.0),
            Transparency::Cutoff(cutoff) => (1, cutoff),
            Transparency::Blend => (2, 0.0),
        };
        self.picture.encode(to.text(&self.name));
        to.plain(&self.base_color)
            .plain(&[self.metallic, self.roughness, cutoff])
            .plain(&self.emissive)
            .plain(&[kind, u8::from(self.is_double_sided), u8::from(self.has_vertex_colors)])
            .counts(&[self.maps.len(), self.others.len()]);
        for (kind, map) in &self.maps {
            map.encode(to.text(kind.name()));
        }
        for (name, words) in &self.others {
            to.text(name).text(words);
        }
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let name = from.text()?;
        let picture: Option<Image> = from.option(Decoder::value)?;
        if !picture.iter().all(|picture| {
            picture.width().checked_mul(picture.height()) == Some(picture.pixels().len())
        }) {
            return Err(DecodeError);
        }
        let base_color = from.plain()?;
        let [metallic, roughness, cutoff] = from.plain()?;
        let emissive = from.plain()?;
        let [kind, is_double_sided, has_vertex_colors]: [u8; 3] = from.plain()?;
        let transparency = match kind {
            0 => Transparency::Opaque,
            1 => Transparency::Cutoff(cutoff),
            _ => Transparency::Blend,
        };
        let [maps, others] = from.counts()?;
        let maps = (0..maps)
            .map(|_| Ok((MapKind::from_name(from.text()?), Map::decode(from)?)))
            .collect::<Result<_, _>>()?;
        let others =
            (0..others).map(|_| Ok((from.text()?, from.text()?))).collect::<Result<_, _>>()?;
        let [is_double_sided, has_vertex_colors] =
            [is_double_sided, has_vertex_colors].map(|it| it == 1);
        Ok(Self {
            name,
            picture,
            base_color,
            metallic,
            roughness,
            emissive,
            transparency,
            is_double_sided,
            has_vertex_colors,
            maps,
            others,
        })
    }

    fn size(&self) -> usize {
        let maps: usize = self.maps.values().map(|map| map.bytes.size()).sum();
        self.picture.as_ref().map_or(0, Value::size) + maps
    }
}

impl MapKind {
    /// The name of the property: `base color`, `emissive`, `metallic`, `normal`, `occlusion`, `roughness`, or the name of the MTL
    /// statement.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::BaseColor => "base color",
            Self::Emissive => "emissive",
            Self::Metallic => "metallic",
            Self::Normal => "normal",
            Self::Occlusion => "occlusion",
            Self::Roughness => "roughness",
            Self::Other(name) => name,
        }
    }

    /// Returns the property with this name. An unknown name stands for an MTL statement.
    #[must_use]
    pub fn from_name(name: String) -> Self {
        use MapKind::*;
        let known = [BaseColor, Emissive, Metallic, Normal, Occlusion, Roughness];
        known.into_iter().find(|kind| kind.name() == name).unwrap_or(Other(name))
    }
}

impl Map {
    /// A texture from a file with this name and content, with the texture coordinates in the attribute `uv`.
    pub fn new(file: impl Into<String>, bytes: impl Into<Column<u8>>) -> Self {
        Self {
            file: file.into(),
            bytes: bytes.into(),
            strength: 1.0,
            channel: None,
            uv: "uv".to_owned(),
            transform: UvTransform::default(),
            wrap: [Wrap::default(); 2],
            filters: [0; 2],
        }
    }

    fn encode(&self, to: &mut Encoder) {
        let UvTransform { offset, rotation, scale } = self.transform;
        to.text(&self.file)
            .column(&self.bytes)
            .text(&self.uv)
            .plain(&[self.strength, rotation, offset[0], offset[1], scale[0], scale[1]])
            .plain(&self.filters)
            .plain(&[self.channel.unwrap_or(u8::MAX), self.wrap[0] as u8, self.wrap[1] as u8]);
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let (file, bytes, uv) = (from.text()?, from.column()?, from.text()?);
        let [strength, rotation, x, y, width, height] = from.plain()?;
        let filters = from.plain()?;
        let [channel, u, v]: [u8; 3] = from.plain()?;
        fn wrap(number: u8) -> Wrap {
            match number {
                0 => Wrap::Repeat,
                1 => Wrap::Mirror,
                _ => Wrap::Clamp,
            }
        }
        let transform = UvTransform { offset: [x, y], rotation, scale: [width, height] };
        let (channel, wrap) = (Some(channel).filter(|it| *it < 3), [wrap(u), wrap(v)]);
        Ok(Self { file, bytes, strength, channel, uv, transform, wrap, filters })
    }
}

impl Wrap {
    /// Maps a texture coordinate beyond the border to the equivalent one inside of the picture.
    #[must_use]
    pub fn wrap_uv(wrap: [Self; 2], uv: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|k| wrap[k].wrap(uv[k]))
    }

    /// The two texels around a position (texel k is at k), and the fraction of the way from the first to the second.
    pub(super) fn texels(self, position: f64, count: usize) -> (usize, usize, f64) {
        if self == Self::Clamp {
            let position = position.clamp(0.0, (count - 1) as f64);
            let first = position as usize;
            return (first, (first + 1).min(count - 1), position - first as f64);
        }
        let first = position.floor();
        let [a, b] = [first as i64, (first as i64).saturating_add(1)]
            .map(|index| self.wrap_index(index, count));
        (a, b, position - first)
    }

    /// Maps a texel index to the equivalent one below `count`, for a repeated or mirrored texture.
    fn wrap_index(self, index: i64, count: usize) -> usize {
        let (count, wide) = (count as i64, 2 * count as i64);
        let index = match self {
            Self::Mirror if index.rem_euclid(wide) >= count => wide - 1 - index.rem_euclid(wide),
            _ => index.rem_euclid(count),
        };
        index as usize
    }

    /// Maps a coordinate to the equivalent one from 0 to 1. The coordinate of a clamped texture is not changed.
    fn wrap(self, x: f64) -> f64 {
        if (0.0..=1.0).contains(&x) {
            return x;
        }
        match self {
            Self::Clamp => x,
            Self::Repeat => x - x.floor(),
            Self::Mirror => {
                let x = x.rem_euclid(2.0);
                if x > 1.0 { 2.0 - x } else { x }
            }
        }
    }
}

/// The tag at the start of an encoded list of materials. The other encodings start with the tag 0 (no material) or 1 (a single picture).
const SEVERAL: u8 = 2;

/// The materials of a mesh. If the only material is a plain picture, only the picture is written.
impl Content for Arc<[Material]> {
    fn encode(&self, to: &mut Encoder) {
        let picture = match &self[..] {
            [] => None,
            [only] if only.is_plain() && only.picture.is_some() => only.picture.as_ref(),
            _ => {
                to.plain(&SEVERAL).counts(&[self.len()]);
                return self.iter().for_each(|material| material.encode(to));
            }
        };
        to.option(picture, |to, picture| {
            to.value(picture);
        });
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        match from.plain::<u8>()? {
            SEVERAL => {
                let [count] = from.counts()?;
                (0..count).map(|_| Material::decode(from)).collect()
            }
            1 => Ok([Material::from_picture(from.value()?)].into()),
            _ => Ok(Self::default()),
        }
    }

    fn size(&self) -> usize {
        self.iter().map(Material::size).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transforms_of_coordinates_can_be_inverted() {
        let quarter = std::f64::consts::FRAC_PI_2;
        let transform = UvTransform { offset: [0.5, 0.25], rotation: quarter, scale: [2.0, 3.0] };
        let moved = transform.apply([0.25, 0.5]);
        assert!((moved[0] - 2.0).abs() < 1e-15 && (moved[1] + 0.25).abs() < 1e-15, "{moved:?}");
        let back = transform.apply_inverse(moved);
        assert!((back[0] - 0.25).abs() < 1e-15 && (back[1] - 0.5).abs() < 1e-15, "{back:?}");
        assert!(!UvTransform { scale: [0.0, 1.0], ..transform }.is_invertible());
    }

    #[test]
    fn pictures_continue_beyond_their_border() {
        fn wrap_samples(wrap: Wrap) -> [f64; 5] {
            [-0.25, 0.0, 1.0, 1.25, 2.5].map(|x| wrap.wrap(x))
        }
        assert_eq!(wrap_samples(Wrap::Repeat), [0.75, 0.0, 1.0, 0.25, 0.5]);
        assert_eq!(wrap_samples(Wrap::Mirror), [0.25, 0.0, 1.0, 0.75, 0.5]);
        assert_eq!(wrap_samples(Wrap::Clamp), [-0.25, 0.0, 1.0, 1.25, 2.5]);
        fn texels(wrap: Wrap) -> [(usize, usize, f64); 4] {
            [-0.5, 1.25, 3.5, 8.0].map(|position| wrap.texels(position, 4))
        }
        assert_eq!(texels(Wrap::Clamp), [(0, 1, 0.0), (1, 2, 0.25), (3, 3, 0.0), (3, 3, 0.0)]);
        assert_eq!(texels(Wrap::Repeat), [(3, 0, 0.5), (1, 2, 0.25), (3, 0, 0.5), (0, 1, 0.0)]);
        assert_eq!(texels(Wrap::Mirror), [(0, 0, 0.5), (1, 2, 0.25), (3, 3, 0.5), (0, 1, 0.0)]);
        let picture = Image::new(2, 1, vec![[0; 3], [200, 100, 0]]).unwrap();
        assert_eq!(picture.sample_beyond([1.0, 0.5], [Wrap::Repeat; 2]), [100.0, 50.0, 0.0]);
    }
}
