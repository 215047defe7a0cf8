//! What a threshold selects, and how far a pixel is from that.

use maquette_value::{Color, Image, Lab, Mask, Rgb};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::otsu::otsu;
use crate::picture_error::{PictureError, check_inside};

/// Which pixels a threshold marks.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub enum Select {
    /// Those near a color.
    Near {
        /// The color to look for, as in `"#c33923"`.
        color: Color,
        /// Largest distance that still counts as near, in CIE L*a*b* (CIE76); 2.3 is just noticeable.
        #[schemars(range(min = 0.0, max = 400.0))]
        #[serde(default = "near")]
        distance: f64,
        /// How much differences of lightness count: 1 as all others, 0 not at all, which ignores shading.
        #[schemars(range(min = 0.0, max = 10.0))]
        #[serde(default = "one")]
        lightness: f64,
    },
    /// Those near the color of one pixel.
    Sample {
        /// The pixel that has the color: column, row.
        at: (u32, u32),
        /// Largest distance that still counts as near, as in `Near`.
        #[schemars(range(min = 0.0, max = 400.0))]
        #[serde(default = "near")]
        distance: f64,
        /// How much differences of lightness count, as in `Near`.
        #[schemars(range(min = 0.0, max = 10.0))]
        #[serde(default = "one")]
        lightness: f64,
    },
    /// Those between two corners of a color space, both included.
    Box {
        /// The space that the corners are given in.
        space: Space,
        /// Lowest value of each channel.
        #[schemars(extend("most" = "high", "wraps" = { "space": "Hsv" }))]
        low: [f64; 3],
        /// Highest value of each channel; a hue below the lowest one wraps around.
        high: [f64; 3],
    },
    /// Those above the level that best divides the picture in two.
    Otsu {
        /// What is divided.
        #[serde(default)]
        channel: Channel,
    },
}

fn near() -> f64 {
    15.0
}

fn one() -> f64 {
    1.0
}

/// A color space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Space {
    /// CIE L*a*b*: lightness 0 to 100, a and b about -128 to 127.
    Lab,
    /// Hue 0 to 360 degrees, saturation and value 0 to 1; gray has no hue and is outside of every box.
    Hsv,
    /// Red, green, blue: 0 to 255.
    Rgb,
}

/// A level from 0 to 255 per pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Channel {
    /// Brightness: 0.299 red + 0.587 green + 0.114 blue.
    #[default]
    Luma,
    /// Red.
    Red,
    /// Green.
    Green,
    /// Blue.
    Blue,
    /// How colorful: 255 (largest - smallest) / largest channel.
    Saturation,
}

/// How far a pixel is from what is selected.
pub(crate) enum Measure {
    /// From a color, in Lab, with lightness weighed.
    Color { color: Lab, lightness: f32 },
    /// From a box: the largest excess over its sides, in the units of its space.
    Box { space: Space, low: [f32; 3], high: [f32; 3] },
    /// From the least level that is selected.
    Level { channel: Channel, least: u32 },
}

/// The measure behind `select`, and the largest distance that it takes.
pub(crate) fn measure(
    image: &Image,
    within: Option<&Mask>,
    select: &Select,
) -> Result<(Measure, f32), PictureError> {
    fn near(color: Color, distance: f64, lightness: f64) -> (Measure, f32) {
        (Measure::Color { color: color.lab(), lightness: lightness as f32 }, distance as f32)
    }
    Ok(match *select {
        Select::Near { color, distance, lightness } => near(color, distance, lightness),
        Select::Sample { at: (column, row), distance, lightness } => {
            check_inside(image, (column, row))?;
            near(Color(image.at([column as usize, row as usize])), distance, lightness)
        }
        Select::Box { space, low, high } => {
            let [low, high] = [low, high].map(|corner| corner.map(|channel| channel as f32));
            (Measure::Box { space, low, high }, 0.0)
        }
        Select::Otsu { channel } => {
            let mut histogram = [0; 256];
            for (index, &pixel) in image.pixels().iter().enumerate() {
                if within.is_none_or(|mask| mask.pixels()[index] == 1) {
                    histogram[level(channel, pixel) as usize] += 1;
                }
            }
            (Measure::Level { channel, least: otsu(&histogram) + 1 }, 0.0)
        }
    })
}

