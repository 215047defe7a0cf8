//! Shared code of the nodes that read range files: units, axes, the camera file, and conversion to mm.

use maquette_base::unit::Unit;
use maquette_format::camera;
use maquette_format::camera::{CameraFile, View};
use maquette_format::pcd::NotOrganizedError;
use maquette_format::range_file;
use maquette_node::{Context, Error, FilePath};
use maquette_value::RangeImage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Axes of a range file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Axes {
    /// x right, y down, z away from the sensor.
    #[default]
    Camera,
    /// x right, y up, z towards the sensor, as PCL's Kinect clouds: y and z are negated.
    YUp,
}

/// Reads a range grid from a file with the extension `ending`, in mm, x right, y down, z away from the sensor, row 0 on top. `unit` and
/// `axes` are used if the file does not state them. `warn` is called with warnings about parts of the file that are ignored.
///
/// Returns an error if the bytes are not a range file, or if a depth map has no camera.
pub(super) fn read(
    bytes: &[u8],
    ending: &str,
    camera: Option<&CameraFile>,
    unit: Unit,
    axes: Axes,
    warn: &dyn Fn(String),
) -> Result<RangeImage, Error> {
    let axes = match axes {
        Axes::Camera => range_file::Axes::Camera,
        Axes::YUp => range_file::Axes::YUp,
    };
    let read = range_file::read(bytes, ending, camera).map_err(|error| {
        let is_list = error.downcast::<NotOrganizedError>().is_some();
        if is_list { PointList(error).into() } else { error }
    });
    let mut file = read?;
    std::mem::take(&mut file.notes).into_iter().for_each(warn);
    Ok(file.normalize(unit.millimeters(), axes)?)
}

/// The error for a file that has a list of points instead of a grid.
#[derive(Debug, thiserror::Error)]
#[error("{0}: use `ReadPoints` instead")]
struct PointList(Error);

/// Returns true if `error` means that no importer of this pack supports the format of the range file.
pub(super) fn is_unknown(error: &Error) -> bool {
    error.downcast::<range_file::UnknownExtension>().is_some()
}

/// The error for a camera file that is for a picture or grid of another size.
#[derive(Debug, thiserror::Error)]
#[error("the camera file is for a {what} of {expected:?}, but the file has {found:?}")]
pub(super) struct CameraSizeError {
    /// The word for the thing that has the wrong size: picture or range grid.
    what: &'static str,
    /// Width and height in the camera file.
    expected: [usize; 2],
    /// Width and height in the picture or range file.
    found: [usize; 2],
}

pub(super) fn read_camera(bytes: &[u8]) -> Result<CameraFile, Error> {
    camera::read(bytes)
        .map_err(|error| Error::new(format!("the camera file cannot be read: {error}")))
}

/// Checks that the camera file describes a picture or grid of the size `found`.
pub(super) fn check_view(
    what: &'static str,
    view: &View,
    found: [usize; 2],
) -> Result<(), CameraSizeError> {
    match view.size.filter(|&expected| expected != found) {
        Some(expected) => Err(CameraSizeError { what, expected, found }),
        None => Ok(()),
    }
}

/// The parameters by which a node finds the camera of a range file.
pub(super) struct CameraSource<'a> {
    /// The range file.
    pub(super) range: &'a FilePath,
    /// The camera file. If empty, `camera.json` in the folder of the range file is used if it exists.
    pub(super) camera: &'a FilePath,
    /// The node's parameter for the unit of the range file.
    pub(super) unit: Unit,
}

impl CameraSource<'_> {
    fn default_camera(&self) -> FilePath {
        self.range.sibling("camera.json")
    }

    /// Returns the optional files of the node: those that it reads only if they exist.
    pub(super) fn files(&self) -> Vec<FilePath> {
        if self.camera.is_empty() { vec![self.default_camera()] } else { Vec::new() }
    }

    /// Reads the camera file, if there is one. Warns if the camera file states another unit than `unit`.
    pub(super) fn read(&self, cx: &Context<'_>) -> Result<Option<CameraFile>, Error> {
        let file = match self.camera.is_empty() {
            true => cx.file_if_any(&self.default_camera()),
            false => Some(cx.file(self.camera)?),
        };
        let camera = file.map(|file| file.read(read_camera)).transpose()?;
        camera.iter().flat_map(|camera| &camera.notes).for_each(|note| cx.warn(note.clone()));
        let units = camera.as_ref().and_then(|camera| camera.units.as_deref());
        // Do not warn for a PTX file, whose format defines the unit.
        if let Some(units) = units.filter(|units| *units != self.unit.name())
            && cx.file(self.range)?.extension() != "ptx"
        {
            cx.warn(format!(
                "the camera file states the unit {units}, but `unit` is {:?}",
                self.unit
            ));
        }
        Ok(camera)
    }
}
