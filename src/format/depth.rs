//! Depth maps: the z coordinate of each pixel, as a 16-bit PNG, or a TIFF or OpenEXR file of floats. A pinhole camera converts depths to
//! points. Depth maps are written as PNG files with a camera file.

use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::{Pinhole, RangeImage};
use serde_json::json;

use super::camera::CameraFile;
use super::picture_kind::Kind;
use super::range_file::{Axes, RangeFile, Rows};
use super::tiff::Depths;
use super::{excerpt, exr, json, png, tiff};

/// The memory per pixel of a depth map, in bytes: for its sample, its depth and its point.
pub(super) const BYTES_PER_PIXEL: usize = 36;

/// Reads a depth map and converts it to points by the pinhole of the range camera. A depth that is 0, negative, not finite or equal to
/// `depth_png.invalid` is a hole.
///
/// Depths are z coordinates, not distances along rays. Integers are multiplied by the step that `depth_png.units_per_mm` of the camera file
/// states; without this number the unit is unknown. Floats are in whole units and are not scaled.
///
/// Returns an error if the bytes are not a depth map, or its camera is missing or belongs to another size.
pub fn read(bytes: &[u8], camera: Option<&CameraFile>) -> Result<RangeFile, Error> {
    let Depths { width, height, depths, is_integer } = match Kind::detect(bytes) {
        Some(Kind::Png) => {
            let (width, height, depths) = png::read_depth(bytes)?;
            let depths = depths.into_iter().map(f64::from).collect();
            Depths { width, height, depths, is_integer: true }
        }
        Some(Kind::Tiff) => tiff::read_depth(bytes)?,
        Some(Kind::Exr) => exr::read_depth(bytes)?,
        _ => bail!(
            "byte 0: expected a PNG, TIFF or OpenEXR file, found `{}`",
            excerpt(&bytes[..bytes.len().min(8)])
        ),
    };
    let Some(camera) = camera else {
        bail!("a depth map needs a camera file: add one beside it");
    };
    let found = [width, height];
    if let Some(expected) = camera.range.size.filter(|&expected| expected != found) {
        bail!(
            "the camera file is for a range grid of {expected:?}, but the depth map has {found:?}"
        );
    }
    let unit = camera.depth_per_mm.filter(|_| is_integer).map(|steps| 1.0 / steps);
    let pinhole = camera.range.pinhole;
    let points = depths
        .iter()
        .enumerate()
        .map(|(cell, &z)| {
            let is_none = z <= 0.0 || camera.no_depth == Some(z);
            let z = if is_none { f64::NAN } else { z };
            pinhole.unproject([(cell % width) as f64, (cell / width) as f64], z)
        })
        .collect();
    let range = RangeImage::new(width, height, points).expect("there is a depth for each pixel");
    let range = range.with_camera(Some(pinhole));
    let notes = camera.range.center_note(found).into_iter().collect();
    Ok(RangeFile { range, unit, axes: Some(Axes::Camera), rows: Rows::TopFirst, notes })
}

/// The maximum distance of a point from the viewing ray of its cell, in cells. Rounding to single precision moves a point by 1e-4 cells; an
/// edited point is off by far more.
const OFF_RAY: f64 = 0.01;

/// Writes a depth map, and a camera file with the same name and the extension `json`. Colors and the flags of filled cells are lost.
///
/// Depths are rounded to the finest steps that fit in 16 bits; the number of steps per mm is 1, 2 or 5 times a power of ten. The camera
/// file contains both cameras and the pose for the readers of this crate, and the intrinsic matrix for Open3D.
pub(super) struct RangeDepthPng;

impl FileFormat for RangeDepthPng {
    type Value = RangeImage;
    const EXTENSION: &'static str = "png";

