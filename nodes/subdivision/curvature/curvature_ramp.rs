//! Which number of the curvature is painted.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What vertex colors show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum CurvatureRamp {
    /// The mean of the principal curvatures.
    #[default]
    Mean,
    /// Their product.
    Gaussian,
    /// The larger one.
    K1,
    /// The smaller one.
    K2,
    /// Nothing: colors and picture stay as they are.
    None,
}
