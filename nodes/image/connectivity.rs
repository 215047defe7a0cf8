//! Which pixels of a mask hang together.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Which pixels of a mask hang together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Connectivity {
    /// Those that share a side or a corner.
    #[default]
    Eight,
    /// Those that share a side.
    Four,
}
