//! JPEG, the photographs: read to 8-bit sRGB; gray becomes three equal channels. Never written, because it loses.

use std::panic::{AssertUnwindSafe, catch_unwind};

use thiserror::Error;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use crate::value::Image;

/// Why bytes are not a picture in a JPEG file.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum JpegError {
    /// Something else, or a damaged file.
    #[error("this is not a readable JPEG file: {reason}")]
    Broken {
        /// What the decoder says.
        reason: String,
    },
    /// A header that promises more than can be there.
    #[error("{width} x {height} pixels cannot be in the {bytes} bytes of the file")]
    CutOff {
        /// The picture's width.
        width: usize,
        /// The picture's height.
        height: usize,
        /// Bytes in the file.
        bytes: usize,
    },
}

/// Most pixels that a byte can hold: a block of 64 takes at least one bit in the scan of its mean.
const PIXELS_PER_BYTE: usize = 64 * 8;

/// The picture in a JPEG file.
///
/// # Errors
/// If the bytes are not a JPEG file, it is damaged, or its header promises more pixels than it can hold.
pub fn read(bytes: &[u8]) -> Result<Image, JpegError> {
    let broken = |reason: &dyn std::fmt::Debug| JpegError::Broken { reason: format!("{reason:?}") };
    // No processor's own instructions: the pixels are the same on every machine.
    let options = DecoderOptions::new_safe()
        .set_max_width(usize::from(u16::MAX))
        .set_max_height(usize::from(u16::MAX))
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|error| broken(&error))?;
    let (width, height) = decoder.dimensions().ok_or_else(|| broken(&"no size"))?;
    if PIXELS_PER_BYTE.saturating_mul(bytes.len()) < width * height {
        return Err(JpegError::CutOff { width, height, bytes: bytes.len() });
    }
    // The decoder panics on some damaged files: https://github.com/etemesi254/zune-image/issues/362. It is not used after that.
    let samples = catch_unwind(AssertUnwindSafe(|| decoder.decode()))
        .map_err(|_| broken(&"the decoder gave up"))?
        .map_err(|error| broken(&error))?;
    let pixels = samples.as_chunks::<3>().0.to_vec();
    Image::new(width, height, pixels).map_err(|error| broken(&error))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::hostile;

    const PHOTO: &[u8] = include_bytes!("../../tests/data/formats/photo.jpg");
    const PROGRESSIVE: &[u8] = include_bytes!("../../tests/data/formats/progressive.jpg");
    const GRAY: &[u8] = include_bytes!("../../tests/data/formats/gray.jpg");

    #[test]
    fn a_file_on_which_the_decoder_panics_is_an_error() {
        let file = include_bytes!("../../tests/data/formats/panics_zune_jpeg_0_5_15.jpg");
        assert!(matches!(read(file), Err(JpegError::Broken { .. })));
    }

    #[test]
    fn photographs_read_as_rgb() {
        for file in [PHOTO, PROGRESSIVE] {
            let image = read(file).unwrap();
            assert_eq!((image.width(), image.height()), (16, 12));
            // Red grows to the right and green downwards, as in the picture that was compressed.
            let [first, last] = [image.at([1, 1]), image.at([14, 10])];
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
        assert!(matches!(read(&file), Err(JpegError::CutOff { width: 65535, .. })));
    }

    #[test]
    fn hostile_files_give_errors() {
        for file in [PHOTO, PROGRESSIVE] {
            hostile::survive(file, read);
        }
    }
}
