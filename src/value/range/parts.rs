//! The parts, layers and edge cases of range images.

use nalgebra::Vector3;

use super::RangeImage;
use crate::edge_cases::{SIZES, point_sets};
use crate::frame::{counts, pose_of};
use crate::layer::BACKGROUND;
use crate::{
    ElementKind, Image, Layer, Meaning, Part, Parts, PartsError, Picture, Pinhole, Registration,
    Rgb,
};

/// The names of two parts that tests ignore: the forced triangles, and the size of the registered picture.
const JOINED: &str = "joined";
const PICTURE: &str = "picture";

pub(super) fn parts(range: &RangeImage) -> Parts<'_> {
    let mut parts = Parts::default();
    parts.grid(range.width, range.height);
    parts.fact("valid cells", range.n_valid());
    parts.push("point", ElementKind::Pixel, Meaning::Position, 3, &range.points[..]);
    if range.filled.is_empty() {
        let none = vec![0u8; range.points.len()];
        parts.push("filled", ElementKind::Pixel, Meaning::Exact, 1, none);
    } else {
        parts.push("filled", ElementKind::Pixel, Meaning::Exact, 1, &range.filled[..]);
    }
    if let Some(colors) = range.colors() {
        parts.push("color", ElementKind::Pixel, Meaning::Level, 3, colors);
    }
    if !range.joined.is_empty() {
        parts.push_hidden(JOINED, ElementKind::Pixel, Meaning::Exact, 1, &range.joined[..]);
    }
    let Registration { scale, offset, picture } = range.registration;
    let registration = [scale, offset].concat();
    parts.push("registration", ElementKind::Whole, Meaning::Number, 4, registration);
    let picture = picture.map(|size| size as f64).to_vec();
    parts.push_hidden(PICTURE, ElementKind::Whole, Meaning::Exact, 2, picture);
    if let Some(camera) = &range.camera {
        parts.push("camera", ElementKind::Whole, Meaning::Number, 4, camera.numbers());
    }
    if let Some(pose) = &range.world_from_camera {
        parts.push("pose", ElementKind::Whole, Meaning::Number, 16, pose.as_slice());
    }
    parts
}

/// Builds a range image from parts. Only the part `point` is required. Without the part `registration` the grid is registered to a picture
/// of the grid's size, so that each cell is on one pixel.
pub(super) fn made_of(parts: &Parts<'_>) -> Result<RangeImage, PartsError> {
    let [width, height] = parts.size()?;
    let points = parts.require("point", 3)?.to_points()?;
    let mut range = RangeImage::new(width, height, points).map_err(PartsError::from_error)?;
    if let Some(filled) = parts.column_of("filled", 1)? {
        range = range.with_filled(filled.to_u8(1)?).map_err(PartsError::from_error)?;
    }
    if let Some(joined) = parts.column_of(JOINED, 1)? {
        range = range.with_joined(joined.to_u8(15)?).map_err(PartsError::from_error)?;
    }
    if let Some(colors) = parts.column_of("color", 3)? {
        range = range.with_colors(colors.colors()?).map_err(PartsError::from_error)?;
    }
    if let Some([sx, sy, ox, oy]) = parts.column("registration").map(Part::single).transpose()? {
        let picture = parts.require(PICTURE, 2)?;
        let picture = counts(picture, 0, picture.single()?)?;
        range =
            range.with_registration(Registration { scale: [sx, sy], offset: [ox, oy], picture });
    }
    let camera = Pinhole::from_parts(parts, "camera")?;
    Ok(range.with_camera(camera).with_world_from_camera(pose_of(parts, "pose")?))
}

/// Draws near cells bright and far cells dark, with shading as if lit from the upper left.
pub(super) fn show(range: &RangeImage) -> Vec<Layer> {
    let (width, height) = (range.width, range.height);
    let depths = || range.points.iter().map(|point| point.z).filter(|z| !z.is_nan());
    let (near, far) = (depths().fold(f64::INFINITY, f64::min), depths().fold(0.0, f64::max));
    let light = Vector3::new(-0.45, -0.55, -0.7).normalize();
    let cells = (0..height).flat_map(|row| (0..width).map(move |column| [column, row]));
    let pixels = cells.map(|[column, row]| -> Rgb {
        let Some(point) = range.point(row * width + column) else { return BACKGROUND };
        // The vector from the previous cell to the next cell. An invalid or missing neighbor is replaced by the cell between them.
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
    let image = Image::new(width, height, Vec::from_iter(pixels));
    let registration = Some(range.registration);
    image
        .into_iter()
        .map(|image| Layer::Picture(Picture { image, registration, has_false_colors: true }))
        .collect()
}

pub(super) fn edge_cases() -> Vec<RangeImage> {
    let sizes = SIZES.into_iter().chain([[3, 3], [8, 5]]);
    let ranges = sizes.flat_map(|[width, height]| {
        point_sets(width * height)
            .into_iter()
            .map(move |points| RangeImage::new(width, height, points))
    });
    ranges.flatten().collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn near_cells_are_brighter_and_holes_have_the_background_color() {
        let range = RangeImage::new(
            4,
            3,
            (0..12)
                .map(|k: usize| match k {
                    5 => Point3::new(f64::NAN, 0.0, 0.0),
                    k => Point3::new(
                        (k % 4) as f64,
                        (k / 4) as f64,
                        if k % 4 < 2 { 100.0 } else { 200.0 },
                    ),
                })
                .collect(),
        )
        .unwrap();
        let [Layer::Picture(picture)] = &show(&range)[..] else { panic!("one picture") };
        assert_eq!(picture.image.pixel([1, 1]), BACKGROUND);
        assert!(picture.image.pixel([0, 2])[0] > picture.image.pixel([3, 2])[0]);
    }
}
