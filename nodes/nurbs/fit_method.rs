//! Methods of surface fitting.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A method of fitting a surface to points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum FitMethod {
    /// The surface interpolates all points.
    #[default]
    Interpolate,
    /// The surface has fewer control points and approximates the points by least squares, first along u, then along v. It interpolates the
    /// corners.
    LeastSquares {
        /// Number of rows of control points; 0 means as many as points, which interpolates along u.
        #[schemars(range(max = 4096))]
        #[serde(default)]
        rows: usize,
        /// Number of columns of control points; 0 means as many as points, which interpolates along v.
        #[schemars(range(max = 4096))]
        #[serde(default)]
        columns: usize,
    },
    /// Least squares by progressive iteration: rounds that move each control point by the residuals near it. Fewer rounds give a smoother
    /// surface.
    Lspia {
        /// Number of rows of control points; 0 means as many as points.
        #[schemars(range(max = 4096))]
        #[serde(default)]
        rows: usize,
        /// Number of columns of control points; 0 means as many as points.
        #[schemars(range(max = 4096))]
        #[serde(default)]
        columns: usize,
        /// Maximum number of rounds in each direction.
        #[schemars(range(max = 100_000))]
        #[serde(default = "default_iterations")]
        iterations: usize,
        /// The iteration ends when no control point moves farther than this, in mm.
        #[schemars(range(min = 0.0), extend("unit" = "mm"))]
        #[serde(default = "default_tolerance")]
        tolerance: f64,
    },
}

fn default_iterations() -> usize {
    100
}

fn default_tolerance() -> f64 {
    1e-3
}
