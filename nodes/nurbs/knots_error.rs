//! Errors of knot vectors.

use maquette_value::{KnotVectorError, ParameterDirection};

/// Reasons why a knot vector cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum KnotsError {
    /// The net has too few control points for the order.
    #[error(
        "order {order} along {along:?} needs at least {order} control points, the net has {points}"
    )]
    TooFew {
        /// The requested order.
        order: usize,
        /// The parameter direction of the surface, u or v.
        along: ParameterDirection,
        /// The number of control points in this direction.
        points: usize,
    },
    /// The knots of a circle are requested for an unsuitable net.
    #[error(
        "`Cylinder` is for 9 control points and order 3, here are {points} along {along:?} and order {order}"
    )]
    NotCylinder {
        /// The requested order.
        order: usize,
        /// The parameter direction of the surface, u or v.
        along: ParameterDirection,
        /// The number of control points in this direction.
        points: usize,
    },
    /// The list of knots has the wrong length.
    #[error("{points} control points of order {order} need {} knots, {count} are given", points + order)]
    Count {
        /// The requested order.
        order: usize,
        /// The number of control points in this direction.
        points: usize,
        /// The number of given knots.
        count: usize,
    },
    /// The values are not valid knots.
    #[error(transparent)]
    Knots(#[from] KnotVectorError),
}
