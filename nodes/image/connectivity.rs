//! Which neighboring pixels of a mask are connected.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Which neighboring pixels of a mask are connected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Connectivity {
    /// Those that share a side or a corner.
    #[default]
    Eight,
    /// Those that share a side.
    Four,
}
