//! The neighborhood that connects the pixels of a mask: four or eight neighbors.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Neighborhood that connects pixels of a mask.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Connectivity {
    /// Pixels that share a side or a corner are connected.
    #[default]
    Eight,
    /// Pixels that share a side are connected.
    Four,
}
