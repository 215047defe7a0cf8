//! What the nodes that read range files share: units, axes, the camera file, and the grid in mm.

use maquette_base::unit::Unit;
use maquette_format::camera;
use maquette_format::camera::{CameraError, CameraFile, View};
use maquette_format::pcd::PcdError;
use maquette_format::range_file;
use maquette_node::{Context, Error, FilePath};
use maquette_value::RangeImage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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
/// `axes` stand for what the file does not say; `warn` is called with what is left out.
///
/// # Errors
/// If the bytes are no range file, or a depth map has no camera.
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
        let is_list = matches!(error.downcast(), Some(PcdError::NotOrganised { .. }));
        if is_list { PointList(error).into() } else { error }
    });
    let mut file = read?;
    std::mem::take(&mut file.notes).into_iter().for_each(warn);
    Ok(file.normalize(unit.millimeters(), axes)?)
}

/// A list of points, where a grid is wanted.
#[derive(Debug, thiserror::Error)]
#[error("{0}; `ReadPoints` reads it")]
struct PointList(Error);

/// Whether a range file is of a format that the engine does not read itself.
pub(super) fn is_unknown(error: &Error) -> bool {
    error.downcast::<range_file::UnknownEnding>().is_some()
}

/// Why a camera file does not go with its capture.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CameraFileError {
    /// It cannot be read.
    #[error("the camera file cannot be read")]
    Read(#[from] CameraError),
    /// It says nothing of the picture.
    #[error(
        "the camera file says nothing of the picture's camera: `color` with `fx`, `fy`, `cx`, `cy` beside `range`; or `ReadRange` reads the grid alone"
    )]
    NoColor,
    /// It is that of another capture.
    #[error("the camera file is for a {what} of {expected:?}, but the file has {found:?}")]
    Size {
        /// The picture or the range grid.
        what: &'static str,
        /// Width and height in the camera file.
        expected: [usize; 2],
        /// Width and height in the file itself.
        found: [usize; 2],
    },
}

pub(super) fn read_camera(bytes: &[u8]) -> Result<CameraFile, CameraFileError> {
    Ok(camera::read(bytes)?)
}

/// Checks that a camera's picture or grid has the size that was found.
pub(super) fn check_view(
    what: &'static str,
    view: &View,
    found: [usize; 2],
) -> Result<(), CameraFileError> {
    match view.size.filter(|&expected| expected != found) {
        Some(expected) => Err(CameraFileError::Size { what, expected, found }),
        None => Ok(()),
    }
}

/// Where a node finds the camera of a range file.
pub(super) struct CameraSource<'a> {
    /// The range file.
    pub(super) range: &'a FilePath,
    /// The camera file that is named; `camera.json` beside the range file, if there is one, if none is.
    pub(super) camera: &'a FilePath,
    /// The unit that is given for the range file.
    pub(super) unit: Unit,
}

impl CameraSource<'_> {
    fn beside(&self) -> FilePath {
        self.range.beside("camera.json")
    }

    /// The files that the node reads if they are there.
    pub(super) fn files(&self) -> Vec<FilePath> {
        if self.camera.is_empty() { vec![self.beside()] } else { Vec::new() }
    }

    /// The camera, if it is known. Warns if its file names another unit than the one given.
    pub(super) fn read(&self, cx: &Context<'_>) -> Result<Option<CameraFile>, Error> {
        let file = match self.camera.is_empty() {
            true => cx.file_if_any(&self.beside()),
            false => Some(cx.file(self.camera)?),
        };
        let camera = file.map(|file| file.read(read_camera)).transpose()?;
        camera.iter().flat_map(|camera| &camera.notes).for_each(|note| cx.warn(note.clone()));
        let units = camera.as_ref().and_then(|camera| camera.units.as_deref());
        // A PTX file has a unit of its own.
        if let Some(units) = units.filter(|units| *units != self.unit.word())
            && cx.file(self.range)?.ending() != "ptx"
        {
            cx.warn(format!(
                "the camera file says that the unit is {units}, but `unit` is {:?}",
                self.unit
            ));
        }
        Ok(camera)
    }
}