    fn write(range: &RangeImage, name: &str) -> Result<Vec<NewFile>, Error> {
        let Some(pinhole) = range.camera() else {
            bail!(
                "a depth map needs the camera of the range grid, which is not known: write it as PCD or PLY"
            );
        };
        check_rays(range, pinhole)?;
        let depths = range.points().iter().map(|point| point.z).filter(|z| !z.is_nan());
        let farthest = depths.clone().fold(0.0, f64::max);
        let nearest = depths.fold(f64::INFINITY, f64::min);
        let per_mm = steps_per_mm(farthest);
        if (nearest * per_mm).round() < 1.0 {
            bail!(
                "depths from {nearest} to {farthest} mm do not fit in 16 bits: write PCD or PLY instead"
            );
        }
        // The cast converts a NaN to 0, which is a hole.
        let steps = range.points().iter().map(|point| (point.z * per_mm).round() as u16);
        let map = NewFile {
            name: name.to_owned(),
            bytes: png::encode_gray([range.width(), range.height()], steps)?,
        };
        let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
        let camera =
            NewFile { name: format!("{stem}.json"), bytes: camera(range, pinhole, per_mm) };
        Ok(vec![map, camera])
    }
}

/// Checks that all points are in front of the camera and on the rays of their cells.
fn check_rays(range: &RangeImage, pinhole: &Pinhole) -> Result<(), Error> {
    fn grid_position(cell: usize, range: &RangeImage) -> (usize, usize) {
        (cell % range.width(), cell / range.width())
    }
    let (mut count, mut farthest) = (0, (0.0, 0));
    for (cell, point) in range.points().iter().enumerate().filter(|(_, point)| !point.z.is_nan()) {
        let (column, row) = grid_position(cell, range);
        if point.z <= 0.0 {
            let z = point.z;
            bail!("the point of cell ({column}, {row}) is not in front of the camera: z is {z}");
        }
        let [x, y] = pinhole.project(*point);
        let off = (x - column as f64).abs().max((y - row as f64).abs());
        if off > OFF_RAY || off.is_nan() {
            count += 1;
            if farthest.0 < off {
                farthest = (off, cell);
            }
        }
    }
    let (cells, (column, row)) = (farthest.0, grid_position(farthest.1, range));
    if count > 0 {
        bail!(
            "{count} points are not on the rays of their cells, at most {cells:.2} cells off at cell ({column}, {row}): write PCD or PLY instead"
        );
    }
    Ok(())
}

/// Returns the number of depth steps per mm: the largest number of the form 1, 2 or 5 times a power of 10 whose product with `farthest`
/// fits in 16 bits; 1 if `farthest` is 0.
fn steps_per_mm(farthest: f64) -> f64 {
    if farthest == 0.0 {
        return 1.0;
    }
    let max_steps = f64::from(u16::MAX);
    let (mut down, mut up) = (1.0, 1.0);
    while farthest / down > max_steps {
        down *= 10.0;
    }
    while farthest * (up * 10.0) <= max_steps {
        up *= 10.0;
    }
    [5.0, 2.0]
        .map(|factor| factor * up / down)
        .into_iter()
        .find(|per_mm| farthest * per_mm <= max_steps)
        .unwrap_or(up / down)
}

fn camera(range: &RangeImage, pinhole: &Pinhole, per_mm: f64) -> Vec<u8> {
    fn view(pinhole: &Pinhole, [width, height]: [usize; 2]) -> serde_json::Value {
        let ([fx, fy], [cx, cy]) = (pinhole.focal, pinhole.center);
        json!({ "width": width, "height": height, "fx": fx, "fy": fy, "cx": cx, "cy": cy })
    }
    let size = [range.width(), range.height()];
    let ([fx, fy], [cx, cy]) = (pinhole.focal, pinhole.center);
    let picture = range.registration();
    let mut camera = json!({
        "units": "mm",
        "color": view(&picture.pinhole_of_picture(pinhole), picture.picture),
        "range": view(pinhole, size),
        "depth_png": { "units_per_mm": per_mm, "invalid": 0, "meaning": "z, not distance along the ray" },
        "width": size[0],
        "height": size[1],
        "intrinsic_matrix": [fx, 0.0, 0.0, 0.0, fy, 0.0, cx, cy, 1.0],
    });
    if let Some(pose) = range.world_from_camera() {
        let rows = [0, 1, 2, 3].map(|row| [0, 1, 2, 3].map(|column| pose[(row, column)]));
        camera["world_from_camera_mm"] = json!(rows);
    }
    json::print(&camera)
}

