//! Reads a grid of points from a file of its own, with its colors if it has some.

use maquette_base::unit::Unit;
use maquette_format::camera::CameraFile;
use maquette_format::ptx;
use maquette_node::{Context, Error, FilePath, Node};
use maquette_value::{Image, RangeImage};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::range_file::{self, Axes, CameraFileError, CameraSource, check_view, is_unknown};

/// Reads a range grid: PCD (organized), PLY with a `range_grid`, PTX, ABS of Minolta, or a depth map, PNG of 16 bits, TIFF or OpenEXR of
/// floats.
///
/// The color picture has a pixel for each cell; where the file has no colors, it is middle gray. A depth map becomes points by the
/// camera file: JSON with `fx`, `fy`, `cx`, `cy`, at its top or in `range`, or Open3D's `intrinsic_matrix`; its
/// `depth_png.units_per_mm` says how fine whole numbers are.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadRange {
    /// The file; its ending says of which format it is: `pcd`, `ply`, `ptx`, `abs`, `png`, `tiff`, `exr`.
    #[schemars(extend("reads" = "RangeImage"))]
    pub path: FilePath,
    /// The camera file; if left out, `camera.json` beside the range file, if there is one and it is for a grid of this size.
    #[serde(default)]
    pub camera: FilePath,
    /// The unit of the file's coordinates; they are converted to mm. A file that says its unit itself, as PTX does, is taken at
    /// its word.
    #[serde(default)]
    pub unit: Unit,
    /// How the file's coordinates lie, unless its format says so, as ABS does.
    #[serde(default)]
    pub axes: Axes,
    /// The scan of a PTX file that has several, from 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scan: Option<u32>,
}

/// The color of cells in files without colors.
const GRAY: [u8; 3] = [128; 3];

impl Node for ReadRange {
    type Outputs = (RangeImage, Image);
    const OUTPUTS: [&'static str; 2] = ["range", "color"];

    fn files(&self) -> Vec<FilePath> {
        self.camera_source().files()
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let file = cx.file(&self.path)?;
        let camera = self.camera_source().read(cx)?;
        let ending = file.ending();
        let warn = |note| cx.warn(note);
        let read = |camera: Option<&CameraFile>| {
            file.read(|bytes| {
                let bytes = match self.scan {
                    Some(scan) if ending == "ptx" => ptx::scan(bytes, scan as usize)?,
                    _ => bytes,
                };
                let (unit, axes) = (self.unit, self.axes);
                with_colors(range_file::read(bytes, &ending, camera, unit, axes, &warn)?, camera)
            })
        };
        match read(camera.as_ref()) {
            // A camera file that nobody named may belong to another file of the folder.
            Err(error) if self.camera.is_empty() && is_size(&error) => {
                cx.warn(format!("the camera file in the same folder is not used: {error}"));
                read(None)
            }
            // A format of another pack, which knows units and axes itself.
            Err(error) if is_unknown(&error) => with_colors(cx.read(&self.path)?, camera.as_ref()),
            outputs => outputs,
        }
    }
}

impl ReadRange {
    fn camera_source(&self) -> CameraSource<'_> {
        CameraSource { range: &self.path, camera: &self.camera, unit: self.unit }
    }
}

fn is_size(error: &Error) -> bool {
    matches!(error.downcast(), Some(CameraFileError::Size { .. }))
}

/// The grid in a range file whose name ends in `ending`, in mm, x right, y down, z away from the sensor, row 0 on top, and a
/// picture of its colors, a pixel for each cell. `unit` and `axes` stand for what the file does not say.
///
/// # Errors
/// If the file cannot be read, or the camera is for a grid of another size.
pub fn read_range(
    bytes: &[u8],
    ending: &str,
    camera: Option<&CameraFile>,
    unit: Unit,
    axes: Axes,
) -> Result<(RangeImage, Image), Error> {
    with_colors(range_file::read(bytes, ending, camera, unit, axes, &|_| ())?, camera)
}

/// A grid with its camera, and the picture of its colors.
fn with_colors(
    mut range: RangeImage,
    camera: Option<&CameraFile>,
) -> Result<(RangeImage, Image), Error> {
    let found = [range.width(), range.height()];
    if let Some(camera) = camera {
        check_view("range grid", &camera.range, found)?;
        range = camera.over(range, None);
    }
    let pixels = match range.colors() {
        Some(colors) => colors.to_vec(),
        None => vec![GRAY; range.points().len()],
    };
    let color = Image::new(found[0], found[1], pixels)?.with_camera(range.camera().copied());
    Ok((range, color))
}

#[cfg(test)]
mod tests {
    use maquette_format::camera;
    use maquette_value::Pinhole;
    use nalgebra::Point3;

    use super::*;

    const PTX: &str = "1\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n\
        0 0.5 2 0.5 1 2 3\n0 0 0 0.5 0 0 0\n";

    #[test]
    fn a_list_of_points_is_said_to_be_for_read_points() {
        let list = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nDATA ascii\n1 2 3\n";
        let error = read_range(list, "pcd", None, Unit::Mm, Axes::Camera).unwrap_err();
        assert!(error.to_string().ends_with("(the cloud is not organized); `ReadPoints` reads it"));
    }

    #[test]
    fn a_grid_has_a_picture_of_its_colors_cell_on_pixel() {
        let read = read_range(PTX.as_bytes(), "ptx", None, Unit::Mm, Axes::Camera);
        let (range, color) = read.unwrap();
        assert_eq!([range.point(0), range.point(1)], [None, Some(Point3::new(0., 500., 2000.))]);
        assert_eq!(color.pixels(), [[0; 3], [1, 2, 3]]);
        assert_eq!(range.registration().picture_from_range([0.0, 1.0]), [0.0, 1.0]);
    }

    #[test]
    fn a_file_without_colors_has_a_gray_picture() {
        let plain = PTX.replace(" 1 2 3\n", "\n").replace(" 0.5 0 0 0\n", " 0.5\n");
        let (range, color) =
            read_range(plain.as_bytes(), "ptx", None, Unit::Mm, Axes::YUp).unwrap();
        assert_eq!(color.pixels(), [GRAY; 2]);
        assert_eq!(range.point(1), Some(Point3::new(0., -500., -2000.)));
    }

    #[test]
    fn a_camera_of_the_grids_size_is_taken_along() {
        fn camera(height: usize) -> CameraFile {
            let text = format!(
                r#"{{"width": 1, "height": {height}, "fx": 10, "fy": 20, "cx": 0, "cy": 0.5}}"#
            );
            camera::read(text.as_bytes()).unwrap()
        }
        let read =
            |camera| read_range(PTX.as_bytes(), "ptx", Some(&camera), Unit::Mm, Axes::Camera);
        let (range, color) = read(camera(2)).unwrap();
        let pinhole = Pinhole { focal: [10.0, 20.0], center: [0.0, 0.5] };
        assert_eq!((range.camera(), color.camera()), (Some(&pinhole), Some(&pinhole)));
        let error = read(camera(3)).unwrap_err();
        assert!(is_size(&error));
        let text = "the camera file is for a range grid of [1, 3], but the file has [1, 2]";
        assert_eq!(error.to_string(), text);
    }
}
