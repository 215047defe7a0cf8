//! The rules of a subdivision.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The rules of a subdivision.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Scheme {
    /// Loop (1987): triangles, which become box splines.
    Loop,
    /// Catmull and Clark (1978): polygons, which become bicubic B-splines.
    CatmullClark,
    /// Doo and Sabin (1978): polygons, which become biquadratic B-splines. It knows no creases, and drops them.
    DooSabin,
}
