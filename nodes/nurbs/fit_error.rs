//! Errors of surface fitting.

use maquette_node::CancelledError;
use maquette_value::{
    ControlNetError, KnotVectorError, ParameterDirection, SurfaceError, TraceError,
};

/// Reasons why a surface cannot be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// The number of control points does not fit the order and the points.
    #[error(
        "{control} control points along {along:?} do not fit: there are {points} points, and order {order} needs {order} of both"
    )]
    Count {
        /// The parameter direction of the surface, u or v.
        along: ParameterDirection,
        /// The requested number of control points.
        control: usize,
        /// The number of points to fit in this direction.
        points: usize,
        /// The order in this direction.
        order: usize,
    },
    /// The equations have no unique solution.
    #[error("the points along {along:?} do not determine the surface: some coincide")]
    Singular {
        /// The parameter direction of the surface, u or v.
        along: ParameterDirection,
    },
    /// The parameters lead to no valid knots.
    #[error(transparent)]
    Knots(#[from] KnotVectorError),
    /// The control points exceed the largest coordinate.
    #[error(transparent)]
    Net(#[from] ControlNetError),
    /// The fitted surface is invalid.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// The residuals are not finite.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// The evaluation was cancelled.
    #[error(transparent)]
    Cancelled(#[from] CancelledError),
}
