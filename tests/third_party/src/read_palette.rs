//! Reads a palette from a file.

use maquette::{Context, Error, FilePath, Node};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Palette;

/// Reads a palette: a file of GIMP or Inkscape, with the colors of those that it includes.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadPalette {
    /// The file.
    #[schemars(extend("reads" = "Palette"))]
    pub path: FilePath,
}

impl Node for ReadPalette {
    type Outputs = (Palette,);
    const OUTPUTS: [&'static str; 1] = ["palette"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((cx.read(&self.path)?,))
    }
}
