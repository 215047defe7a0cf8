//! How the gradient of a picture is measured.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How the levels' change is taken, along columns and rows. At the picture's border it is one-sided.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Operator {
    /// Half the difference of the two neighbors.
    #[default]
    Central,
    /// The difference of the next pixel and this one: finer, but half a pixel off.
    Forward,
    /// As `Central`, averaged over three rows or columns with weights 1, 2, 1: less sensitive to noise.
    Sobel,
}
