//! Rules that select pixels by color, and the distance of a pixel from being selected.

use maquette_node::Error;
use maquette_value::{Color, Image, Lab, Mask, Rgb};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::otsu::otsu;
use crate::checks::check_inside;

/// Rule that selects pixels.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub enum Select {
    /// Pixels close to a color.
    Near {
        /// Reference color, as in `"#c33923"`.
        color: Color,
        /// Maximum distance from the color, in CIE L*a*b* (CIE76); 2.3 is just noticeable.
        #[schemars(range(min = 0.0, max = 400.0))]
        #[serde(default = "default_distance")]
        distance: f64,
        /// Weight of lightness differences: 1 weights lightness like color, 0 ignores it and so shading.
        #[schemars(range(min = 0.0, max = 10.0))]
        #[serde(default = "default_lightness")]
        lightness: f64,
    },
    /// Pixels close to the color of one pixel.
    Sample {
        /// Pixel with the reference color: column, row.
        at: (u32, u32),
        /// Maximum distance from the color, as in `Near`.
        #[schemars(range(min = 0.0, max = 400.0))]
        #[serde(default = "default_distance")]
        distance: f64,
        /// Weight of lightness differences, as in `Near`.
        #[schemars(range(min = 0.0, max = 10.0))]
        #[serde(default = "default_lightness")]
        lightness: f64,
    },
    /// Pixels between two corners of a color space, both included.
    Box {
        /// Color space of the corners.
        space: Space,
        /// Minimum of each channel.
        #[schemars(extend("most" = "high", "wraps" = { "space": "Hsv" }))]
        low: [f64; 3],
        /// Maximum of each channel; a hue below the minimum wraps around.
        high: [f64; 3],
    },
    /// Pixels above the level that best divides the picture in two classes.
    Otsu {
        /// Channel to divide.
        #[serde(default)]
        channel: Channel,
    },
}

fn default_distance() -> f64 {
    15.0
}

fn default_lightness() -> f64 {
    1.0
}

/// A color space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Space {
    /// CIE L*a*b*: lightness 0 to 100, a and b about -128 to 127.
    Lab,
    /// Hue 0 to 360 degrees, saturation and value 0 to 1; gray has no hue and is outside every box.
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
    /// Saturation: 255 (maximum - minimum) / maximum of the channels.
    Saturation,
}

/// Measures how far a pixel is from being selected by a rule. Pixels are selected up to the maximum distance that [`measure`] returns.
pub(crate) enum Measure {
    /// The distance from a color in CIE L*a*b*, with lightness differences weighted by `lightness`.
    Color { color: Lab, lightness: f32 },
    /// The distance from a box in a color space: the maximum amount by which a channel is outside, in the channel's unit.
    Box { space: Space, low: [f32; 3], high: [f32; 3] },
    /// The difference between the minimum selected level and the pixel's level; 0 if the level is not below the minimum.
    Level { channel: Channel, min: u32 },
}

/// Returns the distance measure of `select`, and the maximum distance of a selected pixel.
pub(crate) fn measure(
    image: &Image,
    within: Option<&Mask>,
    select: &Select,
) -> Result<(Measure, f32), Error> {
    fn color_measure(color: Color, distance: f64, lightness: f64) -> (Measure, f32) {
        (Measure::Color { color: color.lab(), lightness: lightness as f32 }, distance as f32)
    }
    Ok(match *select {
        Select::Near { color, distance, lightness } => color_measure(color, distance, lightness),
        Select::Sample { at: (column, row), distance, lightness } => {
            check_inside(image, (column, row))?;
            color_measure(Color(image.pixel([column as usize, row as usize])), distance, lightness)
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
            (Measure::Level { channel, min: otsu(&histogram) + 1 }, 0.0)
        }
    })
}

impl Measure {
    /// Sets `marks` for the pixels whose distance is at most `limit`; if `invert` is true, for all other pixels instead.
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
            Self::Level { channel, min } => min.saturating_sub(level(channel, pixel)) as f32,
        }
    }
}

/// Sets `marks` for the pixels in a box of sRGB values; if `invert` is true, for all other pixels instead.
fn mark_box(pixels: &[Rgb], low: [f32; 3], high: [f32; 3], invert: bool, marks: &mut [bool]) {
    // The smallest and largest integers in the box. Casts to `u8` saturate at 0 and 255.
    let (min, max) = (low.map(|x| x.ceil() as u8), high.map(|x| x.floor() as u8));
    let is_empty =
        (0..3).any(|k| high[k] < low[k] || high[k] < 0.0 || 255.0 < low[k] || max[k] < min[k]);
    if is_empty {
        return marks.fill(invert);
    }
    let span = [0, 1, 2].map(|k| max[k] - min[k]);
    pulp::Arch::new().dispatch(|| {
        for (mark, pixel) in marks.iter_mut().zip(pixels) {
            // With wrapping subtraction, a value below the minimum becomes greater than the span, so one comparison tests both sides.
            let inside = |k: usize| pixel[k].wrapping_sub(min[k]) <= span[k];
            *mark = (inside(0) & inside(1) & inside(2)) != invert;
        }
    });
}

/// Returns hue (degrees), saturation and value (0 to 1) of a color in sRGB, by the hexcone of Smith, "Color Gamut Transform Pairs" (1978).
/// Returns `None` for gray, which has no hue.
fn hsv(pixel: Rgb) -> Option<[f32; 3]> {
    let [r, g, b] = pixel.map(f32::from);
    let (max, min) = (r.max(g).max(b), r.min(g).min(b));
    let chroma = max - min;
    if chroma == 0.0 {
        return None;
    }
    let sextant = if max == r {
        (g - b) / chroma
    } else if max == g {
        (b - r) / chroma + 2.0
    } else {
        (r - g) / chroma + 4.0
    };
    let hue = if sextant < 0.0 { sextant + 6.0 } else { sextant } * 60.0;
    Some([hue, chroma / max, max / 255.0])
}

/// Returns the level of a color in a channel.
pub fn level(channel: Channel, [r, g, b]: Rgb) -> u32 {
    let [red, green, blue] = [r, g, b].map(u32::from);
    match channel {
        Channel::Luma => (299 * red + 587 * green + 114 * blue + 500) / 1000,
        Channel::Red => red,
        Channel::Green => green,
        Channel::Blue => blue,
        Channel::Saturation => {
            let max = red.max(green).max(blue);
            (255 * (max - red.min(green).min(blue))).checked_div(max).unwrap_or(0)
        }
    }
}
