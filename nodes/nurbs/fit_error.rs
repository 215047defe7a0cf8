//! Why no surface can be fitted.

use maquette_node::Cancelled;
use maquette_value::{Along, ControlNetError, KnotVectorError, SurfaceError, TraceError};

/// Why no surface fits.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// A number of control points that does not go with the order and the points.
    #[error(
        "{control} control points along {along:?} do not fit: there are {points} points, and order {order} needs {order} of both"
    )]
    Count {
        /// The direction.
        along: Along,
        /// Control points.
        control: usize,
        /// Points to meet.
        points: usize,
        /// The order.
        order: usize,
    },
    /// Equations without one solution.
    #[error("the points along {along:?} do not determine the surface: some lie in one place")]
    Singular {
        /// The direction.
        along: Along,
    },
    /// Parameters that make no knots.
    #[error(transparent)]
    Knots(#[from] KnotVectorError),
    /// A surface out of all bounds.
    #[error(transparent)]
    Net(#[from] ControlNetError),
    /// No surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// Distances that are no numbers.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
