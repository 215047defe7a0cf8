//! Marks the pixels of a picture by their color.

use maquette_node::Error;
use maquette_value::memory::huge_vec;
use maquette_value::parallel::*;
use maquette_value::{Image, Mask};

use super::select::{Select, measure};
use crate::checks::check_size;

/// Returns a mask of the pixels of `image` that `select` accepts, or of all others if `invert` is true. With `within`, the result contains
/// only pixels inside this mask.
///
/// Returns an error if the pixel of `Select::Sample` is outside the picture, or if `within` does not have the size of the picture.
pub fn threshold(
    image: &Image,
    within: Option<&Mask>,
    select: &Select,
    invert: bool,
) -> Result<Mask, Error> {
    check_size([image.width(), image.height()], within)?;
    let (measure, limit) = measure(image, within, select)?;
    let mut marks = huge_vec(image.pixels().len());
    let chunks = marks.par_chunks_mut(CHUNK).zip(image.pixels().par_chunks(CHUNK));
    chunks.enumerate().for_each(|(chunk, (marks, pixels))| {
        measure.mark(pixels, limit, invert, marks);
        if let Some(within) = within {
            let within = &within.pixels()[chunk * CHUNK..][..marks.len()];
            marks.iter_mut().zip(within).for_each(|(mark, within)| *mark &= *within == 1);
        }
    });
    Ok(Mask::from_bools(image.width(), image.height(), marks).expect("one mark per pixel"))
}

/// The number of pixels that one task processes: about 0.1 ms of work, and few enough for the cache.
const CHUNK: usize = 16 * 1024;
