//! Parameters of the points of a fitted surface.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The spacing of the points' parameters on a fitted surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum FitParameters {
    /// Uniform.
    Uniform,
    /// Proportional to the distances of the points, averaged over all lines.
    Chord,
    /// Proportional to the square roots of the distances, which avoids oscillations at sharp turns.
    #[default]
    Centripetal,
}
