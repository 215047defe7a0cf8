//! Marks the edges of a picture, where the gradient of its levels is large.

use maquette_node::{Context, Error, In, Node};
use maquette_value::memory::huge_vec;
use maquette_value::parallel::*;
use maquette_value::{Field, Mask};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::checks::check_size;
use super::filter::gaussian::blur;
use super::filter::gradient::{Levels, write_gradient};
use super::filter::hysteresis::{Bits, WORD, reconstruct, retain};
use super::filter::percentile::percentile;
use super::operator::Operator;
use super::picture::Picture;

/// Marks the edges of a picture or a mask, where the gradient of its levels is large.
///
/// The levels of a picture are its brightness, 0.299 red + 0.587 green + 0.114 blue, from 0 to 255; those of a mask are 0 outside and 1
/// inside. Edges are wider than one pixel; `Thin` reduces them to lines.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Edges {
    /// Picture, or mask whose outline is wanted.
    pub image: In<Picture>,
    /// Limits the search to these pixels. If omitted, the whole picture is searched.
    pub within: Option<In<Mask>>,
    /// Method to compute the gradient.
    #[serde(default)]
    pub operator: Operator,
    /// Standard deviation of a Gaussian blur that reduces noise first; 0 disables it.
    #[schemars(range(min = 0.0, max = 20.0), extend("unit" = "px"))]
    #[serde(default)]
    pub blur: f64,
    /// Minimum gradient at the steepest pixel of an edge.
    #[serde(default)]
    pub high: High,
    /// Minimum gradient at all other pixels of an edge, as a fraction of `high`.
    #[schemars(range(min = 0.0, max = 1.0))]
    #[serde(default = "default_low")]
    pub low: f64,
}

fn default_low() -> f64 {
    0.4
}

/// Minimum gradient at the steepest pixel of an edge. A pixel with gradient 0 is never on an edge.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum High {
    /// At least as steep as this percentage of the searched pixels are.
    Percentile(#[schemars(range(min = 0.0, max = 100.0), extend("unit" = "%"))] f64),
    /// Gradient in levels per pixel. The straight edge of a mask has 0.5.
    Level(#[schemars(range(min = 0.0))] f64),
}

impl Default for High {
    fn default() -> Self {
        Self::Percentile(90.0)
    }
}

impl Node for Edges {
    type Outputs = (Mask, Field);
    const OUTPUTS: [&'static str; 2] = ["mask", "magnitude"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let within = self.within.as_ref().map(|mask| cx.get(mask));
        let picture = cx.get(&self.image);
        let (mask, magnitude) =
            edges(&picture, within, self.operator, self.blur, self.high, self.low)?;
        if mask.is_empty() {
            let max = magnitude.range().map_or(0.0, |(_, max)| max);
            cx.warn(format!("no edge found: the maximum gradient is {max:.3} levels per pixel"));
        }
        Ok((mask, magnitude))
    }
}

/// Finds the edges of `picture` inside `within` (everywhere if `None`). Also returns the length of the gradient at each pixel, in levels
/// per pixel.
///
/// A pixel is on an edge if two conditions hold. Its gradient is at least `low` x `high`. And a path over pixels with such gradients, along
/// sides and corners, connects it with a pixel whose gradient is at least `high`. This is hysteresis: Canny, "A computational approach to
/// edge detection", IEEE Transactions on Pattern Analysis and Machine Intelligence 8 (1986), section VII. `blur` is the standard deviation
/// of a Gaussian in pixels; `low` is clamped to 0 to 1. A percentile is one of the gradients inside `within`, by nearest rank.
///
/// Returns an error if `within` does not have the size of the picture.
pub fn edges(
    picture: &Picture,
    within: Option<&Mask>,
    operator: Operator,
    blur_by: f64,
    high: High,
    low: f64,
) -> Result<(Mask, Field), Error> {
    let levels = match picture {
        Picture::Image(image) => Levels::Luma(image),
        Picture::Mask(mask) => Levels::Inside(mask),
    };
    let [width, height] = levels.size();
    check_size([width, height], within)?;
    let within = within.map(Mask::pixels);
    let blurred = (blur_by > 0.0 && width > 0).then(|| blur(levels, blur_by));
    let levels = blurred.as_ref().map_or(levels, |levels| Levels::Plane(levels, width));
    let mut magnitude = huge_vec(width * height);
    let write = |first, lengths: &mut [f32]| write_gradient(levels, operator, first, lengths);
    let [weak, strong] = match high {
        High::Level(level) => {
            threshold_bits(&mut magnitude, within, width, limits(level as f32, low), write)
        }
        High::Percentile(percent) => {
            let strips = magnitude.par_chunks_mut(STRIP_ROWS * width.max(1)).enumerate();
            strips.for_each(|(strip, lengths)| write(strip * STRIP_ROWS, lengths));
            let high = percentile(&magnitude, within, percent).unwrap_or(0.0);
            threshold_bits(&mut magnitude, within, width, limits(high, low), |_, _| {})
        }
    };
    let mask = unpack_mask(&reconstruct(&weak, strong), width, height);
    let magnitude = Field::new(width, height, magnitude).expect("one gradient per pixel");
    Ok((mask, magnitude))
}

/// Returns the minimum gradients of weak pixels (edge candidates) and of strong pixels (edge starts). Both are greater than 0.
fn limits(high: f32, low: f64) -> [f32; 2] {
    [high * low.clamp(0.0, 1.0) as f32, high].map(|limit| limit.max(f32::MIN_POSITIVE))
}

/// The number of rows that one task processes: few enough to stay in the cache.
const STRIP_ROWS: usize = 16;

/// Returns the pixels inside `within` whose gradient is at least the first of `limits`, and those whose gradient is at least the second.
/// `write` computes rows of `magnitude` before they are read. It gets the rows and the index of the first of them.
fn threshold_bits(
    magnitude: &mut [f32],
    within: Option<&[u8]>,
    width: usize,
    limits: [f32; 2],
    write: impl Fn(usize, &mut [f32]) + Sync,
) -> [Bits; 2] {
    fn bits(width: usize, magnitude: &[f32]) -> Bits {
        Bits::new(width, magnitude.len() / width.max(1))
    }
    let [mut weak, mut strong] = [bits(width, magnitude), bits(width, magnitude)];
    let words = weak.words.max(1);
    let [weak_rows, strong_rows] =
        [&mut weak, &mut strong].map(|bits| bits.rows.par_chunks_mut(STRIP_ROWS * words));
    let strips = magnitude.par_chunks_mut(STRIP_ROWS * width.max(1));
    strips.zip(weak_rows.zip(strong_rows)).enumerate().for_each(|(strip, (lengths, bits))| {
        write(strip * STRIP_ROWS, lengths);
        let rows = bits.0.chunks_mut(words).zip(bits.1.chunks_mut(words));
        for ((row, lengths), bits) in (strip * STRIP_ROWS..).zip(lengths.chunks(width)).zip(rows) {
            let within = within.map(|within| &within[row * width..][..width]);
            pulp::Arch::new().dispatch(PackRow { lengths, within, limits, bits });
        }
    });
    [weak, strong]
}

/// A kernel that compares the gradients in a row with two limits, and sets one bit per pixel and limit; dispatched to SIMD code.
struct PackRow<'a> {
    lengths: &'a [f32],
    within: Option<&'a [u8]>,
    limits: [f32; 2],
    bits: (&'a mut [u64], &'a mut [u64]),
}

