//! Depth maps: z per pixel, as 16-bit PNG, or as TIFF or OpenEXR of floats, which a pinhole makes points of. Written as PNG with its camera
//! file.

use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::error;
use maquette_value::{Pinhole, RangeImage};
use serde_json::json;
use thiserror::Error;

use super::camera::CameraFile;
use super::picture_kind::Kind;
use super::range_file::{Axes, RangeFile, Rows};
use super::tiff::Depths;
use super::{excerpt, exr, json, png, tiff};

/// Memory that a pixel of a depth map takes: its sample, its depth and its point.
pub(super) const BYTES_PER_PIXEL: usize = 36;

/// Why bytes are not a depth map.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum DepthError {
    /// No camera.
    #[error("a depth map is no points without its camera: there is no camera file")]
    NoCamera,
    /// A camera of another size.
    #[error("the camera file is for a range grid of {expected:?}, but the depth map has {found:?}")]
    Size {
        /// Width and height in the camera file.
        expected: [usize; 2],
        /// Width and height of the depth map.
        found: [usize; 2],
    },
    /// A damaged PNG file, or one of another kind.
    #[error(transparent)]
    Png(#[from] png::PngError),
    /// A damaged TIFF file, or one of another kind.
    #[error(transparent)]
    Tiff(#[from] tiff::TiffError),
    /// A damaged OpenEXR file, or one without depths.
    #[error(transparent)]
    Exr(#[from] exr::ExrError),
    /// Something else.
    #[error("byte 0: the file begins with `{text}`: this is no PNG, TIFF or OpenEXR depth map")]
    Unknown {
        /// How it begins.
        text: String,
    },
}

/// The points of a depth map, seen by the camera's range pinhole. A depth of 0, below 0, not finite or `depth_png.invalid` is a hole.
///
/// Depths are z, not distances along rays, in steps of `depth_png.units_per_mm` of the camera file; if that is not given, the
/// unit is not known. A TIFF of floats has whole units: such a scale is only for whole numbers.
///
/// # Errors
/// If the bytes are no depth map, or its camera is missing or of another size.
pub fn read(bytes: &[u8], camera: Option<&CameraFile>) -> Result<RangeFile, DepthError> {
    let Depths { width, height, depths, whole } = match Kind::of(bytes) {
        Some(Kind::Png) => {
            let (width, height, depths) = png::read_depth(bytes)?;
            let depths = depths.into_iter().map(f64::from).collect();
            Depths { width, height, depths, whole: true }
        }
        Some(Kind::Tiff) => tiff::read_depth(bytes)?,
        Some(Kind::Exr) => exr::read_depth(bytes)?,
        _ => return Err(DepthError::Unknown { text: excerpt(&bytes[..bytes.len().min(8)]) }),
    };
    let camera = camera.ok_or(DepthError::NoCamera)?;
    let found = [width, height];
    if let Some(expected) = camera.range.size.filter(|&expected| expected != found) {
        return Err(DepthError::Size { expected, found });
    }
    let unit = camera.depth_per_mm.filter(|_| whole).map(|steps| 1.0 / steps);
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

/// Why a range image is no depth map.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum NoDepthMap {
    /// No camera.
    #[error(
        "a depth map needs the camera of the range grid, which is not known: write it as PCD or PLY"
    )]
    NoCamera,
    /// A point that no depth stands for.
    #[error("the point of cell ({column}, {row}) is not in front of the camera: z is {depth}")]
    Behind {
        /// The cell's column.
        column: usize,
        /// The cell's row.
        row: usize,
        /// Its depth, in mm.
        depth: f64,
    },
    /// Points beside the pinhole's rays.
    #[error(
        "{count} points do not lie on the rays of their cells, that of cell ({column}, {row}) by {cells:.2} cells: a depth map would move them, write them as PCD or PLY"
    )]
    OffRay {
        /// How many.
        count: usize,
        /// The column of the farthest one.
        column: usize,
        /// Its row.
        row: usize,
        /// How far it is off, in cells.
        cells: f64,
    },
    /// Depths that 16 bits do not span.
    #[error("depths from {nearest} to {farthest} mm are more than a map of 16 bits can tell apart")]
    Span {
        /// The least depth.
        nearest: f64,
        /// The greatest one.
        farthest: f64,
    },
}

