//! Takes one labelled part of a picture as a region of the range grid.

use maquette_base::linear::laplace::Unsolved;
use maquette_image::{Connectivity, close, label};
use maquette_node::{Context, Error, In, Node, Progress, Want};
use maquette_value::{Labels, RangeImage, Region, RegionError};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::grid::contour::contours;
use super::grid::footprint::covered_cells;
use super::holes::range_holes::{fill_points, usable_cells, with_enclosed};

/// Takes one labelled part of a picture as a region of the range grid, ready to be redesigned.
///
/// A range cell belongs to the region if at least half of what it sees of the picture does, or if the part surrounds it. Cells inside for
/// which the scanner has no point are filled smoothly from those around them; where it saw nothing up to the border of the grid, they are
/// left out instead. If the region falls apart, its largest piece is taken.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ExtractRegion {
    /// The labelled picture.
    pub labels: In<Labels>,
    /// The range image taken with the picture.
    pub range: In<RangeImage>,
    /// Which part is taken.
    #[serde(default)]
    pub pick: Pick,
    /// Fills cells without a point, unless they belong to the background. Without it they are holes of the region.
    #[serde(default = "yes")]
    pub fill_holes: bool,
    /// Takes in what the part surrounds, such as the pupil of an eye, if it lies on the same surface: not what is seen through a handle.
    /// Without it that is a hole of the region.
    #[serde(default = "yes")]
    pub enclosed: bool,
    /// Radius of a square that closes gaps of the region, in range cells; 0 closes none.
    #[schemars(range(max = 50), extend("unit" = "cells"))]
    #[serde(default = "one")]
    pub close: u32,
}

fn yes() -> bool {
    true
}

fn one() -> u32 {
    1
}

/// Which labelled part is taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Pick {
    /// The one with the most pixels; of several, the one met first, row by row from the top.
    #[default]
    Largest,
    /// The one with the fewest pixels; of several, the one met first.
    Smallest,
    /// The one in this place by size: 1 is the largest; of equal ones, the one met first comes first.
    Rank(#[schemars(range(min = 1))] u32),
    /// The one with this number.
    Label(#[schemars(range(min = 1))] u32),
    /// The one at this pixel of the picture: column, row.
    At(u32, u32),
}

/// Why there is no region.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ExtractRegionError {
    /// The labels are for another picture.
    #[error(
        "the labels have {labels:?} pixels, but the range image is registered to a picture of {picture:?}"
    )]
    Size {
        /// The labels' size.
        labels: [usize; 2],
        /// The size that the range image's registration has.
        picture: [usize; 2],
    },
    /// There is nothing to choose from.
    #[error("the labels are empty: look at the threshold or the mask that they were made of")]
    NoLabels,
    /// There are not so many parts.
    #[error("there is no {what} {number}: the labels have {count} parts, numbered from 1")]
    NoSuchPart {
        /// `rank` or `label`.
        what: &'static str,
        /// What was asked for.
        number: u32,
        /// How many parts there are.
        count: usize,
    },
    /// The pixel is not in the picture.
    #[error("pixel ({column}, {row}) is outside of the picture, which has {size:?} pixels")]
    Outside {
        /// Its column.
        column: u32,
        /// Its row.
        row: u32,
        /// The picture's width and height.
        size: [usize; 2],
    },
    /// The pixel has no label.
    #[error(
        "pixel ({column}, {row}) is background; the nearest part is label {label} at {nearest:?}"
    )]
    Background {
        /// Its column.
        column: u32,
        /// Its row.
        row: u32,
        /// The nearest pixel that has a label: column, row.
        nearest: [usize; 2],
        /// That pixel's label.
        label: u32,
    },
    /// The part is too small for the range grid, or beside it.
    #[error("label {label} has {area} pixels, but they cover no cell of the range grid by half")]
    NoCell {
        /// The label.
        label: u32,
        /// Its pixels.
        area: usize,
    },
    /// The scanner saw nothing of the part.
    #[error(
        "label {label} covers {cells} cells of the range grid, but none that can be used has a point"
    )]
    NoPoint {
        /// The label.
        label: u32,
        /// The cells.
        cells: usize,
    },
    /// Points of holes could not be computed.
    #[error(transparent)]
    Fill(#[from] Unsolved),
    /// The region is none.
    #[error(transparent)]
    Region(#[from] RegionError),
}

impl Node for ExtractRegion {
    type Outputs = (Region,);
    const OUTPUTS: [&'static str; 1] = ["region"];

    const WANTS: &'static [Want<Self>] = &[Want::new("labels", "NonEmpty")];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (labels, range) = (cx.get(&self.labels), cx.get(&self.range));
        let taken = Taken {
            fill: self.fill_holes,
            enclosed: self.enclosed,
            close_radius: self.close as usize,
        };
        let region = extract_region(labels, range, self.pick, taken, cx.progress())?;
        let (low, high) = region.bounds();
        let [columns, rows] = [0, 1].map(|axis| high[axis] + 1 - low[axis]);
        if columns < 3 || rows < 3 {
            cx.warn(format!("the region is only {columns} x {rows} cells: it has no inside"));
        }
        if is_everything(&region) {
            cx.warn("the region is the whole range image: nothing in it was chosen");
        }
        Ok((region,))
    }
}

/// Whether no cell is outside. A region that only reaches the border may be meant: scans are cropped.
fn is_everything(region: &Region) -> bool {
    region.cells().len() == region.width() * region.height()
}

/// Which cells around a labelled part become part of the region, too.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Taken {
    /// Cells without a point, which are filled.
    pub fill: bool,
    /// What the part surrounds.
    pub enclosed: bool,
    /// Gaps as wide as twice this radius, in cells.
    pub close_radius: usize,
}

