//! Reads captures of range finders: a picture and a grid of points, registered to each other.

use maquette_base::unit::Unit;
use maquette_format::camera::CameraFile;
use maquette_format::exif;
use maquette_format::picture_file;
use maquette_node::{Context, Error, FilePath, Forecast, Node, Sizes, bail};
use maquette_value::{Image, RangeImage, Registration};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::range_file::{self, Axes, CameraSource, check_view, is_unknown};

/// Reads a capture: a picture and a range grid taken together.
///
/// The camera file defines the registration. It is JSON: `color` and `range`, each with `fx`, `fy`, `cx`, `cy` in pixels (pixel centers at
/// integers), `width` and `height`; optionally `world_from_camera_mm`. Without a camera file the corners of picture and grid are aligned.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadCapture {
    /// Picture: a PNG, JPEG, TIFF, WebP, BMP, EXR or HDR file. Its pixels are read as stored, even with an Exif orientation, since camera
    /// intrinsics are for stored pixels.
    pub color: FilePath,
    /// Grid of points: an organized PCD file, a PLY file with a `range_grid`, a PTX or ABS file, or a depth map (16-bit PNG, or TIFF or
    /// OpenEXR of floats), which requires the camera file.
    #[schemars(extend("reads" = "RangeImage"))]
    pub range: FilePath,
    /// Camera file. If omitted, `camera.json` beside the range file is used if it exists.
    #[serde(default)]
    pub camera: FilePath,
    /// Unit of the range file's coordinates, which are converted to mm. A file that states its own unit, such as PTX, takes precedence.
    #[serde(default)]
    pub unit: Unit,
    /// Axes of the range file's coordinates, unless its format defines them, such as ABS.
    #[serde(default)]
    pub axes: Axes,
}

impl Node for ReadCapture {
    type Outputs = (Image, RangeImage);
    const OUTPUTS: [&'static str; 2] = ["color", "range"];

    fn files(&self) -> Vec<FilePath> {
        self.camera_source().files()
    }

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        let (color, range) =
            (sizes.file::<Image>(&self.color), sizes.file::<RangeImage>(&self.range));
        Some(Forecast::new([color, range]))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (color, range) = (cx.file(&self.color)?, cx.file(&self.range)?);
        let camera = self.camera_source().read(cx)?;
        let ending = range.extension();
        let image = color.read(read_picture)?;
        exif::stored_note(color.bytes()).into_iter().for_each(|note| cx.warn(note));
        let range = match range.read(|bytes| {
            range_file::read(bytes, &ending, camera.as_ref(), self.unit, self.axes, &|note| {
                cx.warn(note);
            })
        }) {
            // The format belongs to another pack, whose importer takes care of units and axes.
            Err(error) if is_unknown(&error) => cx.read(&self.range)?,
            range => range?,
        };
        register(image, range, camera.as_ref())
    }
}

impl ReadCapture {
    fn camera_source(&self) -> CameraSource<'_> {
        CameraSource { range: &self.range, camera: &self.camera, unit: self.unit }
    }
}

/// Reads a picture as stored, and the grid in a range file with the extension `ending`, in mm, x right, y down, z away from the sensor. If
/// the cameras are known, picture and grid are registered to each other by `K_color K_range^-1`, with `K` the intrinsic matrix of a camera.
/// Otherwise the corners of both are aligned.
///
/// # Errors
/// Returns an error if a file cannot be read, or if a camera is for a picture or grid of another size.
pub fn read_capture(
    color: &[u8],
    range: &[u8],
    ending: &str,
    camera: Option<&CameraFile>,
    unit: Unit,
    axes: Axes,
) -> Result<(Image, RangeImage), Error> {
    let image = read_picture(color)?;
    register(image, range_file::read(range, ending, camera, unit, axes, &|_| ())?, camera)
}

fn read_picture(bytes: &[u8]) -> Result<Image, Error> {
    picture_file::read(bytes)
        .map_err(|error| Error::new(format!("the picture cannot be read: {error}")))
}

/// Registers a picture and a grid that were taken together. Without a camera, their corners are aligned.
fn register(
    image: Image,
    range: RangeImage,
    camera: Option<&CameraFile>,
) -> Result<(Image, RangeImage), Error> {
    let (picture, grid) = ([image.width(), image.height()], [range.width(), range.height()]);
    let Some(camera) = camera else {
        return Ok((image, range.with_registration(Registration::corners(grid, picture))));
    };
    let Some(color) = camera.color else {
        bail!(
            "the camera file has no camera for the picture: add `color` with `fx`, `fy`, `cx`, `cy` beside `range`, or use `ReadRange` to \
             read the grid alone"
        );
    };
    check_view("picture", &color, picture)?;
    check_view("range grid", &camera.range, grid)?;
    let range = camera.apply_to(range, Some(picture));
    Ok((image.with_camera(Some(color.pinhole)), range))
}

