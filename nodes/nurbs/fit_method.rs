//! How a surface is fitted.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How the points of a fitted surface are met.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum FitMethod {
    /// The surface goes through all of them.
    #[default]
    Interpolate,
    /// It has fewer control points and is as near as possible, by squares, first along u, then along v. It meets the corners.
    LeastSquares {
        /// Rows of control points; 0 takes as many as the points have, which interpolates along u.
        #[schemars(range(max = 4096))]
        #[serde(default)]
        rows: usize,
        /// Columns of control points; 0 takes as many as the points have, which interpolates along v.
        #[schemars(range(max = 4096))]
        #[serde(default)]
        columns: usize,
    },
    /// The same by progressive iteration: rounds that move each control point by what the surface misses near it. Stopped early it
    /// is smoother.
    Lspia {
        /// Rows of control points; 0 takes as many as the points have.
        #[schemars(range(max = 4096))]
        #[serde(default)]
        rows: usize,
        /// Columns of control points; 0 takes as many as the points have.
        #[schemars(range(max = 4096))]
        #[serde(default)]
        columns: usize,
        /// Most rounds in each direction.
        #[schemars(range(max = 100_000))]
        #[serde(default = "rounds")]
        iterations: usize,
        /// A round that moves no control point farther than this is the last one.
        #[schemars(range(min = 0.0), extend("unit" = "mm"))]
        #[serde(default = "micrometer")]
        tolerance: f64,
    },
}

fn rounds() -> usize {
    100
}

fn micrometer() -> f64 {
    1e-3
}
