//! The cells to which a surface is written.

use maquette_node::{Error, bail};
use maquette_value::{Chart, RangeImage, Region, Surface};
use nalgebra::Point3;

use super::distance::from_border;
use crate::blend_mode::BlendMode;

/// A range grid to which a surface is written: the points of all cells of the grid before the change, and the cells that change.
pub(crate) struct Canvas {
    /// Number of cells per row.
    pub(crate) width: usize,
    /// Number of rows of cells.
    pub(crate) height: usize,
    /// The point of every cell before the surface is written; NaN for a cell without a point.
    pub(crate) points: Vec<Point3<f64>>,
    /// The cells inside the region, in raster order.
    pub(crate) targets: Vec<Target>,
}

/// A cell inside the region.
#[derive(Clone, Copy)]
pub(crate) struct Target {
    /// The index of the cell in the grid.
    pub(crate) cell: usize,
    /// The net coordinate of the cell.
    pub(crate) coordinate: [f64; 2],
    /// The distance of the cell from the border of the region, in cells of the range image; known only in the mode `Feather`.
    pub(crate) depth: f64,
}

impl Canvas {
    /// Returns the canvas of a range image and a region. Where the range image has no point, the region's point is used.
    pub(crate) fn new(
        range: &RangeImage,
        region: &Region,
        surface: &Surface,
        mode: BlendMode,
    ) -> Result<Self, Error> {
        let (width, height) = (range.width(), range.height());
        let Some(chart) = surface.net().chart() else {
            bail!(
                "the surface was not made from a region: the positions of cells on it are unknown"
            );
        };
        let grids =
            [("the region", [region.width(), region.height()]), ("the surface", chart.grid)];
        if let Some(&(what, size)) = grids.iter().find(|(_, size)| *size != [width, height]) {
            bail!(
                "{what} is for a grid of {size:?} cells, the range image has {:?}",
                [width, height]
            );
        }
        let mut points = range.points().to_vec();
        for (&cell, &point) in region.cells().iter().zip(region.points()) {
            if range.point(cell as usize).is_none() {
                points[cell as usize] = point;
            }
        }
        let depths = match mode {
            BlendMode::Feather { band } => from_border(region, band),
            BlendMode::Displacement | BlendMode::Replace => vec![0.0; region.cells().len()],
        };
        let targets = region
            .cells()
            .iter()
            .zip(depths)
            .map(|(&cell, depth): (&u32, f64)| match place(chart, cell) {
                Some(coordinate) => Ok(Target { cell: cell as usize, coordinate, depth }),
                None => {
                    let (column, row) = (cell as usize % width, cell as usize / width);
                    bail!(
                        "cell ({column}, {row}) of the region is not on the surface, which was made from another region"
                    )
                }
            })
            .collect::<Result<_, Error>>()?;
        Ok(Self { width, height, points, targets })
    }
}

fn place(chart: &Chart, cell: u32) -> Option<[f64; 2]> {
    let index = chart.cells.binary_search(&cell).ok()?;
    chart.coordinates.get(index).copied()
}
