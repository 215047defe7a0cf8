//! The orientation of photographs: cameras store pixels in the sensor's orientation, with a tag that states how to rotate the picture
//! upright.
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

/// Returns the transformation that makes a picture upright. It is the identity if the file has no orientation tag or is damaged.
pub fn orientation(bytes: &[u8]) -> Orientation {
    // A panic in a third-party decoder is treated as a missing orientation tag.
    let found = catch_unwind(|| stored_orientation(bytes)).unwrap_or_default();
    found.unwrap_or(Orientation::NoTransforms)
}

fn stored_orientation(bytes: &[u8]) -> Option<Orientation> {
    fn decoder_orientation<D: ImageDecoder>(decoder: ImageResult<D>) -> Option<Orientation> {
        decoder.ok()?.orientation().ok()
    }
    let file = Cursor::new(bytes);
    match Kind::detect(bytes) {
        Some(Kind::Jpeg) => jpeg::exif(bytes).and_then(|exif| Orientation::from_exif_chunk(&exif)),
        Some(Kind::Png) => decoder_orientation(PngDecoder::new(file)),
        Some(Kind::Tiff) => decoder_orientation(TiffDecoder::new(file)),
        Some(Kind::WebP) => decoder_orientation(WebPDecoder::new(file)),
        Some(Kind::Bmp | Kind::Exr | Kind::Hdr) | None => None,
    }
}

/// Makes a picture upright. If this moves pixels, the picture's camera is dropped, because its parameters are valid for the stored pixels.
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

/// Returns a warning if the orientation tag of the file is not the identity. The warning is meant for readers that keep the pixels as
/// stored.
pub fn stored_note(bytes: &[u8]) -> Option<String> {
    let orientation = orientation(bytes);
    (orientation != Orientation::NoTransforms).then(|| {
        format!(
            "the picture has the Exif orientation {}: its pixels are read as stored, without rotation, since camera intrinsics are for stored pixels",
            orientation.to_exif()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture_file;

    /// Checks that a picture becomes upright: its upper left corner must then be blue.
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
    fn a_rotation_moves_each_pixel() {
        let pixels = (0..6).map(|k| [k, 0, 0]).collect::<Vec<_>>();
        let image = Image::new(3, 2, pixels).unwrap();
        let turned = upright(image, Orientation::Rotate90);
        let reds = turned.pixels().iter().map(|pixel| pixel[0]);
        assert_eq!((turned.width(), reds.collect::<Vec<_>>()), (2, vec![3, 0, 4, 1, 5, 2]));
    }
}
