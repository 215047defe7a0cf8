//! JPEG, which is read to 8-bit sRGB; gray becomes three equal channels. Pictures are never written as JPEG, because it is lossy.

use ::image::error::{DecodingError, ImageError, ImageResult};
use ::image::{ColorType, ImageDecoder, ImageFormat};
use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::Image;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::decoder::{Decoded, File, too_short};

/// The maximum number of pixels per byte: for each block of 64 pixels, the scan that contains its mean takes at least one bit.
const MAX_PIXELS_PER_BYTE: usize = 64 * 8;

/// Reads a JPEG file.
///
/// Returns an error if the bytes are not a JPEG file, the file is damaged or truncated, or its header states more pixels than fit in the
/// file or in memory.
pub fn read(bytes: &[u8]) -> Result<Image, Error> {
    decode_picture(bytes)?.into_image()
}

/// Decodes a picture; see [`read`].
pub(super) fn decode_picture(bytes: &[u8]) -> Result<Decoded, Error> {
    let outline = scan_markers(bytes);
    let copies = outline.as_ref().map_or(1, Outline::copies);
    let file = File { format: "JPEG", bytes, copies };
    file.decode(
        || StrictDecoder::new(bytes),
        |width, height| {
            let limit = MAX_PIXELS_PER_BYTE.saturating_mul(bytes.len());
            if limit < width as usize * height as usize {
                return Err(too_short(width, height, bytes.len()));
            }
            if outline.is_none() {
                bail!("byte {}: the file is truncated", bytes.len());
            }
            Ok(())
        },
    )
}

/// The decoder that `image` uses, in strict mode: `image` would let the decoder fill missing parts of the picture with gray.
struct StrictDecoder<'b> {
    decoder: JpegDecoder<ZCursor<&'b [u8]>>,
    size: (u32, u32),
}

impl<'b> StrictDecoder<'b> {
    fn new(bytes: &'b [u8]) -> ImageResult<Self> {
        // SIMD instructions are turned off: the pixels are then equal on every machine, and SIMD is not faster here.
        let options = DecoderOptions::new_safe()
            .set_strict_mode(true)
            .set_max_width(usize::from(u16::MAX))
            .set_max_height(usize::from(u16::MAX))
            .jpeg_set_out_colorspace(ColorSpace::RGB);
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
        decoder.decode_headers().map_err(decoding_error)?;
        let (width, height) = decoder.dimensions().unwrap_or_default();
        Ok(Self { decoder, size: (width as u32, height as u32) })
    }
}

/// Returns the Exif data of a JPEG file, or `None` if it has none.
pub(super) fn exif(bytes: &[u8]) -> Option<Vec<u8>> {
    let options = DecoderOptions::new_safe()
        .set_max_width(usize::from(u16::MAX))
        .set_max_height(usize::from(u16::MAX));
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().ok()?;
    decoder.exif().cloned()
}

fn decoding_error(error: impl std::fmt::Debug) -> ImageError {
    ImageError::Decoding(DecodingError::new(ImageFormat::Jpeg.into(), format!("{error:?}")))
}

impl ImageDecoder for StrictDecoder<'_> {
    fn dimensions(&self) -> (u32, u32) {
        self.size
    }

    fn color_type(&self) -> ColorType {
        ColorType::Rgb8
    }

    fn read_image(mut self, samples: &mut [u8]) -> ImageResult<()> {
        self.decoder.decode_into(samples).map_err(decoding_error)
    }

    fn read_image_boxed(self: Box<Self>, samples: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(samples)
    }
}

/// The structure of a JPEG file, determined from its markers.
struct Outline {
    /// The number of scans. A scan covers all or a part of the picture.
    scans: usize,
    /// True if later scans refine earlier ones.
    is_progressive: bool,
}

impl Outline {
    /// Returns the number of copies of the picture that the decoder holds: one for its three channels, and, if the coefficients must be
    /// kept until the last scan, two more for three coefficients of two bytes per pixel.
    fn copies(&self) -> u64 {
        if self.is_progressive || 1 < self.scans { 3 } else { 1 }
    }
}

