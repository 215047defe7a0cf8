//! Errors of `Blend`.

use maquette_node::{CancelledError, LimitError};
use maquette_value::{ControlNetError, SizeError, SurfaceError};

/// Reasons why a surface cannot be written to a range image.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BlendError {
    /// The grids have different sizes.
    #[error("{what} is for a grid of {size:?} cells, the range image has {range:?}")]
    Grid {
        /// `the region` or `the surface`.
        what: &'static str,
        /// The size of the grid of the region or the surface.
        size: [usize; 2],
        /// The size of the range image.
        range: [usize; 2],
    },
    /// The surface was not made from a range grid.
    #[error("the surface was not made from a region: the positions of cells on it are unknown")]
    NoChart,
    /// A cell has no position on the surface.
    #[error(
        "cell ({column}, {row}) of the region is not on the surface, which was made from another region"
    )]
    NotOnSurface {
        /// The column of the cell.
        column: usize,
        /// The row of the cell.
        row: usize,
    },
    /// The division factors are invalid.
    #[error("cells cannot be divided by {factors:?}: the factors are 1 or more")]
    Resample {
        /// The requested factors: smaller rows and smaller columns per cell.
        factors: [usize; 2],
    },
    /// The finer grid would have too many cells.
    #[error(transparent)]
    TooMuch(#[from] LimitError),
    /// The control points exceed the largest allowed coordinate.
    #[error(transparent)]
    Net(#[from] ControlNetError),
    /// The difference between the surface and its base is not a surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// The columns of the range image's data have different lengths.
    #[error(transparent)]
    Size(#[from] SizeError),
    /// The evaluation was cancelled.
    #[error(transparent)]
    Cancelled(#[from] CancelledError),
}
