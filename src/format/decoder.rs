//! Decodes pictures with the crate `image`: checks memory limits before unpacking, then converts to 8-bit sRGB.
//!
//! Gray becomes three equal channels, and 16-bit channels are cut to their upper 8 bits. Floats are linear light: they are clamped to the
//! range from 0 to 1 and converted to sRGB; NaN becomes black. Alpha is dropped; [`Decoded::opaque_pixels`] tells which pixels are opaque.
//!
//! All formats are read through `ImageDecoder` with the limit `max_memory`.

use std::error::Error as _;
use std::fmt::Display;
use std::io::ErrorKind;
use std::panic::{AssertUnwindSafe, catch_unwind};

use ::image::error::{ImageError, LimitErrorKind};
use ::image::{DynamicImage, ImageDecoder, Limits};
use maquette_syntax::error::Error;
use maquette_value::parallel::*;
use maquette_value::{Image, srgb_from_linear};

use super::max_memory;

/// Returns the error that a file is damaged or of another format. `reason` is the message of the decoder.
pub(super) fn unreadable(format: &str, reason: impl Display) -> Error {
    Error::new(format!("this is not a readable {format} file: {reason}"))
}

/// Returns the error that a picture would take more than `limit` bytes of memory.
pub(super) fn too_large(width: u32, height: u32, limit: usize) -> Error {
    Error::new(format!(
        "{width} x {height} pixels would take more than {limit} bytes of memory: make the picture smaller"
    ))
}

/// Returns the error that the header states more pixels than a file of `bytes` bytes can contain.
pub(super) fn too_short(width: u32, height: u32, bytes: usize) -> Error {
    Error::new(format!("{width} x {height} pixels do not fit in the {bytes} bytes of the file"))
}

/// A file to be decoded.
#[derive(Clone, Copy)]
pub(super) struct File<'b> {
    pub(super) format: &'static str,
    pub(super) bytes: &'b [u8],
    /// The number of copies of the picture that the decoder holds in memory; 1 if it decodes directly into the given buffer.
    pub(super) copies: u64,
}

impl File<'_> {
    /// Returns the memory limits for the decoder.
    pub(super) fn limits(&self) -> Limits {
        let mut limits = Limits::no_limits();
        limits.max_alloc = Some(max_memory(self.bytes.len()) as u64);
        limits
    }

    /// Converts an error of `image`. The prefix by which `image` names the format is removed, because [`unreadable`] names it, too.
    fn decode_error(&self, error: &ImageError) -> Error {
        if matches!(error, ImageError::IoError(error) if error.kind() == ErrorKind::UnexpectedEof) {
            return unreadable(self.format, "it ends too early");
        }
        match error.source() {
            Some(reason) => unreadable(self.format, reason),
            None => unreadable(self.format, error),
        }
    }

    /// Decodes the picture if `check` accepts its size.
    pub(super) fn decode<D: ImageDecoder>(
        &self,
        open: impl FnOnce() -> Result<D, ImageError>,
        check: impl FnOnce(u32, u32) -> Result<(), Error>,
    ) -> Result<Decoded, Error> {
        // A panic in a third-party decoder is reported as a damaged file; the decoder is not used afterwards.
        let panicked = |payload| {
            drop(caught(payload));
            unreadable(self.format, "the decoder panicked")
        };
        let decoder = catch_unwind(AssertUnwindSafe(open)).map_err(panicked)?;
        let mut decoder = decoder.map_err(|error| self.decode_error(&error))?;
        let (width, height) = decoder.dimensions();
        check(width, height)?;
        let limit = max_memory(self.bytes.len());
        let too_large = || too_large(width, height, limit);
        let mut limits = self.limits();
        // The resulting picture has three bytes per pixel.
        let ours = 3 * u64::from(width) * u64::from(height);
        let theirs = decoder.total_bytes().saturating_mul(self.copies);
        limits.reserve(ours.saturating_add(theirs)).map_err(|_| too_large())?;
        let mut limits = self.limits();
        limits.reserve(ours).map_err(|_| too_large())?;
        let decoded = catch_unwind(AssertUnwindSafe(|| {
            decoder.set_limits(limits)?;
            DynamicImage::from_decoder(decoder)
        }));
        let decoded = decoded.map_err(panicked)?;
        let picture = decoded.map_err(|found| match found {
            ImageError::Limits(limit) if limit.kind() == LimitErrorKind::InsufficientMemory => {
                too_large()
            }
            found => self.decode_error(&found),
        })?;
        Ok(Decoded { format: self.format, picture })
    }
}

