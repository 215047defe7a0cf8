//! Checks that masks and pixel positions given to a node match its picture.

use maquette_node::{Error, bail};
use maquette_value::{Image, Mask};

/// Checks that the mask `within`, if given, has the size of the picture.
pub(super) fn check_size(picture: [usize; 2], within: Option<&Mask>) -> Result<(), Error> {
    match within.map(|mask| [mask.width(), mask.height()]) {
        Some(mask) if mask != picture => {
            bail!("the mask `within` has {mask:?} pixels, but the picture has {picture:?}")
        }
        _ => Ok(()),
    }
}

/// Checks that a pixel (column, row) is in the picture.
pub(super) fn check_inside(image: &Image, (column, row): (u32, u32)) -> Result<(), Error> {
    let (width, height) = (image.width(), image.height());
    if (column as usize) < width && (row as usize) < height {
        return Ok(());
    }
    bail!("pixel ({column}, {row}) is outside the picture, which has {width} x {height} pixels")
}
