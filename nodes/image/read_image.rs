//! Reads a picture from a file.

use maquette_format::picture_file;
use maquette_node::{Context, Error, FilePath, Forecast, Node, Sizes};
use maquette_value::Image;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Reads a picture: a PNG, JPEG, TIFF, WebP, BMP, EXR or HDR file. The format is detected from the content, not from the extension. 8-bit
/// channels are sRGB, and the upper 8 of 16 bits are used; floats, as in EXR and HDR files, are linear light, clamped to 0 to 1 and
/// converted to sRGB. Alpha is left out.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadImage {
    /// File to read.
    pub path: FilePath,
    /// If true, pixels are kept as stored. If false, a photograph with an Exif orientation is rotated upright.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    #[schemars(extend("default" = false))]
    pub as_stored: bool,
}

impl Node for ReadImage {
    type Outputs = (Image,);
    const OUTPUTS: [&'static str; 1] = ["image"];

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        Some(Forecast::new([sizes.file::<Image>(&self.path)]))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let bytes = cx.file(&self.path)?.bytes();
        match picture_file::Kind::detect(bytes) {
            Some(_) if self.as_stored => Ok((picture_file::read(bytes)?,)),
            Some(_) => Ok((picture_file::read_upright(bytes)?,)),
            None => Ok((cx.read(&self.path)?,)),
        }
    }
}
