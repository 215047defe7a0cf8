//! Why a region has no control net.

use maquette_base::linear::laplace::Unsolved;
use maquette_node::TooMuch;
use maquette_value::ControlNetError;

/// Why a region does not make a net.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NetError {
    /// A region of another range image.
    #[error("the region is part of a grid of {region:?} cells, the range image has {range:?}")]
    Size {
        /// Size of the region's grid.
        region: [usize; 2],
        /// Size of the range image.
        range: [usize; 2],
    },
    /// A region that is a point.
    #[error("the region has {rows} rows and {columns} columns of cells, too few for a surface")]
    DegenerateRegion {
        /// Rows that the region touches.
        rows: usize,
        /// Columns that it touches.
        columns: usize,
    },
    /// A number of rows or columns that this method does not take.
    #[error("`rows` and `columns` are for the methods `Rows`, `Polar` and `Harmonic`")]
    FixedSize,
    /// An order that no surface has.
    #[error("order {order} is not from 2 to 10")]
    Order {
        /// The order.
        order: usize,
    },
    /// Too few columns to go around.
    #[error("{columns} columns do not go around with this order: at least {least} are needed")]
    FewColumns {
        /// Columns asked for.
        columns: usize,
        /// How many are needed.
        least: usize,
    },
    /// A region with a bay that cannot be seen from its middle.
    #[error(
        "the region is not seen whole from its middle: {cells:.1} cells of the way to cell ({column}, {row}) lie outside; use the method `Harmonic`"
    )]
    NotStarShaped {
        /// Column of the cell.
        column: usize,
        /// Row of the cell.
        row: usize,
        /// Cells outside on the way there, where they are most.
        cells: f64,
    },
    /// A region around its middle, or without an inside.
    #[error(
        "the region's middle, cell ({column}, {row}), is not inside of its contour: use the method `Harmonic`"
    )]
    NoMiddle {
        /// Column of the cell.
        column: usize,
        /// Row of the cell.
        row: usize,
    },
    /// A corner off the contour.
    #[error(
        "corner ({}, {}) is not on the region's contour: the nearest cell there is ({}, {})", corner[0], corner[1], nearest[0], nearest[1]
    )]
    CornerOff {
        /// Column and row of the corner.
        corner: [usize; 2],
        /// Column and row of the contour's cell next to it.
        nearest: [usize; 2],
    },
    /// Corners that do not go around.
    #[error("the corners do not follow each other counter-clockwise along the region's contour")]
    CornerOrder,
    /// Cells that are not connected.
    #[error("the region is in several parts: a net covers one")]
    Parts,
    /// The map to the square was not found.
    #[error("the region could not be mapped to a square: residual {residual:e}")]
    Harmonic {
        /// What is left of the equations, as a share of the square's side.
        residual: f64,
    },
    /// A size that memory would not hold.
    #[error(transparent)]
    TooMuch(#[from] TooMuch),
    /// A net of one line.
    #[error("a net has at least 2 rows and 2 columns")]
    OneLine,
    /// Invalid cells could not be filled.
    #[error(transparent)]
    Fill(#[from] Unsolved),
    /// Points that make no net.
    #[error(transparent)]
    Net(#[from] ControlNetError),
}
