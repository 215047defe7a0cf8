//! Reads a curve from a file.

use maquette::format::obj;
use maquette::value::Curve;
use maquette::{Context, Error, FilePath, Node};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Reads a curve: an OBJ file with lines `l`, or with one free-form curve `curv` of type `bspline`.
///
/// A line that returns to its first vertex is closed. Coordinates are taken as they are: mm.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadCurve {
    /// The file: `obj`.
    #[schemars(extend("reads" = "Curve"))]
    pub path: FilePath,
}

/// Why there is no curve.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReadCurveError {
    /// A file of another format.
    #[error("no curve can be read from `.{ending}`; known is obj")]
    Ending {
        /// The ending of the file's name, without the dot.
        ending: String,
    },
}

impl Node for ReadCurve {
    type Outputs = (Curve,);
    const OUTPUTS: [&'static str; 1] = ["curve"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((cx.read(&self.path)?,))
    }
}

/// The curve in a file whose name ends in `ending`: `obj`.
///
/// # Errors
/// If the ending is another one, or the bytes are no such file.
pub fn read_curve(bytes: &[u8], ending: &str) -> Result<Curve, Error> {
    match ending {
        "obj" => Ok(obj::read_curve(bytes)?),
        _ => Err(ReadCurveError::Ending { ending: ending.to_owned() }.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ending_says_what_is_read() {
        let text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2 3 1\n";
        assert!(read_curve(text, "obj").unwrap().is_closed());
        let error = read_curve(text, "svg").unwrap_err();
        assert_eq!(error.to_string(), "no curve can be read from `.svg`; known is obj");
    }
}