/// A decoded picture, with the kind of pixels that the file has.
pub(super) struct Decoded {
    format: &'static str,
    picture: DynamicImage,
}

impl Decoded {
    /// Converts the picture to 8-bit sRGB.
    pub(super) fn into_image(self) -> Result<Image, Error> {
        let (width, height) = (self.picture.width() as usize, self.picture.height() as usize);
        let pixels = eight_bits(self.picture)
            .ok_or_else(|| unreadable(self.format, "an unknown kind of pixels"))?;
        Image::new(width, height, pixels).map_err(|error| unreadable(self.format, error))
    }

    /// Returns true for each pixel whose alpha is at least one half, row by row. `None` if the picture has no alpha channel.
    pub(super) fn opaque_pixels(&self) -> Option<Vec<bool>> {
        Some(match &self.picture {
            DynamicImage::ImageLumaA8(gray) => {
                gray.pixels().map(|pixel| pixel.0[1] >= 128).collect()
            }
            DynamicImage::ImageRgba8(rgba) => {
                rgba.pixels().map(|pixel| pixel.0[3] >= 128).collect()
            }
            DynamicImage::ImageLumaA16(gray) => {
                gray.pixels().map(|pixel| pixel.0[1] >= 1 << 15).collect()
            }
            DynamicImage::ImageRgba16(rgba) => {
                rgba.pixels().map(|pixel| pixel.0[3] >= 1 << 15).collect()
            }
            DynamicImage::ImageRgba32F(rgba) => {
                rgba.pixels().map(|pixel| pixel.0[3] >= 0.5).collect()
            }
            _ => return None,
        })
    }
}

/// Converts decoded pixels to 8-bit sRGB; returns `None` if their type is unknown.
fn eight_bits(decoded: DynamicImage) -> Option<Vec<[u8; 3]>> {
    fn upper(sample: u16) -> u8 {
        (sample >> 8) as u8
    }
    Some(match decoded {
        DynamicImage::ImageRgb8(rgb) => {
            let samples = rgb.into_raw();
            // The cast reuses the memory of the list if the capacity of the list is a multiple of three.
            bytemuck::try_cast_vec(samples)
                .unwrap_or_else(|(_, samples)| samples.as_chunks::<3>().0.to_vec())
        }
        DynamicImage::ImageLuma8(gray) => gray.into_raw().iter().map(|&gray| [gray; 3]).collect(),
        DynamicImage::ImageLumaA8(gray) => {
            gray.into_raw().as_chunks::<2>().0.iter().map(|&[gray, _]| [gray; 3]).collect()
        }
        DynamicImage::ImageRgba8(rgba) => {
            rgba.into_raw().as_chunks::<4>().0.iter().map(|&[r, g, b, _]| [r, g, b]).collect()
        }
        DynamicImage::ImageLuma16(gray) => {
            gray.into_raw().iter().map(|&gray| [upper(gray); 3]).collect()
        }
        DynamicImage::ImageLumaA16(gray) => {
            gray.into_raw().as_chunks::<2>().0.iter().map(|&[gray, _]| [upper(gray); 3]).collect()
        }
        DynamicImage::ImageRgb16(rgb) => {
            rgb.into_raw().as_chunks::<3>().0.iter().map(|pixel| pixel.map(upper)).collect()
        }
        DynamicImage::ImageRgba16(rgba) => rgba
            .into_raw()
            .as_chunks::<4>()
            .0
            .iter()
            .map(|&[r, g, b, _]| [r, g, b].map(upper))
            .collect(),
        DynamicImage::ImageRgb32F(rgb) => rgb
            .into_raw()
            .as_chunks::<3>()
            .0
            .par_iter()
            .map(|pixel| srgb_from_light(*pixel))
            .collect(),
        DynamicImage::ImageRgba32F(rgba) => {
            let pixels = rgba.into_raw();
            pixels
                .as_chunks::<4>()
                .0
                .par_iter()
                .map(|&[r, g, b, _]| srgb_from_light([r, g, b]))
                .collect()
        }
        // `DynamicImage` is a non-exhaustive enum.
        _ => return None,
    })
}

