//! Reads range grids and the colors of their cells.

use maquette_base::unit::Unit;
use maquette_format::camera::CameraFile;
use maquette_format::ptx;
use maquette_node::{Context, Error, FilePath, Forecast, Node, Sizes, ValueSize};
use maquette_value::{Image, RangeImage};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::range_file::{self, Axes, CameraSizeError, CameraSource, check_view, is_unknown};

/// Reads a range grid: PCD (organized), PLY with a `range_grid`, PTX, ABS of Minolta, or a depth map (16-bit PNG, or TIFF or OpenEXR of
/// floats).
///
/// The color picture has a pixel for each cell; it is middle gray if the file has no colors. A depth map requires a camera file: JSON with
/// `fx`, `fy`, `cx`, `cy`, at its top level or in `range`, or Open3D's `intrinsic_matrix`; its `depth_png.units_per_mm` is the scale of
/// integers.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadRange {
    /// File to read; its extension defines the format: `pcd`, `ply`, `ptx`, `abs`, `png`, `tiff`, `exr`.
    #[schemars(extend("reads" = "RangeImage"))]
    pub path: FilePath,
    /// Camera file. If omitted, `camera.json` beside the range file is used if it exists and is for a grid of this size.
    #[serde(default)]
    pub camera: FilePath,
    /// Unit of the file's coordinates, which are converted to mm. A file that states its own unit, such as PTX, takes precedence.
    #[serde(default)]
    pub unit: Unit,
    /// Axes of the file's coordinates, unless its format defines them, such as ABS.
    #[serde(default)]
    pub axes: Axes,
    /// Scan of a PTX file that has several, from 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scan: Option<u32>,
}

/// The color of the cells of a file without colors.
const GRAY: [u8; 3] = [128; 3];

impl Node for ReadRange {
    type Outputs = (RangeImage, Image);
    const OUTPUTS: [&'static str; 2] = ["range", "color"];

    fn files(&self) -> Vec<FilePath> {
        self.camera_source().files()
    }

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        let range = sizes.file::<RangeImage>(&self.path);
        let color = range.map(|range| ValueSize::items(range.points, 3.0).at_most(range.certainty));
        Some(Forecast::new([range, color]))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let file = cx.file(&self.path)?;
        let camera = self.camera_source().read(cx)?;
        let ending = file.extension();
        let read = |camera: Option<&CameraFile>| {
            file.read(|bytes| {
                let bytes = match self.scan {
                    Some(scan) if ending == "ptx" => ptx::scan(bytes, scan as usize)?,
                    _ => bytes,
                };
                let (unit, axes) = (self.unit, self.axes);
                let range = range_file::read(bytes, &ending, camera, unit, axes, &|note| {
                    cx.warn(note);
                })?;
                with_colors(range, camera)
            })
        };
        match read(camera.as_ref()) {
            // A camera file that was found automatically may belong to another file in the folder, so a wrong size gives a warning instead
            // of an error.
            Err(error) if self.camera.is_empty() && is_size(&error) => {
                cx.warn(format!("the camera file in the same folder is not used: {error}"));
                read(None)
            }
            // This pack does not know the extension. Another pack may register a reader for it, which converts units and axes by itself.
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
    error.downcast::<CameraSizeError>().is_some()
}

/// Reads the grid in a range file with the extension `ending`, in mm, x right, y down, z away from the sensor, row 0 on top. Also returns a
/// picture of its colors with one pixel per cell. `unit` and `axes` are used if the file does not state them.
///
/// # Errors
/// Returns an error if the file cannot be read, or if the camera is for a grid of another size.
pub fn read_range(
    bytes: &[u8],
    ending: &str,
    camera: Option<&CameraFile>,
    unit: Unit,
    axes: Axes,
) -> Result<(RangeImage, Image), Error> {
    with_colors(range_file::read(bytes, ending, camera, unit, axes, &|_| ())?, camera)
}

/// Adds the camera to a grid. Returns the grid and the picture of its colors.
fn with_colors(
    mut range: RangeImage,
    camera: Option<&CameraFile>,
) -> Result<(RangeImage, Image), Error> {
    let found = [range.width(), range.height()];
    if let Some(camera) = camera {
        check_view("range grid", &camera.range, found)?;
        range = camera.apply_to(range, None);
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
    fn the_error_for_a_list_of_points_names_read_points() {
        let list = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nDATA ascii\n1 2 3\n";
        let error = read_range(list, "pcd", None, Unit::Mm, Axes::Camera).unwrap_err();
        assert!(
            error.to_string().ends_with("(the cloud is not organized): use `ReadPoints` instead")
        );
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
    fn a_camera_of_the_grids_size_is_added() {
        fn camera(height: usize) -> CameraFile {
            let text = format!(
                r#"{{"width": 1, "height": {height}, "fx": 10, "fy": 20, "cx": 0, "cy": 0.5}}"#
            );
            camera::read(text.as_bytes()).unwrap()
        }
        fn read(camera: &CameraFile) -> Result<(RangeImage, Image), Error> {
            read_range(PTX.as_bytes(), "ptx", Some(camera), Unit::Mm, Axes::Camera)
        }
        let (range, color) = read(&camera(2)).unwrap();
        let pinhole = Pinhole { focal: [10.0, 20.0], center: [0.0, 0.5] };
        assert_eq!((range.camera(), color.camera()), (Some(&pinhole), Some(&pinhole)));
        let error = read(&camera(3)).unwrap_err();
        assert!(is_size(&error));
        let text = "the camera file is for a range grid of [1, 3], but the file has [1, 2]";
        assert_eq!(error.to_string(), text);
    }
}
