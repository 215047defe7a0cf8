//! Pictures and colors.

use std::fmt;
use std::str::FromStr;
use std::sync::LazyLock;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use thiserror::Error;

use super::{Column, Pinhole, Wrap};

mod value;

/// Error of a list whose length does not match the size of a picture or grid.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{count} pixels do not fill {width} x {height}")]
pub struct SizeError {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) count: usize,
}

pub(super) fn check_size(width: usize, height: usize, count: usize) -> Result<(), SizeError> {
    match width.checked_mul(height) {
        Some(pixels) if pixels == count => Ok(()),
        _ => Err(SizeError { width, height, count }),
    }
}

/// A color as in files and on screens: 8-bit sRGB, which is not linear in light.
pub type Rgb = [u8; 3];

/// A picture: 8-bit sRGB pixels; row 0 is the top.
///
/// Invariant, checked by [`Image::new`]: there are width x height pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    width: usize,
    height: usize,
    pixels: Column<Rgb>,
    camera: Option<Pinhole>,
}

impl Image {
    /// A picture of `width` x `height` pixels, row by row from the top.
    ///
    /// # Errors
    /// If the number of pixels is not `width` x `height`.
    pub fn new(
        width: usize,
        height: usize,
        pixels: impl Into<Column<Rgb>>,
    ) -> Result<Self, SizeError> {
        let pixels = pixels.into();
        check_size(width, height, pixels.len())?;
        Ok(Self { width, height, pixels, camera: None })
    }

    /// Sets or removes the camera that took the picture.
    #[must_use]
    pub fn with_camera(mut self, camera: Option<Pinhole>) -> Self {
        self.camera = camera;
        self
    }

    /// The width of the picture in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The height of the picture in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels, row by row from the top.
    pub fn pixels(&self) -> &[Rgb] {
        &self.pixels
    }

    /// The camera that took the picture, if known.
    pub fn camera(&self) -> Option<&Pinhole> {
        self.camera.as_ref()
    }

    /// The pixel at `[column, row]`.
    ///
    /// # Panics
    /// If the position is outside of the picture.
    pub fn pixel(&self, [column, row]: [usize; 2]) -> Rgb {
        assert!(column < self.width, "column {column} is outside of {}", self.width);
        self.pixels[row * self.width + column]
    }

    /// Returns the picture with its red, green and blue channels multiplied by linear factors.
    #[must_use]
    pub fn multiply(&self, factor: [f64; 3]) -> Self {
        if factor == [1.0; 3] {
            return self.clone();
        }
        let table = factor.map(|factor| {
            (0..=255)
                .map(|level| srgb_from_linear(f64::from(linear_from_srgb(level)) * factor))
                .collect::<Vec<u8>>()
        });
        let pixels: Vec<_> = self
            .pixels()
            .iter()
            .map(|color| [0, 1, 2].map(|k| table[k][usize::from(color[k])]))
            .collect();
        Self { pixels: pixels.into(), ..self.clone() }
    }

    /// The color at the texture coordinate `uv`, interpolated in sRGB between the four nearest texels. Outside of the picture it is the
    /// color of the nearest border point. (0, 0) is the lower left corner of the lower left texel, so the center of the texel at column c
    /// and row r of a W x H picture is at ((c + 0.5) / W, 1 - (r + 0.5) / H). At that point the color is exactly the texel's color.
    ///
    /// # Panics
    /// If the picture is empty.
    pub fn sample(&self, uv: [f64; 2]) -> [f64; 3] {
        self.sample_beyond(uv, [Wrap::Clamp; 2])
    }

    /// Returns the color as [`sample`](Self::sample) does, except that the picture continues beyond its border in u and v as `wrap` says.
    ///
    /// # Panics
    /// If the picture is empty.
    pub fn sample_beyond(&self, uv: [f64; 2], wrap: [Wrap; 2]) -> [f64; 3] {
        let (left, right, x) = wrap[0].texels(uv[0] * self.width as f64 - 0.5, self.width);
        let (top, below, y) = wrap[1].texels((1.0 - uv[1]) * self.height as f64 - 0.5, self.height);
        let [a, b, c, d] = [[left, top], [right, top], [left, below], [right, below]]
            .map(|at| self.pixel(at).map(f64::from));
        [0, 1, 2]
            .map(|k| (a[k] * (1.0 - x) + b[k] * x) * (1.0 - y) + (c[k] * (1.0 - x) + d[k] * x) * y)
    }
}

/// A color in CIE L*a*b* with the white point D65. L is from 0 to 100. The distance of two colors approximates their perceived difference
/// (CIE76).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lab {
    /// The lightness, 0 to 100.
    pub l: f32,
    /// The color axis from green (negative) to red (positive).
    pub a: f32,
    /// The color axis from blue (negative) to yellow (positive).
    pub b: f32,
}

