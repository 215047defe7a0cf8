//! Draws flat pictures on top of the picture from which a value was made, and scales pictures.

use maquette_value::parallel::*;
use maquette_value::{BACKGROUND, Image, Layer, Picture, Registration, Rgb};

use super::light::{linear, srgb};

/// The brightness factor of the backdrop where the picture on top is empty. A darker backdrop could not be recognized. On a brighter one
/// the picture on top would not stand out.
const DIMMED_BRIGHTNESS: f64 = 0.35;

/// The opacity with which a color is drawn on the backdrop, and the saturation above which a color has that opacity. With less opacity the
/// color would look like another color; with more the backdrop would be invisible.
const OPACITY: f64 = 0.65;
const OPAQUE_SATURATION: f64 = 0.25;

/// The color of the outlines of gray areas.
const OUTLINE: Rgb = [255, 220, 40];

/// The number of pixels along the larger side of a picture for each pixel of line width. Lines are wider in larger pictures, so that they
/// stay visible when the whole picture is shown on a screen.
const PIXELS_PER_LINE: usize = 400;

/// The picture on which a flat picture is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Backdrop<'a> {
    /// The picture that is below the flat picture.
    pub image: &'a Image,
    /// The transformation from pixels of the flat picture to pixels of the backdrop. If it is `None`, the corners of both pictures are
    /// aligned.
    pub registration: Option<Registration>,
}

/// A [`Backdrop`] that owns the picture.
#[derive(Clone)]
pub struct OwnedBackdrop {
    /// The picture: a value of the type [`Image`].
    pub image: maquette_value::AnyValue,
    pub registration: Option<Registration>,
}

impl OwnedBackdrop {
    pub fn backdrop(&self) -> Option<Backdrop<'_>> {
        self.image.get().map(|image| Backdrop { image, registration: self.registration })
    }
}

/// Returns the first flat picture among the layers, or `None` if no layer is a flat picture.
pub fn picture_layer(layers: &[Layer]) -> Option<&Picture> {
    layers.iter().find_map(|layer| match layer {
        Layer::Picture(picture) => Some(picture),
        _ => None,
    })
}

impl Backdrop<'_> {
    /// Draws the picture `over` on top of the backdrop. The backdrop is darkened where `over` is empty, unchanged where `over` is white,
    /// and tinted where `over` has another color. Lines mark the borders between colors.
    pub(super) fn draw_over(&self, over: &Picture) -> Image {
        let [width, height] = [self.image.width(), self.image.height()];
        let on = self.colors(over);
        let reach = (width.max(height) / PIXELS_PER_LINE).max(1);
        let is_rim = |[column, row]: [usize; 2]| {
            let columns = [column.saturating_sub(reach), (column + reach).min(width - 1)];
            let rows = [row.saturating_sub(reach), (row + reach).min(height - 1)];
            let around = columns.map(|it| [it, row]).into_iter().chain(rows.map(|it| [column, it]));
            around.into_iter().any(|[x, y]| on[y * width + x] != on[row * width + column])
        };
        let mut pixels: Vec<Rgb> = self.image.pixels().to_vec();
        pixels.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, pixels)| {
            for (column, pixel) in pixels.iter_mut().enumerate() {
                *pixel = match on[row * width + column] {
                    None => {
                        pixel.map(|channel| (f64::from(channel) * DIMMED_BRIGHTNESS).round() as u8)
                    }
                    Some(color) if is_rim([column, row]) => line(color),
                    Some(color) => tint(*pixel, color),
                };
            }
        });
        Image::new(width, height, pixels).expect("one pixel per position")
    }

    /// Returns the color of `over` at each pixel of the backdrop, or `None` where `over` is empty.
    fn colors(&self, over: &Picture) -> Vec<Option<Rgb>> {
        let size = [over.image.width(), over.image.height()];
        let [width, height] = [self.image.width(), self.image.height()];
        let map = self.registration.or(over.registration);
        let map = map.unwrap_or_else(|| Registration::corners(size, [width, height]));
        let nothing = if over.has_false_colors { BACKGROUND } else { [0; 3] };
        let positions = (0..height).flat_map(|row| (0..width).map(move |column| [column, row]));
        positions
            .map(|[column, row]: [usize; 2]| {
                let cell = map.range_from_picture([column as f64, row as f64]).map(f64::round);
                let is_inside =
                    (0..2).all(|axis| 0.0 <= cell[axis] && cell[axis] < size[axis] as f64);
                let color = is_inside.then(|| over.image.pixel(cell.map(|at| at as usize)))?;
                (color != nothing).then_some(color)
            })
            .collect()
    }
}