/// The part of `labels` that `pick` chooses, as a region of the range grid with its points and contours.
///
/// A cell is inside if at least half of the area that it sees of the picture is; then gaps are closed with a square of radius
/// `close_radius` in cells, and with `enclosed` what no way by sides leads to from outside, if most of its cells with a point beside
/// the part are at most six times the grid's median spacing away from their neighbors there. With `fill` the invalid cells that hang
/// together by sides and touch no cell outside the region, or neither the border of the grid nor a thousand others, get points by
/// Laplace's equation, coordinate by coordinate, from the cells of the region around them; they are flagged, as are the cells that
/// `range` has as filled. Other invalid cells leave the region. Beyond the grid's border is outside. Of what remains the largest part that
/// is connected by sides is taken, of several the first.
///
/// # Errors
/// If the labels are not those of the range image's picture, there is no such part, or nothing of it remains.
pub fn extract_region(
    labels: &Labels,
    range: &RangeImage,
    pick: Pick,
    taken: Taken,
    progress: &Progress<'_>,
) -> Result<Region, ExtractRegionError> {
    let size = [labels.width(), labels.height()];
    let picture = range.registration().picture;
    if size != picture {
        return Err(ExtractRegionError::Size { labels: size, picture });
    }
    let number = choose(labels, pick)?;
    let covered = covered_cells(labels, number, range);
    let cells = covered.count();
    if cells == 0 {
        let area = labels.statistics()[number as usize - 1].area;
        return Err(ExtractRegionError::NoCell { label: number, area });
    }
    let closed = close(&covered, taken.close_radius);
    let whole = if taken.enclosed { with_enclosed(&closed, range) } else { closed };
    let usable = usable_cells(&whole, range, taken.fill);
    let pieces = label(&usable, Connectivity::Four);
    let no_point = ExtractRegionError::NoPoint { label: number, cells };
    let &largest = pieces.by_area().first().ok_or(no_point.clone())?;
    if !pieces
        .pixels()
        .iter()
        .enumerate()
        .any(|(cell, &piece)| piece == largest && range.point(cell).is_some())
    {
        return Err(no_point);
    }
    finish(&pieces, largest, range, progress)
}

/// The number of the part that `pick` chooses.
fn choose(labels: &Labels, pick: Pick) -> Result<u32, ExtractRegionError> {
    let count = labels.statistics().len();
    if count == 0 {
        return Err(ExtractRegionError::NoLabels);
    }
    fn missing(what: &'static str, number: u32, count: usize) -> ExtractRegionError {
        ExtractRegionError::NoSuchPart { what, number, count }
    }
    fn rank(rank: u32, labels: &Labels) -> Option<u32> {
        let place = (rank as usize).checked_sub(1);
        place.and_then(|place| labels.by_area().get(place).copied())
    }
    match pick {
        Pick::Largest => rank(1, labels).ok_or(missing("rank", 1, count)),
        Pick::Smallest => (1..=count as u32)
            .min_by_key(|label| labels.statistics()[*label as usize - 1].area)
            .ok_or(ExtractRegionError::NoLabels),
        Pick::Rank(number) => rank(number, labels).ok_or(missing("rank", number, count)),
        Pick::Label(label) if (1..=count).contains(&(label as usize)) => Ok(label),
        Pick::Label(label) => Err(missing("label", label, count)),
        Pick::At(column, row) => label_at(labels, column, row),
    }
}

fn label_at(labels: &Labels, column: u32, row: u32) -> Result<u32, ExtractRegionError> {
    let at = [column as usize, row as usize];
    let size = [labels.width(), labels.height()];
    if size[0] <= at[0] || size[1] <= at[1] {
        return Err(ExtractRegionError::Outside { column, row, size });
    }
    let label = labels.at(at);
    if label != 0 {
        return Ok(label);
    }
    fn place(index: usize, size: [usize; 2]) -> [usize; 2] {
        [index % size[0], index / size[0]]
    }
    let labelled = (0..labels.pixels().len()).filter(|&index| labels.pixels()[index] != 0);
    let index = labelled
        .min_by_key(|index| {
            let [x, y] = [0, 1].map(|axis| place(*index, size)[axis].abs_diff(at[axis]) as u64);
            x * x + y * y
        })
        .ok_or(ExtractRegionError::NoLabels)?;
    let (nearest, label) = (place(index, size), labels.pixels()[index]);
    Err(ExtractRegionError::Background { column, row, nearest, label })
}

/// The region of the cells labelled `number` in `pieces`, with points for those that have none.
fn finish(
    pieces: &Labels,
    number: u32,
    range: &RangeImage,
    progress: &Progress<'_>,
) -> Result<Region, ExtractRegionError> {
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
    let contours = contours(width, height, &grid);
    Ok(Region::new(width, height, cells, points, filled, contours)?)
}

#[cfg(test)]
mod tests;
