//! Reads points from a file.

use maquette::format::{ply, xyz};
use maquette::value::Points;
use maquette::{Context, Error, FilePath, Node};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::range::Unit;

/// Reads points that nothing connects: the vertices of a PLY file, or an XYZ text of a point a line.
///
/// What stands behind the coordinates becomes attributes: colors, normals, numbers by name. The axes are the file's own.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadPoints {
    /// The file; its ending says of which format it is: `ply` or `xyz`.
    #[schemars(extend("endings" = ["ply", "xyz"]))]
    pub path: FilePath,
    /// The unit of the file's coordinates; they are converted to mm.
    #[serde(default)]
    pub unit: Unit,
}

/// Why there are no points.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReadPointsError {
    /// A file of another format.
    #[error("no points can be read from `.{ending}`; known are {}", endings())]
    Ending {
        /// The ending of the file's name, without the dot.
        ending: String,
    },
}

impl Node for ReadPoints {
    type Outputs = (Points,);
    const OUTPUTS: [&'static str; 1] = ["points"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let file = cx.file(&self.path)?;
        Ok((read_points(file.bytes(), &file.ending(), self.unit)?,))
    }
}

type Reader = fn(&[u8]) -> Result<Points, Error>;

/// What reads the files of each ending.
const READERS: &[(&str, Reader)] =
    &[("ply", |bytes| Ok(ply::read_points(bytes)?)), ("xyz", |bytes| Ok(xyz::read(bytes)?))];

/// The points in a file whose name ends in `ending`, `ply` or `xyz`, in mm.
///
/// # Errors
/// If the ending is another one, the bytes are no such file, or a coordinate is too large for mm.
pub fn read_points(bytes: &[u8], ending: &str, unit: Unit) -> Result<Points, Error> {
    let reader = READERS.iter().find(|reader| reader.0 == ending);
    let (_, read) = reader.ok_or_else(|| ReadPointsError::Ending { ending: ending.to_owned() })?;
    let points = read(bytes)?;
    if unit == Unit::Mm {
        return Ok(points);
    }
    let normals = points.attributes().get("normal").cloned();
    let scaled = points.positions().iter().map(|point| point * unit.millimeters()).collect();
    let points = points.with_positions(scaled)?;
    Ok(match normals {
        // A unit changes no direction.
        Some(normals) => points.with_attribute("normal", normals)?,
        None => points,
    })
}

fn endings() -> String {
    READERS.iter().map(|reader| reader.0).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_unit_is_converted_to_millimeters_and_normals_stay() {
        let points = read_points(b"1 2 3 0 0.5 0\n", "xyz", Unit::Inch).unwrap();
        assert_eq!(points.positions()[0], nalgebra::Point3::new(25.4, 50.8, 3.0 * 25.4));
        assert_eq!(points.attributes().vectors("normal").unwrap()[0], [0.0, 0.5, 0.0]);
    }

    #[test]
    fn the_ending_says_what_is_read() {
        let text = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
            end_header\n1 2 3\n";
        let points = read_points(text.as_bytes(), "ply", Unit::Mm).unwrap();
        assert_eq!(points.positions().len(), 1);
        let error = read_points(b"", "las", Unit::Mm).unwrap_err();
        assert_eq!(error.to_string(), "no points can be read from `.las`; known are ply, xyz");
    }
}
