//! Reads points from a file.

use maquette_base::unit::Unit;
use maquette_node::{Blocks, ColorRange, Context, Error, FilePath, Forecast, Node, Sizes};
use maquette_value::Points;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Reads unconnected points: the vertices of a PLY file, a PCD file, an XYZ text with a point per line, the points of a survey (LAS), or
/// all scans of a laser scanner (E57, PTX), each moved by its pose.
///
/// Further columns become attributes: colors, normals, numbers by name; of LAS, E57 and PTX files `color`, `intensity`, and `class`, the
/// classification code. The axes of the file are kept: in surveys z is up. LAS, E57 and PTX files are in meters (`unit: M`), LAS files
/// rarely in feet. Points far from the origin, such as 500 km in a national grid, keep all digits in all nodes, but not in files written
/// for viewers, whose numbers have 7 digits: move them near the origin with `Transform` first.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadPoints {
    /// The file; its extension determines the format: `ply`, `pcd`, `xyz`, `las`, `e57` or `ptx`.
    #[schemars(extend("reads" = "Points"))]
    pub path: FilePath,
    /// The unit of the file's coordinates; they are converted to mm.
    #[serde(default)]
    pub unit: Unit,
    /// The range of colors in PLY, PCD and XYZ files, which many do not state. If omitted, it is determined from all colors of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colors: Option<ColorRange>,
}

impl Node for ReadPoints {
    type Outputs = (Points,);
    const OUTPUTS: [&'static str; 1] = ["points"];
    const BLOCKS: Blocks = Blocks::Each;

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        let points = sizes.file::<Points>(&self.path)?;
        let help = "crop or thin the points before they are read";
        Some(Forecast::new([Some(points)]).with_memory(2.0 * points.bytes, help))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((in_millimeters(cx.read_with_colors(&self.path, self.colors)?, self.unit)?,))
    }
}

/// Converts points from `unit` to mm.
///
/// # Errors
/// Returns an error if a coordinate is too large for mm.
pub fn in_millimeters(points: Points, unit: Unit) -> Result<Points, Error> {
    if unit == Unit::Mm {
        return Ok(points);
    }
    let normals = points.attributes().get("normal").cloned();
    let scaled = points.positions().iter();
    let scaled = scaled.map(|point| point.map(|length| unit.in_millimeters(length))).collect();
    let points = points.with_positions(scaled)?;
    Ok(match normals {
        // Normals are unit vectors, which do not depend on the unit.
        Some(normals) => points.with_attribute("normal", normals)?,
        None => points,
    })
}

#[cfg(test)]
mod tests {
    use maquette_format::xyz;

    use super::*;

    #[test]
    fn every_unit_is_converted_to_millimeters_and_normals_stay() {
        let points = in_millimeters(xyz::read(b"1 2 3 0 1 0\n").unwrap(), Unit::Inch).unwrap();
        assert_eq!(points.positions()[0], nalgebra::Point3::new(25.4, 50.8, 76.2));
        assert_eq!(points.attributes().vectors("normal").unwrap()[0], [0.0, 1.0, 0.0]);
    }
}
