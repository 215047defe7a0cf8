//! Errors of nodes that take a picture: pixels outside the picture, and masks of another size.

use maquette_value::{Image, Mask};

/// Error of an input that does not match a picture.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PictureError {
    /// A pixel is outside the picture.
    #[error("pixel ({column}, {row}) is outside the picture, which has {width} x {height} pixels")]
    Outside {
        /// The column of the pixel.
        column: u32,
        /// The row of the pixel.
        row: u32,
        /// The width of the picture, in pixels.
        width: usize,
        /// The height of the picture, in pixels.
        height: usize,
    },
    /// The mask has another size than the picture.
    #[error("the mask `within` has {mask:?} pixels, but the picture has {image:?}")]
    Size {
        /// Width and height of the mask, in pixels.
        mask: [usize; 2],
        /// Width and height of the picture, in pixels.
        image: [usize; 2],
    },
}

/// Checks that a mask, if given, has the size of the picture.
pub(super) fn check_size(image: &Image, within: Option<&Mask>) -> Result<(), PictureError> {
    let image = [image.width(), image.height()];
    match within.map(|mask| [mask.width(), mask.height()]) {
        Some(mask) if mask != image => Err(PictureError::Size { mask, image }),
        _ => Ok(()),
    }
}

/// Checks that a pixel (column, row) is in the picture.
pub(super) fn check_inside(image: &Image, (column, row): (u32, u32)) -> Result<(), PictureError> {
    let (width, height) = (image.width(), image.height());
    match (column as usize) < width && (row as usize) < height {
        true => Ok(()),
        false => Err(PictureError::Outside { column, row, width, height }),
    }
}
