//! PNG pictures.
//!
//! All color types are read to 8-bit sRGB (see `decoder.rs`); palettes are expanded. Depth maps keep their 16 bits. Files are written
//! with fast compression, because the time for writing matters more than the size.

use std::io::Cursor;

use ::image::codecs::png::PngDecoder;
use ::png::{BitDepth, ColorType, Compression, Decoder, Encoder, Filter, Limits, Transformations};
use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::{Field, Image, Labels, Mask};

use super::decoder::{Decoded, File, too_large, too_short, unreadable};
use super::{depth, max_memory};

/// The maximum size of a depth map's samples, in bytes. The limit is necessary because a small file can unpack to a thousand times its
/// size.
const MAX_BYTES: usize = 512 << 20;

/// Reads a PNG file.
///
/// # Errors
/// If the bytes are not a PNG file, it is damaged, or the picture takes too much memory.
pub fn read(bytes: &[u8]) -> Result<Image, Error> {
    decode_picture(bytes)?.into_image()
}

/// Decodes a picture; see [`read`].
pub(super) fn decode_picture(bytes: &[u8]) -> Result<Decoded, Error> {
    let file = File { format: "PNG", bytes, copies: 1 };
    // The file must have at least one bit per pixel.
    file.decode(
        || PngDecoder::with_limits(Cursor::new(bytes), file.limits()),
        |width, height| check_size(width, height, 1, bytes.len()),
    )
}

/// Checks that a file of `bytes` bytes can contain this many pixels.
fn check_size(width: u32, height: u32, bits: u64, bytes: usize) -> Result<(), Error> {
    let limit = MAX_EXPANSION.saturating_mul(bytes) as u64;
    match limit < bits * pixels(width, height) / 8 {
        true => Err(too_short(width, height, bytes)),
        false => Ok(()),
    }
}

/// Reads a depth map from a PNG file of 16-bit gray. Returns width, height and one number per pixel, row by row from the top.
///
/// # Errors
/// If the bytes are not a PNG file of 16-bit gray, the file is damaged, or the picture takes more than 512 MB.
pub(super) fn read_depth(bytes: &[u8]) -> Result<(usize, usize, Vec<u16>), Error> {
    let limit = max_memory(bytes.len());
    let Pixels { width, height, color, buffer } = decode(bytes, limit)?;
    let samples = buffer.as_chunks::<2>().0;
    let gray = color == ColorType::Grayscale;
    if !gray || samples.len() as u64 != pixels(width, height) {
        let bits = 8 * buffer.len() as u64 / pixels(width, height).max(1);
        bail!("expected a depth map in 16-bit gray, found {color:?} of {bits} bits");
    }
    let depths = samples.iter().map(|&sample| u16::from_be_bytes(sample)).collect();
    Ok((width as usize, height as usize, depths))
}

/// The samples of a picture as the decoder returns them.
struct Pixels {
    width: u32,
    height: u32,
    color: ColorType,
    buffer: Vec<u8>,
}

/// The maximum ratio of unpacked to packed size of the compression Deflate.
const MAX_EXPANSION: usize = 1032;

/// Decodes all samples unchanged. Fails if they would take more than `limit` bytes as a depth map.
fn decode(bytes: &[u8], limit: usize) -> Result<Pixels, Error> {
    fn broken_file(reason: ::png::DecodingError) -> Error {
        unreadable("PNG", reason)
    }
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: MAX_BYTES });
    decoder.set_transformations(Transformations::IDENTITY);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let mut reader = decoder.read_info().map_err(broken_file)?;
    let info = reader.info();
    let (width, height) = (info.width, info.height);
    let bits = info.bits_per_pixel() as u64;
    let all = (depth::BYTES_PER_PIXEL as u64).saturating_mul(pixels(width, height));
    let size = reader.output_buffer_size().filter(|size| *size <= MAX_BYTES && all <= limit as u64);
    let size = size.ok_or_else(|| too_large(width, height, limit))?;
    check_size(width, height, bits, bytes.len())?;
    let mut buffer = vec![0; size];
    let frame = reader.next_frame(&mut buffer).map_err(broken_file)?;
    buffer.truncate(frame.buffer_size());
    Ok(Pixels { width, height, color: frame.color_type, buffer })
}

