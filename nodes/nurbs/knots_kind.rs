//! How knots are spaced.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How knots are placed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum KnotsKind {
    /// Evenly; the surface ends at the net's border.
    #[default]
    Uniform,
    /// At the means of evenly spaced parameters, one for each control point; the surface ends at the net's border.
    Averaging,
    /// As `Averaging`, with parameters that follow the distances between the control points.
    Chord,
    /// As `Averaging`, with parameters that follow the square roots of the distances, which avoids oscillations at sharp turns.
    Centripetal,
    /// Evenly, without ends: a net whose last `order - 1` rows or columns repeat the first ones closes smoothly.
    Periodic,
    /// Those of an exact circle: for 9 control points and order 3.
    Cylinder,
    /// These knots: as many as control points and order together, never decreasing.
    Values(Vec<f64>),
}
