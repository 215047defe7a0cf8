//! A number per pixel.

use super::hostile::SIZES;
use super::image::{SizeError, check_size};
use super::{
    Column, DecodeError, Decoder, Encoder, Image, Items, Layer, Meaning, Mesh, On, Parts,
    PartsError, Picture, Rgb, Summary, Value,
};

/// A number per pixel, such as a gradient's length; row 0 on top. Numbers may be NaN, which means: not known there.
///
/// Invariant, checked by [`Field::new`]: as many numbers as width x height.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    width: usize,
    height: usize,
    pixels: Column<f32>,
}

impl Field {
    /// A field of `width` x `height` numbers, row by row from the top.
    ///
    /// # Errors
    /// If there are more or fewer numbers than that.
    pub fn new(
        width: usize,
        height: usize,
        pixels: impl Into<Column<f32>>,
    ) -> Result<Self, SizeError> {
        let pixels = pixels.into();
        check_size(width, height, pixels.len())?;
        Ok(Self { width, height, pixels })
    }

    /// Numbers in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All numbers, row by row from the top.
    pub fn pixels(&self) -> &[f32] {
        &self.pixels
    }

    /// The least and the greatest number; none if no number is finite.
    pub fn range(&self) -> Option<(f32, f32)> {
        self.pixels.iter().filter(|x| x.is_finite()).fold(None, |range, &x| match range {
            None => Some((x, x)),
            Some((lo, hi)) => Some((lo.min(x), hi.max(x))),
        })
    }
}

impl Value for Field {
    const NAME: &'static str = "Field";

    fn encode(&self, to: &mut Encoder) {
        to.counts(&[self.width, self.height]).column(&self.pixels);
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let [width, height] = from.counts()?;
        Ok(Self { width, height, pixels: from.column()? })
    }

    fn size(&self) -> usize {
        self.pixels.size()
    }

    fn describe(&self) -> Summary {
        let summary = Summary::default().with("size", format!("{} x {}", self.width, self.height));
        match self.range() {
            Some((lo, hi)) => summary.with("least", lo).with("greatest", hi),
            None => summary.with("finite numbers", 0),
        }
    }

    fn probe(&self, [column, row]: [usize; 2]) -> Summary {
        if self.width <= column || self.height <= row {
            return Summary::default();
        }
        Summary::default().with("value", self.pixels[row * self.width + column])
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.grid(self.width, self.height);
        parts.push("number", On::Pixel, Meaning::Number, 1, &self.pixels[..]);
        parts
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let [width, height] = parts.size()?;
        let pixels: Vec<f32> = match &parts.need("number", 1)?.items {
            Items::F32(items) => items.to_vec(),
            items => items.numbers().iter().map(|&x| x as f32).collect(),
        };
        Self::new(width, height, pixels).map_err(PartsError::refused)
    }

    /// From black, the least number, to white, the greatest; black where there is no number.
    fn show(&self) -> Vec<Layer> {
        let (least, greatest) = self.range().unwrap_or_default();
        let (least, greatest) = (f64::from(least), f64::from(greatest));
        let scale = if least < greatest { 255.0 / (greatest - least) } else { 0.0 };
        let pixels: Vec<Rgb> = self
            .pixels
            .iter()
            .map(|&x| [((f64::from(x) - least) * scale).round() as u8; 3])
            .collect();
        Picture::own(Image::new(self.width, self.height, pixels))
    }

    fn as_mesh(&self) -> Option<Mesh> {
        None
    }

    fn hostile() -> Vec<Self> {
        let field =
            |[width, height]: [usize; 2], x| Self::new(width, height, vec![x; width * height]);
        let fields = SIZES
            .into_iter()
            .flat_map(|size| [f32::NAN, f32::INFINITY, 0.0, 1e38].map(|x| field(size, x)));
        fields.flatten().collect()
    }
}
