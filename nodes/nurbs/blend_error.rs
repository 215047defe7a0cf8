//! Why a surface cannot be blended into a range image.

use maquette_node::{Cancelled, TooMuch};
use maquette_value::{ControlNetError, SizeError, SurfaceError};

/// Why a surface cannot be written to a range image.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BlendError {
    /// Grids of different sizes.
    #[error("{what} is for a grid of {size:?} cells, the range image has {range:?}")]
    Grid {
        /// `the region` or `the surface`.
        what: &'static str,
        /// Size of its grid.
        size: [usize; 2],
        /// Size of the range image.
        range: [usize; 2],
    },
    /// A surface without a place on the grid.
    #[error("the surface was not made from a region: nothing tells where cells lie on it")]
    NoChart,
    /// A cell without a place on the surface.
    #[error(
        "cell ({column}, {row}) of the region has no place on the surface, which was made from another region"
    )]
    NotOnSurface {
        /// Its column.
        column: usize,
        /// Its row.
        row: usize,
    },
    /// Factors that make no grid.
    #[error("cells cannot be divided by {factors:?}: the factors are 1 or more")]
    Resample {
        /// The factors.
        factors: [usize; 2],
    },
    /// Too fine a grid.
    #[error(transparent)]
    TooMuch(#[from] TooMuch),
    /// The net moved out of all bounds.
    #[error(transparent)]
    Net(#[from] ControlNetError),
    /// The difference between the surface and its base is no surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// Columns of different sizes.
    #[error(transparent)]
    Size(#[from] SizeError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
