//! Errors of free-form deformation.

use maquette_node::CancelledError;
use maquette_value::{
    AttributeError, ControlNetError, CurveError, HandlesError, MeshError, PointsError, SizeError,
};

/// The reason why an object cannot be deformed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FfdError {
    /// The handles are not valid.
    #[error(transparent)]
    Handles(#[from] HandlesError),
    /// Two handles have the same position but different targets.
    #[error("handles {first} and {second} have the same position but different targets")]
    Conflicting {
        /// The earlier handle, counted from 0.
        first: usize,
        /// The later handle, counted from 0.
        second: usize,
    },
    /// The linear system of the handles is too ill-conditioned to be solved.
    #[error(
        "the handles cannot all reach their targets: the condition number is {condition:.1e}; use smaller deviations, fewer \
         handles or `regularize`"
    )]
    Singular {
        /// The estimated condition number.
        condition: f64,
    },
    /// There are too many handles.
    #[error("expected at most {max} handles, found {handles}")]
    TooMany {
        /// The number of given handles.
        handles: usize,
        /// The maximum number of handles.
        max: usize,
    },
    /// A target refers to a handle that does not exist.
    #[error(
        "there is no handle {handle} for a target: there are {handles} handles, numbered from 0"
    )]
    NoHandle {
        /// The number of the handle.
        handle: usize,
        /// The number of existing handles.
        handles: usize,
    },
    /// The background is not valid, or the mode does not support a background.
    #[error(
        "`background` is {background}, but it must be 0 or more, and 0 unless `mode` is `Displacement`"
    )]
    Background {
        /// The value of `background`.
        background: f64,
    },
    /// The regularization is not valid.
    #[error("`regularize` is {regularize}, but it must be 0 or more")]
    Regularize {
        /// The value of `regularize`.
        regularize: f64,
    },
    /// The accuracy is not valid.
    #[error("`accuracy` is {accuracy}, but it must be 0 or more and less than 1")]
    Accuracy {
        /// The value of `accuracy`.
        accuracy: f64,
    },
    /// The deformed point of a range image's cell is not finite.
    #[error("the deformed point of cell {cell} is not finite")]
    NotFinite {
        /// The index of the cell.
        cell: usize,
    },
    /// A position of the deformed mesh is not finite.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The range image has a different size. This never happens, because the grid is kept.
    #[error(transparent)]
    RangeImage(#[from] SizeError),
    /// A position of the deformed points is not finite.
    #[error(transparent)]
    Points(#[from] PointsError),
    /// A position of the deformed curve is not finite.
    #[error(transparent)]
    Curve(#[from] CurveError),
    /// A position of the deformed control net is not finite.
    #[error(transparent)]
    ControlNet(#[from] ControlNetError),
    /// An attribute has a different size. This never happens, because the number of points is kept.
    #[error(transparent)]
    Attribute(#[from] AttributeError),
    /// The evaluation was cancelled.
    #[error(transparent)]
    Cancelled(#[from] CancelledError),
}
