//! Reads a picture from a file.

use maquette::format::png;
use maquette::value::Image;
use maquette::{Context, Error, FilePath, Node};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Reads a picture: a PNG file of any color type, taken as 8-bit sRGB.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadImage {
    /// The file.
    pub path: FilePath,
}

impl Node for ReadImage {
    type Outputs = (Image,);
    const OUTPUTS: [&'static str; 1] = ["image"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((png::read(cx.file(&self.path)?.bytes())?,))
    }
}
