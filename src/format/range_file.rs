//! Range grids, whatever file they are in, brought to one form: x right, y down, z away from the sensor, mm, row 0 on top.

use maquette_node::reading::{FileReader, Reading};
use maquette_syntax::error;
use maquette_value::{RangeImage, SizeError};
use nalgebra::{Matrix4, Point3};
use thiserror::Error;

use super::camera::{self, CameraFile};
use super::{abs, depth, pcd, ply, ptx};

/// How the coordinates of a range file lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// x right, y down, z away from the sensor.
    Camera,
    /// x right, y up, z towards the sensor.
    YUp,
}

/// A range grid in the coordinates of its file, and what the file says of them.
#[derive(Clone, Debug)]
pub struct RangeFile {
    /// The grid, with coordinates as they are in the file.
    pub range: RangeImage,
    /// Millimeters per unit, if the format or the file says so.
    pub unit: Option<f64>,
    /// How the coordinates lie, if the format or the file says so.
    pub axes: Option<Axes>,
    /// Which row is the upper one.
    pub rows: Rows,
    /// Warnings about what is left out.
    pub notes: Vec<String>,
}

/// In which order a file has its rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rows {
    /// The upper row first.
    TopFirst,
    /// Not said: the points' y says it.
    ByHeight,
}

/// A file of another format.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("no range grid can be read from `.{ending}`; known are {}", endings())]
pub struct UnknownEnding {
    /// The ending of the file's name, without the dot.
    pub ending: String,
}

type Reader = fn(&[u8], Option<&CameraFile>) -> Result<RangeFile, error::Error>;

/// What reads the files of each ending.
const READERS: &[(&str, Reader)] = &[
    ("pcd", |bytes, _| {
        let (range, notes) = pcd::read_range(bytes)?;
        Ok(RangeFile { notes, ..range.into() })
    }),
    ("ply", |bytes, _| Ok(ply::read_range(bytes)?)),
    ("ptx", |bytes, _| Ok(ptx::read(bytes)?)),
    ("abs", |bytes, _| Ok(abs::read(bytes)?)),
    ("png", |bytes, camera| Ok(depth::read(bytes, camera)?)),
    ("tiff", |bytes, camera| Ok(depth::read(bytes, camera)?)),
    ("tif", |bytes, camera| Ok(depth::read(bytes, camera)?)),
    ("exr", |bytes, camera| Ok(depth::read(bytes, camera)?)),
];

fn endings() -> String {
    READERS.iter().map(|reader| reader.0).collect::<Vec<_>>().join(", ")
}

/// The range grid in a file whose name ends in `ending`: `pcd`, `ply`, `ptx`, `abs`, or a depth map, `png` or `tiff`, which
/// needs the camera.
///
/// # Errors
/// If the ending is another one, the bytes are no such file, or a depth map has no camera.
pub fn read(
    bytes: &[u8],
    ending: &str,
    camera: Option<&CameraFile>,
) -> Result<RangeFile, error::Error> {
    let reader = READERS.iter().find(|reader| reader.0 == ending);
    let (_, read) = reader.ok_or_else(|| UnknownEnding { ending: ending.to_owned() })?;
    read(bytes, camera)
}

impl From<RangeImage> for RangeFile {
    fn from(range: RangeImage) -> Self {
        Self { range, unit: None, axes: None, rows: Rows::TopFirst, notes: Vec::new() }
    }
}

impl RangeFile {
    /// The grid in mm, x right, y down, z away from the sensor, row 0 on top. `unit`, in mm, and `axes` stand for what the file
    /// does not say.
    ///
    /// # Errors
    /// None for a grid that was read: its columns are equally long.
    pub fn normalize(self, unit: f64, axes: Axes) -> Result<RangeImage, SizeError> {
        let unit = self.unit.unwrap_or(unit);
        let turned = self.axes.unwrap_or(axes) == Axes::YUp;
        let range = self.range;
        let range = match (unit == 1.0, turned) {
            (true, false) => range,
            _ => {
                let sign = if turned { -unit } else { unit };
                let points = range
                    .points()
                    .iter()
                    .map(|p| Point3::new(p.x * unit, p.y * sign, p.z * sign))
                    .collect();
                let pose = range.world_from_camera().filter(|_| turned);
                let pose = pose.map(|pose| pose * Matrix4::from_diagonal(&HALF_TURN.into()));
                let moved = range.with_points(points)?;
                if pose.is_some() { moved.with_world_from_camera(pose) } else { moved }
            }
        };
        match self.rows {
            Rows::TopFirst => Ok(range),
            Rows::ByHeight if grows_upwards(&range) => upside_down(&range),
            Rows::ByHeight => Ok(range),
        }
    }
}

