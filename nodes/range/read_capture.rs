//! Reads what a range finder took in one shot: a picture and a grid of points, registered to each other.

use maquette::format::camera::{self, CameraError, CameraFile};
use maquette::format::{pcd, png};
use maquette::value::{Image, RangeImage, Registration};
use maquette::{Context, Error, FilePath, Node};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Reads a capture: a picture and a range grid that were taken together.
///
/// The camera file says how both lie on each other. It is JSON: `color` and `range`, each with `fx`, `fy`, `cx`, `cy` in pixels
/// (centers at integers), `width` and `height`; if known, `world_from_camera_mm`. Without one the corners of both grids are aligned.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadCapture {
    /// The picture: a PNG file.
    pub color: FilePath,
    /// The grid of points: an organized PCD file, with x right, y down, z away from the sensor.
    pub range: FilePath,
    /// The camera file; if left out, `camera.json` beside the range file, if there is one.
    #[serde(default)]
    pub camera: FilePath,
    /// The unit of the range file's coordinates; they are converted to mm.
    #[serde(default)]
    pub unit: Unit,
}

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
    fn millimeters(self) -> f64 {
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

/// Why files make no capture.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ReadCaptureError {
    /// The picture cannot be read.
    #[error("the picture cannot be read")]
    Color(#[from] png::PngError),
    /// A range file of another format.
    #[error("no range grid can be read from `.{ending}`; known are {}", endings())]
    Ending {
        /// The ending of the file's name, without the dot.
        ending: String,
    },
    /// The camera file cannot be read.
    #[error("the camera file cannot be read")]
    Camera(#[from] CameraError),
    /// The camera file is that of another capture.
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

impl Node for ReadCapture {
    type Outputs = (Image, RangeImage);
    const OUTPUTS: [&'static str; 2] = ["color", "range"];

    fn files(&self) -> Vec<FilePath> {
        if self.camera.is_empty() { vec![self.camera_beside()] } else { Vec::new() }
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (color, range) = (cx.file(&self.color)?, cx.file(&self.range)?);
        let camera = if self.camera.is_empty() {
            cx.file_if_any(&self.camera_beside())
        } else {
            Some(cx.file(&self.camera)?)
        };
        let camera = camera.map(|file| read_camera(file.bytes())).transpose()?;
        let units = camera.as_ref().and_then(|camera| camera.units.as_deref());
        if let Some(units) = units.filter(|&units| units != self.unit.word()) {
            let given = self.unit;
            cx.warn(format!(
                "the camera file says that the unit is {units}, but `unit` is {given:?}"
            ));
        }
        read_capture(color.bytes(), range.bytes(), &range.ending(), camera.as_ref(), self.unit)
    }
}

impl ReadCapture {
    fn camera_beside(&self) -> FilePath {
        self.range.beside("camera.json")
    }
}

fn read_camera(bytes: &[u8]) -> Result<CameraFile, ReadCaptureError> {
    Ok(camera::read(bytes)?)
}

type Reader = fn(&[u8]) -> Result<RangeImage, Error>;

/// What reads the range files of each ending.
const READERS: &[(&str, Reader)] = &[("pcd", |bytes| Ok(pcd::read(bytes)?))];

fn endings() -> String {
    READERS.iter().map(|reader| reader.0).collect::<Vec<_>>().join(", ")
}

/// The picture in a PNG file and the grid in a range file whose name ends in `ending`, in mm, registered to each other: by the
/// cameras if they are known, K_color K_range^-1, else by the corners of both grids.
///
/// # Errors
/// If a file cannot be read, or the cameras are for grids of other sizes.
pub fn read_capture(
    color: &[u8],
    range: &[u8],
    ending: &str,
    camera: Option<&CameraFile>,
    unit: Unit,
) -> Result<(Image, RangeImage), Error> {
    let image = png::read(color).map_err(ReadCaptureError::Color)?;
    let reader = READERS.iter().find(|reader| reader.0 == ending);
    let (_, read) = reader.ok_or_else(|| ReadCaptureError::Ending { ending: ending.to_owned() })?;
    let range = scale(read(range)?, unit)?;
    let (picture, grid) = ([image.width(), image.height()], [range.width(), range.height()]);
    let Some(camera) = camera else {
        return Ok((image, range.with_registration(Registration::corners(grid, picture))));
    };
    let views = [("picture", camera.color, picture), ("range grid", camera.range, grid)];
    for (what, view, found) in views {
        if let Some(expected) = view.size.filter(|&expected| expected != found) {
            return Err(ReadCaptureError::Size { what, expected, found }.into());
        }
    }
    let (color_camera, range_camera) = (camera.color.pinhole, camera.range.pinhole);
    let range = range
        .with_registration(Registration::pinholes(&range_camera, &color_camera, picture))
        .with_camera(Some(range_camera))
        .with_world_from_camera(camera.world_from_camera);
    Ok((image.with_camera(Some(color_camera)), range))
}

/// The same grid in mm.
fn scale(range: RangeImage, unit: Unit) -> Result<RangeImage, Error> {
    if unit == Unit::Mm {
        return Ok(range);
    }
    let points = range.points().iter().map(|point| point * unit.millimeters()).collect();
    Ok(range.with_points(points)?)
}

#[cfg(test)]
mod tests {
    use maquette::value::Pinhole;

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
        read_capture(&png(), pcd().as_bytes(), "pcd", camera.as_ref(), unit)
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
    fn a_camera_file_of_another_size_is_refused() {
        let error = |from, to| read(Some(&CAMERA.replacen(from, to, 1)), Unit::Mm).unwrap_err();
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
    fn what_cannot_be_read_is_named() {
        let error = read_capture(b"", pcd().as_bytes(), "pcd", None, Unit::Mm).unwrap_err();
        assert!(error.to_string().starts_with("the picture cannot be read: "), "{error}");
        let error = read_capture(&png(), b"", "xyz", None, Unit::Mm).unwrap_err();
        let expected = "no range grid can be read from `.xyz`; known are pcd";
        assert_eq!(error.to_string(), expected);
        let error = read(Some("{}"), Unit::Mm).unwrap_err();
        assert!(error.to_string().starts_with("the camera file cannot be read: "), "{error}");
    }
}