impl pulp::NullaryFnOnce for PackRow<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (bits, limit) in [self.bits.0, self.bits.1].into_iter().zip(self.limits) {
            bits.fill(u64::MAX);
            retain(bits, self.lengths, |length| limit <= length);
            if let Some(within) = self.within {
                retain(bits, within, |inside| inside == 1);
            }
        }
    }
}

fn unpack_mask(bits: &Bits, width: usize, height: usize) -> Mask {
    let mut pixels = huge_vec(width * height);
    let rows = pixels.par_chunks_mut(width.max(1)).with_min_len(STRIP_ROWS);
    rows.zip(bits.rows.par_chunks(bits.words.max(1))).for_each(|(pixels, words)| {
        let (blocks, rest) = pixels.as_chunks_mut();
        blocks.iter_mut().zip(words).for_each(|(pixels, word)| unpack(*word, pixels));
        if let Some(word) = words.get(blocks.len()) {
            let mut last = [false; WORD];
            unpack(*word, &mut last);
            rest.copy_from_slice(&last[..rest.len()]);
        }
    });
    Mask::from_bools(width, height, pixels).expect("one mark per pixel")
}

/// Sets the pixels whose bits are 1 in `word`. All pixels must be false before.
fn unpack(word: u64, pixels: &mut [bool; WORD]) {
    if word != 0 {
        let (eights, _) = pixels.as_chunks_mut();
        let bytes = eights.iter_mut().zip(word.to_le_bytes());
        bytes.for_each(|(pixels, byte)| *pixels = UNPACKED[usize::from(byte)]);
    }
}

/// For each byte, its eight bits as booleans, lowest bit first.
const UNPACKED: [[bool; 8]; 256] = {
    let mut table = [[false; 8]; 256];
    let mut index = 0;
    while index < 8 * 256 {
        table[index / 8][index % 8] = (index / 8) >> (index % 8) & 1 == 1;
        index += 1;
    }
    table
};