#[cfg(test)]
mod tests {
    use maquette_value::Registration;
    use nalgebra::{Matrix4, Point3};

    use super::*;
    use crate::range_file::tests::assert_is_grid;
    use crate::{camera, hostile};

    const PNG: &[u8] = include_bytes!("../../tests/data/formats/depth16.png");
    const TIFF: &[u8] = include_bytes!("../../tests/data/formats/depth32f.tiff");

    #[test]
    fn an_open3d_intrinsic_file_is_a_camera() {
        let text =
            br#"{"width": 8, "height": 6, "intrinsic_matrix": [10, 0, 0, 0, 10, 0, 3.5, 2.5, 1]}"#;
        let camera = camera::read(text).unwrap();
        let range = read(TIFF, Some(&camera)).unwrap().normalize(1.0, Axes::Camera).unwrap();
        assert_is_grid(&range, false, 1e-5);
        // The depths are in steps of 1/50 mm; the file with the intrinsic matrix states no scale.
        let range = read(PNG, Some(&camera)).unwrap().normalize(0.02, Axes::YUp).unwrap();
        assert_is_grid(&range, false, 1e-5);
    }

    #[test]
    fn a_depth_map_needs_a_camera_of_its_size() {
        let no_camera = read(PNG, None).unwrap_err().to_string();
        assert_eq!(no_camera, "a depth map needs a camera file: add one beside it");
        let camera = br#"{"width": 9, "height": 6, "fx": 10, "fy": 10, "cx": 3.5, "cy": 2.5}"#;
        let camera = camera::read(camera).unwrap();
        let expected =
            "the camera file is for a range grid of [9, 6], but the depth map has [8, 6]";
        assert_eq!(read(PNG, Some(&camera)).unwrap_err().to_string(), expected);
        assert_eq!(
            read(b"P5", Some(&camera)).unwrap_err().to_string(),
            "byte 0: expected a PNG, TIFF or OpenEXR file, found `P5`"
        );
    }

    /// Creates a slope seen by a pinhole camera, with a hole.
    fn slope() -> RangeImage {
        let pinhole = Pinhole { focal: [90.0, 95.0], center: [3.25, 2.5] };
        let color = Pinhole { focal: [180.0, 190.0], center: [7.0, 5.5] };
        RangeImage::new(
            8,
            6,
            (0..48)
                .map(|cell: usize| {
                    let z = if cell == 9 { f64::NAN } else { 600.0 + 3.7 * cell as f64 };
                    pinhole.unproject([(cell % 8) as f64, (cell / 8) as f64], z)
                })
                .collect(),
        )
        .unwrap()
        .with_camera(Some(pinhole))
        .with_registration(Registration::pinholes(&pinhole, &color, [16, 12]))
        .with_world_from_camera(Some(Matrix4::new_translation(&[1.0, 2.0, 3.5].into())))
    }

