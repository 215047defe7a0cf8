//! The camera file of a capture: the pinhole cameras of its picture and range grid.

use std::iter;

use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::{Pinhole, RangeImage, Registration};
use nalgebra::{Matrix3, Matrix4};
use serde_json::Value;

/// The name of a camera file that is valid for all captures in its folder.
pub const NAME: &str = "camera.json";

/// The cameras of a capture. Both cameras have the same position and orientation.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraFile {
    /// The camera of the picture, if the file has one.
    pub color: Option<View>,
    /// The camera of the range grid.
    pub range: View,
    /// The unit of the range file, if the file names one: `mm`, `m` and so on.
    pub units: Option<String>,
    /// The rigid motion from the sensor's frame to the world's, in mm, if the file has one.
    pub world_from_camera: Option<Matrix4<f64>>,
    /// The number of integer depth steps per millimeter, if the file gives it.
    pub depth_per_mm: Option<f64>,
    /// The value, besides 0, that marks pixels without depth in a depth map, if the file gives it.
    pub no_depth: Option<f64>,
    /// Warnings about keys that are known but not used.
    pub notes: Vec<String>,
}

/// One camera of a capture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The projection of the camera.
    pub pinhole: Pinhole,
    /// Width and height of the camera's images in pixels, if the file gives them.
    pub size: Option<[usize; 2]>,
}

impl View {
    /// Returns a warning if the principal point is outside a grid of the size `found`: the intrinsic parameters may belong to a larger
    /// picture.
    pub fn center_note(&self, found: [usize; 2]) -> Option<String> {
        let [x, y] = self.pinhole.center;
        fn is_on(x: f64, size: usize) -> bool {
            (-0.5..=size as f64 - 0.5).contains(&x)
        }
        (self.size.is_none() && !(is_on(x, found[0]) && is_on(y, found[1]))).then(|| {
            format!(
                "the camera's center ({x}, {y}) is outside the grid of {} x {} cells: its numbers may be for another size; add `width` and `height` to the camera file",
                found[0], found[1]
            )
        })
    }
}

impl CameraFile {
    /// Adds the range camera and the pose of this file to `range`. If this file has no pose, the grid keeps its own. If `picture` (width,
    /// height) and the color camera are given, also adds the registration of the grid in the picture: the matrix K_color K_range^-1, where
    /// K are the intrinsic matrices of both cameras.
    #[must_use]
    pub fn apply_to(&self, range: RangeImage, picture: Option<[usize; 2]>) -> RangeImage {
        let pose = self.world_from_camera.or(range.world_from_camera().copied());
        let pinhole = self.range.pinhole;
        let range = range.with_camera(Some(pinhole)).with_world_from_camera(pose);
        match picture.zip(self.color) {
            Some((size, color)) => {
                range.with_registration(Registration::pinholes(&pinhole, &color.pinhole, size))
            }
            None => range,
        }
    }
}

/// Reads a camera file: a JSON object with `color` (or `colour`) and `range`, each with the pinhole parameters `fx fy cx cy` and optionally
/// `width` and `height`. The keys `units` and `world_from_camera_mm` (a rigid motion as 4 rows of 4 numbers) are optional. A pinhole at the
/// top level or in `camera` is used for both cameras; a file with only `range` has no color camera. For depth maps,
/// `depth_png.units_per_mm` or `depth_units_per_metre` gives the scale of their integers, and `depth_png.invalid` the value of pixels
/// without depth.
///
/// Files of other programs are accepted, too: a matrix of 9 numbers by rows or by columns in `intrinsic_matrix` (Open3D), `K` (Record3D) or
/// `camera_matrix` (OpenCV), and the keys `fl_x fl_y cx cy w h` (NeRF). A lens distortion, or a depth scale under another name, gives a
/// warning; other keys are ignored.
///
/// Returns an error if the bytes are not JSON, a pinhole is missing, or a number is invalid.
pub fn read(bytes: &[u8]) -> Result<CameraFile, Error> {
    let file: Value = serde_json::from_slice(bytes).map_err(|error| {
        let (line, column) = (error.line(), error.column());
        Error::new(format!("line {line}, column {column}: the file is not JSON"))
    })?;
    let both = file.get("camera").unwrap_or(&file);
    let range = file.get("range");
    let color = file.get("color").or_else(|| file.get("colour"));
    let has_both = ["fx", "fl_x"].iter().chain(&MATRICES).any(|key| both.get(key).is_some());
    let color = color.or((has_both || range.is_none()).then_some(both));
    let pose_rows = file.get("world_from_camera_mm").filter(|rows| !rows.is_null());
    Ok(CameraFile {
        color: color.map(|color| view(color, "color")).transpose()?,
        range: view(range.unwrap_or(both), "range")?,
        units: file.get("units").and_then(Value::as_str).map(str::to_owned),
        world_from_camera: pose_rows.map(pose).transpose()?,
        depth_per_mm: depth_scale(&file)?,
        no_depth: file.get("depth_png").and_then(|depth| depth.get("invalid")?.as_f64()),
        notes: notes(&file),
    })
}

