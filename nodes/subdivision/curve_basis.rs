//! What a curve that passes through points is made of.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The kind of a curve through points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum CurveBasis {
    /// The limit of Chaikin's subdivision: quadratic.
    Chaikin,
    /// The limit of the cubic subdivision.
    Cubic,
    /// A B-spline of this degree: uniform if it is closed, else with knots after the points' distances.
    BSpline(#[schemars(range(min = 1, max = 9))] usize),
}

impl CurveBasis {
    pub(super) fn degree(self) -> usize {
        match self {
            Self::Chaikin => 2,
            Self::Cubic => 3,
            Self::BSpline(degree) => degree,
        }
    }
}
