//! How faces look: colors, pictures, and how they reflect light.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{Column, DecodeError, Decoder, Encoder, Image, Rgb, Value, srgb_from_linear};

/// How faces look: the metallic-roughness model of the Khronos Group, "glTF 2.0 Specification" (2021), sections 3.9 and 5.19, with
/// what MTL files say beyond it.
///
/// Numbers are finite; colors are linear in light, 0 to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its name, empty if it has none.
    pub name: String,
    /// What is seen of it: the picture of the map [`MapKind::BaseColor`], times [`base_color`](Self::base_color), in 8-bit sRGB.
    pub picture: Option<Image>,
    /// Red, green, blue and opacity; multiplied with the picture.
    pub base_color: [f64; 4],
    /// 0 (like plastic) to 1 (like metal); multiplied with the map.
    pub metallic: f64,
    /// 0 (smooth) to 1 (rough); multiplied with the map.
    pub roughness: f64,
    /// Light that it sends out; multiplied with the map.
    pub emissive: [f64; 3],
    /// What opacity means.
    pub transparency: Transparency,
    /// Whether faces are seen from both sides.
    pub is_double_sided: bool,
    /// Whether the colors of vertices are multiplied with the picture; where there is no picture they are seen alone.
    pub has_vertex_colors: bool,
    /// Its pictures, as they are in files.
    pub maps: BTreeMap<MapKind, Map>,
    /// What one format alone knows, by name: extensions of glTF as JSON, statements of MTL as their words.
    pub others: BTreeMap<String, String>,
}

/// What opacity means.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Transparency {
    /// Nothing.
    Opaque,
    /// Below this opacity there is nothing to see, above it all.
    Cutoff(f64),
    /// What lies behind shows through.
    Blend,
}

/// What a picture says of a surface.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum MapKind {
    /// Its color, in sRGB, and its opacity.
    BaseColor,
    /// Light that it sends out, in sRGB.
    Emissive,
    /// How metallic it is, in one channel.
    Metallic,
    /// Its normals, in tangent space.
    Normal,
    /// How much light from around reaches it, in one channel.
    Occlusion,
    /// How rough it is, in one channel.
    Roughness,
    /// What a statement of MTL says, such as `map_Ks`.
    Other(String),
}

/// A picture of a material, as it is in a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// The name of its file, without folders; empty if it has none.
    pub file: String,
    /// The content of its file.
    pub bytes: Column<u8>,
    /// How strong normals and occlusion are, usually 1.
    pub strength: f64,
    /// The channel that counts, 0 (red) to 2 (blue), if only one does.
    pub channel: Option<u8>,
    /// The attribute of vertices or corners that has its texture coordinates.
    pub uv: String,
    /// What was done to the coordinates in the file to get those of the mesh.
    pub transform: UvTransform,
    /// How it goes on beyond its border, in u and v.
    pub wrap: [Wrap; 2],
    /// How texels are blended when the picture is seen larger and smaller than it is: the numbers of glTF, 0 for no wish.
    pub filters: [u32; 2],
}

/// How a picture goes on beyond its border.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Wrap {
    /// From the start.
    #[default]
    Repeat,
    /// Backwards.
    Mirror,
    /// With the color of its border.
    Clamp,
}

/// How texture coordinates, (0, 0) at the upper left corner, are moved: scaled, turned (radians, counterclockwise), and shifted, in
/// this order (Khronos Group, "KHR_texture_transform").
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UvTransform {
    /// Added at last.
    pub offset: [f64; 2],
    /// In radians.
    pub rotation: f64,
    /// Multiplied first.
    pub scale: [f64; 2],
}

impl Default for UvTransform {
    fn default() -> Self {
        Self { offset: [0.0; 2], rotation: 0.0, scale: [1.0; 2] }
    }
}

impl UvTransform {
    /// The moved coordinates.
    #[must_use]
    pub fn apply(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = (libm::sin(self.rotation), libm::cos(self.rotation));
        let [u, v] = [u * self.scale[0], v * self.scale[1]];
        [cos * u + sin * v + self.offset[0], cos * v - sin * u + self.offset[1]]
    }

