//! Reads a picture from a file.

use maquette_format::picture_file;
use maquette_node::{Context, Error, FilePath, Node};
use maquette_value::Image;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Reads a picture: a PNG, JPEG, TIFF, WebP, BMP, EXR or HDR file. The content says which, not the ending. 8 bits are taken as sRGB, of
/// 16 the upper 8; floats, as in EXR and HDR files, are light from 0 to 1, beyond which they are cut, and put on the curve of sRGB.
/// Alpha is left out.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadImage {
    /// The file.
    pub path: FilePath,
    /// If true, pixels are kept as they are stored. If false, a photograph that says how it was held (Exif orientation) is turned
    /// upright.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    #[schemars(extend("default" = false))]
    pub as_stored: bool,
}

impl Node for ReadImage {
    type Outputs = (Image,);
    const OUTPUTS: [&'static str; 1] = ["image"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let bytes = cx.file(&self.path)?.bytes();
        match picture_file::Kind::of(bytes) {
            Some(_) if self.as_stored => Ok((picture_file::read(bytes)?,)),
            Some(_) => Ok((picture_file::read_upright(bytes)?,)),
            None => Ok((cx.read(&self.path)?,)),
        }
    }
}
