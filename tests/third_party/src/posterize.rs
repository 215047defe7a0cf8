//! Paints a picture with the colors of a palette.

use maquette::value::{Color, Image};
use maquette::{Context, Error, In, Node};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Palette;

/// Paints a picture with the nearest colors of a palette.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Posterize {
    /// The picture.
    pub image: In<Image>,
    /// The colors to use.
    pub palette: In<Palette>,
}

/// The error if the palette is empty.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the palette is empty")]
pub struct EmptyPalette;

impl Node for Posterize {
    type Outputs = (Image,);
    const OUTPUTS: [&'static str; 1] = ["image"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((posterize(cx.get(&self.image), cx.get(&self.palette))?,))
    }
}

/// Replaces each pixel by the nearest color of the palette in CIE L*a*b*. Of equally near colors the first is used.
///
/// # Errors
/// If the palette is empty.
pub fn posterize(image: &Image, palette: &Palette) -> Result<Image, EmptyPalette> {
    let colors: Vec<_> = palette.0.iter().map(|&color| (color, Color(color).lab())).collect();
    fn nearest(pixel: [u8; 3], colors: &[([u8; 3], maquette::value::Lab)]) -> Option<[u8; 3]> {
        let lab = Color(pixel).lab();
        fn by_distance(a: &f32, b: &f32) -> std::cmp::Ordering {
            a.total_cmp(b)
        }
        let distances = colors.iter().map(|(color, at)| (color, lab.distance_sq(*at, 1.0)));
        distances.min_by(|a, b| by_distance(&a.1, &b.1)).map(|(color, _)| *color)
    }
    let pixels: Option<Vec<_>> =
        image.pixels().iter().map(|&pixel| nearest(pixel, &colors)).collect();
    let pixels = pixels.ok_or(EmptyPalette)?;
    Ok(Image::new(image.width(), image.height(), pixels).expect("as many pixels as before"))
}
