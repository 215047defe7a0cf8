//! What becomes of solids.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What becomes of solids.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Operation {
    /// What is in any of them.
    #[default]
    Union,
    /// What is in the first one, and not in the others.
    Difference,
    /// What is in all of them.
    Intersection,
}

impl Operation {
    /// Whether of the first solid (0) or another one (1) that stays which is inside of the other.
    pub(crate) fn wants_inside(self, solid: usize) -> bool {
        match (self, solid) {
            (Self::Union, _) | (Self::Difference, 0) => false,
            (Self::Intersection, _) | (Self::Difference, _) => true,
        }
    }
}
