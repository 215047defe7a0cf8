//! Marks the pixels of a picture that belong to a color, a box of colors, or the brighter of two classes.

use maquette::value::{Color, Image, Lab, Mask, Rgb};
use maquette::{Context, Error, In, Node};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::morphology::{close, open};

/// Marks the pixels that belong together by their color.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Threshold {
    /// The picture to search.
    pub image: In<Image>,
    /// Where to search; everywhere if left out.
    pub within: Option<In<Mask>>,
    /// Which pixels.
    pub select: Select,
    /// Marks all the others instead.
    #[serde(default)]
    pub invert: bool,
    /// Radius of a square that removes specks (opening) and then closes gaps (closing); 0 does neither.
    #[schemars(range(max = 10), extend("unit" = "px"))]
    #[serde(default)]
    pub clean: u32,
}

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

/// Why a threshold cannot be taken.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ThresholdError {
    /// The sampled pixel is not in the picture.
    #[error(
        "pixel ({column}, {row}) is outside of the picture, which has {width} x {height} pixels"
    )]
    Outside {
        /// Its column.
        column: u32,
        /// Its row.
        row: u32,
        /// The picture's width.
        width: usize,
        /// The picture's height.
        height: usize,
    },
    /// The mask is for another picture.
    #[error("the mask `within` has {mask:?} pixels, the picture {image:?}")]
    Size {
        /// The mask's size.
        mask: [usize; 2],
        /// The picture's size.
        image: [usize; 2],
    },
}

impl Node for Threshold {
    type Outputs = (Mask,);
    const OUTPUTS: [&'static str; 1] = ["mask"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let image = cx.get(&self.image);
        let within = self.within.as_ref().map(|mask| cx.get(mask));
        let mask = threshold(image, within, &self.select, self.invert)?;
        if mask.is_empty() {
            cx.warn(explain_empty(image, within, &self.select)?);
        }
        let radius = self.clean as usize;
        Ok((close(&open(&mask, radius), radius),))
    }
}

/// Marks the pixels of `image`, inside `within` if given, that `select` takes; with `invert` all the others.
///
/// # Errors
/// If a sampled pixel is outside of the picture, or `within` has another size.
pub fn threshold(
    image: &Image,
    within: Option<&Mask>,
    select: &Select,
    invert: bool,
) -> Result<Mask, ThresholdError> {
    check_size(image, within)?;
    let (measure, limit) = measure(image, within, select)?;
    let mut marks = vec![false; image.pixels().len()];
    let chunks = marks.par_chunks_mut(CHUNK).zip(image.pixels().par_chunks(CHUNK));
    chunks.enumerate().for_each(|(chunk, (marks, pixels))| {
        measure.mark(pixels, limit, invert, marks);
        if let Some(within) = within {
            let within = &within.pixels()[chunk * CHUNK..][..marks.len()];
            marks.iter_mut().zip(within).for_each(|(mark, within)| *mark &= *within == 1);
        }
    });
    Ok(Mask::from_bools(image.width(), image.height(), marks).expect("one mark per pixel"))
}

/// Pixels that one thread marks at a time: some 0.1 ms of work, and its memory stays in the cache.
const CHUNK: usize = 16 * 1024;

/// Why nothing was marked: the pixel that came nearest, and how near.
fn explain_empty(
    image: &Image,
    within: Option<&Mask>,
    select: &Select,
) -> Result<String, ThresholdError> {
    let (measure, limit) = measure(image, within, select)?;
    let searched = |index: usize| within.is_none_or(|mask| mask.pixels()[index] == 1);
    let distances = image.pixels().iter().map(|&pixel| measure.distance(pixel)).enumerate();
    let nearest =
        distances.filter(|(index, _)| searched(*index)).min_by(|a, b| a.1.total_cmp(&b.1));
    Ok(match (nearest, &measure) {
        (None, _) => "nothing is selected: there is no pixel to search".into(),
        (Some(_), Measure::Level { .. }) => {
            "nothing is selected: all pixels have the same level".into()
        }
        (Some((index, distance)), _) => {
            let at = [index % image.width(), index / image.width()];
            format!(
                "nothing is selected: the nearest pixel is {} at ({}, {}), {:.1} away where {limit:.1} is allowed",
                Color(image.at(at)),
                at[0],
                at[1],
                distance
            )
        }
    })
}

fn check_size(image: &Image, within: Option<&Mask>) -> Result<(), ThresholdError> {
    let image = [image.width(), image.height()];
    match within.map(|mask| [mask.width(), mask.height()]) {
        Some(mask) if mask != image => Err(ThresholdError::Size { mask, image }),
        _ => Ok(()),
    }
}

