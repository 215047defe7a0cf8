//! Regions: connected parts of range grids.

use nalgebra::Point3;
use thiserror::Error;

use super::Column;

mod value;

/// Error of building a region. Contains the message.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct RegionError(String);

/// A closed chain of cells along the border of a region. Consecutive cells are neighbors, possibly diagonal ones.
#[derive(Clone, Debug, PartialEq)]
pub struct Contour {
    /// True if the contour surrounds a hole of the region. False if it surrounds the region.
    pub hole: bool,
    /// The indices of the contour's cells, which belong to the region. With x to the right and y *up*, the outer contour runs
    /// counter-clockwise and the contours of holes run clockwise.
    pub cells: Vec<u32>,
    /// The outline of the region along this contour, finer than the cells: a closed line through (column, row) positions, where the centers
    /// of cells are at integers. It runs in the direction of `cells`. Empty if only the cells are known.
    pub rim: Vec<[f64; 2]>,
}

/// A part of a range grid, with the points of its cells.
///
/// Invariant, checked by [`Region::new`]: there is at least one cell. The cells are inside the grid, in raster order, and each has a finite
/// point.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    width: usize,
    height: usize,
    cells: Column<u32>,
    points: Column<Point3<f64>>,
    filled: Column<u8>,
    contours: Vec<Contour>,
}

impl Region {
    /// Builds a region of a `width` x `height` grid from three lists: the indices of the region's cells (row by row from the top), the
    /// point of each cell, and a flag per cell, which is 1 if the point was computed, not measured.
    ///
    /// # Errors
    /// If there is no cell, the lists differ in length, a cell is outside of the grid or out of order, or a point is not finite.
    pub fn new(
        width: usize,
        height: usize,
        cells: Vec<u32>,
        points: Vec<Point3<f64>>,
        filled: Vec<u8>,
        contours: Vec<Contour>,
    ) -> Result<Self, RegionError> {
        if cells.is_empty() {
            let why = "the region is empty: it contains no cell of the range grid";
            return Err(RegionError(why.into()));
        }
        if points.len() != cells.len() || filled.len() != cells.len() {
            let (points, flags, cells) = (points.len(), filled.len(), cells.len());
            return Err(RegionError(format!(
                "{points} points and {flags} flags for {cells} cells"
            )));
        }
        let unsorted = cells.windows(2).find(|pair| pair[1] <= pair[0]).map(|pair| pair[1]);
        let outside = |cell: &&u32| width.saturating_mul(height) <= **cell as usize;
        if let Some(cell) = unsorted.or_else(|| cells.last().filter(outside).copied()) {
            let why = format!("cell {cell} is outside of the grid or not after the previous cell");
            return Err(RegionError(why));
        }
        if let Some(index) = super::first_not_finite(&points) {
            let cell = cells[index];
            return Err(RegionError(format!("cell {cell} of the region has no point")));
        }
        Ok(Self {
            width,
            height,
            cells: cells.into(),
            points: points.into(),
            filled: filled.into(),
            contours,
        })
    }

    /// The number of columns of the grid.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The number of rows of the grid.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The indices of the region's cells in the grid, row by row from the top.
    pub fn cells(&self) -> &[u32] {
        &self.cells
    }

    /// The point of each cell, in the order of [`cells`](Self::cells), in the frame of the range grid.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// The flag of each cell, in the order of [`cells`](Self::cells): 1 if the cell's point was computed, not measured.
    pub fn filled_cells(&self) -> &[u8] {
        &self.filled
    }

    /// The contours of the region: the outer one first, then those of the holes.
    pub fn contours(&self) -> &[Contour] {
        &self.contours
    }

    /// Converts the index of a cell in the grid to its index in [`cells`](Self::cells). `None` if the cell is not in the region.
    pub fn find(&self, cell: usize) -> Option<usize> {
        u32::try_from(cell).ok().and_then(|cell| self.cells.binary_search(&cell).ok())
    }

    /// The region as a mask of the whole grid, row by row from the top: 1 inside the region and 0 outside.
    pub fn grid(&self) -> Vec<u8> {
        let mut grid = vec![0; self.width * self.height];
        self.cells.iter().for_each(|&cell| grid[cell as usize] = 1);
        grid
    }

    /// The bounding rectangle: its upper left and lower right cells (both inclusive) as (column, row).
    pub fn bounds(&self) -> ([usize; 2], [usize; 2]) {
        let start = ([usize::MAX; 2], [0; 2]);
        self.cells.iter().fold(start, |(low, high), &cell| {
            let at = [cell as usize % self.width, cell as usize / self.width];
            ([0, 1].map(|k| low[k].min(at[k])), [0, 1].map(|k| high[k].max(at[k])))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(cells: Vec<u32>) -> Result<Region, RegionError> {
        let count = cells.len();
        Region::new(3, 2, cells, vec![Point3::origin(); count], vec![0; count], vec![])
    }

    #[test]
    fn cells_are_found_by_their_index_in_the_grid() {
        let region = region(vec![1, 2, 5]).unwrap();
        assert_eq!((region.find(5), region.find(0), region.find(99)), (Some(2), None, None));
        assert_eq!(region.bounds(), ([1, 0], [2, 1]));
        assert_eq!(region.grid(), [0, 1, 1, 0, 0, 1]);
    }

    #[test]
    fn invalid_regions_are_refused() {
        fn check(region: Result<Region, RegionError>, expected: &str) {
            assert_eq!(region, Err(RegionError(expected.into())));
        }
        check(region(vec![]), "the region is empty: it contains no cell of the range grid");
        let wrong = "is outside of the grid or not after the previous cell";
        check(region(vec![2, 1]), &format!("cell 1 {wrong}"));
        check(region(vec![6]), &format!("cell 6 {wrong}"));
        let nowhere = Point3::new(f64::NAN, 0.0, 0.0);
        let region = Region::new(1, 1, vec![0], vec![nowhere], vec![0], vec![]);
        check(region, "cell 0 of the region has no point");
    }
}
