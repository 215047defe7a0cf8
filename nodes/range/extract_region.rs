//! Extracts a labelled part of a picture as a region of the range grid.

use maquette_image::{Connectivity, close, label};
use maquette_node::{Context, Error, In, Node, Progress, Want, bail};
use maquette_value::{Labels, RangeImage, Region};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::grid::contour::contours;
use super::grid::depth_steps::{DepthSteps, without_steps};
use super::grid::footprint::{covered_cells, covered_fractions};
use super::grid::rim::rims;
use super::holes::range_holes::{fill_points, usable_cells, with_enclosed};

/// Extracts a labelled part of a picture as a region of the range grid, ready to be redesigned.
///
/// A range cell belongs to the region if at least half of its footprint in the picture belongs to the part, or if the part surrounds the
/// cell. Cells inside without a measured point are filled smoothly from those around them; cells without a point that are connected with
/// the border of the grid are left out instead. If the region is not connected, its largest piece is taken.
///
/// The region also has a rim, a smooth outline between the cells: it follows the outline of the part, without the steps of cells and
/// pixels, within half a cell. Corners stay.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ExtractRegion {
    /// Labelled picture.
    pub labels: In<Labels>,
    /// Range image taken with the picture.
    pub range: In<RangeImage>,
    /// Part to extract.
    #[serde(default)]
    pub pick: Pick,
    /// Fills cells without a point, unless they belong to the background. If false, they are holes of the region.
    #[serde(default = "default_true")]
    pub fill_holes: bool,
    /// Includes areas that the part surrounds, such as the pupil of an eye, if they are on the same surface; the gap of a handle is not. If
    /// false, they are holes of the region.
    #[serde(default = "default_true")]
    pub enclosed: bool,
    /// Radius of the square that closes gaps of the region, in range cells; 0 disables it.
    #[schemars(range(max = 50), extend("unit" = "cells"))]
    #[serde(default = "default_close")]
    pub close: u32,
}

fn default_true() -> bool {
    true
}

fn default_close() -> u32 {
    1
}

/// Choice of a labelled part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Pick {
    /// Part with the most pixels; if several are equally large, the first of them, row by row from the top.
    #[default]
    Largest,
    /// Part with the fewest pixels; if several are equally small, the first of them.
    Smallest,
    /// Part of this rank by size: 1 is the largest; equal ones are ordered by their first pixel.
    Rank(#[schemars(range(min = 1))] u32),
    /// Part with this label.
    Label(#[schemars(range(min = 1))] u32),
    /// Part at this pixel of the picture: column, row.
    At(u32, u32),
}

impl Node for ExtractRegion {
    type Outputs = (Region,);
    const OUTPUTS: [&'static str; 1] = ["region"];

    const WANTS: &'static [Want<Self>] = &[Want::new("labels", "NonEmpty")];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (labels, range) = (cx.get(&self.labels), cx.get(&self.range));
        let options = RegionOptions {
            fill: self.fill_holes,
            enclosed: self.enclosed,
            close_radius: self.close as usize,
        };
        let (region, steps) = extract(labels, range, self.pick, options, cx.progress())?;
        if let Some(warning) = steps.warning() {
            cx.warn(warning);
        }
        let (low, high) = region.bounds();
        let [columns, rows] = [0, 1].map(|axis| high[axis] + 1 - low[axis]);
        if columns < 3 || rows < 3 {
            cx.warn(format!(
                "the region is only {columns} x {rows} cells, so it has no interior cells; label a larger area"
            ));
        }
        if is_everything(&region) {
            cx.warn("the region is the whole range image: check the labels");
        }
        Ok((region,))
    }
}

/// Returns true if the region contains all cells. A region that only reaches the border of the grid is no cause for a warning, since scans
/// are cropped.
fn is_everything(region: &Region) -> bool {
    region.cells().len() == region.width() * region.height()
}

/// Options that add cells near a labelled part to the region.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegionOptions {
    /// If true, cells without a point are filled.
    pub fill: bool,
    /// If true, areas that the labelled part surrounds are included.
    pub enclosed: bool,
    /// Half of the maximum width of gaps that are closed, in cells.
    pub close_radius: usize,
}