/// The keys under which other programs store the intrinsic matrix of a camera.
const MATRICES: [&str; 3] = ["intrinsic_matrix", "K", "camera_matrix"];

/// The keys under which other programs store lens distortions.
const DISTORTIONS: [&str; 10] = [
    "k1",
    "k2",
    "k3",
    "k4",
    "p1",
    "p2",
    "distortion",
    "distortion_coefficients",
    "dist_coeffs",
    "D",
];

/// The keys of depth scales that have different meanings in different programs.
const DEPTH_SCALES: [&str; 3] = ["depth_scale", "depthScale", "integer_depth_scale"];

/// Returns warnings about keys of cameras that are known but not used.
fn notes(file: &Value) -> Vec<String> {
    let cameras =
        ["camera", "range", "color", "colour"].into_iter().filter_map(|key| file.get(key));
    let cameras: Vec<_> = iter::once(file).chain(cameras).collect();
    let lens = quoted_nonzero(&cameras, &DISTORTIONS);
    let scale = quoted_nonzero(&cameras, &DEPTH_SCALES);
    let lens = (!lens.is_empty()).then(|| {
        format!("the camera file has a lens distortion ({lens}), which is not applied: undistort the pictures first")
    });
    let is_scaled = file.get("depth_png").is_some_and(|depth| depth.get("units_per_mm").is_some());
    let scale = (!scale.is_empty() && !is_scaled).then(|| {
        format!("{scale} of the camera file is not used: write `depth_png: {{units_per_mm: ..}}` instead")
    });
    lens.into_iter().chain(scale).collect()
}

/// Lists, in backticks, the `keys` that have a nonzero value in one of the cameras.
fn quoted_nonzero(cameras: &[&Value], keys: &[&str]) -> String {
    fn is_zero(value: &Value) -> bool {
        numbers(value).iter().all(|&number| number == 0.0)
    }
    keys.iter()
        .filter(|key| {
            cameras.iter().any(|camera| camera.get(**key).is_some_and(|value| !is_zero(value)))
        })
        .map(|key| format!("`{key}`"))
        .collect::<Vec<_>>()
        .join(", ")
}

/// Returns all numbers in a JSON value: the number itself, the numbers of a list or of nested lists, or the numbers under `data`.
fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(values) => values.iter().flat_map(numbers).collect(),
        Value::Object(keys) => keys.get("data").map(numbers).unwrap_or_default(),
        value => value.as_f64().into_iter().collect(),
    }
}

fn depth_scale(file: &Value) -> Result<Option<f64>, Error> {
    let per_mm = file.get("depth_png").and_then(|depth| depth.get("units_per_mm"));
    let per_mm = per_mm.map(|value| ("depth_png.units_per_mm", value, 1.0));
    let per_meter = file.get("depth_units_per_metre");
    let per_meter = per_meter.map(|value| ("depth_units_per_metre", value, 1000.0));
    let Some((key, value, unit)) = per_mm.or(per_meter) else { return Ok(None) };
    let Some(scale) = value.as_f64().filter(|&scale| scale > 0.0) else {
        bail!("`{key}` is {value}: expected a number greater than 0");
    };
    Ok(Some(scale / unit))
}

