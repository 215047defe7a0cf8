//! A connected part of a range grid.

use nalgebra::Point3;
use thiserror::Error;

use super::{
    Column, DecodeError, Decoder, Encoder, Layer, Mesh, Parts, PartsError, Summary, Value,
};

mod parts;

/// Why cells do not make a region.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum RegionError {
    /// Nothing is left.
    #[error("the region is empty: no cell of the range grid lies in it")]
    Empty,
    /// Lists of different lengths.
    #[error("{points} points and {flags} flags for {cells} cells")]
    Length {
        /// Cells inside.
        cells: usize,
        /// Points given.
        points: usize,
        /// Flags given.
        flags: usize,
    },
    /// A cell outside of the grid, or cells out of order.
    #[error("cell {cell} is outside of the grid or not after the one before it")]
    Cell {
        /// The offending cell.
        cell: u32,
    },
    /// A cell without a point.
    #[error("cell {cell} of the region has no point")]
    NoPoint {
        /// The offending cell.
        cell: u32,
    },
}

/// A closed chain of cells along the border of a region, each a neighbor (also diagonally) of the next.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Contour {
    /// Whether it surrounds a hole of the region, instead of the region.
    pub hole: bool,
    /// Cells of the region, by index. The outer contour runs counter-clockwise and holes run clockwise, seen with x to the
    /// right and y *up*.
    pub cells: Vec<u32>,
}

/// A part of a range grid that is to be redesigned, with its cells' points.
///
/// Invariant, checked by [`Region::new`]: not empty; cells in raster order, inside the grid, each with a finite point.
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
    /// A region of a `width` x `height` grid: its cells' indices (row by row from the top), one point for each, and 1 for
    /// each cell whose point was computed, not measured.
    ///
    /// # Errors
    /// If there is no cell, the lists differ in length, a cell is outside or out of order, or a point is not finite.
    pub fn new(
        width: usize,
        height: usize,
        cells: Vec<u32>,
        points: Vec<Point3<f64>>,
        filled: Vec<u8>,
        contours: Vec<Contour>,
    ) -> Result<Self, RegionError> {
        if cells.is_empty() {
            return Err(RegionError::Empty);
        }
        if points.len() != cells.len() || filled.len() != cells.len() {
            let (points, flags) = (points.len(), filled.len());
            return Err(RegionError::Length { cells: cells.len(), points, flags });
        }
        if let Some(pair) = cells.windows(2).find(|pair| pair[1] <= pair[0]) {
            return Err(RegionError::Cell { cell: pair[1] });
        }
        if let Some(&cell) =
            cells.last().filter(|&&cell| width.saturating_mul(height) <= cell as usize)
        {
            return Err(RegionError::Cell { cell });
        }
        if let Some(index) =
            points.iter().position(|point| !point.coords.iter().all(|x| x.is_finite()))
        {
            return Err(RegionError::NoPoint { cell: cells[index] });
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

    /// Cells in a row of the grid.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows of the grid.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Its cells' indices in the grid, row by row from the top.
    pub fn cells(&self) -> &[u32] {
        &self.cells
    }

    /// The point of each cell, in the order of [`cells`](Self::cells), in the range's frame.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// 1 for each cell whose point was computed, not measured, in the order of [`cells`](Self::cells).
    pub fn filled(&self) -> &[u8] {
        &self.filled
    }

    /// The outer contour first, then the holes.
    pub fn contours(&self) -> &[Contour] {
        &self.contours
    }

    /// Where a cell of the grid stands in [`cells`](Self::cells), if it is inside.
    pub fn find(&self, cell: usize) -> Option<usize> {
        u32::try_from(cell).ok().and_then(|cell| self.cells.binary_search(&cell).ok())
    }

    /// The whole grid, 1 inside and 0 outside, row by row from the top.
    pub fn grid(&self) -> Vec<u8> {
        let mut grid = vec![0; self.width * self.height];
        self.cells.iter().for_each(|&cell| grid[cell as usize] = 1);
        grid
    }

    /// The smallest rectangle of cells that holds it: upper left and lower right cell, both inside, as (column, row).
    pub fn bounds(&self) -> ([usize; 2], [usize; 2]) {
        let start = ([usize::MAX; 2], [0; 2]);
        self.cells.iter().fold(start, |(low, high), &cell| {
            let at = [cell as usize % self.width, cell as usize / self.width];
            ([0, 1].map(|k| low[k].min(at[k])), [0, 1].map(|k| high[k].max(at[k])))
        })
    }
}

impl Value for Region {
    const NAME: &'static str = "Region";

    fn encode(&self, to: &mut Encoder) {
        to.counts(&[self.width, self.height, self.contours.len()])
            .column(&self.cells)
            .column(&self.points)
            .column(&self.filled);
        for contour in &self.contours {
            to.plain(&u8::from(contour.hole)).column(&Column::from(contour.cells.clone()));
        }
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let [width, height, contours] = from.counts()?;
        let (cells, points, filled) = (from.column()?, from.column()?, from.column()?);
        let contours = (0..contours)
            .map(|_| {
                let hole = from.plain::<u8>()? == 1;
                Ok(Contour { hole, cells: from.column::<u32>()?.to_vec() })
            })
            .collect::<Result<_, _>>()?;
        Ok(Self { width, height, cells, points, filled, contours })
    }

    fn size(&self) -> usize {
        let contours: usize = self.contours.iter().map(|contour| 4 * contour.cells.len()).sum();
        self.cells.size() + self.points.size() + self.filled.size() + contours
    }

    fn describe(&self) -> Summary {
        let ([left, top], [right, bottom]) = self.bounds();
        let filled = self.filled.iter().filter(|&&filled| filled == 1).count();
        let holes = self.contours.iter().filter(|contour| contour.hole).count();
        let summary = Summary::default()
            .with("grid", format!("{} x {}", self.width, self.height))
            .with("cells", self.cells.len())
            .with("filled", filled)
            .with("box", format!("({left}, {top})-({right}, {bottom})"))
            .with("holes", holes);
        super::mesh::describe_bounds(summary, self.points.iter())
    }

    fn parts(&self) -> Parts<'_> {
        parts::parts(self)
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        parts::made_of(parts)
    }

    fn show(&self) -> Vec<Layer> {
        parts::show(self)
    }

    fn as_mesh(&self) -> Option<Mesh> {
        None
    }

    fn hostile() -> Vec<Self> {
        parts::hostile()
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
    fn cells_that_make_no_region_are_refused() {
        assert_eq!(region(vec![]), Err(RegionError::Empty));
        assert_eq!(region(vec![2, 1]), Err(RegionError::Cell { cell: 1 }));
        assert_eq!(region(vec![6]), Err(RegionError::Cell { cell: 6 }));
        let nowhere = Point3::new(f64::NAN, 0.0, 0.0);
        assert_eq!(
            Region::new(1, 1, vec![0], vec![nowhere], vec![0], vec![]),
            Err(RegionError::NoPoint { cell: 0 })
        );
    }
}
