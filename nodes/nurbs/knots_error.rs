//! Why there is no knot vector.

use maquette_value::{Along, KnotVectorError};

/// Why knots cannot be placed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum KnotsError {
    /// Too few control points.
    #[error(
        "order {order} along {along:?} needs at least {order} control points, the net has {points}"
    )]
    TooFew {
        /// The order.
        order: usize,
        /// The direction.
        along: Along,
        /// Control points of the net in this direction.
        points: usize,
    },
    /// A circle's knots for something else.
    #[error(
        "`Cylinder` is for 9 control points and order 3, here are {points} along {along:?} and order {order}"
    )]
    NotCylinder {
        /// The order.
        order: usize,
        /// The direction.
        along: Along,
        /// Control points of the net in this direction.
        points: usize,
    },
    /// A list of another length.
    #[error("{points} control points of order {order} need {} knots, {count} are given", points + order)]
    Count {
        /// The order.
        order: usize,
        /// Control points of the net in this direction.
        points: usize,
        /// Knots given.
        count: usize,
    },
    /// Numbers that are no knots.
    #[error(transparent)]
    Knots(#[from] KnotVectorError),
}
