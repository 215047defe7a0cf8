//! Separates the scanned object from the background of a picture or range image.

use maquette_image::{Channel, Connectivity, Select, close, label, level, threshold};
use maquette_node::{Context, Error, FieldError, In, Node, bail};
use maquette_value::parallel::*;
use maquette_value::{Color, Image, Mask, RangeImage};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Marks the pixels of the picture that show the object.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Foreground {
    /// Range image, required for `Valid`.
    pub range: Option<In<RangeImage>>,
    /// Picture, required for `KeyColor` and `Luma`.
    pub image: Option<In<Image>>,
    /// Property that separates the object from the background.
    #[serde(default)]
    pub by: ForegroundBy,
    /// Adds areas that the object surrounds: pixels without a measured point, or of the background's color.
    #[serde(default = "default_true")]
    pub fill_holes: bool,
    /// Radius of the square that closes gaps before holes are filled: in range cells for `Valid`, otherwise in pixels of the picture.
    /// Closing gaps prevents the shadow beside a feature from separating the feature from the object.
    #[schemars(range(max = 50), extend("unit" = "px"))]
    #[serde(default = "default_close")]
    pub close: u32,
}

/// Property that separates the object from the background.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum ForegroundBy {
    /// Pixels with a measured point. Requires `range`.
    #[default]
    Valid,
    /// Pixels whose color differs from that of the background. Requires `image`.
    KeyColor {
        /// Color of the background, as in `"#00ff00"`.
        color: Color,
        /// Maximum distance of background pixels from the color, in CIE L*a*b* (CIE76); 2.3 is just noticeable.
        #[schemars(range(min = 0.0, max = 100.0))]
        #[serde(default = "default_distance")]
        distance: f64,
    },
    /// Bright pixels. Requires `image`.
    Luma {
        /// Maximum level of the background, of 0.299 red + 0.587 green + 0.114 blue. If omitted, the level that best divides the picture
        /// (Otsu).
        #[serde(default)]
        above: Option<u8>,
    },
}

fn default_true() -> bool {
    true
}

fn default_close() -> u32 {
    2
}

fn default_distance() -> f64 {
    12.0
}

