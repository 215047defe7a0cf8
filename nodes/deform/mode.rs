//! The mode of a deformation: the quantity of the handles that is blended.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Quantity of the handles that is blended with Gaussian weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Mode {
    /// Displacements of the handles. Handles at rest change nothing.
    #[default]
    Displacement,
    /// Positions of the handles, as published. Even handles at rest contract the object, the more the smaller their deviations are.
    Absolute,
    /// Displacements relative to the best-fitting affine motion. Handles that are translated, rotated, scaled or sheared together transform
    /// the whole object in the same way.
    Affine,
}
