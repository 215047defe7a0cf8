//! Parameters of the transfer of colors from captures.

use maquette_mesh::Poses;
use maquette_node::{Error, bail};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Parameters of the transfer of colors from captures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Baking {
    /// If true, captures are moved from camera to world coordinates, or to those of the mesh's camera if it has one.
    #[serde(default)]
    pub poses: Poses,
    /// Maximum distance in mm between the mesh and a capture that sees it; 0 means three times the spacing of the capture's points.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub tolerance: f64,
    /// Distance in mm from the border of a capture below which it has less weight; 0 means five times the spacing of its points.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub feather: f64,
    /// Equalization of captures.
    #[serde(default)]
    pub level: Level,
}

/// Equalization of the captures' colors where they overlap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Level {
    /// Colors are not changed.
    None,
    /// One factor for each channel of each capture: corrects exposure and white balance.
    Exposure,
    /// Also a factor that varies slowly over the surface: corrects lighting.
    #[default]
    Smooth,
}

impl Baking {
    /// # Errors
    /// Returns an error if a length is invalid.
    pub(super) fn check(&self) -> Result<(), Error> {
        let lengths = [("tolerance", self.tolerance), ("feather", self.feather)];
        if let Some((name, value)) = lengths.iter().find(|it| !(0.0..1e50).contains(&it.1)) {
            bail!("`{name}` is {value}, but must be a length, or 0");
        }
        Ok(())
    }
}
