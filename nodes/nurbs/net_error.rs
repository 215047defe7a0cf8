//! Errors of `ControlNet`.

use maquette_base::linear::laplace::PoissonError;
use maquette_node::LimitError;
use maquette_value::ControlNetError;

/// Reasons why a region has no control net.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NetError {
    /// The region belongs to another range image.
    #[error("the region is part of a grid of {region:?} cells, the range image has {range:?}")]
    Size {
        /// The size of the region's grid.
        region: [usize; 2],
        /// The size of the range image.
        range: [usize; 2],
    },
    /// The region has too few rows or columns of cells.
    #[error("the region has {rows} rows and {columns} columns of cells, too few for a surface")]
    DegenerateRegion {
        /// The number of rows that the region touches.
        rows: usize,
        /// The number of columns that the region touches.
        columns: usize,
    },
    /// A number of rows or columns is given, but the method `Grid` does not use it.
    #[error("`rows` and `columns` are for the methods `Rows`, `Polar` and `Harmonic`")]
    FixedSize,
    /// The order is out of range.
    #[error("expected an order from 2 to 10, found {order}")]
    Order {
        /// The requested order.
        order: usize,
    },
    /// The closed net has too few columns.
    #[error("expected at least {least} columns for a closed net of this order, found {columns}")]
    FewColumns {
        /// The requested number of columns.
        columns: usize,
        /// The minimum number of columns.
        least: usize,
    },
    /// The region has a bay that is not visible from its center.
    #[error(
        "the whole region is not visible from its center: {cells:.1} cells on the line to cell ({column}, {row}) are outside; use the method `Harmonic`"
    )]
    NotStarShaped {
        /// Column of the cell.
        column: usize,
        /// Row of the cell.
        row: usize,
        /// The length of the ray to the cell that is outside of the region, in cells; no other ray is outside for longer.
        cells: f64,
    },
    /// The center is outside of the region, or the region has no interior.
    #[error(
        "the region's middle, cell ({column}, {row}), is not inside of its contour: use the method `Harmonic`"
    )]
    NoMiddle {
        /// Column of the cell.
        column: usize,
        /// Row of the cell.
        row: usize,
    },
    /// A corner is too far from the contour.
    #[error(
        "corner ({}, {}) is not on the region's contour: the nearest cell there is ({}, {})", corner[0], corner[1], nearest[0], nearest[1]
    )]
    CornerOff {
        /// Column and row of the corner.
        corner: [usize; 2],
        /// Column and row of the contour's nearest cell.
        nearest: [usize; 2],
    },
    /// The corners are not in order around the contour.
    #[error("the corners do not follow each other counter-clockwise along the region's contour")]
    CornerOrder,
    /// The region has disconnected parts.
    #[error("the region is in several parts: a net covers one")]
    Parts,
    /// The map to the square did not converge.
    #[error("the region could not be mapped to a square: residual {residual:e}")]
    Harmonic {
        /// The residual of the equations, as a fraction of the square's side.
        residual: f64,
    },
    /// The net exceeds the memory limit.
    #[error(transparent)]
    TooMuch(#[from] LimitError),
    /// The net has only one row or column.
    #[error("a net has at least 2 rows and 2 columns")]
    OneLine,
    /// Invalid cells could not be filled.
    #[error(transparent)]
    Fill(#[from] PoissonError),
    /// The points do not form a valid net.
    #[error(transparent)]
    Net(#[from] ControlNetError),
}
