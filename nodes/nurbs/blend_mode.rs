//! Modes of `Blend`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A mode of `Blend`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum BlendMode {
    /// The scan, displaced as the offset displaced the surface. It keeps all detail and leaves no seam.
    #[default]
    Displacement,
    /// The surface itself. It is smooth inside, with a small step at the border where the scan is rough.
    Replace,
    /// The surface, with a smooth transition to the scan at the border.
    Feather {
        /// Width of the transition in cells.
        #[schemars(range(min = 0.0, max = 1000.0), extend("unit" = "px"))]
        #[serde(default = "default_band")]
        band: f64,
    },
}

fn default_band() -> f64 {
    4.0
}