    /// The coordinates that are moved to these.
    #[must_use]
    pub fn undo(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = (libm::sin(self.rotation), libm::cos(self.rotation));
        let [u, v] = [u - self.offset[0], v - self.offset[1]];
        [(cos * u - sin * v) / self.scale[0], (sin * u + cos * v) / self.scale[1]]
    }

    /// Whether [`undo`](Self::undo) finds the coordinates.
    #[must_use]
    pub fn can_be_undone(&self) -> bool {
        self.scale.iter().all(|scale| scale.abs() > 1e-12)
    }
}

impl Default for Material {
    /// What a mesh looks like of which nothing is known: rough, not metallic, seen from both sides.
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
    /// A material of which only a picture of its color is known.
    #[must_use]
    pub fn of_picture(picture: Image) -> Self {
        Self { picture: Some(picture), ..Self::default() }
    }

    /// Whether nothing is known of it but perhaps a picture.
    #[must_use]
    pub fn is_plain(&self) -> bool {
        Self { picture: None, ..self.clone() } == Self::default()
    }

    /// The picture of its color, if it has pixels.
    #[must_use]
    pub fn shown(&self) -> Option<&Image> {
        self.picture.as_ref().filter(|picture| !picture.pixels().is_empty())
    }

    /// Its color where it has no picture.
    #[must_use]
    pub fn color(&self) -> Rgb {
        let [red, green, blue, _] = self.base_color;
        [red, green, blue].map(srgb_from_linear)
    }

    /// How its picture goes on beyond its border.
    #[must_use]
    pub fn wrap(&self) -> [Wrap; 2] {
        self.maps.get(&MapKind::BaseColor).map_or([Wrap::Clamp; 2], |map| map.wrap)
    }

    /// The color of its picture at a texture coordinate, (0, 0) at the lower left corner, as [`Image::sample`] gives it; white without a
    /// picture. Beyond its border the picture goes on as its map says, and at the border nothing of the other side is mixed in.
    #[must_use]
    pub fn sample(&self, uv: [f64; 2]) -> [f64; 3] {
        self.shown().map_or([255.0; 3], |picture| picture.sample(Wrap::uv(self.wrap(), uv)))
    }

    fn encode(&self, to: &mut Encoder) {
        let (kind, cutoff) = match self.transparency {
            Transparency::Opaque => (0, 0.0),
            Transparency::Cutoff(cutoff) => (1, cutoff),
            Transparency::Blend => (2, 0.0),
        };
        to.text(&self.name)
            .option(self.picture.as_ref(), |to, picture| {
                to.value(picture);
            })
            .plain(&self.base_color)
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
            .map(|_| Ok((MapKind::of(from.text()?), Map::decode(from)?)))
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
    /// Its name: `base color`, `emissive`, `metallic`, `normal`, `occlusion`, `roughness`, or what MTL calls it.
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

    /// The kind of this name.
    #[must_use]
    pub fn of(name: String) -> Self {
        use MapKind::*;
        let known = [BaseColor, Emissive, Metallic, Normal, Occlusion, Roughness];
        known.into_iter().find(|kind| kind.name() == name).unwrap_or(Other(name))
    }
}

impl Map {
    /// A picture in a file of this name with this content, on the attribute `uv`.
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
    /// The texture coordinate inside of a picture where it has what it shows at this one.
    #[must_use]
    pub fn uv(wrap: [Self; 2], uv: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|k| wrap[k].inside(uv[k]))
    }

