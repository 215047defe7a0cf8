//! What nodes on a picture refuse: pixels outside of it, and masks of another size.

use maquette_value::{Image, Mask};

/// Why something does not fit a picture.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PictureError {
    /// A pixel that is not in the picture.
    #[error(
        "pixel ({column}, {row}) is outside of the picture, which has {width} x {height} pixels"
    )]
    Outside {
        /// Its column.
        column: u32,
        /// Its row.
        row: u32,
        /// The picture's width.
        width: usize,
        /// The picture's height.
        height: usize,
    },
    /// The mask is for another picture.
    #[error("the mask `within` has {mask:?} pixels, the picture {image:?}")]
    Size {
        /// The mask's size.
        mask: [usize; 2],
        /// The picture's size.
        image: [usize; 2],
    },
}

/// Whether a mask, if there is one, is as large as the picture.
pub(super) fn check_size(image: &Image, within: Option<&Mask>) -> Result<(), PictureError> {
    let image = [image.width(), image.height()];
    match within.map(|mask| [mask.width(), mask.height()]) {
        Some(mask) if mask != image => Err(PictureError::Size { mask, image }),
        _ => Ok(()),
    }
}

/// Whether a pixel (column, row) is in the picture.
pub(super) fn check_inside(image: &Image, (column, row): (u32, u32)) -> Result<(), PictureError> {
    let (width, height) = (image.width(), image.height());
    match (column as usize) < width && (row as usize) < height {
        true => Ok(()),
        false => Err(PictureError::Outside { column, row, width, height }),
    }
}
