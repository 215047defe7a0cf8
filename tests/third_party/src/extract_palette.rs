//! Finds the most frequent colors of a picture.

use std::collections::BTreeMap;

use maquette::value::{Image, Mask, Rgb};
use maquette::{Context, Error, In, Node};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Palette;

/// Finds the most frequent colors of a picture.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ExtractPalette {
    /// The picture.
    pub image: In<Image>,
    /// The pixels to use; all if omitted.
    pub within: Option<In<Mask>>,
    /// Maximum number of colors.
    #[schemars(range(min = 1, max = 256))]
    #[serde(default = "eight")]
    pub count: u32,
}

fn eight() -> u32 {
    8
}

/// The error if the mask has another size than the picture.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the mask `within` has another size than the picture")]
pub struct SizeError;

impl Node for ExtractPalette {
    type Outputs = (Palette,);
    const OUTPUTS: [&'static str; 1] = ["palette"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let within = self.within.as_ref().map(|mask| cx.get(mask));
        Ok((extract_palette(cx.get(&self.image), within, self.count as usize)?,))
    }
}

/// Returns the `count` most frequent colors of a picture, the most frequent first. Two colors count as different if the four upper bits of
/// a channel differ. Of equally frequent colors the darker comes first.
///
/// # Errors
/// If the mask has another size than the picture.
pub fn extract_palette(
    image: &Image,
    within: Option<&Mask>,
    count: usize,
) -> Result<Palette, SizeError> {
    if within.is_some_and(|mask| [mask.width(), mask.height()] != [image.width(), image.height()]) {
        return Err(SizeError);
    }
    let mut counts: BTreeMap<Rgb, usize> = BTreeMap::new();
    for (index, pixel) in image.pixels().iter().enumerate() {
        if within.is_none_or(|mask| mask.pixels()[index] == 1) {
            *counts.entry(pixel.map(|channel| channel & 0xf0 | channel >> 4)).or_default() += 1;
        }
    }
    let mut colors: Vec<(Rgb, usize)> = counts.into_iter().collect();
    colors.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    Ok(Palette(colors.into_iter().take(count).map(|(color, _)| color).collect()))
}