/// How far from its ray a point may be, in cells: coordinates of single precision round by 1e-4, a point that was moved is off by
/// far more.
const OFF_RAY: f64 = 0.01;

/// Writes a depth map and its camera file, of the same name with the ending `json`. Colors and the marks of filled cells have no
/// place in it.
///
/// Depths are rounded to steps as fine as 16 bits allow, of a number of steps per mm that begins with 1, 2 or 5. The camera file is
/// one for our readers, with both cameras and the pose, and one of intrinsics for Open3D.
pub(super) struct RangeDepthPng;

impl FileFormat for RangeDepthPng {
    type Value = RangeImage;
    const ENDING: &'static str = "png";

    fn write(range: &RangeImage, name: &str) -> Result<Vec<NewFile>, error::Error> {
        let pinhole = range.camera().ok_or(NoDepthMap::NoCamera)?;
        check(range, pinhole)?;
        let depths = || range.points().iter().map(|point| point.z).filter(|z| !z.is_nan());
        let farthest = depths().fold(0.0, f64::max);
        let nearest = depths().fold(f64::INFINITY, f64::min);
        let per_mm = steps_per_mm(farthest);
        if (nearest * per_mm).round() < 1.0 {
            return Err(NoDepthMap::Span { nearest, farthest }.into());
        }
        // A NaN becomes 0, which is a hole.
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

/// Whether all points are in front of the camera and on the rays of their cells.
fn check(range: &RangeImage, pinhole: &Pinhole) -> Result<(), NoDepthMap> {
    fn place(cell: usize, range: &RangeImage) -> (usize, usize) {
        (cell % range.width(), cell / range.width())
    }
    let (mut count, mut farthest) = (0, (0.0, 0));
    for (cell, point) in range.points().iter().enumerate().filter(|(_, point)| !point.z.is_nan()) {
        let (column, row) = place(cell, range);
        if point.z <= 0.0 {
            return Err(NoDepthMap::Behind { column, row, depth: point.z });
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
    let (cells, (column, row)) = (farthest.0, place(farthest.1, range));
    if count == 0 { Ok(()) } else { Err(NoDepthMap::OffRay { count, column, row, cells }) }
}

/// The largest 1, 2 or 5 times a power of 10 that a depth times it fits in 16 bits; 1 for a depth of 0.
fn steps_per_mm(farthest: f64) -> f64 {
    if farthest == 0.0 {
        return 1.0;
    }
    let most = f64::from(u16::MAX);
    let fits = |per_mm: &f64| farthest * per_mm <= most;
    let (mut down, mut up) = (1.0, 1.0);
    while farthest / down > most {
        down *= 10.0;
    }
    while fits(&(up * 10.0)) {
        up *= 10.0;
    }
    [5.0, 2.0].map(|factor| factor * up / down).into_iter().find(fits).unwrap_or(up / down)
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
        let row = |row: usize| [0, 1, 2, 3].map(|column| pose[(row, column)]);
        camera["world_from_camera_mm"] = json!([0, 1, 2, 3].map(row));
    }
    json::print(&camera)
}

#[cfg(test)]
mod tests {
    use maquette_value::Registration;
    use nalgebra::{Matrix4, Point3};

    use super::*;
    use crate::range_file::tests::is_grid;
    use crate::{camera, hostile};

    const PNG: &[u8] = include_bytes!("../../tests/data/formats/depth16.png");
    const TIFF: &[u8] = include_bytes!("../../tests/data/formats/depth32f.tiff");

    #[test]
    fn an_open3d_intrinsic_file_is_a_camera() {
        let text =
            br#"{"width": 8, "height": 6, "intrinsic_matrix": [10, 0, 0, 0, 10, 0, 3.5, 2.5, 1]}"#;
        let camera = camera::read(text).unwrap();
        let range = read(TIFF, Some(&camera)).unwrap().normalize(1.0, Axes::Camera).unwrap();
        is_grid(&range, false, 1e-5);
        // Steps of 1/50 mm, of which the intrinsic file says nothing.
        let range = read(PNG, Some(&camera)).unwrap().normalize(0.02, Axes::YUp).unwrap();
        is_grid(&range, false, 1e-5);
    }

    #[test]
    fn a_depth_map_needs_a_camera_of_its_size() {
        assert_eq!(read(PNG, None).unwrap_err(), DepthError::NoCamera);
        let camera = br#"{"width": 9, "height": 6, "fx": 10, "fy": 10, "cx": 3.5, "cy": 2.5}"#;
        let camera = camera::read(camera).unwrap();
        let expected =
            "the camera file is for a range grid of [9, 6], but the depth map has [8, 6]";
        assert_eq!(read(PNG, Some(&camera)).unwrap_err().to_string(), expected);
        assert!(matches!(read(b"P5", Some(&camera)), Err(DepthError::Unknown { .. })));
    }

    /// A slope seen by a pinhole, with a hole.
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
    fn what_is_written_is_read_again() {
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
        // The first depth, 600 mm, stands for none.
        let text = String::from_utf8(files[1].bytes.clone()).unwrap();
        let none = text.replacen("\"invalid\": 0", "\"invalid\": 30000", 1);
        let one_less =
            read(&files[0].bytes, Some(&camera::read(none.as_bytes()).unwrap())).unwrap();
        assert_eq!(one_less.range.n_valid(), 46);
        // Open3D's readers take the matrix alone.
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
    fn what_a_depth_map_cannot_hold_is_said() {
        fn error(range: &RangeImage) -> NoDepthMap {
            let error = RangeDepthPng::write(range, "a.png").unwrap_err();
            error.downcast::<NoDepthMap>().cloned().unwrap()
        }
        fn moved(cell: usize, by: [f64; 3]) -> RangeImage {
            let mut points = slope().points().to_vec();
            points[cell] += nalgebra::Vector3::from(by);
            slope().with_points(points).unwrap()
        }
        assert_eq!(error(&slope().with_camera(None)), NoDepthMap::NoCamera);
        let behind = NoDepthMap::Behind { column: 2, row: 1, depth: -363.0 };
        assert_eq!(error(&moved(10, [0.0, 0.0, -1000.0])), behind);
        let off = error(&moved(10, [1.0, 0.0, 0.0]));
        let expected = "1 points do not lie on the rays of their cells, that of cell (2, 1) by 0.14 cells: a depth map would move them, write them as PCD or PLY";
        assert_eq!(off.to_string(), expected);
        let pinhole = Pinhole { focal: [1.0; 2], center: [0.0; 2] };
        let points = vec![Point3::new(0.0, 0.0, 1e-3), Point3::new(1e3, 0.0, 1e3)];
        let deep = RangeImage::new(2, 1, points).unwrap().with_camera(Some(pinhole));
        assert_eq!(error(&deep), NoDepthMap::Span { nearest: 1e-3, farthest: 1e3 });
        let nothing = RangeImage::new(2, 1, vec![Point3::new(f64::NAN, 0.0, 0.0); 2]).unwrap();
        assert!(RangeDepthPng::write(&nothing.with_camera(Some(pinhole)), "a.png").is_ok());
    }

    #[test]
    fn hostile_files_give_errors() {
        let camera = camera::read(br#"{"fx": 10, "fy": 10, "cx": 3.5, "cy": 2.5}"#).unwrap();
        for file in [PNG, TIFF] {
            hostile::survive(file, |bytes| read(bytes, Some(&camera)).is_ok());
        }
    }
}