impl Measure {
    /// Marks the pixels that are at most `limit` away; with `invert` the others.
    pub(crate) fn mark(&self, pixels: &[Rgb], limit: f32, invert: bool, marks: &mut [bool]) {
        if let Self::Box { space: Space::Rgb, low, high } = *self {
            return mark_box(pixels, low, high, invert, marks);
        }
        for (mark, &pixel) in marks.iter_mut().zip(pixels) {
            *mark = (self.distance(pixel) <= limit) != invert;
        }
    }

    pub(crate) fn distance(&self, pixel: Rgb) -> f32 {
        match *self {
            Self::Color { color, lightness } => {
                Lab::from_srgb(pixel).distance_sq(color, lightness).sqrt()
            }
            Self::Box { space, low, high } => {
                let channels = match space {
                    Space::Rgb => pixel.map(f32::from),
                    Space::Lab => {
                        let lab = Lab::from_srgb(pixel);
                        [lab.l, lab.a, lab.b]
                    }
                    Space::Hsv => match hsv(pixel) {
                        Some(hsv) => hsv,
                        None => return f32::INFINITY,
                    },
                };
                let excess = |k: usize| (low[k] - channels[k]).max(channels[k] - high[k]);
                let first = if space == Space::Hsv && high[0] < low[0] {
                    (low[0] - channels[0]).min(channels[0] - high[0])
                } else {
                    excess(0)
                };
                first.max(excess(1)).max(excess(2)).max(0.0)
            }
            Self::Level { channel, least } => least.saturating_sub(level(channel, pixel)) as f32,
        }
    }
}

/// Marks the pixels in a box of sRGB values; with `invert` the others.
fn mark_box(pixels: &[Rgb], low: [f32; 3], high: [f32; 3], invert: bool, marks: &mut [bool]) {
    // The whole numbers in the box; the conversion ends at 0 and 255.
    let (least, most) = (low.map(|x| x.ceil() as u8), high.map(|x| x.floor() as u8));
    let is_empty =
        (0..3).any(|k| high[k] < low[k] || high[k] < 0.0 || 255.0 < low[k] || most[k] < least[k]);
    if is_empty {
        return marks.fill(invert);
    }
    let span = [0, 1, 2].map(|k| most[k] - least[k]);
    pulp::Arch::new().dispatch(|| {
        for (mark, pixel) in marks.iter_mut().zip(pixels) {
            // What is below the least value wraps around to above the span: one comparison for both sides.
            let inside = |k: usize| pixel[k].wrapping_sub(least[k]) <= span[k];
            *mark = (inside(0) & inside(1) & inside(2)) != invert;
        }
    });
}

/// Hue (degrees), saturation and value (0 to 1) on sRGB values: the hexcone of Smith, "Color Gamut Transform Pairs" (1978).
/// None for gray, which has no hue.
fn hsv(pixel: Rgb) -> Option<[f32; 3]> {
    let [r, g, b] = pixel.map(f32::from);
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    let chroma = most - least;
    if chroma == 0.0 {
        return None;
    }
    let sextant = if most == r {
        (g - b) / chroma
    } else if most == g {
        (b - r) / chroma + 2.0
    } else {
        (r - g) / chroma + 4.0
    };
    let hue = if sextant < 0.0 { sextant + 6.0 } else { sextant } * 60.0;
    Some([hue, chroma / most, most / 255.0])
}

/// The level of a color.
pub fn level(channel: Channel, [r, g, b]: Rgb) -> u32 {
    let [red, green, blue] = [r, g, b].map(u32::from);
    match channel {
        Channel::Luma => (299 * red + 587 * green + 114 * blue + 500) / 1000,
        Channel::Red => red,
        Channel::Green => green,
        Channel::Blue => blue,
        Channel::Saturation => {
            let most = red.max(green).max(blue);
            (255 * (most - red.min(green).min(blue))).checked_div(most).unwrap_or(0)
        }
    }
}
