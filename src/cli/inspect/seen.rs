//! Pictures of what is flat and no picture: labels in colors, regions by their masks, range images by their depth.

use nalgebra::Vector3;

use crate::value::{AnyValue, Image, Labels, RangeImage, Region, Rgb};

/// Where nothing is.
const PLAIN: Rgb = [24, 26, 32];

/// A picture of labels, a region or a range image, a pixel for each pixel or cell.
pub(super) fn seen(value: &AnyValue) -> Option<Image> {
    let labels = value.get::<Labels>().map(labels);
    let region = || value.get::<Region>().map(region);
    let range = || value.get::<RangeImage>().map(range);
    labels.or_else(region).or_else(range)
}

fn image(width: usize, height: usize, pixels: Vec<Rgb>) -> Image {
    Image::new(width, height, pixels).expect("a color for each place")
}

fn labels(labels: &Labels) -> Image {
    let pixels = labels.pixels().iter().map(|&label| match label {
        0 => PLAIN,
        label => hue(label),
    });
    image(labels.width(), labels.height(), pixels.collect())
}

/// A color that is far from those of the next labels: steps of the golden angle around the wheel of hues, in three brightnesses.
fn hue(label: u32) -> Rgb {
    const STEP: f64 = 0.618_033_988_749_894_9;
    const BRIGHT: [f64; 3] = [1.0, 0.72, 0.86];
    let around = (f64::from(label) * STEP).fract() * 6.0;
    let bright = BRIGHT[label as usize % 3];
    [0.0, 4.0, 2.0].map(|shift| {
        let ramp = ((around + shift) % 6.0 - 3.0).abs() - 1.0;
        (255.0 * bright * (0.3 + 0.7 * ramp.clamp(0.0, 1.0))).round() as u8
    })
}

fn region(region: &Region) -> Image {
    let pixels = region.grid().into_iter().map(|inside| if inside == 1 { [255; 3] } else { PLAIN });
    image(region.width(), region.height(), pixels.collect())
}

/// Near is bright and far is dark, lit from the left above.
fn range(range: &RangeImage) -> Image {
    let (width, height) = (range.width(), range.height());
    let depths = || range.points().iter().map(|point| point.z).filter(|z| !z.is_nan());
    let (near, far) = (depths().fold(f64::INFINITY, f64::min), depths().fold(0.0, f64::max));
    let light = Vector3::new(-0.45, -0.55, -0.7).normalize();
    let cells = (0..height).flat_map(|row| (0..width).map(move |column| [column, row]));
    let pixels = cells.map(|[column, row]| {
        let Some(point) = range.point(row * width + column) else { return PLAIN };
        // The way from the cell before to the one behind, as far as both are there.
        let across = |step: usize, at: usize, count: usize| {
            let cell = row * width + column;
            let before = (at > 0).then(|| range.point(cell - step)).flatten().unwrap_or(point);
            let behind =
                (at + 1 < count).then(|| range.point(cell + step)).flatten().unwrap_or(point);
            behind - before
        };
        let normal = across(width, row, height).cross(&across(1, column, width));
        let lit = normal.try_normalize(0.0).map_or(0.5, |normal| normal.dot(&light).max(0.0));
        let depth = if near < far { (point.z - near) / (far - near) } else { 0.0 };
        let gray = 255.0 * (1.0 - 0.6 * depth) * (0.3 + 0.7 * lit);
        [gray.round().clamp(0.0, 255.0) as u8; 3]
    });
    image(width, height, pixels.collect())
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use nalgebra::Point3;

    use super::*;

    #[test]
    fn labels_have_colors_of_their_own() {
        let labels = Labels::new(20, 10, (0..200).collect()).unwrap();
        let picture = seen(&AnyValue::new(labels)).unwrap();
        assert_eq!(picture.at([0, 0]), PLAIN);
        assert_eq!(picture.pixels().iter().collect::<HashSet<_>>().len(), 200);
    }

    #[test]
    fn near_is_brighter_than_far_and_holes_are_plain() {
        let point = |k: usize| match k {
            5 => Point3::new(f64::NAN, 0.0, 0.0),
            k => Point3::new((k % 4) as f64, (k / 4) as f64, if k % 4 < 2 { 100.0 } else { 200.0 }),
        };
        let range = RangeImage::new(4, 3, (0..12).map(point).collect()).unwrap();
        let picture = seen(&AnyValue::new(range)).unwrap();
        assert_eq!(picture.at([1, 1]), PLAIN);
        assert!(picture.at([0, 2])[0] > picture.at([3, 2])[0]);
    }

    #[test]
    fn what_is_a_picture_already_is_not_drawn_anew() {
        assert!(seen(&AnyValue::new(Image::new(1, 1, vec![[0; 3]]).unwrap())).is_none());
    }
}
