//! Reads a picture from a file.

use maquette::format::picture_file;
use maquette::value::Image;
use maquette::{Context, Error, FilePath, Node};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Reads a picture: a PNG, JPEG or TIFF file, taken as 8-bit sRGB. The content says which, not the ending.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadImage {
    /// The file.
    pub path: FilePath,
}

impl Node for ReadImage {
    type Outputs = (Image,);
    const OUTPUTS: [&'static str; 1] = ["image"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let bytes = cx.file(&self.path)?.bytes();
        match picture_file::Kind::of(bytes) {
            Some(_) => Ok((picture_file::read(bytes)?,)),
            None => Ok((cx.read(&self.path)?,)),
        }
    }
}