fn pixels(width: u32, height: u32) -> u64 {
    u64::from(width) * u64::from(height)
}

/// Encodes a picture as PNG.
///
/// # Errors
/// If the picture has no pixels.
pub fn encode_rgb(image: &Image) -> Result<Vec<u8>, Error> {
    let pixels = image.pixels().as_flattened();
    encode([image.width(), image.height()], ColorType::Rgb, BitDepth::Eight, pixels)
}

/// Encodes a 16-bit gray picture as PNG.
///
/// # Errors
/// If the picture has no pixels.
pub(super) fn encode_gray(
    size: [usize; 2],
    samples: impl Iterator<Item = u16>,
) -> Result<Vec<u8>, Error> {
    // PNG stores the high byte of a sample first.
    let samples: Vec<u8> = samples.flat_map(u16::to_be_bytes).collect();
    encode(size, ColorType::Grayscale, BitDepth::Sixteen, &samples)
}

fn wrong_size(width: usize, height: usize) -> Error {
    Error::new(format!("a picture of {width} x {height} pixels cannot be written as PNG"))
}

fn encode(
    [width, height]: [usize; 2],
    color: ColorType,
    depth: BitDepth,
    samples: &[u8],
) -> Result<Vec<u8>, Error> {
    let (Ok(columns), Ok(rows)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(wrong_size(width, height));
    };
    let mut bytes = Vec::with_capacity(samples.len() / 2 + 1024);
    let mut encoder = Encoder::new(&mut bytes, columns, rows);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.set_compression(Compression::Fast);
    encoder.set_filter(Filter::Up);
    let written = encoder
        .write_header()
        .and_then(|mut writer| writer.write_image_data(samples).and_then(|()| writer.finish()));
    written.map(|()| bytes).map_err(|_| wrong_size(width, height))
}

/// Writes a picture.
pub(super) struct ImagePng;

impl FileFormat for ImagePng {
    type Value = Image;
    const EXTENSION: &'static str = "png";

    fn write(image: &Image, name: &str) -> Result<Vec<NewFile>, Error> {
        Ok(NewFile::single(name, encode_rgb(image)?))
    }
}

/// Writes a mask as a gray picture: 255 inside, 0 outside.
pub(super) struct MaskPng;

impl FileFormat for MaskPng {
    type Value = Mask;
    const EXTENSION: &'static str = "png";

    fn write(mask: &Mask, name: &str) -> Result<Vec<NewFile>, Error> {
        let samples: Vec<_> = mask.pixels().iter().map(|inside| inside * 255).collect();
        let size = [mask.width(), mask.height()];
        let bytes = encode(size, ColorType::Grayscale, BitDepth::Eight, &samples)?;
        Ok(NewFile::single(name, bytes))
    }
}

/// Writes labels as a 16-bit gray picture.
pub(super) struct LabelsPng;

impl FileFormat for LabelsPng {
    type Value = Labels;
    const EXTENSION: &'static str = "png";

    fn write(labels: &Labels, name: &str) -> Result<Vec<NewFile>, Error> {
        let count = labels.statistics().len();
        if count > usize::from(u16::MAX) {
            bail!("expected at most 65535 labels for a 16-bit picture, found {count}");
        }
        let samples = labels.pixels().iter().map(|&label| label as u16);
        let bytes = encode_gray([labels.width(), labels.height()], samples)?;
        Ok(NewFile::single(name, bytes))
    }
}

/// Writes a field as a 16-bit gray picture, from black at the field's minimum to white at its maximum; NaN is black.
pub(super) struct FieldPng;

