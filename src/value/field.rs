//! A number per pixel.

use super::content::content_of_fields;
use super::edge_cases::uniform_pictures;
use super::image::{SizeError, check_size};
use super::{
    Column, ElementKind, Image, Items, Layer, Meaning, Mesh, Parts, PartsError, Picture, Rgb,
    Summary, Value,
};

/// A number per pixel, such as the length of a gradient. Row 0 is the top. NaN marks an unknown number.
///
/// Invariant, checked by [`Field::new`]: there are width x height numbers.
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
    /// If the number of entries is not `width` x `height`.
    pub fn new(
        width: usize,
        height: usize,
        pixels: impl Into<Column<f32>>,
    ) -> Result<Self, SizeError> {
        let pixels = pixels.into();
        check_size(width, height, pixels.len())?;
        Ok(Self { width, height, pixels })
    }

    /// The number of columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All numbers, row by row from the top.
    pub fn pixels(&self) -> &[f32] {
        &self.pixels
    }

    /// The minimum and maximum of the finite numbers; `None` if there are none.
    pub fn range(&self) -> Option<(f32, f32)> {
        self.pixels.iter().filter(|x| x.is_finite()).fold(None, |range, &x| match range {
            None => Some((x, x)),
            Some((lo, hi)) => Some((lo.min(x), hi.max(x))),
        })
    }
}

impl Value for Field {
    const NAME: &'static str = "Field";

    content_of_fields! { width height pixels }

    fn describe(&self) -> Summary {
        let summary =
            Summary::default().with_fact("size", format!("{} x {}", self.width, self.height));
        match self.range() {
            Some((lo, hi)) => summary.with_fact("least", lo).with_fact("greatest", hi),
            None => summary.with_fact("finite numbers", 0),
        }
    }

    fn probe(&self, [column, row]: [usize; 2]) -> Summary {
        if self.width <= column || self.height <= row {
            return Summary::default();
        }
        Summary::default().with_fact("value", self.pixels[row * self.width + column])
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.grid(self.width, self.height);
        parts.push("number", ElementKind::Pixel, Meaning::Number, 1, &self.pixels[..]);
        parts
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let [width, height] = parts.size()?;
        let pixels: Vec<f32> = match &parts.require("number", 1)?.items {
            Items::F32(items) => items.to_vec(),
            items => items.numbers().iter().map(|&x| x as f32).collect(),
        };
        Self::new(width, height, pixels).map_err(PartsError::from_error)
    }

    /// Draws the minimum in black and the maximum in white. Unknown numbers are black.
    fn show(&self) -> Vec<Layer> {
        let (min, max) = self.range().unwrap_or_default();
        let (min, max) = (f64::from(min), f64::from(max));
        let scale = if min < max { 255.0 / (max - min) } else { 0.0 };
        let pixels: Vec<Rgb> = self
            .pixels
            .iter()
            .map(|&x| [((f64::from(x) - min) * scale).round() as u8; 3])
            .collect();
        Picture::from_true_colors(Image::new(self.width, self.height, pixels))
    }

    fn as_mesh(&self) -> Option<Mesh> {
        None
    }

    fn edge_cases() -> Vec<Self> {
        uniform_pictures(&[f32::NAN, f32::INFINITY, 0.0, 1e38], Self::new)
    }
}
