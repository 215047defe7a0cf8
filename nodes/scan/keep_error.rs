//! Errors of nodes that keep a part of a scan.

use thiserror::Error;

/// Reasons why a part of a scan cannot be selected.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum KeepError {
    /// A lower bound of a box is greater than the upper bound.
    #[error("the box goes from {min} to {max} along {axis}: `min` must not be above `max`")]
    Box {
        /// The axis: `x`, `y` or `z`.
        axis: char,
        /// The lower bound, in mm.
        min: f64,
        /// The upper bound, in mm.
        max: f64,
    },
    /// The lower bound of a depth range is greater than the upper bound.
    #[error("the depth goes from {from} to {to}: `from` must not be above `to`")]
    Depth {
        /// The lower bound, in mm.
        from: f64,
        /// The upper bound, in mm.
        to: f64,
    },
    /// The normal of a plane is zero.
    #[error("the normal (0, 0, 0) of the plane has no direction")]
    NoNormal,
    /// The mesh that defines the plane has no area.
    #[error("the mesh at the port `plane` has no area, so it has no plane")]
    NoPlane,
    /// The mesh that defines the plane is not flat.
    #[error(
        "the mesh at the port `plane` is not flat: its corners are {off:.3} mm from their plane and {size:.3} mm from their center (root mean square); connect a flat mesh, such as `plane` of `DominantPlane`"
    )]
    NotFlat {
        /// The root mean square distance of the corners from their plane, in mm.
        off: f64,
        /// The root mean square distance of the corners from their center, in mm.
        size: f64,
    },
    /// The scan has no numeric attribute with this name.
    #[error(
        "there is no attribute `{name}` with a number on each of its {elements}; there {known}"
    )]
    NoAttribute {
        /// The name of the attribute.
        name: String,
        /// The kind of elements, such as `points`.
        elements: &'static str,
        /// The numeric attributes that exist, as the end of a sentence that begins with "there".
        known: String,
    },
    /// The size of the mask is neither that of the picture nor that of the grid.
    #[error(
        "`mask` has {mask:?} pixels, but `range` is registered to a picture of {picture:?} and has {grid:?} cells"
    )]
    Size {
        /// The size of the mask, in pixels.
        mask: [usize; 2],
        /// The size of the picture to which the range image is registered, in pixels.
        picture: [usize; 2],
        /// The numbers of columns and rows of the range image's grid.
        grid: [usize; 2],
    },
}