    #[test]
    fn a_written_map_is_read_back() {
        let range = slope();
        let files = RangeDepthPng::write(&range, "a.b.png").unwrap();
        assert_eq!([&*files[0].name, &*files[1].name], ["a.b.png", "a.b.json"]);
        let camera = camera::read(&files[1].bytes).unwrap();
        assert_eq!(camera.depth_per_mm, Some(50.0));
        assert_eq!(camera.world_from_camera, range.world_from_camera().copied());
        let [grid, picture] = [camera.range, camera.color.unwrap()];
        assert_eq!((grid.size, picture.size), (Some([8, 6]), Some([16, 12])));
        let map = Registration::pinholes(&grid.pinhole, &picture.pinhole, [16, 12]);
        assert_eq!(&map, range.registration());
        let again = read(&files[0].bytes, Some(&camera)).unwrap();
        let again = again.normalize(1.0, Axes::YUp).unwrap();
        assert_eq!((again.n_valid(), again.camera()), (47, range.camera()));
        for (cell, point) in range.points().iter().enumerate().filter(|(cell, _)| *cell != 9) {
            assert!((again.points()[cell].z - point.z).abs() <= 0.01 + 1e-12);
            assert!((again.points()[cell] - point).norm() <= 0.0101);
        }
        // In this camera file the first depth, 600 mm, marks invalid pixels.
        let text = String::from_utf8(files[1].bytes.clone()).unwrap();
        let none = text.replacen("\"invalid\": 0", "\"invalid\": 30000", 1);
        let one_less =
            read(&files[0].bytes, Some(&camera::read(none.as_bytes()).unwrap())).unwrap();
        assert_eq!(one_less.range.n_valid(), 46);
        // If the cameras have unknown names, the intrinsic matrix is read.
        let matrix = text.replace("\"range\"", "\"r\"").replace("\"color\"", "\"c\"");
        assert_eq!(camera::read(matrix.as_bytes()).unwrap().range, grid);
    }

    #[test]
    fn steps_are_as_fine_as_16_bits_allow() {
        for (farthest, per_mm) in [
            (700.0, 50.0),
            (65_535.0, 1.0),
            (65_536.0, 0.5),
            (1e9, 5e-5),
            (6.5535, 10_000.0),
            (0.0, 1.0),
        ] {
            assert!((steps_per_mm(farthest) / per_mm - 1.0).abs() <= 1e-15, "{farthest}");
        }
        for farthest in [1e-300, 1e300, f64::MAX] {
            let steps = farthest * steps_per_mm(farthest);
            assert!((20_000.0..=65_535.0).contains(&steps), "{farthest} {steps}");
        }
    }

    #[test]
    fn ranges_that_a_depth_map_cannot_hold_give_errors() {
        fn error(range: &RangeImage) -> String {
            RangeDepthPng::write(range, "a.png").unwrap_err().to_string()
        }
        fn slope_with_moved_point(cell: usize, by: [f64; 3]) -> RangeImage {
            let mut points = slope().points().to_vec();
            points[cell] += nalgebra::Vector3::from(by);
            slope().with_points(points).unwrap()
        }
        assert_eq!(
            error(&slope().with_camera(None)),
            "a depth map needs the camera of the range grid, which is not known: write it as PCD or PLY"
        );
        assert_eq!(
            error(&slope_with_moved_point(10, [0.0, 0.0, -1000.0])),
            "the point of cell (2, 1) is not in front of the camera: z is -363"
        );
        assert_eq!(
            error(&slope_with_moved_point(10, [1.0, 0.0, 0.0])),
            "1 points are not on the rays of their cells, at most 0.14 cells off at cell (2, 1): write PCD or PLY instead"
        );
        let pinhole = Pinhole { focal: [1.0; 2], center: [0.0; 2] };
        let points = vec![Point3::new(0.0, 0.0, 1e-3), Point3::new(1e3, 0.0, 1e3)];
        let deep = RangeImage::new(2, 1, points).unwrap().with_camera(Some(pinhole));
        assert_eq!(
            error(&deep),
            "depths from 0.001 to 1000 mm do not fit in 16 bits: write PCD or PLY instead"
        );
        let nothing = RangeImage::new(2, 1, vec![Point3::new(f64::NAN, 0.0, 0.0); 2]).unwrap();
        assert!(RangeDepthPng::write(&nothing.with_camera(Some(pinhole)), "a.png").is_ok());
    }

    #[test]
    fn hostile_files_give_errors() {
        let camera = camera::read(br#"{"fx": 10, "fy": 10, "cx": 3.5, "cy": 2.5}"#).unwrap();
        for file in [PNG, TIFF] {
            hostile::check_no_panic(file, |bytes| read(bytes, Some(&camera)).is_ok());
        }
    }
}
