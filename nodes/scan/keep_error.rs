//! Why it cannot be said what is kept.

use thiserror::Error;

/// Why it cannot be said what is kept.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum KeepError {
    /// A box whose ends are exchanged.
    #[error("the box goes from {min} to {max} along {axis}: `min` must not be above `max`")]
    Box {
        /// Along which axis.
        axis: char,
        /// Its lower end, in mm.
        min: f64,
        /// Its upper end, in mm.
        max: f64,
    },
    /// A depth whose ends are exchanged.
    #[error("the depth goes from {from} to {to}: `from` must not be above `to`")]
    Depth {
        /// Where it begins, in mm.
        from: f64,
        /// Where it ends, in mm.
        to: f64,
    },
    /// A normal without direction.
    #[error("the normal (0, 0, 0) of the plane has no direction")]
    NoNormal,
    /// A plane mesh without area.
    #[error("the mesh at the port `plane` has no area, and so lies on no plane")]
    NoPlane,
    /// A plane mesh that is bent.
    #[error(
        "the mesh at the port `plane` is not flat: its corners are {off:.3} mm off their plane, as mean squares go, and {size:.3} mm from their middle; connect one that is, such as `plane` of `DominantPlane`"
    )]
    NotFlat {
        /// How far its corners are off, as root mean square in mm.
        off: f64,
        /// How far they are from their middle, as root mean square in mm.
        size: f64,
    },
    /// There is no such attribute.
    #[error(
        "there is no attribute `{name}` with a number on each of its {elements}; there {known}"
    )]
    NoAttribute {
        /// Its name.
        name: String,
        /// What it should be on.
        elements: &'static str,
        /// Those that there are, in words.
        known: String,
    },
    /// A mask of another size.
    #[error(
        "`mask` has {mask:?} pixels, but `range` is registered to a picture of {picture:?} and has {grid:?} cells"
    )]
    Size {
        /// The mask's size.
        mask: [usize; 2],
        /// The size of the picture that the range image is registered to.
        picture: [usize; 2],
        /// The size of the grid.
        grid: [usize; 2],
    },
}
