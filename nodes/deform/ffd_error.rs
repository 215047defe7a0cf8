//! Errors of free-form deformation.

use maquette_node::CancelledError;
use maquette_value::{
    AttributeError, ControlNetError, CurveError, HandlesError, MeshError, PointsError, SizeError,
};

/// The reason why an object cannot be deformed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FfdError {
    /// Handles that are not valid.
    #[error(transparent)]
    Handles(#[from] HandlesError),
    /// Two handles with the same position but different targets.
    #[error("handles {first} and {second} have the same position but different targets")]
    Conflicting {
        /// The earlier handle, counted from 0.
        first: usize,
        /// The later handle.
        second: usize,
    },
    /// Handles whose linear system is too ill-conditioned to be solved.
    #[error(
        "the handles cannot all reach their targets: the condition number is {condition:.1e}; use smaller deviations, fewer \
         handles or `regularize`"
    )]
    Singular {
        /// The estimated condition number.
        condition: f64,
    },
    /// Too many handles.
    #[error("expected at most {max} handles, found {handles}")]
    TooMany {
        /// The number of handles.
        handles: usize,
        /// The maximum number of handles.
        max: usize,
    },
    /// A target for a handle that does not exist.
    #[error(
        "there is no handle {handle} for a target: there are {handles} handles, numbered from 0"
    )]
    NoHandle {
        /// The number of the handle.
        handle: usize,
        /// The number of handles.
        handles: usize,
    },
    /// A background that is not valid, or that is used in a mode without background.
    #[error(
        "`background` is {background}, but it must be 0 or more, and 0 unless `mode` is `Displacement`"
    )]
    Background {
        /// The background.
        background: f64,
    },
    /// A regularization that is not valid.
    #[error("`regularize` is {regularize}, but it must be 0 or more")]
    Regularize {
        /// The regularization.
        regularize: f64,
    },
    /// An accuracy that is not valid.
    #[error("`accuracy` is {accuracy}, but it must be 0 or more and less than 1")]
    Accuracy {
        /// The accuracy.
        accuracy: f64,
    },
    /// A cell whose deformed point is not finite.
    #[error("the deformed point of cell {cell} is not finite")]
    NotFinite {
        /// The cell.
        cell: usize,
    },
    /// A deformed mesh with a position that is not finite.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A range image of a different size; never happens, because the grid is kept.
    #[error(transparent)]
    RangeImage(#[from] SizeError),
    /// Deformed points with a position that is not finite.
    #[error(transparent)]
    Points(#[from] PointsError),
    /// A deformed curve with a position that is not finite.
    #[error(transparent)]
    Curve(#[from] CurveError),
    /// A deformed control net with a position that is not finite.
    #[error(transparent)]
    ControlNet(#[from] ControlNetError),
    /// An attribute of a different size; never happens, because the number of points is kept.
    #[error(transparent)]
    Attribute(#[from] AttributeError),
    /// The evaluation was cancelled.
    #[error(transparent)]
    Cancelled(#[from] CancelledError),
}