fn view(camera: &Value, name: &str) -> Result<View, Error> {
    fn number_error(key: &str, value: &Value, wanted: &str, name: &str) -> Error {
        Error::new(format!("`{name}.{key}` is {value}: expected {wanted}"))
    }
    let intrinsics = intrinsics(camera)?;
    // NeRF uses other names for the focal length and the size.
    fn find(from: &Value, key: &str, other: &str) -> Option<Value> {
        from.get(key).or_else(|| from.get(other)).cloned()
    }
    let number = |key: &str| match find(
        intrinsics.as_ref().unwrap_or(camera),
        key,
        &key.replace('f', "fl_"),
    )
    .as_ref()
    {
        None => bail!("the {name} camera has no `{key}`"),
        Some(value) => value.as_f64().ok_or_else(|| number_error(key, value, "a number", name)),
    };
    let focal = |key| match number(key)? {
        length if length > 0.0 => Ok(length),
        length => Err(number_error(key, &length.into(), "a number greater than 0", name)),
    };
    let size = |key: &str| match find(camera, key, &key[..1]).as_ref() {
        None => Ok(None),
        Some(value) => match value.as_u64().and_then(|size| usize::try_from(size).ok()) {
            Some(size) => Ok(Some(size)),
            None => Err(number_error(key, value, "an integer", name)),
        },
    };
    let pinhole =
        Pinhole { focal: [focal("fx")?, focal("fy")?], center: [number("cx")?, number("cy")?] };
    let size = size("width")?.zip(size("height")?).map(|(width, height)| [width, height]);
    Ok(View { pinhole, size })
}

/// Converts a pinhole given as a matrix, by rows or by columns, to the keys `fx fy cx cy`. Returns `None` if the camera has no matrix.
fn intrinsics(camera: &Value) -> Result<Option<Value>, Error> {
    let found = MATRICES.iter().find_map(|key| Some((*key, camera.get(key)?)));
    let Some((key, matrix)) = found else { return Ok(None) };
    let (fx, fy, cx, cy) = match numbers(matrix)[..] {
        [fx, 0.0, 0.0, 0.0, fy, 0.0, cx, cy, 1.0] | [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0] => {
            (fx, fy, cx, cy)
        }
        _ => bail!(
            "`{key}` is not a pinhole: expected 9 numbers, row by row, as in `[fx, 0, cx, 0, fy, cy, 0, 0, 1]`, or column by column, as in `[fx, 0, 0, 0, fy, 0, cx, cy, 1]`"
        ),
    };
    Ok(Some(serde_json::json!({ "fx": fx, "fy": fy, "cx": cx, "cy": cy })))
}

/// The maximum deviation of a rotation matrix from an orthonormal one. Files round to 6 digits or fewer; matrices that are not rotations
/// deviate far more.
const ROTATION_TOLERANCE: f64 = 1e-3;

fn pose(rows: &Value) -> Result<Matrix4<f64>, Error> {
    let rows: Option<[[f64; 4]; 4]> = serde_json::from_value(rows.clone()).ok();
    let pose = rows.map(|rows| Matrix4::from_fn(|row, column| rows[row][column]));
    let Some(pose) = pose.filter(is_rigid) else {
        bail!(
            "`world_from_camera_mm` is not a rigid motion: expected 4 rows of 4 numbers, a rotation and a translation"
        );
    };
    Ok(pose)
}

