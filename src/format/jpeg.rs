//! JPEG, the photographs: read to 8-bit sRGB; gray becomes three equal channels. Never written, because it loses.

use ::image::error::{DecodingError, ImageError, ImageResult};
use ::image::{ColorType, ImageDecoder, ImageFormat};
use maquette_value::Image;
use thiserror::Error;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::decoder::{DecodeError, File};

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
    /// A file that ends inside the picture.
    #[error("byte {bytes}: the file ends before its picture does: it is cut off")]
    Ends {
        /// Bytes in the file.
        bytes: usize,
    },
    /// More pixels than are read.
    #[error(
        "{width} x {height} pixels would take more than {most} bytes of memory: make the picture smaller"
    )]
    TooLarge {
        /// The picture's width.
        width: usize,
        /// The picture's height.
        height: usize,
        /// Bytes that reading it may take.
        most: usize,
    },
}

/// Most pixels that a byte can hold: a block of 64 takes at least one bit in the scan of its mean.
const PIXELS_PER_BYTE: usize = 64 * 8;

impl From<DecodeError> for JpegError {
    fn from(error: DecodeError) -> Self {
        match error {
            DecodeError::Broken { reason, .. } => Self::Broken { reason },
            DecodeError::TooLarge { width, height, most } => {
                Self::TooLarge { width: width as usize, height: height as usize, most }
            }
        }
    }
}

/// The picture in a JPEG file.
///
/// # Errors
/// If the bytes are not a JPEG file, it is damaged or cut off, or its header promises more pixels than it can hold or memory may.
pub fn read(bytes: &[u8]) -> Result<Image, JpegError> {
    let outline = outline(bytes);
    let copies = outline.as_ref().map_or(1, Outline::copies);
    let file = File { format: "JPEG", bytes, copies };
    file.picture(
        || Strict::new(bytes),
        |width, height| {
            let [width, height] = [width, height].map(|side: u32| side as usize);
            if PIXELS_PER_BYTE.saturating_mul(bytes.len()) < width * height {
                return Err(JpegError::CutOff { width, height, bytes: bytes.len() });
            }
            outline.as_ref().map(|_| ()).ok_or(JpegError::Ends { bytes: bytes.len() })
        },
    )
}

/// The decoder that `image` uses, too, but strict: `image` lets it make gray of what is missing inside the picture.
struct Strict<'b> {
    decoder: JpegDecoder<ZCursor<&'b [u8]>>,
    size: (u32, u32),
}

impl<'b> Strict<'b> {
    fn new(bytes: &'b [u8]) -> ImageResult<Self> {
        // No processor's own instructions: the pixels are the same on every machine, and they would not be there sooner.
        let options = DecoderOptions::new_safe()
            .set_strict_mode(true)
            .set_max_width(usize::from(u16::MAX))
            .set_max_height(usize::from(u16::MAX))
            .jpeg_set_out_colorspace(ColorSpace::RGB);
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
        decoder.decode_headers().map_err(broken)?;
        let (width, height) = decoder.dimensions().unwrap_or_default();
        Ok(Self { decoder, size: (width as u32, height as u32) })
    }
}

/// The Exif data of a JPEG file, if it has any.
pub(super) fn exif(bytes: &[u8]) -> Option<Vec<u8>> {
    let options = DecoderOptions::new_safe()
        .set_max_width(usize::from(u16::MAX))
        .set_max_height(usize::from(u16::MAX));
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().ok()?;
    decoder.exif().cloned()
}

fn broken(error: impl std::fmt::Debug) -> ImageError {
    ImageError::Decoding(DecodingError::new(ImageFormat::Jpeg.into(), format!("{error:?}")))
}

impl ImageDecoder for Strict<'_> {
    fn dimensions(&self) -> (u32, u32) {
        self.size
    }

    fn color_type(&self) -> ColorType {
        ColorType::Rgb8
    }

    fn read_image(mut self, samples: &mut [u8]) -> ImageResult<()> {
        self.decoder.decode_into(samples).map_err(broken)
    }

    fn read_image_boxed(self: Box<Self>, samples: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(samples)
    }
}

/// What the markers of a file say of its parts.
struct Outline {
    /// How often all or a part of the picture is gone through.
    scans: usize,
    /// Whether the scans refine each other.
    progressive: bool,
}

impl Outline {
    /// How often the decoder holds the picture: besides its three channels, three coefficients of two bytes a pixel if they must be
    /// kept until the last scan.
    fn copies(&self) -> u64 {
        if self.progressive || 1 < self.scans { 3 } else { 1 }
    }
}

/// Follows the markers from the start of a file to the end of its picture; none if the file ends before. The decoder does not
/// notice when only the last rows are missing.
fn outline(bytes: &[u8]) -> Option<Outline> {
    let mut outline = Outline { scans: 0, progressive: false };
    let mut at = 2;
    loop {
        // Between markers are the bits of a scan, where a byte of 255 has a zero behind it, and restarts.
        at += bytes.get(at..)?.iter().position(|&byte| byte == 0xff)?;
        let kind = *bytes.get(at + 1)?;
        at += match kind {
            0xff => 1,
            0x00 | 0x01 | 0xd0..=0xd8 => 2,
            0xd9 => return Some(outline),
            _ => 2 + usize::from(u16::from_be_bytes(*bytes.get(at + 2..)?.first_chunk()?)),
        };
        outline.scans += usize::from(kind == 0xda);
        outline.progressive |= kind == 0xc2;
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
    fn a_photograph_that_is_cut_anywhere_is_refused() {
        for file in [PHOTO, PROGRESSIVE, GRAY] {
            let whole = (0..file.len()).find(|&length| read(&file[..length]).is_ok());
            assert_eq!(whole, None);
            // What cameras write behind a picture is none of its parts.
            assert_eq!(read(&[file, b"more"].concat()), read(file));
        }
        let half = read(&PHOTO[..PHOTO.len() - 20]).unwrap_err().to_string();
        assert_eq!(half, "byte 700: the file ends before its picture does: it is cut off");
    }

    #[test]
    fn a_small_file_of_a_huge_picture_is_refused() {
        for (photo, side) in [(PHOTO, 0x40), (PROGRESSIVE, 0x28)] {
            let mut file = photo.to_vec();
            let size = file.windows(4).position(|window| window == [0, 12, 0, 16]).unwrap();
            file[size..size + 4].copy_from_slice(&[side, 0, side, 0]);
            // So many bytes could hold as many pixels.
            file.resize(1_000_000, 0);
            let error = read(&file).unwrap_err();
            assert!(matches!(error, JpegError::TooLarge { .. }), "{error}");
        }
    }

    #[test]
    fn hostile_files_give_errors() {
        for file in [PHOTO, PROGRESSIVE] {
            hostile::survive(file, read);
        }
    }
}
