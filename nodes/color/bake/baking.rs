//! How colors are taken from captures.

use maquette_mesh::Poses;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::bake_error::BakeError;

/// How colors are taken from captures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Baking {
    /// Whether captures are moved from their cameras' places to the world's, or to the place of the camera of the mesh, if it has one.
    #[serde(default)]
    pub poses: Poses,
    /// How far the mesh may be from what a capture saw and still be seen by it; 0 is three times the distance of the capture's points.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub tolerance: f64,
    /// How far from the border of what it saw a capture counts less; 0 is five times the distance of its points.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub feather: f64,
    /// How captures are made equal.
    #[serde(default)]
    pub level: Level,
}

/// How the colors of captures are made equal where they overlap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Level {
    /// They stay as they are.
    None,
    /// By one factor for each channel of each capture: another exposure or another white.
    Exposure,
    /// Also by a factor that varies slowly over the surface: another light.
    #[default]
    Smooth,
}

impl Baking {
    /// # Errors
    /// If a length is none.
    pub(super) fn check(&self) -> Result<(), BakeError> {
        let lengths = [("tolerance", self.tolerance), ("feather", self.feather)];
        match lengths.into_iter().find(|it| !(0.0..1e50).contains(&it.1)) {
            Some((what, value)) => Err(BakeError::Parameter { what, value }),
            None => Ok(()),
        }
    }
}
