//! Takes away cells of a range image.

use maquette_node::{Carry, Context, Error, Fate, FieldError, In, Node};
use maquette_value::{Mask, RangeImage};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::keep_error::KeepError;
use super::scan::Scan;
use super::within::{Within, kept};

/// Keeps the cells of a range image that a mask shows, that lie in a part of space, or both.
///
/// The others have no point any more, as if the sensor had seen nothing there. The grid, its registration and its colors stay.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct KeepCells {
    /// The range image.
    pub range: In<RangeImage>,
    /// The pixels of the picture, or the cells of the grid, that show what stays; the size says which.
    pub mask: Option<In<Mask>>,
    /// Where lies what stays.
    #[serde(default)]
    pub within: Option<Within>,
    /// Keeps what would go, and takes away the rest.
    #[serde(default)]
    pub invert: bool,
}

impl Node for KeepCells {
    type Outputs = (RangeImage,);
    const OUTPUTS: [&'static str; 1] = ["range"];

    const CARRIES: &'static [Carry] = &[Carry::cells("range", "range", Fate::Kept)];

    fn check(&self) -> Result<(), FieldError> {
        match self.within {
            Some(Within::Attribute { .. }) => {
                let message = "cells have no attributes that say where they are";
                let help = "choose another part of space, or link a `mask`";
                Err(FieldError::new("within", message, help))
            }
            _ => Ok(()),
        }
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let range = cx.get(&self.range);
        let mask = self.mask.as_ref().map(|mask| cx.get(mask));
        let kept = keep_cells(range, mask, self.within.as_ref(), self.invert)?;
        if kept.n_valid() == 0 && range.n_valid() > 0 {
            cx.warn(Scan::RangeImage(range.clone()).nothing_left());
        }
        Ok((kept,))
    }
}

/// The cells of `range` whose pixel `mask` shows and that are `within`; with `invert` the others.
///
/// A cell sees the pixel that is nearest to the place where it looks; one that looks past the picture is not shown.
///
/// # Errors
/// The mask has another size, or the part of space is none.
pub fn keep_cells(
    range: &RangeImage,
    mask: Option<&Mask>,
    within: Option<&Within>,
    invert: bool,
) -> Result<RangeImage, KeepError> {
    let scan = Scan::RangeImage(range.clone());
    let shown = mask.map(|mask| shown(range, mask)).transpose()?;
    match kept(&scan, within, shown, invert)? {
        Scan::RangeImage(range) => Ok(range),
        _ => unreachable!("a range image stays one"),
    }
}

/// Whether the mask shows each cell.
fn shown(range: &RangeImage, mask: &Mask) -> Result<Vec<bool>, KeepError> {
    let (width, height) = (range.width(), range.height());
    let (size, map) = ([mask.width(), mask.height()], range.registration());
    if size != map.picture {
        if size == [width, height] {
            return Ok(mask.pixels().iter().map(|&pixel| pixel == 1).collect());
        }
        return Err(KeepError::Size { mask: size, picture: map.picture, grid: [width, height] });
    }
    Ok((0..width * height)
        .map(|cell: usize| {
            let at = map.picture_from_range([(cell % width) as f64, (cell / width) as f64]);
            let pixel = at.map(f64::round);
            let is_inside =
                [0, 1].iter().all(|&axis| 0.0 <= pixel[axis] && pixel[axis] < size[axis] as f64);
            is_inside && mask.contains(pixel.map(|x| x as usize))
        })
        .collect())
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn a_depth_whose_ends_are_exchanged_is_an_error() {
        let range = RangeImage::new(1, 1, vec![Point3::new(0.0, 0.0, 650.0)]).unwrap();
        fn between(from: f64, to: f64, range: &RangeImage) -> Result<usize, KeepError> {
            let depth = Within::Depth { from: Some(from), to: Some(to) };
            keep_cells(range, None, Some(&depth), false).map(|kept| kept.n_valid())
        }
        assert_eq!(between(600.0, 700.0, &range), Ok(1));
        let text = "the depth goes from 700 to 600: `from` must not be above `to`";
        assert_eq!(between(700.0, 600.0, &range).unwrap_err().to_string(), text);
    }
}