/// Returns true if the matrix is a rigid motion: a rotation followed by a translation.
pub(super) fn is_rigid(motion: &Matrix4<f64>) -> bool {
    let rotation = motion.fixed_view::<3, 3>(0, 0).into_owned();
    let error = (rotation * rotation.transpose() - Matrix3::identity()).amax();
    error <= ROTATION_TOLERANCE
        && rotation.determinant() > 0.0
        && motion.iter().all(|entry| entry.is_finite())
        && motion.row(3).iter().eq(&[0.0, 0.0, 0.0, 1.0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hostile;

    const FILE: &str = r#"{
        "units": "mm",
        "colour": { "file": "colour.png", "width": 400, "height": 300, "fx": 2800.0, "fy": 2700, "cx": 199.5, "cy": 149.5 },
        "range": { "fx": 1400.0, "fy": 1350.0, "cx": 99.5, "cy": 74.5 },
        "range_to_colour": "colour column = 2 * range column + 0.5; same for rows",
        "world_from_camera_mm": [[0, -1, 0, 5], [1, 0, 0, 6.5], [0, 0, 1, -7], [0, 0, 0, 1]]
    }"#;

    #[test]
    fn both_cameras_and_the_pose_are_read() {
        let file = read(FILE.as_bytes()).unwrap();
        let color = file.color.unwrap();
        assert_eq!(color.size, Some([400, 300]));
        assert_eq!(color.pinhole, Pinhole { focal: [2800.0, 2700.0], center: [199.5, 149.5] });
        assert_eq!(file.range.pinhole, Pinhole { focal: [1400.0, 1350.0], center: [99.5, 74.5] });
        assert_eq!((file.range.size, file.units.as_deref()), (None, Some("mm")));
        assert_eq!(file.world_from_camera.unwrap().column(3).as_slice(), [5.0, 6.5, -7.0, 1.0]);
    }

    #[test]
    fn american_spelling_and_one_pinhole_for_both_are_understood() {
        let american = read(FILE.replace("colour", "color").as_bytes()).unwrap();
        assert_eq!(american, read(FILE.as_bytes()).unwrap());
        let one = br#"{"width": 640, "height": 480, "fx": 1, "fy": 2, "cx": 3, "cy": 4}"#;
        let file = read(one).unwrap();
        assert_eq!(file.color, Some(file.range));
        assert_eq!(file.range.size, Some([640, 480]));
        assert_eq!(file.world_from_camera, None);
    }

    #[test]
    fn the_color_camera_is_optional() {
        let text = r#"{"range": {"fx": 1, "fy": 2, "cx": 3, "cy": 4}}"#;
        let file = read(text.as_bytes()).unwrap();
        assert_eq!((file.color, file.range.pinhole.focal), (None, [1.0, 2.0]));
        let both = text.replacen('{', r#"{"fx": 5, "fy": 6, "cx": 7, "cy": 8, "#, 1);
        assert_eq!(read(both.as_bytes()).unwrap().color.unwrap().pinhole.focal, [5.0, 6.0]);
        let broken = text.replacen('{', r#"{"color": {"width": 5}, "#, 1);
        let missing = "the color camera has no `fx`";
        assert_eq!(read(broken.as_bytes()).unwrap_err().to_string(), missing);
    }

    #[test]
    fn the_steps_of_depth_maps_are_read() {
        let camera = r#""fx": 1, "fy": 2, "cx": 3, "cy": 4"#;
        fn scale(text: &str, camera: &str) -> Result<Option<f64>, String> {
            let file = read(format!("{{{camera}, {text}}}").as_bytes());
            file.map(|file| file.depth_per_mm).map_err(|error| error.to_string())
        }
        assert_eq!(scale(r#""depth_png": {"units_per_mm": 50}"#, camera), Ok(Some(50.0)));
        assert_eq!(scale(r#""depth_units_per_metre": 10000"#, camera), Ok(Some(10.0)));
        assert_eq!(scale(r#""depth_png": {}"#, camera), Ok(None));
        let zero = "`depth_png.units_per_mm` is 0: expected a number greater than 0";
        assert_eq!(scale(r#""depth_png": {"units_per_mm": 0}"#, camera), Err(zero.into()));
    }

    #[test]
    fn pinholes_of_other_programs_are_read() {
        fn view(text: &str) -> View {
            read(text.as_bytes()).unwrap().range
        }
        let pinhole = Pinhole { focal: [1.0, 2.0], center: [3.0, 4.0] };
        for text in [
            r#"{"w": 8, "h": 6, "intrinsic_matrix": [1, 0, 0, 0, 2, 0, 3, 4, 1]}"#,
            r#"{"w": 8, "h": 6, "K": [[1, 0, 3], [0, 2, 4], [0, 0, 1]]}"#,
            r#"{"width": 8, "height": 6, "camera_matrix": {"rows": 3, "data": [1, 0, 3, 0, 2, 4, 0, 0, 1]}}"#,
            r#"{"w": 8, "h": 6, "fl_x": 1, "fl_y": 2, "cx": 3, "cy": 4}"#,
        ] {
            assert_eq!(view(text), View { pinhole, size: Some([8, 6]) }, "{text}");
        }
        let skewed = read(br#"{"K": [1, 9, 3, 0, 2, 4, 0, 0, 1]}"#);
        assert!(skewed.unwrap_err().to_string().starts_with("`K` is not a pinhole: "));
    }

    #[test]
    fn unsupported_keys_give_warnings() {
        fn notes(text: &str) -> Vec<String> {
            let text = format!(r#"{{"fx": 1, "fy": 2, "cx": 3, "cy": 4, {text}}}"#);
            read(text.as_bytes()).unwrap().notes
        }
        assert_eq!(notes(r#""k1": 0.0, "distortion": [0, 0, 0]"#), [""; 0]);
        assert!(notes(r#""k1": 0.1, "p2": -0.2"#)[0].contains("(`k1`, `p2`)"));
        assert!(
            notes(r#""range": {"fx": 1, "fy": 2, "cx": 3, "cy": 4, "D": [0.1]}"#)[0]
                .contains("`D`")
        );
        assert!(
            notes(r#""depth_scale": 0.001"#)[0].starts_with("`depth_scale` of the camera file")
        );
        assert_eq!(notes(r#""depth_scale": 5000, "depth_png": {"units_per_mm": 5}"#), [""; 0]);
    }

    #[test]
    fn a_center_outside_the_grid_gives_a_warning_unless_the_size_is_known() {
        fn view(text: &str) -> View {
            read(text.as_bytes()).unwrap().range
        }
        let camera = r#""fx": 100, "fy": 100, "cx": 47.5, "cy": 31.5"#;
        assert!(view(&format!("{{{camera}}}")).center_note([6, 4]).is_some());
        assert_eq!(view(&format!("{{{camera}}}")).center_note([96, 64]), None);
        assert_eq!(view(&format!("{{{camera}, \"w\": 6, \"h\": 4}}")).center_note([6, 4]), None);
    }

    fn error(from: &str, to: &str) -> String {
        assert!(FILE.contains(from));
        read(FILE.replacen(from, to, 1).as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn errors_name_the_invalid_key() {
        let missing = "the range camera has no `fx`";
        assert_eq!(error("\"range\"", "\"grid\""), missing);
        assert_eq!(error("{ \"fx\": 1400.0,", "{"), missing);
        assert_eq!(error("1400.0", "-1"), "`range.fx` is -1.0: expected a number greater than 0");
        assert_eq!(error("1400.0", "\"a\""), "`range.fx` is \"a\": expected a number");
        assert_eq!(error("400", "0.5"), "`color.width` is 0.5: expected an integer");
        assert_eq!(error(": \"mm\"", " \"mm\""), "line 2, column 17: the file is not JSON");
        let pose = "`world_from_camera_mm` is not a rigid motion: expected 4 rows of 4 numbers, a rotation and a translation";
        assert_eq!(error("-1, 0, 5", "1, 0, 5"), pose);
        assert_eq!(error("[0, -1, 0, 5]", "[0, -2, 0, 5]"), pose);
        assert_eq!(error("[0, -1, 0, 5], ", ""), pose);
    }

    #[test]
    fn hostile_files_give_errors() {
        hostile::check_no_panic(FILE.as_bytes(), read);
    }
}
