//! Reads pictures in any supported format: PNG, JPEG, TIFF, WebP, BMP, OpenEXR, Radiance HDR. The format is detected from the content, not
//! from the file name.

use std::io::Cursor;

use ::image::codecs::bmp::BmpDecoder;
use ::image::codecs::hdr::HdrDecoder;
use ::image::codecs::openexr::OpenExrDecoder;
use ::image::codecs::webp::WebPDecoder;
use maquette_node::importers::{FileReader, InputFile};
use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::{Image, Mask, Mesh, Rgb};

use super::decoder::{Decoded, File};
pub use super::picture_kind::Kind;
use super::{camera, excerpt, exif, exr, jpeg, png, tiff};

/// Adds the picture `name` to a mesh. If the picture cannot be loaded, or the mesh has no texture coordinates, adds a warning instead.
pub(super) fn on_mesh(mesh: Mesh, name: &str, file: &InputFile<'_>) -> Mesh {
    if mesh.vertex().pairs("uv").is_none() && mesh.corner().pairs("uv").is_none() {
        file.warn(format!("the picture `{name}` is left out: the mesh has no texture coordinates"));
        return mesh;
    }
    let image = file
        .companion(name)
        .and_then(|bytes| read(&bytes).map_err(|error| format!("{name}: {error}")));
    match image {
        Ok(image) => mesh.with_texture(Some(image)),
        Err(why) => {
            file.warn(format!("{why}: the mesh comes without its picture"));
            mesh
        }
    }
}

/// Reads a picture in any supported format as 8-bit sRGB. From an animated WebP file the first frame is read.
///
/// Returns an error if the format is unknown, the file is damaged, or the picture is too large.
pub fn read(bytes: &[u8]) -> Result<Image, Error> {
    decode(bytes)?.into_image()
}

/// Reads a picture like [`read`]. Also returns the mask of the opaque pixels, whose alpha is at least one half. It is `None` if the picture
/// has no alpha channel.
///
/// # Errors
/// The errors of [`read`].
pub fn read_with_opacity(bytes: &[u8]) -> Result<(Image, Option<Mask>), Error> {
    let decoded = decode(bytes)?;
    let opaque = decoded.opaque_pixels();
    let image = decoded.into_image()?;
    let opaque = opaque.map(|pixels| Mask::from_bools(image.width(), image.height(), pixels));
    let opaque = opaque.transpose()?;
    Ok((image, opaque))
}

fn decode(bytes: &[u8]) -> Result<Decoded, Error> {
    fn accept_any_size(_: u32, _: u32) -> Result<(), Error> {
        Ok(())
    }
    fn file<'b>(format: &'static str, bytes: &'b [u8], copies: u64) -> File<'b> {
        File { format, bytes, copies }
    }
    let cursor = Cursor::new(bytes);
    match Kind::detect(bytes) {
        Some(Kind::Png) => png::decode_picture(bytes),
        Some(Kind::Jpeg) => jpeg::decode_picture(bytes),
        Some(Kind::Tiff) => tiff::decode_picture(bytes),
        // The WebP decoder decodes into its own RGBA buffer.
        Some(Kind::WebP) => {
            file("WebP", bytes, 3).decode(|| WebPDecoder::new(cursor), accept_any_size)
        }
        Some(Kind::Bmp) => {
            file("BMP", bytes, 1).decode(|| BmpDecoder::new(cursor), accept_any_size)
        }
        // The OpenEXR decoder allocates its own buffer and a copy of it. Its size is that of the display window, but layers may be larger.
        Some(Kind::Exr) => {
            exr::check_size(bytes, 0)?;
            file("EXR", bytes, 2).decode(|| OpenExrDecoder::new(cursor), accept_any_size)
        }
        Some(Kind::Hdr) => {
            file("HDR", bytes, 1).decode(|| HdrDecoder::new(cursor), accept_any_size)
        }
        None => bail!(
            "byte 0: expected a PNG, JPEG, TIFF, WebP, BMP, EXR or HDR picture, found `{}`",
            excerpt(&bytes[..bytes.len().min(8)])
        ),
    }
}

/// Reads a picture like [`read`], and rotates it upright according to its orientation tag.
///
/// # Errors
/// The errors of [`read`].
pub fn read_upright(bytes: &[u8]) -> Result<Image, Error> {
    Ok(exif::upright(read(bytes)?, exif::orientation(bytes)))
}

/// Reads a picture in any supported format; the file extension is ignored. If there is a file `camera.json` beside the picture, it
/// describes the picture's camera; otherwise the picture is rotated upright.
pub(crate) struct ImageFiles;

impl FileReader for ImageFiles {
    type Value = Image;
    const EXTENSIONS: &'static [&'static str] =
        &["png", "jpg", "jpeg", "tif", "tiff", "webp", "bmp", "exr", "hdr"];
    const SIZE: crate::SizeReader = Some(crate::size::picture);

    fn read(file: &InputFile<'_>) -> Result<Image, Error> {
        let image = read(file.bytes())?;
        let camera = file.companion(camera::NAME).ok();
        let camera = camera.map(|bytes| camera::read(&bytes)).transpose()?;
        let size = Some([image.width(), image.height()]);
        let camera = camera.and_then(|camera| camera.color).filter(|camera| camera.size == size);
        let Some(camera) = camera else {
            return Ok(exif::upright(image, exif::orientation(file.bytes())));
        };
        exif::stored_note(file.bytes()).into_iter().for_each(|note| file.warn(note));
        Ok(image.with_camera(Some(camera.pinhole)))
    }
}

/// Reads a picture as a mask: pixels closer to white than to black are inside.
pub(crate) struct MaskFiles;

impl FileReader for MaskFiles {
    type Value = Mask;
    const EXTENSIONS: &'static [&'static str] =
        &["png", "jpg", "jpeg", "tif", "tiff", "webp", "bmp", "exr", "hdr"];
    const SIZE: crate::SizeReader = Some(crate::size::mask);

    fn read(file: &InputFile<'_>) -> Result<Mask, Error> {
        let image = read_upright(file.bytes())?;
        fn is_light([r, g, b]: &Rgb) -> bool {
            u16::from(*r) + u16::from(*g) + u16::from(*b) >= 3 * 128
        }
        let inside = image.pixels().iter().map(|pixel| u8::from(is_light(pixel)));
        Ok(Mask::new(image.width(), image.height(), inside.collect())?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_format_is_detected_from_the_content() {
        let png = include_bytes!("../../tests/data/formats/colour_2x.png");
        assert_eq!(read(png).unwrap().width(), 16);
        for (file, error) in [
            (&b"\xff\xd8\xff"[..], "this is not a readable JPEG file: "),
            (b"MM\0*", "this is not a readable TIFF file: "),
        ] {
            assert!(read(file).unwrap_err().to_string().starts_with(error));
        }
    }

    #[test]
    fn an_unknown_format_is_named_by_its_first_bytes() {
        let text =
            "byte 0: expected a PNG, JPEG, TIFF, WebP, BMP, EXR or HDR picture, found `GIF89a`";
        assert_eq!(read(b"GIF89a").unwrap_err().to_string(), text);
        assert!(read(b"").is_err());
    }
}