/// Extracts the part of `labels` chosen by `pick` as a region of the range grid, with its points and contours.
///
/// A cell is inside if at least half of its footprint in the picture belongs to the part. Cells beyond the picture or the grid are outside.
/// Then these steps follow:
/// - Gaps are closed with a square of radius `close_radius` in cells.
/// - With `enclosed`, areas that the part surrounds are added if they continue its surface. The part surrounds an area if no path along
///   sides of cells leads outside. The area continues the surface if it has no points, or if most pairs of adjacent cells, one in the area
///   and one in the part, have points at most six times the grid's median spacing apart.
/// - With `fill`, groups of invalid cells connected by sides get points. A group qualifies if it touches no cell outside the region, or if
///   it neither touches the border of the grid nor has more than a thousand cells. The points solve Laplace's equation, coordinate by
///   coordinate, from the cells of the region around them. They are flagged as filled, as are cells already filled in `range`.
/// - All other invalid cells leave the region. Of the remaining cells, the largest component connected by sides is taken; of several
///   equally large components, the first. Cells whose points are more than six times the grid's median spacing apart, across a depth step,
///   are not connected.
///
/// Returns an error if the labels do not have the size of the range image's picture, if the part does not exist, or if no cell with a point
/// remains.
pub fn extract_region(
    labels: &Labels,
    range: &RangeImage,
    pick: Pick,
    options: RegionOptions,
    progress: &Progress<'_>,
) -> Result<Region, Error> {
    Ok(extract(labels, range, pick, options, progress)?.0)
}

/// Extracts a region as [`extract_region`] does, and finds the depth steps that it crosses.
fn extract(
    labels: &Labels,
    range: &RangeImage,
    pick: Pick,
    options: RegionOptions,
    progress: &Progress<'_>,
) -> Result<(Region, DepthSteps), Error> {
    let size = [labels.width(), labels.height()];
    let picture = range.registration().picture;
    if size != picture {
        bail!(
            "the labels have {size:?} pixels, but the range image is registered to a picture of {picture:?}"
        );
    }
    let number = choose(labels, pick)?;
    let fractions = covered_fractions(labels, number, range);
    let covered = covered_cells(range.width(), range.height(), &fractions);
    let cells = covered.count();
    if cells == 0 {
        let area = labels.statistics()[number as usize - 1].area;
        bail!(
            "label {number} has {area} pixels, but they do not cover half of any cell of the range grid; label a larger area"
        );
    }
    let closed = close(&covered, options.close_radius);
    let filled_region = if options.enclosed { with_enclosed(&closed, range) } else { closed };
    let usable = usable_cells(&filled_region, range, options.fill);
    let (usable, steps) = without_steps(usable, range);
    let pieces = label(&usable, Connectivity::Four);
    let no_point = Error::new(format!(
        "label {number} covers {cells} cells of the range grid, but no usable one has a point"
    ));
    let &largest = pieces.by_area().first().ok_or(no_point.clone())?;
    if !pieces
        .pixels()
        .iter()
        .enumerate()
        .any(|(cell, &piece)| piece == largest && range.point(cell).is_some())
    {
        return Err(no_point);
    }
    Ok((finish(&pieces, largest, range, &fractions, progress)?, steps))
}

