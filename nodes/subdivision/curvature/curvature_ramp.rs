//! The curvature that vertex colors show.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The curvature that vertex colors show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum CurvatureRamp {
    /// The mean of the principal curvatures.
    #[default]
    Mean,
    /// The product of the principal curvatures.
    Gaussian,
    /// The larger principal curvature.
    K1,
    /// The smaller principal curvature.
    K2,
    /// None: colors and texture do not change.
    None,
}