/// Converts linear light to sRGB.
fn srgb_from_light(light: [f32; 3]) -> [u8; 3] {
    light.map(|channel| srgb_from_linear(f64::from(channel)))
}

#[cfg(test)]
mod tests {
    //! Compares the decoded pixels with those of the decoders that `image` uses.

    use std::io::Cursor;

    use ::png::{BitDepth, ColorType, Decoder, Encoder, Transformations};
    use ::tiff::decoder::DecodingResult;
    use ::tiff::encoder::{Compression, TiffEncoder, TiffValue, colortype};
    use expect_test::{Expect, expect};
    use maquette_value::{Image, Mask};

    use crate::{hostile, max_memory, picture_file, png, tiff};

    /// Returns reproducible pseudo-random bytes.
    fn noise(count: usize) -> Vec<u8> {
        let mut state = 3u64;
        fn next(state: &mut u64) -> u8 {
            *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (*state >> 56) as u8
        }
        (0..count).map(|_| next(&mut state)).collect()
    }

    const SIZE: [u32; 2] = [19, 7];

    fn gray_or_rgb(samples: &[u8], channels: usize) -> Vec<[u8; 3]> {
        samples
            .chunks(channels)
            .map(|pixel| match *pixel {
                [gray] | [gray, _] => [gray; 3],
                [red, green, blue, ..] => [red, green, blue],
                [] => [0; 3],
            })
            .collect()
    }

    #[test]
    fn every_kind_of_png_has_the_pixels_of_its_decoder() {
        use BitDepth::{Eight, Four, One, Sixteen, Two};
        let few = [One, Two, Four, Eight];
        let kinds = [
            (ColorType::Grayscale, &[One, Two, Four, Eight, Sixteen][..]),
            (ColorType::GrayscaleAlpha, &[Eight, Sixteen]),
            (ColorType::Rgb, &[Eight, Sixteen]),
            (ColorType::Rgba, &[Eight, Sixteen]),
            (ColorType::Indexed, &few),
        ];
        let kinds = kinds.iter().flat_map(|(color, depths)| depths.iter().map(|d| (*color, *d)));
        for ((color, depth), keyed) in kinds.flat_map(|kind| [(kind, false), (kind, true)]) {
            let [width, height] = SIZE;
            let mut file = Vec::new();
            let mut encoder = Encoder::new(&mut file, width, height);
            encoder.set_color(color);
            encoder.set_depth(depth);
            if color == ColorType::Indexed {
                encoder.set_palette(noise(3 * 256.min(1 << depth as usize)));
            }
            // The color that counts as transparent in the test picture. Color types with alpha have no such color.
            let key = match color {
                ColorType::Indexed => vec![0],
                ColorType::Grayscale => vec![0, 1],
                _ => vec![0; 6],
            };
            if keyed && !matches!(color, ColorType::Rgba | ColorType::GrayscaleAlpha) {
                encoder.set_trns(key);
            }
            let bits = color.samples() * depth as usize * width as usize;
            let samples = noise(bits.div_ceil(8) * height as usize);
            encoder.write_header().unwrap().write_image_data(&samples).unwrap();
            let mut decoder = Decoder::new(Cursor::new(&file));
            decoder.set_transformations(Transformations::EXPAND | Transformations::STRIP_16);
            let mut reader = decoder.read_info().unwrap();
            let mut buffer = vec![0; reader.output_buffer_size().unwrap()];
            let frame = reader.next_frame(&mut buffer).unwrap();
            let expected = gray_or_rgb(&buffer, frame.color_type.samples());
            let image = png::read(&file).unwrap();
            assert_eq!(image.pixels(), expected, "{color:?} {depth:?} {keyed}");
            let channels = frame.color_type.samples();
            let opaque = [2, 4].contains(&channels).then(|| {
                let pixels = buffer.chunks(channels).map(|pixel| pixel[channels - 1] >= 128);
                Mask::from_bools(width as usize, height as usize, pixels.collect()).unwrap()
            });
            assert_eq!(picture_file::read_with_opacity(&file).unwrap(), (image, opaque));
        }
    }

