//! The methods to compute the gradient of a picture.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Difference along columns and rows that gives the gradient. At the border of the picture it is one-sided.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Operator {
    /// Half the difference of the two neighbors.
    #[default]
    Central,
    /// Difference between the next pixel and the current one: finer, but shifted by half a pixel.
    Forward,
    /// Like `Central`, averaged over three rows or columns with weights 1, 2, 1: less sensitive to noise.
    Sobel,
}
