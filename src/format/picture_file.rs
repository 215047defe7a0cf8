//! Pictures, whatever file they are in: PNG, JPEG, TIFF, WebP, BMP, OpenEXR, Radiance HDR. The content says which, not the
//! file's name.

use std::io::Cursor;

use ::image::codecs::bmp::BmpDecoder;
use ::image::codecs::hdr::HdrDecoder;
use ::image::codecs::openexr::OpenExrDecoder;
use ::image::codecs::webp::WebPDecoder;
use maquette_node::reading::{FileReader, Reading};
use maquette_value::{Image, Mask, Mesh, Rgb};
use thiserror::Error;

use super::decoder::{DecodeError, File};
pub use super::picture_kind::Kind;
use super::{camera, excerpt, exif, jpeg, png, tiff};

/// Why bytes are not a picture.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum PictureError {
    /// A damaged PNG file.
    #[error(transparent)]
    Png(#[from] png::PngError),
    /// A damaged JPEG file.
    #[error(transparent)]
    Jpeg(#[from] jpeg::JpegError),
    /// A damaged TIFF file, or a kind of it that is not read.
    #[error(transparent)]
    Tiff(#[from] tiff::TiffError),
    /// A damaged file of another format, or a picture that is too large.
    #[error(transparent)]
    Other(#[from] DecodeError),
    /// Something else.
    #[error(
        "byte 0: the file begins with `{text}`: this is no PNG, JPEG, TIFF, WebP, BMP, EXR or HDR picture"
    )]
    Unknown {
        /// How it begins.
        text: String,
    },
}

/// The mesh with the picture that its file names, if the picture is there and the mesh has texture coordinates; else the user is told.
pub(super) fn on_mesh(mesh: Mesh, name: &str, file: &Reading<'_>) -> Mesh {
    if mesh.vertex().pairs("uv").is_none() && mesh.corner().pairs("uv").is_none() {
        file.doubt(format!(
            "the picture `{name}` is left out: the mesh has no texture coordinates"
        ));
        return mesh;
    }
    let image = file
        .companion(name)
        .and_then(|bytes| read(&bytes).map_err(|error| format!("{name}: {error}")));
    match image {
        Ok(image) => mesh.with_texture(Some(image)),
        Err(why) => {
            file.doubt(format!("{why}: the mesh comes without its picture"));
            mesh
        }
    }
}

/// The picture in a file of any of these formats, as 8-bit sRGB. Of a film in WebP, the first picture.
///
/// # Errors
/// If the bytes are no such file, it is damaged, or the picture is too large.
pub fn read(bytes: &[u8]) -> Result<Image, PictureError> {
    let other = |format, copies| File { format, bytes, copies };
    let cursor = || Cursor::new(bytes);
    let any = |_, _| Ok(());
    match Kind::of(bytes) {
        Some(Kind::Png) => Ok(png::read(bytes)?),
        Some(Kind::Jpeg) => Ok(jpeg::read(bytes)?),
        Some(Kind::Tiff) => Ok(tiff::read(bytes)?),
        // The decoder unpacks into a list with alpha.
        Some(Kind::WebP) => other("WebP", 3).picture(|| WebPDecoder::new(cursor()), any),
        Some(Kind::Bmp) => other("BMP", 1).picture(|| BmpDecoder::new(cursor()), any),
        // The decoder makes a list of its own and a copy of it.
        Some(Kind::Exr) => other("EXR", 2).picture(|| OpenExrDecoder::new(cursor()), any),
        Some(Kind::Hdr) => other("HDR", 1).picture(|| HdrDecoder::new(cursor()), any),
        None => Err(PictureError::Unknown { text: excerpt(&bytes[..bytes.len().min(8)]) }),
    }
}

/// The picture in a file of any of these formats as [`read`] gives it, turned upright if the file says that it is turned.
///
/// # Errors
/// Those of [`read`].
pub fn read_upright(bytes: &[u8]) -> Result<Image, PictureError> {
    Ok(exif::upright(read(bytes)?, exif::orientation(bytes)))
}

/// Reads a picture, whatever its extension says; `camera.json` beside it says which camera took it. Without a camera the picture is turned upright.
pub(crate) struct ImageFiles;

impl FileReader for ImageFiles {
    type Value = Image;
    const ENDINGS: &'static [&'static str] =
        &["png", "jpg", "jpeg", "tif", "tiff", "webp", "bmp", "exr", "hdr"];

    fn read(file: &Reading<'_>) -> Result<Image, maquette_syntax::error::Error> {
        let image = read(file.bytes())?;
        let camera = file.companion(camera::NAME).ok();
        let camera = camera.map(|bytes| camera::read(&bytes)).transpose()?;
        let size = Some([image.width(), image.height()]);
        let camera = camera.and_then(|camera| camera.color).filter(|camera| camera.size == size);
        let Some(camera) = camera else {
            return Ok(exif::upright(image, exif::orientation(file.bytes())));
        };
        exif::stored_note(file.bytes()).into_iter().for_each(|note| file.doubt(note));
        Ok(image.with_camera(Some(camera.pinhole)))
    }
}

/// Reads a picture as a mask: what is nearer to white than to black is inside.
pub(crate) struct MaskFiles;

impl FileReader for MaskFiles {
    type Value = Mask;
    const ENDINGS: &'static [&'static str] =
        &["png", "jpg", "jpeg", "tif", "tiff", "webp", "bmp", "exr", "hdr"];

    fn read(file: &Reading<'_>) -> Result<Mask, maquette_syntax::error::Error> {
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
    fn the_content_says_what_is_read() {
        let png = include_bytes!("../../tests/data/formats/colour_2x.png");
        assert_eq!(read(png).unwrap().width(), 16);
        assert!(matches!(read(b"\xff\xd8\xff"), Err(PictureError::Jpeg(_))));
        assert!(matches!(read(b"MM\0*"), Err(PictureError::Tiff(_))));
    }

    #[test]
    fn what_is_no_picture_is_shown_by_its_start() {
        let text = "byte 0: the file begins with `GIF89a`: this is no PNG, JPEG, TIFF, WebP, BMP, EXR or HDR picture";
        assert_eq!(read(b"GIF89a").unwrap_err().to_string(), text);
        assert!(read(b"").is_err());
    }
}