    fn check_tiff<C: colortype::ColorType>(samples: &[C::Inner], channels: usize)
    where
        [C::Inner]: TiffValue,
    {
        for (name, packing) in [
            ("none", Compression::Uncompressed),
            ("LZW", Compression::Lzw),
            ("Deflate", Compression::Deflate(Default::default())),
            ("PackBits", Compression::Packbits),
        ] {
            let [width, height] = SIZE;
            let mut file = Vec::new();
            let encoder = TiffEncoder::new(Cursor::new(&mut file)).unwrap();
            let mut encoder = encoder.with_compression(packing);
            encoder.write_image::<C>(width, height, samples).unwrap();
            let mut decoder = ::tiff::decoder::Decoder::new(Cursor::new(&file)).unwrap();
            let expected = match decoder.read_image().unwrap() {
                DecodingResult::U8(samples) => samples,
                DecodingResult::U16(samples) => samples.iter().map(|x| (x >> 8) as u8).collect(),
                other => panic!("{other:?}"),
            };
            let image = tiff::read(&file).unwrap();
            assert_eq!(image.pixels(), gray_or_rgb(&expected, channels), "{name}");
        }
    }

    #[test]
    fn every_kind_of_tiff_has_the_pixels_of_its_decoder() {
        fn count(channels: usize) -> usize {
            channels * (SIZE[0] * SIZE[1]) as usize
        }
        fn wide(channels: usize) -> Vec<u16> {
            let bytes = noise(2 * count(channels));
            bytes.as_chunks::<2>().0.iter().map(|pair| u16::from_le_bytes(*pair)).collect()
        }
        check_tiff::<colortype::Gray8>(&noise(count(1)), 1);
        check_tiff::<colortype::Gray16>(&wide(1), 1);
        check_tiff::<colortype::RGB8>(&noise(count(3)), 3);
        check_tiff::<colortype::RGB16>(&wide(3), 3);
        check_tiff::<colortype::RGBA8>(&noise(count(4)), 4);
        check_tiff::<colortype::RGBA16>(&wide(4), 4);
    }

    macro_rules! seed {
        ($name:literal) => {
            include_bytes!(concat!("../../tests/data/formats/", $name)).as_slice()
        };
    }

    fn read(file: &[u8]) -> Image {
        let image = picture_file::read(file).unwrap();
        assert_eq!((image.width(), image.height()), (16, 12));
        image
    }

    #[test]
    fn lossless_files_have_their_pixels() {
        let expected: Vec<_> =
            (0..16 * 12).map(|k: usize| [(k % 16 * 16) as u8, (k / 16 * 20) as u8, 128]).collect();
        assert_eq!(read(seed!("lossless.webp")).pixels(), expected);
        assert_eq!(read(seed!("alpha.webp")).pixels(), expected);
        assert_eq!(read(seed!("rgb.bmp")).pixels(), expected);
    }

