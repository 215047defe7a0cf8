//! The part of a range grid around a region, without gaps.

use std::borrow::Cow;

use maquette_base::linear::laplace;
use maquette_node::{Error, Progress};
use maquette_value::{RangeImage, Region};
use nalgebra::Point3;

/// The cells of a range grid in the rectangle around a region, padded. Every cell has a point.
pub(crate) struct GridWindow {
    /// The index of the window's first column in the whole grid.
    pub(crate) left: usize,
    /// The index of the window's first row in the whole grid.
    pub(crate) top: usize,
    /// Number of cells per row of the whole grid.
    width: usize,
    /// Number of rows of the window.
    pub(crate) rows: usize,
    /// Number of columns of the window.
    pub(crate) columns: usize,
    /// A point for each cell, row by row: that of the region, else that of the range image, else a smooth interpolation.
    pub(crate) points: Vec<Point3<f64>>,
    /// 1 for each cell of the region, row by row.
    pub(crate) inside: Vec<u8>,
    /// 1 for each cell whose point is interpolated, row by row.
    pub(crate) interpolated: Vec<u8>,
}

impl GridWindow {
    /// Returns the rectangle around a region with the given padding on each side, as far as the grid extends.
    pub(crate) fn new(
        region: &Region,
        range: &RangeImage,
        padding: usize,
        progress: &Progress<'_>,
    ) -> Result<Self, Error> {
        let width = range.width();
        let (low, high) = region.bounds();
        let [left, top] = low.map(|low| low.saturating_sub(padding));
        let right = (high[0] + padding).min(width - 1);
        let bottom = (high[1] + padding).min(range.height() - 1);
        let (rows, columns) = (bottom - top + 1, right - left + 1);
        let points = (top..=bottom)
            .flat_map(|row| &range.points()[row * width + left..=row * width + right])
            .copied()
            .collect();
        let (inside, interpolated) = (Vec::new(), Vec::new());
        Self { left, top, width, rows, columns, points, inside, interpolated }
            .fill(region, progress)
    }

    /// Returns the bounding rectangle of a region. The points outside of the region are extrapolated from the region and not taken from the
    /// scan. So if the region ends at a step in depth, the background does not influence points that are interpolated near the region's
    /// border.
    pub(crate) fn around_region(region: &Region, progress: &Progress<'_>) -> Result<Self, Error> {
        let (low, high) = region.bounds();
        let ([left, top], width) = (low, region.width());
        let (rows, columns) = (high[1] - top + 1, high[0] - left + 1);
        let points = vec![Point3::new(f64::NAN, f64::NAN, f64::NAN); rows * columns];
        let (inside, interpolated) = (Vec::new(), Vec::new());
        Self { left, top, width, rows, columns, points, inside, interpolated }
            .fill(region, progress)
    }

    /// Returns the window with the points of the region in its cells, and with interpolated points in cells without a point.
    fn fill(self, region: &Region, progress: &Progress<'_>) -> Result<Self, Error> {
        let (rows, columns) = (self.rows, self.columns);
        let mut window = Self { inside: vec![0; rows * columns], ..self };
        for (&cell, &point) in region.cells().iter().zip(region.points()) {
            let [row, column] = window.place(cell);
            window.points[row * columns + column] = point;
            window.inside[row * columns + column] = 1;
        }
        window.interpolated =
            window.points.iter().map(|point| u8::from(point.x.is_nan())).collect();
        fill(&mut window.points, rows, columns, progress)?;
        Ok(window)
    }

    /// Converts the index of a cell in the whole grid to the cell's row and column in the window.
    pub(crate) fn place(&self, cell: u32) -> [usize; 2] {
        [cell as usize / self.width - self.top, cell as usize % self.width - self.left]
    }

    /// Returns the point at (column, row), interpolated bilinearly between cells; outside of the window, the nearest point on its border.
    pub(crate) fn interpolate(&self, [x, y]: [f64; 2]) -> Point3<f64> {
        let [x, y] = [x.min((self.columns - 1) as f64), y.min((self.rows - 1) as f64)];
        let [x, y] = [x.max(0.0), y.max(0.0)];
        fn lower_index(at: f64, count: usize) -> usize {
            (at as usize).min(count.saturating_sub(2))
        }
        let (column, row) = (lower_index(x, self.columns), lower_index(y, self.rows));
        let (s, t) = (x - column as f64, y - row as f64);
        let [above, below] = [row, row + 1].map(|row| {
            let [a, b] = [column, column + 1].map(|column| {
                let (row, column) = (row.min(self.rows - 1), column.min(self.columns - 1));
                self.points[row * self.columns + column]
            });
            a + (b - a) * s
        });
        above + (below - above) * t
    }
}

/// Returns the region with the current points of `range`. Where `range` has no point, the region keeps its own point, displaced smoothly
/// with the points around it.
pub(crate) fn place_region<'a>(
    region: &'a Region,
    range: &RangeImage,
    progress: &Progress<'_>,
) -> Result<Cow<'a, Region>, Error> {
    fn now(cell: u32, range: &RangeImage) -> Option<Point3<f64>> {
        range.point(cell as usize)
    }
    let mut cells = region.cells().iter().zip(region.points());
    if cells.all(|(&cell, point)| now(cell, range).is_none_or(|now| now == *point)) {
        return Ok(Cow::Borrowed(region));
    }
    let (low, high) = region.bounds();
    let (columns, rows) = (high[0] - low[0] + 1, high[1] - low[1] + 1);
    fn place(cell: u32, low: [usize; 2], columns: usize, region: &Region) -> usize {
        let (column, row) = (cell as usize % region.width(), cell as usize / region.width());
        (row - low[1]) * columns + column - low[0]
    }
    let mut motions = vec![Point3::new(f64::NAN, f64::NAN, f64::NAN); rows * columns];
    for (&cell, point) in region.cells().iter().zip(region.points()) {
        if let Some(now) = now(cell, range) {
            motions[place(cell, low, columns, region)] = (now - point).into();
        }
    }
    if region.cells().iter().any(|&cell| now(cell, range).is_none()) {
        fill(&mut motions, rows, columns, progress)?;
    }
    let cells = region.cells().iter().zip(region.points());
    let points = cells.map(|(&cell, point)| {
        now(cell, range).unwrap_or(point + motions[place(cell, low, columns, region)].coords)
    });
    let moved = Region::new(
        region.width(),
        region.height(),
        region.cells().to_vec(),
        points.collect(),
        region.filled_cells().to_vec(),
        region.contours().to_vec(),
    );
    Ok(Cow::Owned(moved.expect("the cells are those of a region, and their points finite")))
}

/// Replaces the invalid points of a grid by the smoothest values that fit the valid points.
fn fill(
    points: &mut [Point3<f64>],
    rows: usize,
    columns: usize,
    progress: &Progress<'_>,
) -> Result<(), Error> {
    let free: Vec<u8> = points.iter().map(|point| u8::from(point.x.is_nan())).collect();
    if !free.contains(&1) {
        return Ok(());
    }
    for axis in 0..3 {
        let mut values: Vec<f64> = points.iter().map(|point| point[axis]).collect();
        laplace::solve(columns, rows, &free, 0.0, &mut values, progress)?;
        points.iter_mut().zip(values).for_each(|(point, value)| point[axis] = value);
    }
    Ok(())
}