/// Returns the saturation of a color, from 0 (gray) to 1.
fn saturation([r, g, b]: Rgb) -> f64 {
    f64::from(r.max(g).max(b) - r.min(g).min(b)) / 255.0
}

/// Returns the color of the outline around an area of the color `color`.
fn line(color: Rgb) -> Rgb {
    if saturation(color) > 0.0 { color } else { OUTLINE }
}

/// Blends a color over a pixel of the backdrop.
fn tint(pixel: Rgb, color: Rgb) -> Rgb {
    let opacity = OPACITY * (saturation(color) / OPAQUE_SATURATION).min(1.0);
    [0, 1, 2].map(|k| {
        (f64::from(pixel[k]) * (1.0 - opacity) + f64::from(color[k]) * opacity).round() as u8
    })
}

/// Scales a picture to another size. Each new pixel is the mean of the pixels that it covers. If the aspect ratios differ, bars are added
/// at two sides.
pub fn fit_picture(picture: &Image, size: [usize; 2]) -> Image {
    let [width, height] = size;
    let given = [picture.width(), picture.height()];
    let mut pixels = vec![BACKGROUND; width.saturating_mul(height)];
    if !pixels.is_empty() && !picture.pixels().is_empty() {
        let scale = (0..2).map(|axis| size[axis] as f64 / given[axis] as f64);
        let scale = scale.fold(f64::INFINITY, f64::min);
        let axes = [0, 1].map(|axis| {
            let count = (given[axis] as f64 * scale).round() as usize;
            let count = count.clamp(1, size[axis]);
            Axis { given: given[axis], count, first: (size[axis] - count) / 2 }
        });
        pixels.par_chunks_mut(width).enumerate().for_each(|(row, pixels)| {
            let Some(rows) = axes[1].covered_pixels(row) else { return };
            for (column, pixel) in pixels.iter_mut().enumerate() {
                let Some(columns) = axes[0].covered_pixels(column) else { continue };
                *pixel = mean(picture, columns, rows.clone());
            }
        });
    }
    Image::new(width, height, pixels).expect("one pixel per position")
}

/// One axis (columns or rows) of a picture that is being scaled.
struct Axis {
    /// The number of pixels along the axis before scaling.
    given: usize,
    /// The number of pixels along the axis after scaling, and the index of the first of these pixels in the new picture. All other pixels
    /// along the axis are bars.
    count: usize,
    first: usize,
}

impl Axis {
    /// Returns the range of old pixels that a new pixel covers, or `None` if the new pixel is in a bar.
    fn covered_pixels(&self, at: usize) -> Option<std::ops::Range<usize>> {
        let at = at.checked_sub(self.first).filter(|at| *at < self.count)?;
        let from = at * self.given / self.count;
        Some(from..((at + 1) * self.given).div_ceil(self.count).max(from + 1))
    }
}

/// Returns the mean color of a box of pixels, computed in linear light.
fn mean(picture: &Image, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> Rgb {
    let fraction = 1.0 / (columns.len() * rows.len()) as f32;
    let positions = rows.flat_map(|row| columns.clone().map(move |column| [column, row]));
    let lights = positions.map(|at| linear(picture.pixel(at).map(f64::from)));
    let sum = lights.fold([0.0; 4], |sum, light| super::array4(|k| sum[k] + fraction * light[k]));
    srgb(sum)
}