    fn check(file: &[u8], expected: Expect) {
        let image = read(file);
        expected.assert_eq(&format!("{:?}", [[0, 0], [8, 3], [15, 11]].map(|at| image.pixel(at))));
    }

    #[test]
    fn a_palette_is_expanded() {
        check(seed!("palette.bmp"), expect!["[[16, 0, 128], [144, 60, 128], [224, 220, 128]]"]);
    }

    #[test]
    fn a_lossy_picture_is_close_to_the_original() {
        let image = read(seed!("photo.webp"));
        for (k, pixel) in image.pixels().iter().enumerate() {
            let was = [(k % 16 * 16) as u8, (k / 16 * 20) as u8, 128];
            assert!((0..3).all(|c| pixel[c].abs_diff(was[c]) < 40), "{k} {pixel:?}");
        }
        read(seed!("cmyk.jpg"));
    }

    /// In the test files, red grows to the right and green downwards; blue is above 1.
    #[test]
    fn linear_light_is_converted_to_srgb_and_clamped() {
        check(seed!("light.exr"), expect!["[[0, 0, 255], [188, 137, 255], [248, 245, 255]]"]);
        check(seed!("alpha.exr"), expect!["[[0, 0, 255], [188, 137, 255], [248, 245, 255]]"]);
        check(seed!("light.hdr"), expect!["[[0, 0, 255], [188, 137, 255], [248, 244, 255]]"]);
    }

    #[test]
    fn a_file_that_is_cut_off_ends_too_early() {
        let file = seed!("rgb.bmp");
        let text = "this is not a readable BMP file: it ends too early";
        assert_eq!(picture_file::read(&file[..file.len() / 2]).unwrap_err().to_string(), text);
    }

    #[test]
    fn a_small_file_of_a_huge_picture_is_refused() {
        let huge = [
            ("BMP", seed!("rgb.bmp"), &b"\x10\0\0\0\x0c\0\0\0"[..], &b"\0\x7f\0\0\0\x7f\0\0"[..]),
            ("HDR", seed!("light.hdr"), b"-Y 12 +X 16", b"-Y 32512 +X 32512"),
            (
                "EXR",
                seed!("alpha.exr"),
                b"displayWindow\0box2i\0\x10\0\0\0\0\0\0\0\0\0\0\0\x0f\0\0\0\x0b\0\0\0",
                b"displayWindow\0box2i\0\x10\0\0\0\0\0\0\0\0\0\0\0\xff\x7e\0\0\xff\x7e\0\0",
            ),
            (
                "EXR whose layer is larger than the picture",
                seed!("alpha.exr"),
                b"dataWindow\0box2i\0\x10\0\0\0\0\0\0\0\0\0\0\0\x0f\0\0\0\x0b\0\0\0",
                b"dataWindow\0box2i\0\x10\0\0\0\0\0\0\0\0\0\0\0\xff\x7e\0\0\xff\x7e\0\0",
            ),
        ];
        for (format, file, size, larger) in huge {
            let at = file.windows(size.len()).position(|window| window == size).expect(format);
            let file = [&file[..at], larger, &file[at + size.len()..]].concat();
            let limit = max_memory(file.len());
            assert_eq!(
                picture_file::read(&file).unwrap_err().to_string(),
                format!(
                    "32512 x 32512 pixels would take more than {limit} bytes of memory: make the picture smaller"
                ),
                "{format}"
            );
        }
    }

    #[test]
    fn hostile_files_give_errors() {
        for file in [
            seed!("lossless.webp"),
            seed!("photo.webp"),
            seed!("palette.bmp"),
            seed!("light.hdr"),
            seed!("light.exr"),
            seed!("alpha.exr"),
        ] {
            hostile::check_no_panic(file, picture_file::read);
        }
    }
}
