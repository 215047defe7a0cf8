//! A mask that was painted with another program.

use maquette_format::picture_file;
use maquette_node::{Context, Error, FilePath, In, Node};
use maquette_value::{Color, Image, Mask};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::picture::Picture;
use super::segment::mark_pixels::threshold;
use super::segment::select::{Channel, Select, level};

/// Reads a mask that was painted: a picture of any size, which is stretched over the one that it is for.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct PaintedMask {
    /// The painted picture: a PNG, JPEG, TIFF, WebP, BMP, EXR or HDR file.
    #[schemars(extend("reads" = "Image"))]
    pub path: FilePath,
    /// The picture or mask that it is for, which says how large the mask becomes.
    pub image: In<Picture>,
    /// What was painted.
    #[serde(default)]
    pub paint: Paint,
    /// Marks all the other pixels instead.
    #[serde(default)]
    pub invert: bool,
}

/// What was painted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Paint {
    /// What is bright: white on black.
    #[default]
    Bright,
    /// What is dark: black on white.
    Dark,
    /// What has a color, such as red on a photograph.
    Color {
        /// The color.
        color: Color,
        /// Largest distance from it, in CIE L*a*b* (CIE76); 2.3 is just noticeable.
        #[schemars(range(min = 0.0, max = 100.0))]
        #[serde(default = "twenty")]
        distance: f64,
    },
}

fn twenty() -> f64 {
    20.0
}

impl Node for PaintedMask {
    type Outputs = (Mask,);
    const OUTPUTS: [&'static str; 1] = ["mask"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let painted = picture_file::read(cx.file(&self.path)?.bytes())?;
        let size = cx.get(&self.image).size();
        let from = [painted.width(), painted.height()];
        if is_stretched(from, size) {
            let ([w, h], [width, height]) = (from, size);
            cx.warn(format!(
                "the painted picture has {w} x {h} pixels, and is stretched to {width} x {height}"
            ));
        }
        let mask = painted_mask(&painted, size, &self.paint, self.invert);
        if mask.is_empty() {
            cx.warn("nothing of the picture is painted so");
        }
        Ok((mask,))
    }
}

/// Whether one picture has other proportions than another one, by more than a pixel.
fn is_stretched([w, h]: [usize; 2], [width, height]: [usize; 2]) -> bool {
    let most = w.max(h).max(width).max(height);
    (w * height).abs_diff(h * width) > most
}

/// The painted pixels of a picture, as a mask of another size: each pixel is what the nearest one of the picture is. With `invert` it is
/// the others.
pub fn painted_mask(
    painted: &Image,
    [width, height]: [usize; 2],
    paint: &Paint,
    invert: bool,
) -> Mask {
    let (w, h) = (painted.width(), painted.height());
    let marked = match *paint {
        Paint::Color { color, distance } => {
            let select = Select::Near { color, distance, lightness: 1.0 };
            threshold(painted, None, &select, invert).expect("no pixel is sampled, no mask given")
        }
        Paint::Bright | Paint::Dark => {
            let dark = (*paint == Paint::Dark) != invert;
            let pixels = painted
                .pixels()
                .iter()
                .map(|&pixel| (level(Channel::Luma, pixel) < 128) == dark)
                .collect();
            Mask::from_bools(w, h, pixels).expect("one entry per pixel")
        }
    };
    fn nearest(at: usize, of: usize, from: usize) -> usize {
        (2 * at + 1) * from / (2 * of)
    }
    let pixels = (0..width * height).map(|pixel| {
        let [column, row] = [nearest(pixel % width, width, w), nearest(pixel / width, height, h)];
        w > 0 && h > 0 && marked.contains([column, row])
    });
    Mask::from_bools(width, height, pixels.collect()).expect("one entry per pixel")
}

#[cfg(test)]
mod tests {
    use expect_test::expect;

    use super::*;

    fn painted() -> Image {
        let [black, white, red] = [[0, 0, 0], [255, 255, 255], [200, 20, 20]];
        Image::new(3, 2, vec![white, black, red, black, black, white]).unwrap()
    }

    #[test]
    fn a_smaller_picture_is_stretched_over_a_larger_one_and_the_other_way_round() {
        let large = painted_mask(&painted(), [6, 4], &Paint::Bright, false);
        expect![["##....\n##....\n....##\n....##\n"]].assert_eq(&large.draw());
        assert_eq!(painted_mask(&painted(), [1, 1], &Paint::Bright, true).draw(), "#\n");
        assert_eq!(painted_mask(&painted(), [0, 3], &Paint::Bright, false).count(), 0);
    }

    #[test]
    fn dark_and_colored_paint_is_told_from_the_rest() {
        fn draw(paint: Paint, invert: bool) -> String {
            painted_mask(&painted(), [3, 2], &paint, invert).draw()
        }
        assert_eq!(draw(Paint::Dark, false), ".##\n##.\n");
        assert_eq!(draw(Paint::Dark, true), "#..\n..#\n");
        let red = Paint::Color { color: Color([200, 20, 20]), distance: 5.0 };
        assert_eq!(draw(red, false), "..#\n...\n");
        assert_eq!(draw(red, true), "##.\n###\n");
    }

    #[test]
    fn other_proportions_are_told() {
        assert!(!is_stretched([640, 480], [320, 240]));
        assert!(!is_stretched([641, 480], [320, 240]));
        assert!(is_stretched([640, 480], [320, 320]));
    }
}