#[cfg(test)]
mod tests {
    use maquette_format::png;
    use maquette_value::Pinhole;

    use super::super::range_file::read_camera;
    use super::*;

    const CAMERA: &str = r#"{
        "color": { "width": 4, "height": 2, "fx": 40, "fy": 40, "cx": 1.5, "cy": 0.5 },
        "range": { "width": 2, "height": 2, "fx": 20, "fy": 20, "cx": 0.75, "cy": 0.25 }
    }"#;

    fn png() -> Vec<u8> {
        png::encode_rgb(&Image::new(4, 2, vec![[1, 2, 3]; 8]).unwrap()).unwrap()
    }

    fn pcd() -> String {
        "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 2\nDATA ascii\n\
         1 2 3\nnan nan nan\n4 5 6\n0 0 0\n"
            .into()
    }

    fn read(camera: Option<&str>, unit: Unit) -> Result<(Image, RangeImage), Error> {
        let camera = camera.map(|camera| read_camera(camera.as_bytes())).transpose()?;
        read_capture(&png(), pcd().as_bytes(), "pcd", camera.as_ref(), unit, Axes::Camera)
    }

    #[test]
    fn two_pinholes_register_the_grid_to_the_picture() {
        let (image, range) = read(Some(CAMERA), Unit::Mm).unwrap();
        assert_eq!(range.n_valid(), 2);
        assert_eq!(range.registration().picture_from_range([1.0, 1.0]), [2.0, 2.0]);
        assert_eq!(range.registration().picture, [4, 2]);
        assert_eq!(image.camera().unwrap().center, [1.5, 0.5]);
        assert_eq!(range.camera(), Some(&Pinhole { focal: [20.0; 2], center: [0.75, 0.25] }));
    }

    #[test]
    fn a_camera_file_must_have_a_camera_for_the_picture() {
        let camera = r#"{ "range": { "fx": 20, "fy": 20, "cx": 0.75, "cy": 0.25 } }"#;
        let error = read(Some(camera), Unit::Mm).unwrap_err().to_string();
        assert!(error.starts_with("the camera file has no camera for the picture"), "{error}");
    }

    #[test]
    fn without_a_camera_file_the_corners_of_both_grids_are_aligned() {
        let (image, range) = read(None, Unit::Mm).unwrap();
        assert_eq!(range.registration().picture_from_range([0.0, 0.0]), [0.5, 0.0]);
        assert_eq!((image.camera(), range.camera()), (None, None));
    }

    #[test]
    fn every_unit_is_converted_to_millimeters() {
        for (unit, factor) in
            [(Unit::Mm, 1.0), (Unit::Cm, 10.0), (Unit::M, 1000.0), (Unit::Inch, 25.4)]
        {
            let (_, range) = read(None, unit).unwrap();
            assert_eq!(range.point(0).unwrap().z, 3.0 * factor);
            assert_eq!(range.n_valid(), 2);
        }
    }

    #[test]
    fn a_camera_file_of_another_size_is_rejected() {
        fn error(from: &str, to: &str) -> Error {
            read(Some(&CAMERA.replacen(from, to, 1)), Unit::Mm).unwrap_err()
        }
        assert_eq!(
            error("\"width\": 4", "\"width\": 5").to_string(),
            "the camera file is for a picture of [5, 2], but the file has [4, 2]"
        );
        assert_eq!(
            error("\"width\": 2", "\"width\": 5").to_string(),
            "the camera file is for a range grid of [5, 2], but the file has [2, 2]"
        );
    }

    #[test]
    fn errors_name_the_file_that_cannot_be_read() {
        fn read_plain(color: &[u8], range: &[u8], ending: &str) -> Error {
            read_capture(color, range, ending, None, Unit::Mm, Axes::Camera).unwrap_err()
        }
        let error = read_plain(b"", pcd().as_bytes(), "pcd");
        assert!(error.to_string().starts_with("the picture cannot be read: "), "{error}");
        let error = read_plain(&png(), b"", "xyz");
        let expected = "cannot read a range grid from `.xyz`: expected one of pcd, ply";
        assert!(error.to_string().starts_with(expected), "{error}");
        let error = read(Some("{}"), Unit::Mm).unwrap_err();
        assert!(error.to_string().starts_with("the camera file cannot be read: "), "{error}");
    }
}
