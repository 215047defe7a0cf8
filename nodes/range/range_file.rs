//! What the nodes that read range files share: units, axes, and the grid in mm.

use maquette::Error;
use maquette::format::camera::CameraFile;
use maquette::format::range_file;
use maquette::value::RangeImage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A unit of length.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Unit {
    /// Millimeters.
    #[default]
    Mm,
    /// Centimeters.
    Cm,
    /// Meters.
    M,
    /// Inches of 25.4 mm.
    Inch,
}

impl Unit {
    /// Millimeters in one of it.
    pub fn millimeters(self) -> f64 {
        match self {
            Self::Mm => 1.0,
            Self::Cm => 10.0,
            Self::M => 1000.0,
            Self::Inch => 25.4,
        }
    }

    /// The word for it in camera files.
    fn word(self) -> &'static str {
        match self {
            Self::Mm => "mm",
            Self::Cm => "cm",
            Self::M => "m",
            Self::Inch => "inch",
        }
    }
}

/// How the coordinates of a range file lie.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Axes {
    /// x right, y down, z away from the sensor.
    #[default]
    Camera,
    /// x right, y up, z towards the sensor, as PCL's Kinect clouds: y and z are turned round.
    YUp,
}

/// The grid in a range file whose name ends in `ending`, in mm, x right, y down, z away from the sensor, row 0 on top. `unit` and
/// `axes` stand for what the file does not say.
///
/// # Errors
/// If the bytes are no range file, or a depth map has no camera.
pub(super) fn read(
    bytes: &[u8],
    ending: &str,
    camera: Option<&CameraFile>,
    unit: Unit,
    axes: Axes,
) -> Result<RangeImage, Error> {
    let axes = match axes {
        Axes::Camera => range_file::Axes::Camera,
        Axes::YUp => range_file::Axes::YUp,
    };
    Ok(range_file::read(bytes, ending, camera)?.normalize(unit.millimeters(), axes)?)
}

/// What to tell the user if the camera file and the parameter name different units; a PTX file has its own.
pub(super) fn doubt_of_unit(
    camera: Option<&CameraFile>,
    ending: &str,
    given: Unit,
) -> Option<String> {
    let units = camera?.units.as_deref()?;
    let doubtful = units != given.word() && ending != "ptx";
    doubtful
        .then(|| format!("the camera file says that the unit is {units}, but `unit` is {given:?}"))
}