impl Lab {
    /// Converts from 8-bit sRGB. The formulas are those of IEC 61966-2-1 for the transfer curve and of CIE 15 for L*a*b*, with the white
    /// point (0.95047, 1, 1.08883). The result is exact to about 1e-5 (single precision).
    pub fn from_srgb(color: Rgb) -> Self {
        let [r, g, b] = color.map(linear_from_srgb);
        let x = (0.4124564 * r + 0.3575761 * g + 0.1804375 * b) / 0.95047;
        let y = 0.2126729 * r + 0.7151522 * g + 0.0721750 * b;
        let z = (0.0193339 * r + 0.119_192 * g + 0.9503041 * b) / 1.08883;
        let [fx, fy, fz] = [x, y, z].map(|t| {
            // The two decimal numbers are (6/29)^3 and 3 (6/29)^2. For `t` up to the first number, a line replaces the cube root.
            if t > 0.008_856_452 { libm::cbrtf(t) } else { t / 0.128_418_55 + 4.0 / 29.0 }
        });
        Self { l: 116.0 * fy - 16.0, a: 500.0 * (fx - fy), b: 200.0 * (fy - fz) }
    }

    /// The squared distance to another color. The weight of the difference in lightness is `lightness`; a weight of 1 gives CIE76.
    pub fn distance_sq(self, other: Self, lightness: f32) -> f32 {
        let l = (self.l - other.l) * lightness;
        let (a, b) = (self.a - other.a, self.b - other.b);
        l * l + a * a + b * b
    }
}

/// The linear light of an 8-bit sRGB channel, from 0 to 1 (IEC 61966-2-1).
pub fn linear_from_srgb(channel: u8) -> f32 {
    static TABLE: LazyLock<[f32; 256]> = LazyLock::new(|| {
        std::array::from_fn(|i| {
            let c = i as f64 / 255.0;
            let light = if c <= 0.04045 { c / 12.92 } else { libm::pow((c + 0.055) / 1.055, 2.4) };
            light as f32
        })
    });
    TABLE[usize::from(channel)]
}

/// The 8-bit sRGB channel for linear light, which is clamped to 0 to 1. This is the inverse of [`linear_from_srgb`].
pub fn srgb_from_linear(light: f64) -> u8 {
    let light = light.clamp(0.0, 1.0);
    let c = if light <= 0.0031308 {
        light * 12.92
    } else {
        1.055 * libm::pow(light, 1.0 / 2.4) - 0.055
    };
    (c * 255.0).round() as u8
}

/// A color as a parameter of a node, written `"#rrggbb"` in graph files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Color(pub Rgb);

impl Color {
    /// Converts the color to CIE L*a*b*.
    pub fn lab(self) -> Lab {
        Lab::from_srgb(self.0)
    }
}

/// The error for a text that is not a color; contains the text.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("`{0}` is not a color; write six hexadecimal digits, as in \"#c33923\"")]
pub struct ColorError(String);

impl FromStr for Color {
    type Err = ColorError;

    fn from_str(text: &str) -> Result<Self, ColorError> {
        let error = || ColorError(text.to_owned());
        let digits = text.strip_prefix('#').ok_or_else(error)?;
        if digits.len() != 6 || !digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
            return Err(error());
        }
        let number = u32::from_str_radix(digits, 16).map_err(|_| error())?;
        let [_, r, g, b] = number.to_be_bytes();
        Ok(Self([r, g, b]))
    }
}

impl fmt::Display for Color {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [r, g, b] = self.0;
        write!(f, "#{r:02x}{g:02x}{b:02x}")
    }
}

impl Serialize for Color {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Color {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(de::Error::custom)
    }
}

impl JsonSchema for Color {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Color".into()
    }

    fn inline_schema() -> bool {
        true
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string", "format": "color" })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_and_black_have_their_lab_values() {
        let white = Lab::from_srgb([255; 3]);
        assert!((white.l - 100.0).abs() < 1e-2 && white.a.abs() < 1e-2 && white.b.abs() < 1e-2);
        let black = Lab::from_srgb([0; 3]);
        assert!(black.l.abs() < 1e-4 && black.a.abs() < 1e-4 && black.b.abs() < 1e-4);
    }

    #[test]
    fn linear_light_and_srgb_round_trip_for_every_channel_value() {
        for channel in 0..=255 {
            assert_eq!(srgb_from_linear(f64::from(linear_from_srgb(channel))), channel);
        }
    }

    #[test]
    fn colors_round_trip_as_text() {
        assert_eq!("#c33923".parse::<Color>().unwrap().to_string(), "#c33923");
        for wrong in ["c33923", "#c3392", "#c3392g", "#c339231", "red", "#+12345"] {
            assert!(wrong.parse::<Color>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_texel_center_has_exactly_its_texels_color() {
        let pixels: Vec<Rgb> = (0..12).map(|i| [i * 20, 255 - i * 20, i]).collect();
        let image = Image::new(4, 3, pixels).unwrap();
        for row in 0..3 {
            for column in 0..4 {
                let uv = [(column as f64 + 0.5) / 4.0, 1.0 - (row as f64 + 0.5) / 3.0];
                let expected = image.pixel([column, row]).map(f64::from);
                let difference = (0..3).map(|k| (image.sample(uv)[k] - expected[k]).abs());
                assert!(difference.fold(0.0, f64::max) < 1e-9, "{column} {row}");
            }
        }
    }

    #[test]
    fn pixels_that_do_not_fill_the_size_are_refused() {
        assert!(Image::new(2, 2, vec![[0; 3]; 3]).is_err());
        assert!(Image::new(usize::MAX, 2, vec![[0; 3]; 3]).is_err());
    }
}
