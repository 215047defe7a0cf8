//! Which parameters the points of a net get.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Where on a fitted surface the points lie.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum FitParameters {
    /// Evenly spaced.
    Uniform,
    /// As far apart as the points are, in the mean over all lines.
    Chord,
    /// As far apart as the square roots of the points' distances, which avoids oscillations at sharp turns.
    #[default]
    Centripetal,
}
