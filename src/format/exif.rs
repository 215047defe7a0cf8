//! The orientation of photographs: cameras store pixels as the sensor has them, and say how the picture stands upright.
//!
//! JEITA, "Exchangeable image file format for digital still cameras: Exif", 2.32 (2019), tag 274.

use std::io::Cursor;
use std::panic::catch_unwind;

use ::image::codecs::png::PngDecoder;
use ::image::codecs::tiff::TiffDecoder;
use ::image::codecs::webp::WebPDecoder;
use ::image::metadata::Orientation;
use ::image::{DynamicImage, ImageDecoder, ImageResult, RgbImage};
use maquette_value::Image;

use super::jpeg;
use super::picture_kind::Kind;

/// Returns how the pixels of a picture file must be turned so that the picture stands upright. A file that does not say it, or that is
/// damaged, is upright.
pub fn orientation(bytes: &[u8]) -> Orientation {
    // Decoders are others' work: where one panics nothing is turned.
    let found = catch_unwind(|| stored_orientation(bytes)).unwrap_or_default();
    found.unwrap_or(Orientation::NoTransforms)
}

fn stored_orientation(bytes: &[u8]) -> Option<Orientation> {
    fn of<D: ImageDecoder>(decoder: ImageResult<D>) -> Option<Orientation> {
        decoder.ok()?.orientation().ok()
    }
    let file = || Cursor::new(bytes);
    match Kind::of(bytes) {
        Some(Kind::Jpeg) => jpeg::exif(bytes).and_then(|exif| Orientation::from_exif_chunk(&exif)),
        Some(Kind::Png) => of(PngDecoder::new(file())),
        Some(Kind::Tiff) => of(TiffDecoder::new(file())),
        Some(Kind::WebP) => of(WebPDecoder::new(file())),
        Some(Kind::Bmp | Kind::Exr | Kind::Hdr) | None => None,
    }
}

/// Turns a picture upright. Its camera, whose numbers are those of the pixels as they were, is dropped if anything moves.
pub fn upright(image: Image, orientation: Orientation) -> Image {
    if orientation == Orientation::NoTransforms {
        return image;
    }
    let (width, height) = (image.width() as u32, image.height() as u32);
    let pixels = image.pixels().as_flattened().to_vec();
    let pixels = RgbImage::from_raw(width, height, pixels).expect("three samples for each pixel");
    let mut turned = DynamicImage::ImageRgb8(pixels);
    turned.apply_orientation(orientation);
    let turned = turned.into_rgb8();
    let (width, height) = (turned.width() as usize, turned.height() as usize);
    let pixels = turned.into_raw().as_chunks::<3>().0.to_vec();
    Image::new(width, height, pixels).expect("as many pixels as before")
}

/// A warning for readers that keep the pixels of a file as they are stored, if it says that the picture is turned.
pub fn stored_note(bytes: &[u8]) -> Option<String> {
    let orientation = orientation(bytes);
    (orientation != Orientation::NoTransforms).then(|| {
        format!(
            "the picture says that it is turned (Exif orientation {}): its pixels are read as they are stored, for which a camera's numbers are",
            orientation.to_exif()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture_file;

    /// Checks that a picture whose upper left corner is blue stands upright.
    #[track_caller]
    fn check(bytes: &[u8], exif: u8) {
        let orientation = orientation(bytes);
        assert_eq!(orientation.to_exif(), exif);
        assert_eq!(stored_note(bytes).is_some(), exif != 1);
        let image = upright(picture_file::read(bytes).unwrap(), orientation);
        let [red, _, blue] = image.pixels()[0];
        if exif == 6 {
            assert_eq!((image.width(), image.height()), (32, 48));
            assert!(blue > 150 && red < 100, "{:?}", image.pixels()[0]);
        }
    }

    #[test]
    fn photographs_of_every_format_are_turned_upright() {
        check(include_bytes!("../../tests/data/others/I01/orientation1.jpg"), 1);
        check(include_bytes!("../../tests/data/others/I01/orientation3.jpg"), 3);
        check(include_bytes!("../../tests/data/others/I01/orientation8.jpg"), 8);
        check(include_bytes!("../../tests/data/others/I01/orientation6.jpg"), 6);
        check(include_bytes!("../../tests/data/others/I01/orientation6.png"), 6);
        check(include_bytes!("../../tests/data/others/I01/orientation6.tif"), 6);
        check(include_bytes!("../../tests/data/others/I01/orientation6.webp"), 6);
    }

    #[test]
    fn a_turn_moves_each_pixel() {
        let pixels = (0..6).map(|k| [k, 0, 0]).collect::<Vec<_>>();
        let image = Image::new(3, 2, pixels).unwrap();
        let turned = upright(image, Orientation::Rotate90);
        let reds = turned.pixels().iter().map(|pixel| pixel[0]);
        assert_eq!((turned.width(), Vec::from_iter(reds)), (2, vec![3, 0, 4, 1, 5, 2]));
    }
}
