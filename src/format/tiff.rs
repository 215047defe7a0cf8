//! TIFF, for pictures and depth maps: uncompressed, LZW, Deflate or PackBits.
//!
//! Pictures are read to 8-bit sRGB (see `decoder.rs`). A depth map is one channel of floats or integers. Files are written without
//! compression: fields as 32-bit floats, everything else with 8 bits.

use std::io::Cursor;

use ::image::codecs::tiff::TiffDecoder;
use ::tiff::ColorType;
use ::tiff::decoder::{Decoder, DecodingResult, Limits};
use ::tiff::encoder::{TiffEncoder, colortype};
use ::tiff::tags::{CompressionMethod, Tag};
use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::{Field, Image, Mask};

use super::decoder::{Decoded, File, too_large, too_short, unreadable};
use super::{depth, max_memory};

/// The maximum size of a decoded picture, in bytes.
const MAX_BYTES: usize = 512 << 20;

/// The maximum ratio of decoded to compressed size: LZW nearly reaches it, Deflate reaches a quarter of it.
const MAX_EXPANSION: usize = 4096;

/// Decoded pixels, as stored in the file.
struct Pixels {
    width: usize,
    height: usize,
    color: ColorType,
    samples: DecodingResult,
}

/// A file whose header has been read.
struct OpenFile<'b> {
    decoder: Decoder<Cursor<&'b [u8]>>,
    width: u32,
    height: u32,
    color: ColorType,
}

fn broken_file(error: ::tiff::TiffError) -> Error {
    unreadable("TIFF", error)
}

/// Opens a file, and checks that it is long enough for the picture that its header states.
fn open_file(bytes: &[u8]) -> Result<OpenFile<'_>, Error> {
    let limit = MAX_BYTES.min(MAX_EXPANSION.saturating_mul(bytes.len()));
    let mut limits = Limits::default();
    limits.decoding_buffer_size = limit;
    limits.intermediate_buffer_size = limit;
    limits.ifd_value_size = bytes.len();
    check_directory(bytes)?;
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(broken_file)?.with_limits(limits);
    let (width, height) = decoder.dimensions().map_err(broken_file)?;
    if (limit as u64) < u64::from(width) * u64::from(height) / 8 {
        return Err(too_short(width, height, bytes.len()));
    }
    let color = decoder.colortype().map_err(broken_file)?;
    Ok(OpenFile { decoder, width, height, color })
}

/// Decodes all samples. Returns an error if `per_pixel` bytes per pixel do not fit in memory.
fn decode(bytes: &[u8], per_pixel: usize) -> Result<Pixels, Error> {
    let OpenFile { mut decoder, width, height, color } = open_file(bytes)?;
    let memory = max_memory(bytes.len());
    if ((memory / per_pixel) as u64) < u64::from(width) * u64::from(height) {
        return Err(too_large(width, height, memory));
    }
    let samples = decoder.read_image().map_err(broken_file)?;
    Ok(Pixels { width: width as usize, height: height as usize, color, samples })
}

/// Checks that no entry of the first directory is longer than the file. This is necessary because the decoder reads entries before its
/// limits apply. The decoder itself rejects a missing directory.
fn check_directory(bytes: &[u8]) -> Result<(), Error> {
    let [big_endian, large] =
        [bytes.starts_with(b"MM"), bytes.get(2..4).is_some_and(|version| version.contains(&43))];
    fn number(at: usize, size: usize, big_endian: bool, bytes: &[u8]) -> Option<u64> {
        let number = bytes.get(at..)?.get(..size)?;
        fn join(sum: u64, byte: &u8) -> u64 {
            sum << 8 | u64::from(*byte)
        }
        Some(match big_endian {
            true => number.iter().fold(0, join),
            false => number.iter().rev().fold(0, join),
        })
    }
    // In BigTIFF, the offset of the directory, the number of its entries and the values in an entry take more bytes.
    let (start, length, width, entry) = if large { (8, 8, 8, 20) } else { (4, 2, 4, 12) };
    fn as_index(place: Option<u64>) -> Option<usize> {
        place.and_then(|place| usize::try_from(place).ok())
    }
    let Some(directory) = as_index(number(start, width, big_endian, bytes)) else { return Ok(()) };
    let Some(first) = directory.checked_add(length) else { return Ok(()) };
    for k in 0..as_index(number(directory, length, big_endian, bytes)).unwrap_or(0) {
        let byte = first.saturating_add(k.saturating_mul(entry));
        let Some((kind, count)) = number(byte.saturating_add(2), 2, big_endian, bytes).zip(number(
            byte.saturating_add(4),
            width,
            big_endian,
            bytes,
        )) else {
            break;
        };
        // The size in bytes of each type that the specification defines.
        let size = match kind {
            3 | 8 => 2,
            4 | 9 | 11 | 13 => 4,
            5 | 10 | 12 | 16..=18 => 8,
            _ => 1,
        };
        if (bytes.len() as u64) < count.saturating_mul(size) {
            bail!("byte {byte}: the entry is longer than the file");
        }
    }
    Ok(())
}

