//! Kinds of knot vectors.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A kind of knot vector.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum KnotsKind {
    /// Uniform; the surface ends at the net's border.
    #[default]
    Uniform,
    /// Averages of uniformly spaced parameters, one for each control point; the surface ends at the net's border.
    Averaging,
    /// As `Averaging`, with parameters that follow the distances between the control points.
    Chord,
    /// As `Averaging`, with parameters that follow the square roots of the distances, which avoids oscillations at sharp turns.
    Centripetal,
    /// Uniform and unclamped: a net whose last `order - 1` rows or columns repeat the first ones closes smoothly.
    Periodic,
    /// The knots of an exact circle: for 9 control points and order 3.
    Cylinder,
    /// The given knots: as many as control points plus the order, non-decreasing.
    Values(Vec<f64>),
}