#[cfg(test)]
mod tests {
    use expect_test::{Expect, expect};
    use maquette_value::Image;

    use super::*;

    /// Returns a gray picture drawn with one digit per pixel; the gray level is ten times the digit.
    fn gray(rows: &[&str]) -> Picture {
        let pixels =
            rows.iter().flat_map(|row| row.bytes()).map(|digit: u8| [(digit - b'0') * 10; 3]);
        Picture::Image(Image::new(rows[0].len(), rows.len(), pixels.collect::<Vec<_>>()).unwrap())
    }

    fn check(picture: &Picture, high: High, low: f64, expected: Expect) {
        let (mask, _) = edges(picture, None, Operator::Central, 0.0, high, low).unwrap();
        expected.assert_eq(&mask.draw());
    }

    #[test]
    fn a_gray_plane_has_the_same_gradient_everywhere() {
        let pixels = (0..30 * 25).map(|index| [(3 * (index / 30) + 4 * (index % 30)) as u8; 3]);
        let picture = Picture::Image(Image::new(30, 25, pixels.collect::<Vec<_>>()).unwrap());
        for operator in [Operator::Central, Operator::Forward, Operator::Sobel] {
            let (mask, magnitude) =
                edges(&picture, None, operator, 0.0, High::Level(5.0), 1.0).unwrap();
            assert!(magnitude.pixels().iter().all(|&length| length == 5.0), "{operator:?}");
            assert_eq!(mask.count(), 750);
        }
    }

    #[test]
    fn the_edge_of_a_mask_is_a_band_of_two_pixels() {
        let mask = Mask::from_rows(&[".....", ".###.", ".###.", ".###.", "....."]);
        let (band, magnitude) =
            edges(&Picture::Mask(mask), None, Operator::Central, 0.0, High::Level(0.25), 0.4)
                .unwrap();
        expect![[r#"
            .###.
            #####
            ##.##
            #####
            .###.
        "#]]
        .assert_eq(&band.draw());
        // At the border of the picture the gradient is one-sided: inside the picture, over two pixels.
        assert_eq!((magnitude.pixels()[2], magnitude.pixels()[7]), (1.0, 0.5));
    }

    #[test]
    fn weak_pixels_are_kept_if_connected_with_a_strong_one() {
        let picture = gray(&["000000000", "000000000", "003300099", "003300099", "000000000"]);
        check(
            &picture,
            High::Level(40.0),
            0.3,
            expect![[r#"
            .........
            .......##
            ......###
            ......###
            .......##
        "#]],
        );
    }

    #[test]
    fn a_flat_picture_has_no_edge_for_any_limit() {
        let picture = gray(&["333", "333"]);
        for high in [High::Level(0.0), High::Percentile(0.0), High::Percentile(90.0)] {
            for blur in [0.0, 1.3] {
                let (mask, _) = edges(&picture, None, Operator::Sobel, blur, high, 0.4).unwrap();
                assert!(mask.is_empty(), "{high:?} {blur}");
            }
        }
    }

    #[test]
    fn the_percentile_counts_the_pixels_within() {
        let picture = gray(&["0123456789", "0000000000", "0000000000"]);
        let within = Mask::from_rows(&["..........", "..........", "##########"]);
        let all = edges(&picture, None, Operator::Forward, 0.0, High::Percentile(50.0), 1.0);
        assert_eq!(all.unwrap().0.count(), 10);
        let none =
            edges(&picture, Some(&within), Operator::Forward, 0.0, High::Percentile(50.0), 1.0);
        assert!(none.unwrap().0.is_empty());
    }

    #[test]
    fn a_mask_of_another_size_is_an_error() {
        let within = Mask::from_rows(&["##"]);
        let error =
            edges(&gray(&["000"]), Some(&within), Operator::Central, 0.0, High::default(), 0.4);
        expect!["the mask `within` has [2, 1] pixels, but the picture has [3, 1]"]
            .assert_eq(&error.unwrap_err().to_string());
    }

    #[test]
    fn edges_are_the_same_for_any_number_of_threads() {
        let pixels =
            (0..150u32 * 200).map(|k| [(k * k % 251) as u8, (k % 199) as u8, (k / 150) as u8]);
        let picture = Picture::Image(Image::new(150, 200, pixels.collect::<Vec<_>>()).unwrap());
        fn find(picture: &Picture) -> (Mask, Field) {
            edges(picture, None, Operator::Sobel, 1.0, High::default(), 0.4).unwrap()
        }
        let expected = find(&picture);
        for threads in [1, 8] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            assert_eq!(pool.install(|| find(&picture)), expected, "{threads}");
        }
    }
}
