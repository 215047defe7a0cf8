//! Flat pictures: what a value shows as a picture, on the one that it was made from.

use maquette_value::parallel::*;
use maquette_value::{Image, Layer, PLAIN, Picture, Registration, Rgb};

use super::light::{linear, srgb};

/// How bright a picture is where nothing lies on it: darker, and it can no longer be made out; brighter, and what does lie on it is not
/// seen at once.
const DIMMED: f64 = 0.35;

/// How much of a picture is hidden by a color on it, and from which saturation on: less, and the color looks like another one;
/// more, and nothing is left of the picture.
const HIDDEN: f64 = 0.65;
const COLORED: f64 = 0.25;

/// Lines around what has no color.
const OUTLINE: Rgb = [255, 220, 40];

/// Pixels of a picture for each pixel of the width of lines: what is looked at as a whole on a screen shows them.
const LINE: usize = 400;

/// What a flat picture lies on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Below<'a> {
    /// The picture.
    pub image: &'a Image,
    /// Where on it the pixels are of what lies on it; corner on corner without it.
    pub registration: Option<Registration>,
}

/// A picture of a graph on which another one lies, as [`Below`] without a borrow.
#[derive(Clone)]
pub struct Ground {
    /// An [`Image`].
    pub image: maquette_value::AnyValue,
    pub registration: Option<Registration>,
}

impl Ground {
    pub fn below(&self) -> Option<Below<'_>> {
        self.image.get().map(|image| Below { image, registration: self.registration })
    }
}

/// The first picture of some layers.
pub fn picture_of(layers: &[Layer]) -> Option<&Picture> {
    layers.iter().find_map(|layer| match layer {
        Layer::Picture(picture) => Some(picture),
        _ => None,
    })
}

impl Below<'_> {
    /// It with another picture on it: dark where that shows nothing, as it is where that is white, in between tinted by the color, and
    /// lines where it changes.
    pub(super) fn under(&self, over: &Picture) -> Image {
        let [width, height] = [self.image.width(), self.image.height()];
        let on = self.colors(over);
        let reach = (width.max(height) / LINE).max(1);
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
                    None => pixel.map(|channel| (f64::from(channel) * DIMMED).round() as u8),
                    Some(color) if is_rim([column, row]) => line(color),
                    Some(color) => tinted(*pixel, color),
                };
            }
        });
        Image::new(width, height, pixels).expect("a pixel for each place")
    }

    /// What lies on each pixel.
    fn colors(&self, over: &Picture) -> Vec<Option<Rgb>> {
        let size = [over.image.width(), over.image.height()];
        let [width, height] = [self.image.width(), self.image.height()];
        let map = self.registration.or(over.registration);
        let map = map.unwrap_or_else(|| Registration::corners(size, [width, height]));
        let nothing = if over.drawn { PLAIN } else { [0; 3] };
        let places = (0..height).flat_map(|row| (0..width).map(move |column| [column, row]));
        places
            .map(|[column, row]: [usize; 2]| {
                let cell = map.range_from_picture([column as f64, row as f64]).map(f64::round);
                let is_inside =
                    (0..2).all(|axis| 0.0 <= cell[axis] && cell[axis] < size[axis] as f64);
                let color = is_inside.then(|| over.image.at(cell.map(|at| at as usize)))?;
                (color != nothing).then_some(color)
            })
            .collect()
    }
}

/// How much of a color is a color, from 0 (gray) to 1.
fn saturation([r, g, b]: Rgb) -> f64 {
    f64::from(r.max(g).max(b) - r.min(g).min(b)) / 255.0
}

/// The line around a part of this color.
fn line(color: Rgb) -> Rgb {
    if saturation(color) > 0.0 { color } else { OUTLINE }
}

/// A pixel with a color on it.
fn tinted(pixel: Rgb, color: Rgb) -> Rgb {
    let share = HIDDEN * (saturation(color) / COLORED).min(1.0);
    fn mix(k: usize, pixel: [u8; 3], share: f64, color: [u8; 3]) -> f64 {
        f64::from(pixel[k]) * (1.0 - share) + f64::from(color[k]) * share
    }
    [0, 1, 2].map(|k| mix(k, pixel, share, color).round() as u8)
}

/// The whole picture in another size, with bars at its sides if its shape is another. Each pixel is the mean of those that it covers.
pub fn fitted(picture: &Image, size: [usize; 2]) -> Image {
    let [width, height] = size;
    let given = [picture.width(), picture.height()];
    let mut pixels = vec![PLAIN; width.saturating_mul(height)];
    if !pixels.is_empty() && !picture.pixels().is_empty() {
        let scale = (0..2).map(|axis| size[axis] as f64 / given[axis] as f64);
        let scale = scale.fold(f64::INFINITY, f64::min);
        let axes = [0, 1].map(|axis| {
            let count = (given[axis] as f64 * scale).round() as usize;
            let count = count.clamp(1, size[axis]);
            Axis { given: given[axis], count, first: (size[axis] - count) / 2 }
        });
        pixels.par_chunks_mut(width).enumerate().for_each(|(row, pixels)| {
            let Some(rows) = axes[1].covered(row) else { return };
            for (column, pixel) in pixels.iter_mut().enumerate() {
                let Some(columns) = axes[0].covered(column) else { continue };
                *pixel = mean(picture, columns, rows.clone());
            }
        });
    }
    Image::new(width, height, pixels).expect("a pixel for each place")
}

/// Pixels along one side of a picture that is scaled.
struct Axis {
    /// How many it has.
    given: usize,
    /// How many it is to have, and before how many of the new picture's.
    count: usize,
    first: usize,
}

impl Axis {
    /// Which pixels a new one covers; none beside the picture.
    fn covered(&self, at: usize) -> Option<std::ops::Range<usize>> {
        let at = at.checked_sub(self.first).filter(|at| *at < self.count)?;
        let from = at * self.given / self.count;
        Some(from..((at + 1) * self.given).div_ceil(self.count).max(from + 1))
    }
}

/// The mean light of a box of pixels.
fn mean(picture: &Image, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> Rgb {
    let share = 1.0 / (columns.len() * rows.len()) as f32;
    let places = rows.flat_map(|row| columns.clone().map(move |column| [column, row]));
    let lights = places.map(|at| linear(picture.at(at).map(f64::from)));
    let sum = lights.fold([0.0; 4], |sum, light| super::four(|k| sum[k] + share * light[k]));
    srgb(sum)
}