/// Returns the label of the part of the picture that `pick` chooses.
fn choose(labels: &Labels, pick: Pick) -> Result<u32, Error> {
    let count = labels.statistics().len();
    if count == 0 {
        return Err(no_labels());
    }
    fn missing(what: &'static str, number: u32, count: usize) -> Error {
        Error::new(format!(
            "there is no {what} {number}: the labels have {count} parts, numbered from 1"
        ))
    }
    fn rank(rank: u32, labels: &Labels) -> Option<u32> {
        let index = (rank as usize).checked_sub(1);
        index.and_then(|index| labels.by_area().get(index).copied())
    }
    match pick {
        Pick::Largest => rank(1, labels).ok_or(missing("rank", 1, count)),
        Pick::Smallest => (1..=count as u32)
            .min_by_key(|label| labels.statistics()[*label as usize - 1].area)
            .ok_or_else(no_labels),
        Pick::Rank(number) => rank(number, labels).ok_or(missing("rank", number, count)),
        Pick::Label(label) if (1..=count).contains(&(label as usize)) => Ok(label),
        Pick::Label(label) => Err(missing("label", label, count)),
        Pick::At(column, row) => label_at(labels, column, row),
    }
}

fn no_labels() -> Error {
    Error::new("the labels are empty: check the threshold or the mask from which they were made")
}

fn label_at(labels: &Labels, column: u32, row: u32) -> Result<u32, Error> {
    let at = [column as usize, row as usize];
    let size = [labels.width(), labels.height()];
    if size[0] <= at[0] || size[1] <= at[1] {
        bail!("pixel ({column}, {row}) is outside the picture, which has {size:?} pixels");
    }
    let label = labels.label(at);
    if label != 0 {
        return Ok(label);
    }
    fn position(index: usize, size: [usize; 2]) -> [usize; 2] {
        [index % size[0], index / size[0]]
    }
    let labelled = (0..labels.pixels().len()).filter(|&index| labels.pixels()[index] != 0);
    let index = labelled
        .min_by_key(|index| {
            let [x, y] = [0, 1].map(|axis| position(*index, size)[axis].abs_diff(at[axis]) as u64);
            x * x + y * y
        })
        .ok_or_else(no_labels)?;
    let (nearest, label) = (position(index, size), labels.pixels()[index]);
    bail!("pixel ({column}, {row}) is background: the closest part is label {label} at {nearest:?}")
}

/// Creates a region from the cells labelled `number` in `pieces`, and computes points for its cells without one. `fractions` is the covered
/// fraction of each cell, from which the rims follow.
fn finish(
    pieces: &Labels,
    number: u32,
    range: &RangeImage,
    fractions: &[f64],
    progress: &Progress<'_>,
) -> Result<Region, Error> {
    let (width, height) = (pieces.width(), pieces.height());
    let grid: Vec<u8> = pieces.pixels().iter().map(|&piece| u8::from(piece == number)).collect();
    let cells: Vec<u32> =
        (0..).zip(&grid).filter(|(_, inside)| **inside == 1).map(|(cell, _)| cell).collect();
    let mut points: Vec<Point3<f64>> =
        cells.iter().map(|&cell| range.points()[cell as usize]).collect();
    let filled = cells
        .iter()
        .zip(&points)
        .map(|(&cell, point): (&u32, &Point3<f64>)| {
            u8::from(point.x.is_nan() || range.is_filled(cell as usize))
        })
        .collect();
    if points.iter().any(|point| point.x.is_nan()) {
        let component = &pieces.statistics()[number as usize - 1];
        fill_points([component.low, component.high], width, &cells, &mut points, progress)?;
    }
    let mut contours = contours(width, height, &grid);
    let rims = rims(width, height, &grid, fractions, pixel_width(range));
    contours.iter_mut().zip(rims).for_each(|(contour, rim)| contour.rim = rim);
    Ok(Region::new(width, height, cells, points, filled, contours)?)
}

/// Returns the larger side of a pixel of the picture, in cells.
fn pixel_width(range: &RangeImage) -> f64 {
    range.registration().scale.iter().fold(0.0, |widest, scale| f64::max(widest, 1.0 / scale.abs()))
}

#[cfg(test)]
mod tests;