/// Half a turn about x, as the diagonal of its matrix: what turns y and z round.
const HALF_TURN: [f64; 4] = [1.0, -1.0, -1.0, 1.0];

/// Whether a cell is on the whole above the one before it in its column, y pointing down.
fn grows_upwards(range: &RangeImage) -> bool {
    let width = range.width();
    let cells = range.points().len().saturating_sub(width);
    (0..cells)
        .filter_map(|cell: usize| Some(range.point(cell + width)?.y - range.point(cell)?.y))
        .sum::<f64>()
        < 0.0
}

/// The same grid with its rows in the opposite order.
fn upside_down(range: &RangeImage) -> Result<RangeImage, SizeError> {
    fn reversed<T: Copy>(items: &[T], width: usize) -> Vec<T> {
        items.chunks_exact(width.max(1)).rev().flatten().copied().collect()
    }
    let width = range.width();
    let turned = range.with_points(reversed(range.points(), width))?;
    let filled =
        (0..range.points().len()).map(|cell| u8::from(range.is_filled(cell))).collect::<Vec<_>>();
    let turned = turned.with_filled(reversed(&filled, width))?;
    Ok(match range.colors() {
        Some(colors) => turned.with_colors(reversed(colors, width))?,
        None => turned,
    })
}

/// Reads a range image in mm; `camera.json` beside it says which camera took it, and where it is in the picture of the same capture.
pub(crate) struct RangeFiles;

impl FileReader for RangeFiles {
    type Value = RangeImage;
    const ENDINGS: &'static [&'static str] =
        &["pcd", "ply", "ptx", "abs", "png", "tiff", "tif", "exr"];

    fn read(file: &Reading<'_>) -> Result<RangeImage, error::Error> {
        let camera = file.companion(camera::NAME).ok();
        let camera = camera.map(|bytes| camera::read(&bytes)).transpose()?;
        let range = read(file.bytes(), &file.ending(), camera.as_ref())?;
        let notes = camera.iter().flat_map(|camera| &camera.notes).chain(&range.notes);
        notes.for_each(|note| file.doubt(note));
        let range = range.normalize(1.0, Axes::Camera)?;
        Ok(
            match camera.filter(|camera| {
                camera.range.size.is_none_or(|size| size == [range.width(), range.height()])
            }) {
                Some(camera) => camera.over(range, camera.color.and_then(|color| color.size)),
                None => range,
            },
        )
    }
}

#[cfg(test)]
pub(super) mod tests {
    use maquette_value::Rgb;

    use super::*;

    const GRID: &str = include_str!("../../tests/data/formats/grid.json");

    /// The points and colors that every file of the test grid holds; no point for a hole.
    pub(crate) fn grid() -> (Vec<Option<[f64; 3]>>, Vec<Rgb>) {
        let grid: serde_json::Value = serde_json::from_str(GRID).unwrap();
        let points: Vec<Vec<_>> = serde_json::from_value(grid["xyz"].clone()).unwrap();
        let colors: Vec<Vec<_>> = serde_json::from_value(grid["rgb"].clone()).unwrap();
        (points.concat(), colors.concat())
    }

    /// Checks that a range image is the test grid, to this distance in mm; colors count where a cell is valid.
    pub(crate) fn is_grid(range: &RangeImage, colored: bool, tolerance: f64) {
        assert_eq!((range.width(), range.height()), (8, 6));
        let (points, colors) = grid();
        for cell in 0..48 {
            match (range.point(cell), points[cell]) {
                (None, None) => continue,
                (Some(found), Some(expected)) => {
                    let error = (found - Point3::from(expected)).norm();
                    assert!(error <= tolerance, "cell {cell}: {found} is no {expected:?}");
                }
                (found, expected) => panic!("cell {cell}: {found:?} is no {expected:?}"),
            }
            if colored {
                assert_eq!(range.colors().unwrap()[cell], colors[cell], "cell {cell}");
            }
        }
        assert!(colored || range.colors().is_none());
    }

