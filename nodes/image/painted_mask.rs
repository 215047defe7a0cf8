//! Reads masks painted with another program.

use maquette_format::picture_file;
use maquette_node::{Context, Error, FilePath, Forecast, In, Node, Sizes, ValueSize};
use maquette_value::{Color, Image, Mask};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::picture::Picture;
use super::segment::mark_pixels::threshold;
use super::segment::select::{Channel, Select, level};

/// Reads a painted mask: a picture of any size, which is stretched to the size of another picture. What is transparent is not painted.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct PaintedMask {
    /// Painted picture: a PNG, JPEG, TIFF, WebP, BMP, EXR or HDR file.
    #[schemars(extend("reads" = "Image"))]
    pub path: FilePath,
    /// Picture or mask that defines the size of the result.
    pub image: In<Picture>,
    /// Paint that marks pixels.
    #[serde(default)]
    pub paint: Paint,
    /// Inverts the mask.
    #[serde(default)]
    pub invert: bool,
}

/// Paint that marks pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Paint {
    /// Bright pixels: white on black.
    #[default]
    Bright,
    /// Dark pixels: black on white.
    Dark,
    /// Pixels of a color, such as red on a photograph.
    Color {
        /// Color of the paint.
        color: Color,
        /// Maximum distance from the color, in CIE L*a*b* (CIE76); 2.3 is just noticeable.
        #[schemars(range(min = 0.0, max = 100.0))]
        #[serde(default = "default_distance")]
        distance: f64,
    },
}

fn default_distance() -> f64 {
    20.0
}

impl Node for PaintedMask {
    type Outputs = (Mask,);
    const OUTPUTS: [&'static str; 1] = ["mask"];

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        let pixels = sizes.get(&self.image)?;
        Some(Forecast::by_law(ValueSize::items(pixels.points, 1.0).at_most(pixels.certainty)))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (painted, opaque) = picture_file::read_with_opacity(cx.file(&self.path)?.bytes())?;
        let size = cx.get(&self.image).size();
        let from = [painted.width(), painted.height()];
        if is_stretched(from, size) {
            let ([w, h], [width, height]) = (from, size);
            cx.warn(format!(
                "the painted picture has {w} x {h} pixels, and is stretched to {width} x {height}"
            ));
        }
        let mask = painted_mask(&painted, opaque.as_ref(), size, &self.paint, self.invert);
        if mask.is_empty() {
            cx.warn("no pixel of the picture has this paint");
        }
        Ok((mask,))
    }
}

/// Returns true if the aspect ratios of two pictures differ by more than rounding to whole pixels explains.
fn is_stretched([w, h]: [usize; 2], [width, height]: [usize; 2]) -> bool {
    let max = w.max(h).max(width).max(height);
    (w * height).abs_diff(h * width) > max
}

/// Returns a mask of the painted pixels, or of all other pixels if `invert` is true, scaled to the given size by nearest neighbor. A pixel
/// outside of `opaque`, a mask of the picture's size, is not painted.
pub fn painted_mask(
    painted: &Image,
    opaque: Option<&Mask>,
    [width, height]: [usize; 2],
    paint: &Paint,
    invert: bool,
) -> Mask {
    let (w, h) = (painted.width(), painted.height());
    let marked = match *paint {
        Paint::Color { color, distance } => {
            let select = Select::Near { color, distance, lightness: 1.0 };
            threshold(painted, None, &select, false).expect("no pixel is sampled, no mask given")
        }
        Paint::Bright | Paint::Dark => {
            let dark = *paint == Paint::Dark;
            let pixels = painted
                .pixels()
                .iter()
                .map(|&pixel| (level(Channel::Luma, pixel) < 128) == dark)
                .collect();
            Mask::from_bools(w, h, pixels).expect("one entry per pixel")
        }
    };
    fn nearest(index: usize, count: usize, source_count: usize) -> usize {
        (2 * index + 1) * source_count / (2 * count)
    }
    let pixels = (0..width * height).map(|pixel| {
        let [column, row] = [nearest(pixel % width, width, w), nearest(pixel / width, height, h)];
        let at = [column, row];
        let is_opaque = |opaque: &Mask| opaque.contains(at);
        w > 0 && h > 0 && (marked.contains(at) && opaque.is_none_or(is_opaque)) != invert
    });
    Mask::from_bools(width, height, pixels.collect()).expect("one entry per pixel")
}

#[cfg(test)]
mod tests {
    use expect_test::expect;

    use super::*;

    fn example() -> Image {
        let [black, white, red] = [[0, 0, 0], [255, 255, 255], [200, 20, 20]];
        Image::new(3, 2, vec![white, black, red, black, black, white]).unwrap()
    }

    #[test]
    fn pictures_are_stretched_and_shrunk() {
        let large = painted_mask(&example(), None, [6, 4], &Paint::Bright, false);
        expect![["##....\n##....\n....##\n....##\n"]].assert_eq(&large.draw());
        assert_eq!(painted_mask(&example(), None, [1, 1], &Paint::Bright, true).draw(), "#\n");
        assert_eq!(painted_mask(&example(), None, [0, 3], &Paint::Bright, false).count(), 0);
    }

    #[test]
    fn dark_and_colored_paint_is_recognized() {
        fn draw(paint: Paint, invert: bool) -> String {
            painted_mask(&example(), None, [3, 2], &paint, invert).draw()
        }
        assert_eq!(draw(Paint::Dark, false), ".##\n##.\n");
        assert_eq!(draw(Paint::Dark, true), "#..\n..#\n");
        let red = Paint::Color { color: Color([200, 20, 20]), distance: 5.0 };
        assert_eq!(draw(red, false), "..#\n...\n");
        assert_eq!(draw(red, true), "##.\n###\n");
    }

    #[test]
    fn what_is_transparent_is_not_painted() {
        let opaque = Mask::from_rows(&[".#.", "##."]);
        fn draw(paint: Paint, invert: bool, opaque: &Mask) -> String {
            painted_mask(&example(), Some(opaque), [3, 2], &paint, invert).draw()
        }
        assert_eq!(draw(Paint::Dark, false, &opaque), ".#.\n##.\n");
        assert_eq!(draw(Paint::Dark, true, &opaque), "#.#\n..#\n");
        assert_eq!(draw(Paint::Bright, false, &opaque), "...\n...\n");
        let white = Paint::Color { color: Color([255; 3]), distance: 5.0 };
        assert_eq!(draw(white, false, &Mask::from_rows(&["#..", "..."])), "#..\n...\n");
    }

    #[test]
    fn other_proportions_are_recognized() {
        assert!(!is_stretched([640, 480], [320, 240]));
        assert!(!is_stretched([641, 480], [320, 240]));
        assert!(is_stretched([640, 480], [320, 320]));
    }
}