/// Reads a picture from a TIFF file: gray or RGB, with or without alpha, of 8 or 16 bits, or floats in color.
///
/// Returns an error if the bytes are not a TIFF file, the file is damaged, the picture takes too much memory, or its kind is not supported.
pub fn read(bytes: &[u8]) -> Result<Image, Error> {
    decode_picture(bytes)?.into_image()
}

/// Decodes a picture; see [`read`].
pub(super) fn decode_picture(bytes: &[u8]) -> Result<Decoded, Error> {
    check_picture(bytes)?;
    // The TIFF decoder decodes into a buffer of its own, so the picture is in memory twice.
    let file = File { format: "TIFF", bytes, copies: 2 };
    file.decode(|| TiffDecoder::new(Cursor::new(bytes)), |_, _| Ok(()))
}

/// Checks that a file contains a picture of a supported kind, and is long enough for it.
fn check_picture(bytes: &[u8]) -> Result<(), Error> {
    let OpenFile { mut decoder, color, .. } = open_file(bytes)?;
    let compression = decoder.find_tag_unsigned::<u16>(Tag::Compression).map_err(broken_file)?;
    match (color, compression.map(CompressionMethod::from_u16_exhaustive)) {
        (_, Some(CompressionMethod::JPEG | CompressionMethod::ModernJPEG)) => {
            bail!("expected no compression, or LZW, Deflate or PackBits, found JPEG inside of TIFF")
        }
        (ColorType::Gray(1 | 8 | 16) | ColorType::GrayA(8 | 16), _)
        | (ColorType::RGB(8 | 16 | 32) | ColorType::RGBA(8 | 16 | 32), _) => Ok(()),
        _ => bail!(
            "expected a picture of 8 or 16 bits in gray or RGB, or of floats in RGB, found {color:?}"
        ),
    }
}

/// A depth map as stored in a file.
#[derive(Debug, PartialEq)]
pub(super) struct Depths {
    pub(super) width: usize,
    pub(super) height: usize,
    /// The depths, one number per pixel, row by row from the top.
    pub(super) depths: Vec<f64>,
    /// True if the depths are integers, which count steps of some length.
    pub(super) is_integer: bool,
}

/// Reads a depth map from a TIFF file.
///
/// # Errors
/// If the bytes are not a TIFF file, the file is damaged, the depth map takes more than 512 MB, or it has more than one channel.
pub(super) fn read_depth(bytes: &[u8]) -> Result<Depths, Error> {
    let Pixels { width, height, color, samples } = decode(bytes, depth::BYTES_PER_PIXEL)?;
    fn kind_error(color: &ColorType) -> Error {
        Error::new(format!(
            "expected depths in one channel of floats, or of integers of 16 or 32 bits, found {color:?}"
        ))
    }
    let ColorType::Gray(_) = color else { return Err(kind_error(&color)) };
    let is_integer = !matches!(samples, DecodingResult::F32(_) | DecodingResult::F64(_));
    let depths: Vec<f64> = match samples {
        DecodingResult::F32(samples) => samples.into_iter().map(f64::from).collect(),
        DecodingResult::F64(samples) => samples,
        DecodingResult::U16(samples) => samples.into_iter().map(f64::from).collect(),
        DecodingResult::U32(samples) => samples.into_iter().map(f64::from).collect(),
        _ => return Err(kind_error(&color)),
    };
    if depths.len() != width * height {
        return Err(kind_error(&color));
    }
    Ok(Depths { width, height, depths, is_integer })
}

fn wrong_size(width: usize, height: usize) -> Error {
    Error::new(format!("a picture of {width} x {height} pixels cannot be written as TIFF"))
}

fn encode<C: colortype::ColorType>(
    [width, height]: [usize; 2],
    samples: &[C::Inner],
) -> Result<Vec<u8>, Error>
where
    [C::Inner]: ::tiff::encoder::TiffValue,
{
    let (Ok(columns @ 1..), Ok(rows @ 1..)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(wrong_size(width, height));
    };
    let mut bytes = Vec::with_capacity(size_of_val(samples) + 1024);
    let written = TiffEncoder::new(Cursor::new(&mut bytes))
        .and_then(|mut encoder| encoder.write_image::<C>(columns, rows, samples));
    written.map(|()| bytes).map_err(|_| wrong_size(width, height))
}

/// Writes a field as 32-bit floats.
pub(super) struct FieldTiff;

impl FileFormat for FieldTiff {
    type Value = Field;
    const EXTENSION: &'static str = "tiff";

    fn write(field: &Field, name: &str) -> Result<Vec<NewFile>, Error> {
        let size = [field.width(), field.height()];
        Ok(NewFile::single(name, encode::<colortype::Gray32Float>(size, field.pixels())?))
    }
}

/// Writes a picture.
pub(super) struct ImageTiff;

impl FileFormat for ImageTiff {
    type Value = Image;
    const EXTENSION: &'static str = "tiff";

    fn write(image: &Image, name: &str) -> Result<Vec<NewFile>, Error> {
        let size = [image.width(), image.height()];
        let samples = image.pixels().as_flattened();
        Ok(NewFile::single(name, encode::<colortype::RGB8>(size, samples)?))
    }
}

