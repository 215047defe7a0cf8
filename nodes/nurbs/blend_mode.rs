//! How a surface is blended into a range image.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What a blend writes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum BlendMode {
    /// The scan, moved as the surface was moved by the offset of its net: keeps all detail and leaves no seam.
    #[default]
    Displacement,
    /// The surface itself: smooth inside, with a small step at the border where the scan is rough.
    Replace,
    /// The surface, fading into the scan towards the border.
    Feather {
        /// Width of the band in which it fades.
        #[schemars(range(min = 0.0, max = 1000.0), extend("unit" = "px"))]
        #[serde(default = "four")]
        band: f64,
    },
}

fn four() -> f64 {
    4.0
}
