//! The Boolean operations.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A Boolean operation on solids.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Operation {
    /// Union: the volume of any of the solids.
    #[default]
    Union,
    /// Difference: the volume of the first solid without that of the others.
    Difference,
    /// Intersection: the volume that all solids have in common.
    Intersection,
}

impl Operation {
    /// Returns true if the result keeps the parts of a solid's surface that are inside of the other solid. `solid` is 0 for the first and 1
    /// for the second solid.
    pub(crate) fn wants_inside(self, solid: usize) -> bool {
        match (self, solid) {
            (Self::Union, _) | (Self::Difference, 0) => false,
            (Self::Intersection, _) | (Self::Difference, _) => true,
        }
    }

    /// Returns true if a place is inside of the result. `windings` has the winding number of each solid there.
    pub(crate) fn contains(self, windings: &[i32]) -> bool {
        let mut inside = windings.iter().map(|it| 0 < *it);
        match self {
            Self::Union => inside.any(|it| it),
            Self::Intersection => inside.all(|it| it),
            Self::Difference => inside.next() == Some(true) && !inside.any(|it| it),
        }
    }
}
