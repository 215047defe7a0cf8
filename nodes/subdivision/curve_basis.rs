//! Kinds of interpolating curves.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The kind of an interpolating curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum CurveBasis {
    /// The limit of Chaikin's subdivision, a quadratic B-spline.
    Chaikin,
    /// The limit of the cubic subdivision, a cubic B-spline.
    Cubic,
    /// A B-spline of this degree. A closed one is uniform; the knots of an open one follow from the distances of the points.
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