impl Node for Foreground {
    type Outputs = (Mask,);
    const OUTPUTS: [&'static str; 1] = ["mask"];

    fn check(&self) -> Result<(), FieldError> {
        let (by, port, is_linked) = match self.by {
            ForegroundBy::Valid => ("Valid", "range", self.range.is_some()),
            ForegroundBy::KeyColor { .. } => ("KeyColor", "image", self.image.is_some()),
            ForegroundBy::Luma { .. } => ("Luma", "image", self.image.is_some()),
        };
        let help = format!("add a link, as in `{port}: \"node\"`, or use another value of `by`");
        is_linked.then_some(()).ok_or_else(|| FieldError::new("by", missing(by, port), help))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let range = self.range.as_ref().map(|range| cx.get(range));
        let image = self.image.as_ref().map(|image| cx.get(image));
        let mask = foreground(range, image, &self.by, self.fill_holes, self.close as usize)?;
        if mask.count() == 0 {
            let help = match self.by {
                ForegroundBy::Valid => "the range image has no valid point",
                ForegroundBy::KeyColor { .. } => {
                    "the whole picture has the background's `color`; choose a smaller `distance`"
                }
                ForegroundBy::Luma { .. } => "no pixel is bright enough; choose a lower `above`",
            };
            cx.warn(format!("no pixel is foreground: {help}"));
        }
        Ok((mask,))
    }
}

/// Returns the error for a missing link to `port`, which this value of `by` requires.
fn missing(by: &str, port: &str) -> Error {
    Error::new(format!("`by: {by}` requires the port `{port}`, which is not linked"))
}

/// Marks the pixels of the picture that show the object. Gaps are closed with a square of radius `close_radius`. Then, with `fill`, areas
/// that the object surrounds are added: background pixels from which no path along sides leads to the border of the picture.
///
/// With [`ForegroundBy::Valid`] both steps use the cells of the range grid; then a pixel is marked if the closest cell is marked.
///
/// Returns an error if the port that `by` requires is missing, or if both ports are linked and `range` is registered to a picture of
/// another size.
pub fn foreground(
    range: Option<&RangeImage>,
    image: Option<&Image>,
    by: &ForegroundBy,
    fill: bool,
    close_radius: usize,
) -> Result<Mask, Error> {
    if let (Some(range), Some(image)) = (range, image) {
        let (image, picture) = ([image.width(), image.height()], range.registration().picture);
        if image != picture {
            bail!(
                "`image` has {image:?} pixels, but `range` is registered to a picture of {picture:?}"
            );
        }
    }
    fn clean_up(mask: Mask, close_radius: usize, fill: bool) -> Mask {
        let closed = close(&mask, close_radius);
        if fill { fill_holes(&closed) } else { closed }
    }
    let need_image = |by| image.ok_or_else(|| missing(by, "image"));
    match *by {
        ForegroundBy::Valid => {
            let range = range.ok_or_else(|| missing("Valid", "range"))?;
            Ok(lift(&clean_up(valid_cells(range), close_radius, fill), range))
        }
        ForegroundBy::KeyColor { color, distance } => {
            let background = Select::Near { color, distance, lightness: 1.0 };
            Ok(clean_up(select(need_image("KeyColor")?, &background, true), close_radius, fill))
        }
        ForegroundBy::Luma { above: None } => {
            let bright = Select::Otsu { channel: Channel::Luma };
            Ok(clean_up(select(need_image("Luma")?, &bright, false), close_radius, fill))
        }
        ForegroundBy::Luma { above: Some(above) } => {
            let image = need_image("Luma")?;
            let bright = image
                .pixels()
                .iter()
                .map(|&pixel| u8::from(level(Channel::Luma, pixel) > u32::from(above)))
                .collect();
            Ok(clean_up(mask(image.width(), image.height(), bright), close_radius, fill))
        }
    }
}

fn mask(width: usize, height: usize, pixels: Vec<u8>) -> Mask {
    Mask::new(width, height, pixels).expect("one entry per pixel")
}

fn select(image: &Image, select: &Select, invert: bool) -> Mask {
    threshold(image, None, select, invert).expect("no pixel is sampled and no mask given")
}

/// Returns a mask of the range cells that have a point.
fn valid_cells(range: &RangeImage) -> Mask {
    let valid = range.points().iter().map(|point| u8::from(!point.x.is_nan()));
    mask(range.width(), range.height(), valid.collect())
}

/// Returns the mask `object` with its holes added: background components, connected by sides, that do not reach the border.
fn fill_holes(object: &Mask) -> Mask {
    let (width, height) = (object.width(), object.height());
    let background = object.pixels().iter().map(|pixel| 1 - pixel).collect();
    let parts = label(&mask(width, height, background), Connectivity::Four);
    let filled = parts.pixels().iter().map(|&part| {
        let is_background = part
            .checked_sub(1)
            .is_some_and(|part| parts.statistics()[part as usize].touches_border);
        u8::from(!is_background)
    });
    mask(width, height, filled.collect())
}

/// Converts a mask of range cells to a mask of the picture's pixels: each pixel takes the value of the closest cell. Pixels outside all
/// cells are 0.
fn lift(cells: &Mask, range: &RangeImage) -> Mask {
    let map = range.registration();
    let [width, height] = map.picture;
    let grid = [cells.width(), cells.height()];
    let [columns, rows] = [0, 1].map(|axis| -> Vec<Option<usize>> {
        (0..map.picture[axis])
            .map(|pixel| {
                let at = map.range_from_picture([pixel as f64; 2])[axis];
                // Cells at the border of the grid extend half a cell beyond their centers.
                let is_covered = -0.5 <= at && at <= grid[axis] as f64 - 0.5;
                is_covered.then(|| (at.round() as usize).min(grid[axis] - 1))
            })
            .collect()
    });
    let mut pixels = vec![0; width * height];
    pixels.par_chunks_mut(width.max(1)).zip(&rows).with_min_len(64).for_each(|(pixels, &row)| {
        let Some(row) = row else { return };
        let cells = &cells.pixels()[row * grid[0]..][..grid[0]];
        for (pixel, column) in pixels.iter_mut().zip(&columns) {
            *pixel = column.map_or(0, |column| cells[column]);
        }
    });
    mask(width, height, pixels)
}

#[cfg(test)]
mod tests {
    use expect_test::{Expect, expect};
    use maquette_value::Registration;
    use nalgebra::Point3;

    use super::*;