/// Writes a mask as a gray picture: 255 inside, 0 outside.
pub(super) struct MaskTiff;

impl FileFormat for MaskTiff {
    type Value = Mask;
    const EXTENSION: &'static str = "tiff";

    fn write(mask: &Mask, name: &str) -> Result<Vec<NewFile>, Error> {
        let samples: Vec<_> = mask.pixels().iter().map(|inside| inside * 255).collect();
        let size = [mask.width(), mask.height()];
        Ok(NewFile::single(name, encode::<colortype::Gray8>(size, &samples)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hostile;

    const LZW: &[u8] = include_bytes!("../../tests/data/formats/lzw.tiff");
    const RGBA: &[u8] = include_bytes!("../../tests/data/formats/deflate_rgba.tiff");
    const DEPTH: &[u8] = include_bytes!("../../tests/data/formats/depth32f.tiff");

    fn write_bytes<F: FileFormat>(value: &F::Value) -> Vec<u8> {
        F::write(value, "a.tiff").unwrap().remove(0).bytes
    }

    #[test]
    fn pictures_of_other_programs_are_read() {
        let expected: Vec<_> =
            (0..16 * 12).map(|k: usize| [(k % 16 * 16) as u8, (k / 16 * 20) as u8, 128]).collect();
        for file in [LZW, RGBA] {
            let image = read(file).unwrap();
            assert_eq!((image.width(), image.height()), (16, 12));
            assert_eq!(image.pixels(), expected);
        }
    }

    #[test]
    fn written_files_are_read_back() {
        let pixels: Vec<_> =
            (0..300).map(|i: u32| [i as u8, (i * 7) as u8, (i / 3) as u8]).collect();
        let image = Image::new(20, 15, pixels).unwrap();
        assert_eq!(read(&write_bytes::<ImageTiff>(&image)).unwrap(), image);
        let numbers = [0.1f32, -3.5, f32::INFINITY, 1e30, 0.0, 7.0];
        let field = Field::new(3, 2, numbers.to_vec()).unwrap();
        let depths = numbers.map(f64::from).to_vec();
        let expected = Depths { width: 3, height: 2, depths, is_integer: false };
        assert_eq!(read_depth(&write_bytes::<FieldTiff>(&field)).unwrap(), expected);
        let mask = read(&write_bytes::<MaskTiff>(&Mask::from_rows(&["#.", ".#"]))).unwrap();
        assert_eq!(mask.pixels(), [[255; 3], [0; 3], [0; 3], [255; 3]]);
    }

    #[test]
    fn depth_maps_and_pictures_are_distinguished() {
        let text = "expected a picture of 8 or 16 bits in gray or RGB, or of floats in RGB, found Gray(32)";
        assert_eq!(read(DEPTH).unwrap_err().to_string(), text);
        let text = "expected depths in one channel of floats, or of integers of 16 or 32 bits, found RGB(8)";
        assert_eq!(read_depth(LZW).unwrap_err().to_string(), text);
    }

    #[test]
    fn an_entry_that_is_longer_than_the_file_takes_no_memory() {
        // The files have one entry, a text of nearly 256 MiB, in both byte orders and with both sizes of offsets.
        let little = b"II*\0\x08\0\0\0\x01\0\x0e\x01\x02\0\xff\xff\xff\x0f\x08\0\0\0\0\0\0\0";
        let big = b"MM\0*\0\0\0\x08\0\x01\x01\x0e\0\x02\x0f\xff\xff\xff\0\0\0\x08\0\0\0\0";
        let large = b"II+\0\x08\0\0\0\x10\0\0\0\0\0\0\0\x01\0\0\0\0\0\0\0\x0e\x01\x02\0\xff\xff\xff\x0f\0\0\0\0\0\0\0\0\0\0\0\0";
        for (file, byte) in [(&little[..], 10), (big, 10), (large, 24)] {
            let text = format!("byte {byte}: the entry is longer than the file");
            assert_eq!(read(file).unwrap_err().to_string(), text);
        }
    }

    #[test]
    fn a_small_file_of_a_huge_depth_map_is_refused() {
        let mut file = write_bytes::<FieldTiff>(&Field::new(1, 1, vec![1.0]).unwrap());
        for tag in [0, 1] {
            let entry = [tag, 1, 4, 0, 1, 0, 0, 0, 1];
            let at = file.windows(9).position(|window| window == entry).unwrap();
            file[at + 8..at + 12].copy_from_slice(&8192u32.to_le_bytes());
        }
        file.resize(1_000_000, 0);
        let error = read_depth(&file).unwrap_err().to_string();
        assert!(error.starts_with("8192 x 8192 pixels would take more than "), "{error}");
    }

    #[test]
    fn a_picture_without_pixels_cannot_be_written() {
        let empty = Image::new(0, 0, vec![]).unwrap();
        assert!(ImageTiff::write(&empty, "a.tiff").is_err());
    }

    #[test]
    fn hostile_files_give_errors() {
        for file in [LZW, RGBA, DEPTH] {
            hostile::check_no_panic(file, read);
            hostile::check_no_panic(file, |bytes| read_depth(bytes).is_ok());
        }
    }
}
