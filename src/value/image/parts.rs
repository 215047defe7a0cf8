//! The parts, layers and edge cases of pictures.

use super::Image;
use crate::edge_cases::SIZES;
use crate::{ElementKind, Layer, Meaning, Parts, PartsError, Picture, Pinhole};

pub(super) fn parts(image: &Image) -> Parts<'_> {
    let mut parts = Parts::default();
    parts.grid(image.width, image.height);
    parts.push("color", ElementKind::Pixel, Meaning::Level, 3, &image.pixels[..]);
    if let Some(camera) = image.camera {
        parts.push_hidden(CAMERA, ElementKind::Whole, Meaning::Number, 4, camera.numbers());
    }
    parts
}

/// The name of the part that holds the camera. Tests ignore this part.
const CAMERA: &str = "camera";

pub(super) fn made_of(parts: &Parts<'_>) -> Result<Image, PartsError> {
    let [width, height] = parts.size()?;
    let image = Image::new(width, height, parts.require("color", 3)?.colors()?);
    Ok(image.map_err(PartsError::from_error)?.with_camera(Pinhole::from_parts(parts, CAMERA)?))
}

pub(super) fn show(image: &Image) -> Vec<Layer> {
    Picture::from_true_colors::<PartsError>(Ok(image.clone()))
}

pub(super) fn edge_cases() -> Vec<Image> {
    SIZES
        .into_iter()
        .filter_map(|[width, height]| {
            Image::new(width, height, vec![[9, 8, 7]; width * height]).ok()
        })
        .collect()
}
