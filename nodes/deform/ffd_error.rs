//! Why an object cannot be deformed.

use maquette_node::Cancelled;
use maquette_value::{
    AttributeError, ControlNetError, CurveError, HandlesError, MeshError, PointsError, SizeError,
};

/// Why an object cannot be deformed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FfdError {
    /// Numbers that are no handles.
    #[error(transparent)]
    Handles(#[from] HandlesError),
    /// Two handles at one place with two targets.
    #[error("handles {first} and {second} are at one place, but go to different targets")]
    Conflicting {
        /// The earlier, counted from 0.
        first: usize,
        /// The later.
        second: usize,
    },
    /// Handles whose system has no solution that could be trusted.
    #[error(
        "the handles cannot all reach their targets: the condition is {condition:.1e}; smaller deviations, fewer handles or \
         `regularize` help"
    )]
    Singular {
        /// The estimate of the condition.
        condition: f64,
    },
    /// Too many handles.
    #[error("{handles} handles are more than the {most} that can be solved for")]
    TooMany {
        /// How many there are.
        handles: usize,
        /// How many there may be.
        most: usize,
    },
    /// A target for a handle that is not there.
    #[error("there is a target for handle {handle}, but there are only {handles}, counted from 0")]
    NoHandle {
        /// The handle.
        handle: usize,
        /// How many there are.
        handles: usize,
    },
    /// A background that is no number, or in a mode that has none.
    #[error(
        "the background is {background}; it must not be negative, and only displacements may have one"
    )]
    Background {
        /// The background.
        background: f64,
    },
    /// A regularization that is no number.
    #[error("the regularization is {regularize}, but it must be 0 or more")]
    Regularize {
        /// The regularization.
        regularize: f64,
    },
    /// An accuracy that is no number.
    #[error("the accuracy is {accuracy}, but it must be 0 or more, and less than 1")]
    Accuracy {
        /// The accuracy.
        accuracy: f64,
    },
    /// A cell whose point would be nowhere.
    #[error("the point of cell {cell} would be at no finite place")]
    NotFinite {
        /// The cell.
        cell: usize,
    },
    /// A mesh that has moved out of the numbers.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A range image that changed its size; never happens.
    #[error(transparent)]
    RangeImage(#[from] SizeError),
    /// Points that have moved out of the numbers.
    #[error(transparent)]
    Points(#[from] PointsError),
    /// A curve that has moved out of the numbers.
    #[error(transparent)]
    Curve(#[from] CurveError),
    /// A net that has moved out of the numbers.
    #[error(transparent)]
    ControlNet(#[from] ControlNetError),
    /// An attribute that does not fit; never happens.
    #[error(transparent)]
    Attribute(#[from] AttributeError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