/// How far a pixel is from what is selected.
enum Measure {
    /// From a color, in Lab, with lightness weighed.
    Color { color: Lab, lightness: f32 },
    /// From a box: the largest excess over its sides, in the units of its space.
    Box { space: Space, low: [f32; 3], high: [f32; 3] },
    /// From the least level that is selected.
    Level { channel: Channel, least: u32 },
}

/// The measure behind `select`, and the largest distance that it takes.
fn measure(
    image: &Image,
    within: Option<&Mask>,
    select: &Select,
) -> Result<(Measure, f32), ThresholdError> {
    let near = |color: Color, distance: f64, lightness: f64| {
        (Measure::Color { color: color.lab(), lightness: lightness as f32 }, distance as f32)
    };
    Ok(match *select {
        Select::Near { color, distance, lightness } => near(color, distance, lightness),
        Select::Sample { at: (column, row), distance, lightness } => {
            let (width, height) = (image.width(), image.height());
            if width <= column as usize || height <= row as usize {
                return Err(ThresholdError::Outside { column, row, width, height });
            }
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
    fn mark(&self, pixels: &[Rgb], limit: f32, invert: bool, marks: &mut [bool]) {
        if let Self::Box { space: Space::Rgb, low, high } = *self {
            return mark_box(pixels, low, high, invert, marks);
        }
        for (mark, &pixel) in marks.iter_mut().zip(pixels) {
            *mark = (self.distance(pixel) <= limit) != invert;
        }
    }

    fn distance(&self, pixel: Rgb) -> f32 {
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
pub(crate) fn level(channel: Channel, [r, g, b]: Rgb) -> u32 {
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

/// The level that divides a histogram best: levels above it are the second class. Of several, their mean, rounded down; of a
/// histogram with one level, that level.
///
/// Otsu, "A threshold selection method from gray-level histograms" (1979), eq. 18: the largest variance between classes,
/// `(mu_T w - mu)^2 / (w (1 - w))`. All sums are whole numbers, so that equal variances are equal exactly.
pub fn otsu(histogram: &[u64; 256]) -> u32 {
    let total: u64 = histogram.iter().sum();
    let moment: u64 =
        histogram.iter().zip(0..).map(|(count, level): (&u64, u64)| count * level).sum();
    let (mut below, mut moment_below) = (0u64, 0u64);
    let mut best = (-1.0, 0, 1);
    for (level, count) in (0u64..).zip(histogram) {
        below += count;
        moment_below += count * level;
        let above = total - below;
        let variance = if below == 0 || above == 0 {
            0.0
        } else {
            let difference = (moment as f64 * below as f64) - (moment_below as f64 * total as f64);
            difference * difference / (below as f64 * above as f64)
        };
        if variance > best.0 {
            best = (variance, level, 1);
        } else if variance == best.0 {
            best = (variance, best.1 + level, best.2 + 1);
        }
    }
    if best.0 <= 0.0 {
        return (0..).zip(histogram).find(|(_, count)| **count > 0).map_or(0, |(level, _)| level);
    }
    (best.1 / best.2) as u32
}

#[cfg(test)]
mod tests {
    use expect_test::{Expect, expect};

    use super::*;

    /// A picture drawn with letters: r, g, b, w (white), k (black), p (pink).
    fn picture(rows: &[&str]) -> Image {
        let pixels = rows.iter().flat_map(|row| row.chars()).map(|letter| match letter {
            'r' => [255, 0, 0],
            'g' => [0, 255, 0],
            'b' => [0, 0, 255],
            'w' => [255, 255, 255],
            'p' => [255, 128, 160],
            _ => [0, 0, 0],
        });
        Image::new(rows[0].len(), rows.len(), pixels.collect::<Vec<_>>()).unwrap()
    }

    fn check(select: Select, rows: &[&str], expected: Expect) {
        expected.assert_eq(&threshold(&picture(rows), None, &select, false).unwrap().draw());
    }

    fn red(distance: f64, lightness: f64) -> Select {
        Select::Near { color: Color([255, 0, 0]), distance, lightness }
    }

    #[test]
    fn a_pixel_at_the_limit_is_near() {
        check(red(0.0, 1.0), &["rgr", "ggg"], expect![["#.#\n...\n"]]);
    }

    #[test]
    fn without_lightness_black_is_as_near_to_white_as_white() {
        let white = |lightness| Select::Near { color: Color([255; 3]), distance: 1.0, lightness };
        check(white(0.0), &["wk", "rk"], expect![["##\n.#\n"]]);
        check(white(1.0), &["wk", "rk"], expect![["#.\n..\n"]]);
    }

    #[test]
    fn a_sampled_pixel_selects_its_like() {
        let select = Select::Sample { at: (1, 0), distance: 5.0, lightness: 1.0 };
        check(select, &["rgb", "gbr"], expect![[".#.\n#..\n"]]);
    }

    #[test]
    fn a_sampled_pixel_outside_is_an_error() {
        let select = Select::Sample { at: (3, 0), distance: 5.0, lightness: 1.0 };
        let error = threshold(&picture(&["rgb"]), None, &select, false).unwrap_err();
        expect!["pixel (3, 0) is outside of the picture, which has 3 x 1 pixels"]
            .assert_eq(&error.to_string());
    }

    #[test]
    fn a_box_includes_its_sides() {
        let select = |low, high| Select::Box { space: Space::Rgb, low, high };
        check(select([255., 0., 0.], [255., 128., 160.]), &["rpw"], expect![["##.\n"]]);
        check(select([255., 0., 0.], [255., 127., 160.]), &["rpw"], expect![["#..\n"]]);
    }

    #[test]
    fn a_box_holds_the_whole_numbers_between_its_sides() {
        let levels = (0..=255u8).map(|level| [level; 3]);
        let image = Image::new(256, 1, Vec::from_iter(levels)).unwrap();
        for (low, high) in [
            (-5.0, 3.5),
            (3.5, 3.9),
            (254.5, 300.0),
            (-9.0, -1.0),
            (256.0, 300.0),
            (7.0, 5.0),
            (9.0, 9.0),
        ] {
            let select = Select::Box { space: Space::Rgb, low: [low; 3], high: [high; 3] };
            let is_inside = |level: &usize| low <= *level as f64 && *level as f64 <= high;
            let expected = (0..256).filter(is_inside).count();
            let mask = threshold(&image, None, &select, false).unwrap();
            assert_eq!(mask.count(), expected, "{low} {high}");
            let others = threshold(&image, None, &select, true).unwrap();
            assert_eq!(others.count(), 256 - expected, "{low} {high}");
        }
    }

    #[test]
    fn a_hue_interval_wraps_around_and_never_holds_gray() {
        let select = |low, high| Select::Box {
            space: Space::Hsv,
            low: [low, 0.0, 0.0],
            high: [high, 1.0, 1.0],
        };
        check(select(330.0, 30.0), &["rgbpwk"], expect![["#..#..\n"]]);
        check(select(0.0, 360.0), &["rgbpwk"], expect![["####..\n"]]);
    }

    #[test]
    fn a_lab_box_takes_light_colors() {
        let select = Select::Box {
            space: Space::Lab,
            low: [60.0, -128.0, -128.0],
            high: [101.0, 128.0, 128.0],
        };
        check(select, &["rgbpwk"], expect![[".#.##.\n"]]);
    }

    #[test]
    fn otsu_takes_the_brighter_class() {
        check(Select::Otsu { channel: Channel::Luma }, &["kwkb"], expect![[".#..\n"]]);
    }

    #[test]
    fn otsu_of_two_levels_lies_between_them() {
        for (a, b) in [(0, 1), (10, 200), (254, 255), (7, 8), (3, 250)] {
            for share in [1, 50, 99] {
                let mut histogram = [0; 256];
                histogram[a] = share;
                histogram[b] = 100 - share;
                assert_eq!(otsu(&histogram) as usize, (a + b - 1) / 2, "{a} {b} {share}");
            }
        }
    }

    #[test]
    fn otsu_of_one_level_is_that_level() {
        let mut histogram = [0; 256];
        histogram[77] = 5;
        assert_eq!(otsu(&histogram), 77);
    }

    #[test]
    fn inverting_stays_within_the_mask() {
        let within = Mask::drawn(&["##."]);
        let mask = threshold(&picture(&["rgg"]), Some(&within), &red(0.0, 1.0), true).unwrap();
        assert_eq!(mask.draw(), ".#.\n");
    }

    #[test]
    fn an_empty_selection_names_the_nearest_pixel() {
        let message = explain_empty(&picture(&["gp"]), None, &red(5.0, 1.0)).unwrap();
        expect!["nothing is selected: the nearest pixel is #ff80a0 at (1, 0), 69.6 away where 5.0 is allowed"]
            .assert_eq(&message);
    }

    #[test]
    fn a_mask_of_another_size_is_an_error() {
        let within = Mask::drawn(&["##"]);
        let error = threshold(&picture(&["rgb"]), Some(&within), &red(5.0, 1.0), false);
        assert!(matches!(error, Err(ThresholdError::Size { .. })));
    }
}
