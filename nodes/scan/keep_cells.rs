//! Removes cells of a range image.

use maquette_node::{Carry, Context, Error, FieldError, Forecast, In, Node, Sizes, Transfer, bail};
use maquette_value::{Mask, RangeImage};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::scan::Scan;
use super::within::{Region, select_parts};

/// Keeps the cells of a range image that are selected by a mask, a region of space, or both.
///
/// The other cells lose their points, as if the sensor had measured nothing there. The grid, its registration and its colors do not change.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct KeepCells {
    /// Range image.
    pub range: In<RangeImage>,
    /// Mask of the cells to keep. It has the size of the picture or of the grid.
    pub mask: Option<In<Mask>>,
    /// Region whose cells are kept.
    #[serde(default)]
    pub within: Option<Region>,
    /// Removes what would be kept, and keeps the rest.
    #[serde(default)]
    pub invert: bool,
}

impl Node for KeepCells {
    type Outputs = (RangeImage,);
    const OUTPUTS: [&'static str; 1] = ["range"];

    const CARRIES: &'static [Carry] = &[Carry::cells("range", "range", Transfer::Kept)];

    fn check(&self) -> Result<(), FieldError> {
        match self.within {
            Some(Region::Attribute { .. }) => {
                let message = "the cells of a range image have no attributes";
                let help = "use another region, or connect `mask`";
                Err(FieldError::new("within", message, help))
            }
            _ => Ok(()),
        }
    }

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        Some(Forecast::by_law(sizes.get(&self.range)?))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let range = cx.get(&self.range);
        let mask = self.mask.as_ref().map(|mask| cx.get(mask));
        let kept = keep_cells(range, mask, self.within.as_ref(), self.invert)?;
        if kept.n_valid() == 0 && range.n_valid() > 0 {
            cx.warn(Scan::RangeImage(range.clone()).empty_result_warning());
        }
        Ok((kept,))
    }
}

/// Keeps the cells of `range` that are set in `mask` and inside `within`; with `invert` keeps all other cells.
///
/// A cell belongs to the pixel that is nearest to its position in the picture. Cells outside of the picture are not selected.
///
/// # Errors
/// If the mask has neither the size of the picture nor that of the grid, or the region is invalid.
pub fn keep_cells(
    range: &RangeImage,
    mask: Option<&Mask>,
    within: Option<&Region>,
    invert: bool,
) -> Result<RangeImage, Error> {
    let scan = Scan::RangeImage(range.clone());
    let selected = mask.map(|mask| cells_in_mask(range, mask)).transpose()?;
    match select_parts(&scan, within, selected, invert)? {
        Scan::RangeImage(range) => Ok(range),
        _ => unreachable!("a range image stays one"),
    }
}

/// Returns for each cell true if `mask`, which has the size of the picture or of the grid, selects the cell.
fn cells_in_mask(range: &RangeImage, mask: &Mask) -> Result<Vec<bool>, Error> {
    let (width, height) = (range.width(), range.height());
    let (size, map) = ([mask.width(), mask.height()], range.registration());
    if size != map.picture {
        if size == [width, height] {
            return Ok(mask.pixels().iter().map(|&pixel| pixel == 1).collect());
        }
        let grid = [width, height];
        bail!(
            "`mask` has {size:?} pixels, but `range` is registered to a picture of {:?} and has {grid:?} cells",
            map.picture
        );
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
    fn a_depth_with_exchanged_bounds_is_an_error() {
        let range = RangeImage::new(1, 1, vec![Point3::new(0.0, 0.0, 650.0)]).unwrap();
        fn count_between(from: f64, to: f64, range: &RangeImage) -> Result<usize, Error> {
            let depth = Region::Depth { from: Some(from), to: Some(to) };
            keep_cells(range, None, Some(&depth), false).map(|kept| kept.n_valid())
        }
        assert_eq!(count_between(600.0, 700.0, &range).unwrap(), 1);
        let text = "the depth goes from 700 to 600: `from` must not be above `to`";
        assert_eq!(count_between(700.0, 600.0, &range).unwrap_err().to_string(), text);
    }
}
