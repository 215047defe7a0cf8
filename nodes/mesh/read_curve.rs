//! Reads a curve from a file.

use maquette_base::unit::Unit;
use maquette_format::obj;
use maquette_node::{Context, Error, FilePath, Node, bail};
use maquette_value::{Curve, CurveError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Reads a curve: an OBJ file with lines `l`, or with one free-form curve `curv` of type `bspline`.
///
/// A line that returns to its first vertex is closed. The axes of the file are kept.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadCurve {
    /// The file: `obj`.
    #[schemars(extend("reads" = "Curve"))]
    pub path: FilePath,
    /// The unit of the file's coordinates; they are converted to mm.
    #[serde(default, skip_serializing_if = "Unit::is_millimeters")]
    #[schemars(extend("default" = "Mm"))]
    pub unit: Unit,
}

impl Node for ReadCurve {
    type Outputs = (Curve,);
    const OUTPUTS: [&'static str; 1] = ["curve"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((curve_in_millimeters(cx.read(&self.path)?, self.unit)?,))
    }
}

/// Converts a curve from `unit` to mm.
///
/// # Errors
/// Returns an error if a coordinate is too large for mm.
pub fn curve_in_millimeters(curve: Curve, unit: Unit) -> Result<Curve, CurveError> {
    if unit.is_millimeters() {
        return Ok(curve);
    }
    curve.with_points(
        curve
            .points()
            .iter()
            .map(|point| point.map(|length| unit.in_millimeters(length)))
            .collect(),
    )
}

/// Reads the curve of a file with the extension `ending`: `obj`.
///
/// # Errors
/// Returns an error if the extension is not `obj`, or the bytes are not an OBJ file.
pub fn read_curve(bytes: &[u8], ending: &str) -> Result<Curve, Error> {
    match ending {
        "obj" => obj::read_curve(bytes),
        _ => bail!("cannot read a curve from a `.{ending}` file: the supported format is obj"),
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
        assert_eq!(
            error.to_string(),
            "cannot read a curve from a `.svg` file: the supported format is obj"
        );
    }

    #[test]
    fn every_unit_is_converted_to_millimeters() {
        let curve = read_curve(b"v 1 2 3\nv 1 0 0\nl 1 2\n", "obj").unwrap();
        let scaled = curve_in_millimeters(curve.clone(), Unit::Inch).unwrap();
        assert_eq!(scaled.points()[0], nalgebra::Point3::new(25.4, 50.8, 76.2));
        assert_eq!(curve_in_millimeters(curve.clone(), Unit::Mm).unwrap(), curve);
    }
}