    /// The two texels beside a place, of which texel k is at k, and how far from the first to the second one it is.
    pub(super) fn texels(self, place: f64, count: usize) -> (usize, usize, f64) {
        if self == Self::Clamp {
            let place = place.clamp(0.0, (count - 1) as f64);
            let first = place as usize;
            return (first, (first + 1).min(count - 1), place - first as f64);
        }
        let texel = |place: i64| {
            let (count, wide) = (count as i64, 2 * count as i64);
            match self {
                Self::Mirror if place.rem_euclid(wide) >= count => {
                    wide - 1 - place.rem_euclid(wide)
                }
                _ => place.rem_euclid(count),
            }
        };
        let first = place.floor();
        let [a, b] = [first as i64, (first as i64).saturating_add(1)].map(|it| texel(it) as usize);
        (a, b, place - first)
    }

    /// The coordinate from 0 to 1 where the picture has what it shows at this one.
    fn inside(self, x: f64) -> f64 {
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

/// Writes the materials of a mesh. One that is plain is written as its picture alone.
pub(super) fn encode(materials: &[Material], to: &mut Encoder) {
    let picture = match materials {
        [] => None,
        [only] if only.is_plain() && only.picture.is_some() => only.picture.as_ref(),
        _ => {
            to.plain(&SEVERAL).counts(&[materials.len()]);
            return materials.iter().for_each(|material| material.encode(to));
        }
    };
    to.option(picture, |to, picture| {
        to.value(picture);
    });
}

/// Where 0 would be no picture, and 1 a picture.
const SEVERAL: u8 = 2;

pub(super) fn decode(from: &mut Decoder<'_>) -> Result<Vec<Material>, DecodeError> {
    match from.plain::<u8>()? {
        SEVERAL => {
            let [count] = from.counts()?;
            (0..count).map(|_| Material::decode(from)).collect()
        }
        1 => Ok(vec![Material::of_picture(from.value()?)]),
        _ => Ok(Vec::new()),
    }
}

/// How many bytes they take.
pub(super) fn size(materials: &[Material]) -> usize {
    materials.iter().map(Material::size).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_are_moved_and_moved_back() {
        let quarter = std::f64::consts::FRAC_PI_2;
        let transform = UvTransform { offset: [0.5, 0.25], rotation: quarter, scale: [2.0, 3.0] };
        let moved = transform.apply([0.25, 0.5]);
        assert!((moved[0] - 2.0).abs() < 1e-15 && (moved[1] + 0.25).abs() < 1e-15, "{moved:?}");
        let back = transform.undo(moved);
        assert!((back[0] - 0.25).abs() < 1e-15 && (back[1] - 0.5).abs() < 1e-15, "{back:?}");
        assert!(!UvTransform { scale: [0.0, 1.0], ..transform }.can_be_undone());
    }

    #[test]
    fn beyond_its_border_a_picture_goes_on() {
        fn of(wrap: Wrap) -> [f64; 5] {
            [-0.25, 0.0, 1.0, 1.25, 2.5].map(|x| wrap.inside(x))
        }
        assert_eq!(of(Wrap::Repeat), [0.75, 0.0, 1.0, 0.25, 0.5]);
        assert_eq!(of(Wrap::Mirror), [0.25, 0.0, 1.0, 0.75, 0.5]);
        assert_eq!(of(Wrap::Clamp), [-0.25, 0.0, 1.0, 1.25, 2.5]);
        fn texels(wrap: Wrap) -> [(usize, usize, f64); 4] {
            [-0.5, 1.25, 3.5, 8.0].map(|place| wrap.texels(place, 4))
        }
        assert_eq!(texels(Wrap::Clamp), [(0, 1, 0.0), (1, 2, 0.25), (3, 3, 0.0), (3, 3, 0.0)]);
        assert_eq!(texels(Wrap::Repeat), [(3, 0, 0.5), (1, 2, 0.25), (3, 0, 0.5), (0, 1, 0.0)]);
        assert_eq!(texels(Wrap::Mirror), [(0, 0, 0.5), (1, 2, 0.25), (3, 3, 0.5), (0, 1, 0.0)]);
        let picture = Image::new(2, 1, vec![[0; 3], [200, 100, 0]]).unwrap();
        assert_eq!(picture.sample_beyond([1.0, 0.5], [Wrap::Repeat; 2]), [100.0, 50.0, 0.0]);
    }
}