impl FileFormat for FieldPng {
    type Value = Field;
    const EXTENSION: &'static str = "png";

    fn write(field: &Field, name: &str) -> Result<Vec<NewFile>, Error> {
        let (min, max) = field.range().unwrap_or_default();
        let (min, max) = (f64::from(min), f64::from(max));
        let scale = if min < max { 65535.0 / (max - min) } else { 0.0 };
        // The casts saturate infinite numbers and convert NaN to 0.
        let bytes = encode_gray(
            [field.width(), field.height()],
            field.pixels().iter().map(|&x| (((f64::from(x) - min) * scale).round()) as u16),
        )?;
        Ok(NewFile::single(name, bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hostile;

    const COLOR: &[u8] = include_bytes!("../../tests/data/formats/colour_2x.png");
    const DEPTH: &[u8] = include_bytes!("../../tests/data/formats/depth16.png");

    fn write_bytes<F: FileFormat>(value: &F::Value) -> Vec<u8> {
        F::write(value, "a.png").unwrap().remove(0).bytes
    }

    fn grays(file: &[u8]) -> Vec<u8> {
        read(file).unwrap().pixels().iter().map(|pixel| pixel[0]).collect()
    }

    #[test]
    fn a_written_picture_is_read_back() {
        let pixels: Vec<_> =
            (0..300).map(|i: u32| [i as u8, (i * 7) as u8, (i / 3) as u8]).collect();
        let image = Image::new(20, 15, pixels).unwrap();
        assert_eq!(read(&encode_rgb(&image).unwrap()).unwrap(), image);
    }

    #[test]
    fn every_color_type_reads_as_eight_bit_rgb() {
        fn picture(
            color: ColorType,
            depth: BitDepth,
            samples: &[u8],
            palette: &[u8],
        ) -> Vec<[u8; 3]> {
            let mut bytes = Vec::new();
            let mut encoder = Encoder::new(&mut bytes, 2, 1);
            encoder.set_color(color);
            encoder.set_depth(depth);
            if !palette.is_empty() {
                encoder.set_palette(palette);
            }
            encoder.write_header().unwrap().write_image_data(samples).unwrap();
            read(&bytes).unwrap().pixels().to_vec()
        }
        let (eight, sixteen) = (BitDepth::Eight, BitDepth::Sixteen);
        assert_eq!(picture(ColorType::Grayscale, BitDepth::One, &[0x40], &[]), [[0; 3], [255; 3]]);
        assert_eq!(picture(ColorType::Grayscale, sixteen, &[7, 255, 9, 0], &[]), [[7; 3], [9; 3]]);
        assert_eq!(picture(ColorType::GrayscaleAlpha, eight, &[7, 0, 9, 1], &[]), [[7; 3], [9; 3]]);
        let rgba = [1, 2, 3, 0, 4, 5, 6, 255];
        assert_eq!(picture(ColorType::Rgba, eight, &rgba, &[]), [[1, 2, 3], [4, 5, 6]]);
        let palette = [1, 2, 3, 4, 5, 6];
        assert_eq!(picture(ColorType::Indexed, eight, &[1, 0], &palette), [[4, 5, 6], [1, 2, 3]]);
    }

    #[test]
    fn files_of_other_programs_are_read() {
        let image = read(COLOR).unwrap();
        assert_eq!((image.width(), image.height()), (16, 12));
        let image = read(DEPTH).unwrap();
        assert_eq!((image.width(), image.height()), (8, 6));
    }

    #[test]
    fn a_mask_is_black_and_white() {
        assert_eq!(
            grays(&write_bytes::<MaskPng>(&Mask::from_rows(&["#.", ".#"]))),
            [255, 0, 0, 255]
        );
    }

    #[test]
    fn a_field_goes_from_black_to_white_and_its_holes_are_black() {
        let field = Field::new(5, 1, vec![-1.0, 1.0, f32::NAN, 3.0, f32::INFINITY]).unwrap();
        assert_eq!(grays(&write_bytes::<FieldPng>(&field)), [0, 128, 0, 255, 255]);
        let flat = Field::new(2, 1, vec![5.0, f32::INFINITY]).unwrap();
        assert_eq!(grays(&write_bytes::<FieldPng>(&flat)), [0, 0]);
    }

    #[test]
    fn labels_keep_their_numbers_in_sixteen_bits() {
        let labels = Labels::new(300, 1, (0..300).collect()).unwrap();
        let bytes = write_bytes::<LabelsPng>(&labels);
        let mut reader = Decoder::new(Cursor::new(&bytes[..])).read_info().unwrap();
        let mut samples = vec![0; 600];
        reader.next_frame(&mut samples).unwrap();
        assert_eq!(samples, (0..300u16).flat_map(u16::to_be_bytes).collect::<Vec<_>>());
        let many = Labels::new(65536, 1, (1..=65536).collect()).unwrap();
        assert!(LabelsPng::write(&many, "a.png").is_err());
    }

    #[test]
    fn a_picture_without_pixels_cannot_be_written() {
        let empty = Image::new(0, 0, vec![]).unwrap();
        assert_eq!(
            encode_rgb(&empty).unwrap_err().to_string(),
            "a picture of 0 x 0 pixels cannot be written as PNG"
        );
    }

    #[test]
    fn a_picture_that_would_fill_the_memory_is_refused() {
        let mut bytes = Vec::new();
        let mut writer = Encoder::new(&mut bytes, 1 << 15, 1 << 15).write_header().unwrap();
        writer.write_chunk(::png::chunk::IDAT, &[]).unwrap();
        drop(writer);
        // A file of this size could contain that many pixels.
        bytes.resize(1_000_000, 0);
        assert_eq!(
            read(&bytes).unwrap_err().to_string(),
            "32768 x 32768 pixels would take more than 1073741824 bytes of memory: make the picture smaller"
        );
    }

    #[test]
    fn a_small_file_of_a_huge_depth_map_is_refused() {
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, 1 << 13, 1 << 13);
        encoder.set_depth(BitDepth::Sixteen);
        let mut writer = encoder.write_header().unwrap();
        writer.write_chunk(::png::chunk::IDAT, &[]).unwrap();
        drop(writer);
        assert_eq!(
            read_depth(&bytes).unwrap_err().to_string(),
            "8192 x 8192 pixels would take more than 1073741824 bytes of memory: make the picture smaller"
        );
    }

    #[test]
    fn a_picture_that_cannot_be_in_its_file_takes_no_memory() {
        let mut bytes = Vec::new();
        let mut writer = Encoder::new(&mut bytes, 1 << 12, 1 << 12).write_header().unwrap();
        writer.write_chunk(::png::chunk::IDAT, &[]).unwrap();
        drop(writer);
        let error = read(&bytes).unwrap_err().to_string();
        assert!(error.starts_with("4096 x 4096 pixels do not fit in the "), "{error}");
    }

    #[test]
    fn depths_keep_their_sixteen_bits() {
        let (width, height, depths) = read_depth(DEPTH).unwrap();
        assert_eq!((width, height), (8, 6));
        // The depths are the grid's z coordinates in steps of 1/50 mm; the first pixel is a hole.
        assert_eq!(depths[..3], [0, 5100, 5025]);
        let text = "expected a depth map in 16-bit gray, found Rgb of 24 bits";
        assert_eq!(read_depth(COLOR).unwrap_err().to_string(), text);
    }

    #[test]
    fn hostile_files_give_errors() {
        for file in [COLOR, DEPTH] {
            hostile::check_no_panic(file, read);
            hostile::check_no_panic(file, |bytes| read_depth(bytes).is_ok());
        }
    }
}