    /// Returns a range image whose valid cells are drawn as `#`.
    fn scan(rows: &[&str]) -> RangeImage {
        let valid = Mask::from_rows(rows);
        fn z(&valid: &u8) -> f64 {
            if valid == 1 { 700.0 } else { f64::NAN }
        }
        let points = valid.pixels().iter().map(|valid| Point3::new(0.0, 0.0, z(valid)));
        RangeImage::new(valid.width(), valid.height(), points.collect()).unwrap()
    }

    fn check(rows: &[&str], fill: bool, close: usize, expected: Expect) {
        let mask = foreground(Some(&scan(rows)), None, &ForegroundBy::Valid, fill, close).unwrap();
        expected.assert_eq(&mask.draw());
    }

    #[test]
    fn holes_are_filled_and_bays_are_not() {
        let rows = ["#####", "#...#", "###.#", "#.###", "#.###"];
        check(&rows, true, 0, expect![["#####\n#####\n#####\n#.###\n#.###\n"]]);
        check(&rows, false, 0, expect![["#####\n#...#\n###.#\n#.###\n#.###\n"]]);
    }

    #[test]
    fn a_shadow_that_cuts_a_feature_off_is_closed() {
        let rows = ["##.##", "#...#", "##.##"];
        check(&rows, true, 1, expect![["#####\n#####\n#####\n"]]);
    }

    #[test]
    fn a_pixel_equals_its_closest_cell() {
        fn lift_example(scale: f64, offset: f64, picture: [usize; 2]) -> String {
            let map = Registration { scale: [scale; 2], offset: [offset; 2], picture };
            let range = scan(&["#.", ".#"]).with_registration(map);
            foreground(Some(&range), None, &ForegroundBy::Valid, false, 0).unwrap().draw()
        }
        assert_eq!(lift_example(2.0, 0.5, [4, 4]), "##..\n##..\n..##\n..##\n");
        // The last pixel is on the edge of the last cell. The pixel at the center is equally close to two cells and takes the value of the
        // second cell.
        assert_eq!(lift_example(2.0, 0.0, [4, 4]), "#...\n.###\n.###\n.###\n");
        // No cell covers the pixels at the border of the picture.
        assert_eq!(lift_example(2.0, 1.5, [6, 4]), "......\n.##...\n.##...\n...##.\n");
        assert_eq!(lift_example(0.5, 0.0, [1, 1]), "#\n");
        assert_eq!(lift_example(f64::NAN, 0.0, [2, 1]), "..\n");
    }

    fn picture() -> Image {
        let pixels = [[0, 255, 0], [0, 250, 0], [200, 0, 0], [30, 30, 30]];
        Image::new(4, 1, pixels.to_vec()).unwrap()
    }

    #[test]
    fn colors_unlike_the_background_are_foreground() {
        let by = ForegroundBy::KeyColor { color: Color([0, 255, 0]), distance: 12.0 };
        let mask = foreground(None, Some(&picture()), &by, true, 0).unwrap();
        assert_eq!(mask.draw(), "..##\n");
    }

    #[test]
    fn bright_pixels_are_foreground() {
        fn draw(above: Option<u8>) -> String {
            let by = ForegroundBy::Luma { above };
            foreground(None, Some(&picture()), &by, true, 0).unwrap().draw()
        }
        assert_eq!(draw(None), "##..\n");
        assert_eq!(draw(Some(30)), "###.\n");
        assert_eq!(draw(Some(29)), "####\n");
    }

    #[test]
    fn a_missing_port_is_named() {
        fn message(by: ForegroundBy) -> String {
            foreground(None, None, &by, true, 0).unwrap_err().to_string()
        }
        expect!["`by: Valid` requires the port `range`, which is not linked"]
            .assert_eq(&message(ForegroundBy::Valid));
        expect!["`by: Luma` requires the port `image`, which is not linked"]
            .assert_eq(&message(ForegroundBy::Luma { above: None }));
    }

    #[test]
    fn a_picture_of_another_size_is_an_error() {
        let range = scan(&["##"]);
        let error = foreground(Some(&range), Some(&picture()), &ForegroundBy::Valid, true, 0);
        expect!["`image` has [4, 1] pixels, but `range` is registered to a picture of [2, 1]"]
            .assert_eq(&error.unwrap_err().to_string());
    }
}