    #[test]
    fn every_file_gives_the_same_grid() {
        macro_rules! file {
            ($name:literal) => {
                ($name, include_bytes!(concat!("../../tests/data/formats/", $name)).as_slice())
            };
        }
        let camera = camera::read(GRID.as_bytes()).unwrap();
        let camera = CameraFile { depth_per_mm: Some(50.0), ..camera };
        // Exact to the digits in the file: single precision, six digits, 1/50 mm.
        let files = [
            (file!("ascii.pcd"), true, 0.0),
            (file!("binary.pcd"), true, 0.0),
            (file!("binary_norgb.pcd"), false, 0.0),
            (file!("compressed_rgba.pcd"), true, 0.0),
            (file!("odd_fields.pcd"), true, 0.0),
            (file!("range_grid_ascii.ply"), true, 1e-4),
            (file!("range_grid_crlf.ply"), true, 1e-4),
            (file!("range_grid_le.ply"), true, 0.0),
            (file!("range_grid_be.ply"), true, 0.0),
            (file!("rgb.ptx"), true, 1e-4),
            (file!("norgb.ptx"), false, 1e-4),
            (file!("minolta.abs"), false, 1e-6),
            (file!("depth16.png"), false, 1e-5),
            (file!("depth32f.tiff"), false, 1e-5),
        ];
        for ((name, bytes), colored, tolerance) in files {
            let ending = name.rsplit('.').next().unwrap();
            let range = read(bytes, ending, Some(&camera)).unwrap();
            is_grid(&range.normalize(1.0, Axes::Camera).unwrap(), colored, tolerance);
        }
    }

    #[test]
    fn a_grid_with_y_up_is_turned_and_scaled() {
        let points = vec![Point3::new(1.0, 2.0, -3.0), Point3::new(1.0, 1.0, -3.0)];
        let colors = vec![[1; 3], [2; 3]];
        let range = RangeImage::new(1, 2, points).unwrap().with_colors(colors).unwrap();
        fn file(rows: Rows, range: &RangeImage) -> RangeFile {
            RangeFile { rows, ..range.clone().into() }
        }
        let turned = file(Rows::ByHeight, &range).normalize(1000.0, Axes::YUp).unwrap();
        assert_eq!(turned.points()[0], Point3::new(1000.0, -2000.0, 3000.0));
        // Taken as a camera's, its first row is the lower one.
        let flipped = file(Rows::ByHeight, &range).normalize(1.0, Axes::Camera).unwrap();
        assert_eq!(flipped.points()[0], Point3::new(1.0, 1.0, -3.0));
        assert_eq!(flipped.colors().unwrap(), [[2; 3], [1; 3]]);
        let kept = file(Rows::TopFirst, &range).normalize(1.0, Axes::Camera).unwrap();
        assert_eq!(kept.points()[0], Point3::new(1.0, 2.0, -3.0));
    }

    #[test]
    fn a_turned_grid_is_at_the_same_place_of_the_world() {
        let pose = Matrix4::new_translation(&nalgebra::Vector3::new(1.0, 2.0, 3.0));
        let range = RangeImage::new(1, 1, vec![Point3::new(4.0, 5.0, 6.0)]).unwrap();
        let file = RangeFile::from(range.with_world_from_camera(Some(pose)));
        let turned = file.normalize(1.0, Axes::YUp).unwrap();
        let place = turned.world_from_camera().unwrap().transform_point(&turned.points()[0]);
        assert_eq!(place, Point3::new(5.0, 7.0, 9.0));
    }

    #[test]
    fn what_a_file_says_of_itself_counts_more_than_what_is_said_of_it() {
        let range = RangeImage::new(1, 1, vec![Point3::new(1.0, 2.0, 3.0)]).unwrap();
        let file = RangeFile { unit: Some(10.0), axes: Some(Axes::YUp), ..range.into() };
        let normal = file.normalize(1000.0, Axes::Camera).unwrap();
        assert_eq!(normal.points()[0], Point3::new(10.0, -20.0, -30.0));
    }

    #[test]
    fn another_ending_is_an_error_that_lists_the_known_ones() {
        let error = read(b"", "xyz", None).unwrap_err();
        let text = "no range grid can be read from `.xyz`; known are pcd, ply, ptx, abs, png, tiff, tif, exr";
        assert_eq!(error.to_string(), text);
    }
}