/// Follows the markers from the start of a file to the end of its picture. Returns `None` if the file ends before the picture. This check
/// is necessary because the decoder does not notice that the last rows are missing.
fn scan_markers(bytes: &[u8]) -> Option<Outline> {
    let mut outline = Outline { scans: 0, is_progressive: false };
    let mut at = 2;
    loop {
        // Between two markers are the bits of a scan. A byte 255 among them is followed by 0, or is the start of a restart marker.
        at += bytes.get(at..)?.iter().position(|&byte| byte == 0xff)?;
        let kind = *bytes.get(at + 1)?;
        at += match kind {
            0xff => 1,
            0x00 | 0x01 | 0xd0..=0xd8 => 2,
            0xd9 => return Some(outline),
            _ => 2 + usize::from(u16::from_be_bytes(*bytes.get(at + 2..)?.first_chunk()?)),
        };
        outline.scans += usize::from(kind == 0xda);
        outline.is_progressive |= kind == 0xc2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hostile;

    const PHOTO: &[u8] = include_bytes!("../../tests/data/formats/photo.jpg");
    const PROGRESSIVE: &[u8] = include_bytes!("../../tests/data/formats/progressive.jpg");
    const GRAY: &[u8] = include_bytes!("../../tests/data/formats/gray.jpg");

    #[test]
    fn a_file_on_which_the_decoder_panics_is_an_error() {
        let file = include_bytes!("../../tests/data/formats/panics_zune_jpeg_0_5_15.jpg");
        let error = read(file).unwrap_err().to_string();
        assert!(error.starts_with("this is not a readable JPEG file: "), "{error}");
    }

    #[test]
    fn photographs_read_as_rgb() {
        for file in [PHOTO, PROGRESSIVE] {
            let image = read(file).unwrap();
            assert_eq!((image.width(), image.height()), (16, 12));
            // In the picture, red grows to the right and green downwards.
            let [first, last] = [image.pixel([1, 1]), image.pixel([14, 10])];
            assert!(first[0] < 60 && 180 < last[0], "{first:?} {last:?}");
            assert!(first[1] < 60 && 180 < last[1], "{first:?} {last:?}");
        }
        let image = read(GRAY).unwrap();
        assert!(image.pixels().iter().all(|[red, green, blue]| red == green && green == blue));
    }

    #[test]
    fn a_picture_that_would_fill_the_memory_is_refused() {
        let mut file = PHOTO.to_vec();
        let size = file.windows(4).position(|window| window == [0, 12, 0, 16]).unwrap();
        file[size..size + 4].fill(0xff);
        let error = read(&file).unwrap_err().to_string();
        assert!(error.starts_with("65535 x 65535 pixels do not fit in the "), "{error}");
    }

    #[test]
    fn a_photograph_that_is_cut_anywhere_is_refused() {
        for file in [PHOTO, PROGRESSIVE, GRAY] {
            let accepted = (0..file.len()).find(|&length| read(&file[..length]).is_ok());
            assert_eq!(accepted, None);
            // Cameras write more data after the picture; the reader ignores these data.
            assert_eq!(read(&[file, b"more"].concat()).unwrap(), read(file).unwrap());
        }
        let half = read(&PHOTO[..PHOTO.len() - 20]).unwrap_err().to_string();
        assert_eq!(half, "byte 700: the file is truncated");
    }

    #[test]
    fn a_small_file_of_a_huge_picture_is_refused() {
        for (photo, side) in [(PHOTO, 0x40), (PROGRESSIVE, 0x28)] {
            let mut file = photo.to_vec();
            let size = file.windows(4).position(|window| window == [0, 12, 0, 16]).unwrap();
            file[size..size + 4].copy_from_slice(&[side, 0, side, 0]);
            // A file of this size could contain that many pixels.
            file.resize(1_000_000, 0);
            let error = read(&file).unwrap_err().to_string();
            assert!(error.contains(" pixels would take more than "), "{error}");
        }
    }

    #[test]
    fn hostile_files_give_errors() {
        for file in [PHOTO, PROGRESSIVE] {
            hostile::check_no_panic(file, read);
        }
    }
}
