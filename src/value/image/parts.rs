//! What a picture is made of.

use super::Image;
use crate::hostile::SIZES;
use crate::{Layer, Meaning, On, Parts, PartsError, Picture, Pinhole};

pub(super) fn parts(image: &Image) -> Parts<'_> {
    let mut parts = Parts::default();
    parts.grid(image.width, image.height);
    parts.push("color", On::Pixel, Meaning::Level, 3, &image.pixels[..]);
    if let Some(camera) = image.camera {
        parts.push_aside(CAMERA, On::Whole, Meaning::Number, 4, camera.numbers());
    }
    parts
}

/// The camera that took it: tests leave it out.
const CAMERA: &str = "camera";

pub(super) fn made_of(parts: &Parts<'_>) -> Result<Image, PartsError> {
    let [width, height] = parts.size()?;
    let image = Image::new(width, height, parts.need("color", 3)?.colors()?);
    Ok(image.map_err(PartsError::refused)?.with_camera(Pinhole::of(parts, CAMERA)?))
}

pub(super) fn show(image: &Image) -> Vec<Layer> {
    Picture::own::<PartsError>(Ok(image.clone()))
}

pub(super) fn hostile() -> Vec<Image> {
    let image =
        |[width, height]: [usize; 2]| Image::new(width, height, vec![[9, 8, 7]; width * height]);
    SIZES.into_iter().filter_map(|size| image(size).ok()).collect()
}
