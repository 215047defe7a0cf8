//! Reads range grids from files of any format, and converts them to x right, y down, z away from the sensor, mm, row 0 on top.

use maquette_node::importers::{FileReader, InputFile};
use maquette_syntax::error::Error;
use maquette_value::{RangeImage, SizeError};
use nalgebra::{Matrix4, Point3};

use super::camera::{self, CameraFile};
use super::{abs, depth, pcd, ply, ptx};

/// The axes of a range file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// x right, y down, z away from the sensor.
    Camera,
    /// x right, y up, z towards the sensor.
    YUp,
}

/// A range grid with the coordinates of its file, and the properties that the file states.
#[derive(Clone, Debug)]
pub struct RangeFile {
    /// The grid, with the coordinates of the file.
    pub range: RangeImage,
    /// Millimeters per unit of the coordinates, if the format or the file states it.
    pub unit: Option<f64>,
    /// The axes, if the format or the file states them.
    pub axes: Option<Axes>,
    /// The order of the rows.
    pub rows: Rows,
    /// Warnings about data that are left out.
    pub notes: Vec<String>,
}

/// The order of rows in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rows {
    /// The top row first.
    TopFirst,
    /// Not stated; the order is determined from the y coordinates of the points.
    ByHeight,
}

/// The error for an extension (without the dot) that no format of range grids has.
#[derive(Debug, thiserror::Error)]
#[error("cannot read a range grid from `.{}`: expected one of {}", .0, extensions())]
pub struct UnknownExtension(String);

type Reader = fn(&[u8], Option<&CameraFile>) -> Result<RangeFile, Error>;

/// The extensions of range files, each with its reader.
const READERS: &[(&str, Reader)] = &[
    ("pcd", |bytes, _| {
        let (range, notes) = pcd::read_range(bytes)?;
        Ok(RangeFile { notes, ..range.into() })
    }),
    ("ply", |bytes, _| ply::read_range(bytes)),
    ("ptx", |bytes, _| ptx::read(bytes)),
    ("abs", |bytes, _| abs::read(bytes)),
    ("png", depth::read),
    ("tiff", depth::read),
    ("tif", depth::read),
    ("exr", depth::read),
];

fn extensions() -> String {
    READERS.iter().map(|reader| reader.0).collect::<Vec<_>>().join(", ")
}

/// Reads a range grid from a file with the extension `ending`: `pcd`, `ply`, `ptx`, `abs`, or for a depth map `png`, `tiff` or `exr`. A
/// depth map needs `camera`.
///
/// Returns an error if the extension is unknown, the bytes are not such a file, or a depth map has no camera.
pub fn read(bytes: &[u8], ending: &str, camera: Option<&CameraFile>) -> Result<RangeFile, Error> {
    let reader = READERS.iter().find(|reader| reader.0 == ending);
    let (_, read) = reader.ok_or_else(|| UnknownExtension(ending.to_owned()))?;
    read(bytes, camera)
}

impl From<RangeImage> for RangeFile {
    fn from(range: RangeImage) -> Self {
        Self { range, unit: None, axes: None, rows: Rows::TopFirst, notes: Vec::new() }
    }
}

impl RangeFile {
    /// Converts the grid to mm, x right, y down, z away from the sensor, row 0 on top. `unit` (mm per unit) and `axes` are used if the file
    /// does not state its own.
    ///
    /// No error occurs for a grid that was read from a file, because its columns are equally long.
    pub fn normalize(self, unit: f64, axes: Axes) -> Result<RangeImage, SizeError> {
        let unit = self.unit.unwrap_or(unit);
        let is_rotated = self.axes.unwrap_or(axes) == Axes::YUp;
        let range = self.range;
        let range = match (unit == 1.0, is_rotated) {
            (true, false) => range,
            _ => {
                let sign = if is_rotated { -unit } else { unit };
                let points = range
                    .points()
                    .iter()
                    .map(|p| Point3::new(p.x * unit, p.y * sign, p.z * sign))
                    .collect();
                let pose = range.world_from_camera().filter(|_| is_rotated);
                let pose = pose.map(|pose| pose * Matrix4::from_diagonal(&HALF_ROTATION.into()));
                let moved = range.with_points(points)?;
                if pose.is_some() { moved.with_world_from_camera(pose) } else { moved }
            }
        };
        match self.rows {
            Rows::TopFirst => Ok(range),
            Rows::ByHeight if grows_upwards(&range) => flip_rows(&range),
            Rows::ByHeight => Ok(range),
        }
    }
}

/// The diagonal of the matrix that rotates by 180 degrees about x.
const HALF_ROTATION: [f64; 4] = [1.0, -1.0, -1.0, 1.0];

/// Returns true if the rows are in upward order: each cell is on average above the cell of the previous row, where y points down.
fn grows_upwards(range: &RangeImage) -> bool {
    let width = range.width();
    let cells = range.points().len().saturating_sub(width);
    (0..cells)
        .filter_map(|cell: usize| Some(range.point(cell + width)?.y - range.point(cell)?.y))
        .sum::<f64>()
        < 0.0
}

/// Reverses the order of the rows.
fn flip_rows(range: &RangeImage) -> Result<RangeImage, SizeError> {
    fn reverse_rows<T: Copy>(items: &[T], width: usize) -> Vec<T> {
        items.chunks_exact(width.max(1)).rev().flatten().copied().collect()
    }
    let width = range.width();
    let turned = range.with_points(reverse_rows(range.points(), width))?;
    let filled =
        (0..range.points().len()).map(|cell| u8::from(range.is_filled(cell))).collect::<Vec<_>>();
    let turned = turned.with_filled(reverse_rows(&filled, width))?;
    Ok(match range.colors() {
        Some(colors) => turned.with_colors(reverse_rows(colors, width))?,
        None => turned,
    })
}

/// Reads a range image in mm. A file `camera.json` beside the range file gives the camera of the grid, and the registration of the grid in
/// the picture of the capture. Its cameras are ignored if it states another size for the grid.
pub(crate) struct RangeFiles;

impl FileReader for RangeFiles {
    type Value = RangeImage;
    const EXTENSIONS: &'static [&'static str] =
        &["pcd", "ply", "ptx", "abs", "png", "tiff", "tif", "exr"];
    const SIZE: crate::SizeReader = Some(crate::size::range);

    fn read(file: &InputFile<'_>) -> Result<RangeImage, Error> {
        let camera = file.companion(camera::NAME).ok();
        let camera = camera.map(|bytes| camera::read(&bytes)).transpose()?;
        let range = read(file.bytes(), &file.extension(), camera.as_ref())?;
        let notes = camera.iter().flat_map(|camera| &camera.notes).chain(&range.notes);
        notes.for_each(|note| file.warn(note));
        let range = range.normalize(1.0, Axes::Camera)?;
        Ok(
            match camera.filter(|camera| {
                camera.range.size.is_none_or(|size| size == [range.width(), range.height()])
            }) {
                Some(camera) => camera.apply_to(range, camera.color.and_then(|color| color.size)),
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

    /// The points and colors of the test grid, which all test files contain; `None` for a hole.
    pub(crate) fn grid() -> (Vec<Option<[f64; 3]>>, Vec<Rgb>) {
        let grid: serde_json::Value = serde_json::from_str(GRID).unwrap();
        let points: Vec<Vec<_>> = serde_json::from_value(grid["xyz"].clone()).unwrap();
        let colors: Vec<Vec<_>> = serde_json::from_value(grid["rgb"].clone()).unwrap();
        (points.concat(), colors.concat())
    }

    /// Checks that a range image equals the test grid within `tolerance`, in mm. Colors are compared for valid cells only.
    pub(crate) fn assert_is_grid(range: &RangeImage, colored: bool, tolerance: f64) {
        assert_eq!((range.width(), range.height()), (8, 6));
        let (points, colors) = grid();
        for cell in 0..48 {
            match (range.point(cell), points[cell]) {
                (None, None) => continue,
                (Some(found), Some(expected)) => {
                    let error = (found - Point3::from(expected)).norm();
                    assert!(error <= tolerance, "cell {cell}: {found} is not {expected:?}");
                }
                (found, expected) => panic!("cell {cell}: {found:?} is not {expected:?}"),
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
        // The tolerance is the precision of the file: single precision, six digits, or 1/50 mm.
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
            assert_is_grid(&range.normalize(1.0, Axes::Camera).unwrap(), colored, tolerance);
        }
    }

    #[test]
    fn a_grid_with_y_up_is_rotated_and_scaled() {
        let points = vec![Point3::new(1.0, 2.0, -3.0), Point3::new(1.0, 1.0, -3.0)];
        let colors = vec![[1; 3], [2; 3]];
        let range = RangeImage::new(1, 2, points).unwrap().with_colors(colors).unwrap();
        fn file(rows: Rows, range: &RangeImage) -> RangeFile {
            RangeFile { rows, ..range.clone().into() }
        }
        let turned = file(Rows::ByHeight, &range).normalize(1000.0, Axes::YUp).unwrap();
        assert_eq!(turned.points()[0], Point3::new(1000.0, -2000.0, 3000.0));
        // If the axes are those of the camera, the first row of this file is the bottom one.
        let flipped = file(Rows::ByHeight, &range).normalize(1.0, Axes::Camera).unwrap();
        assert_eq!(flipped.points()[0], Point3::new(1.0, 1.0, -3.0));
        assert_eq!(flipped.colors().unwrap(), [[2; 3], [1; 3]]);
        let kept = file(Rows::TopFirst, &range).normalize(1.0, Axes::Camera).unwrap();
        assert_eq!(kept.points()[0], Point3::new(1.0, 2.0, -3.0));
    }

    #[test]
    fn a_rotated_grid_keeps_its_position_in_the_world() {
        let pose = Matrix4::new_translation(&nalgebra::Vector3::new(1.0, 2.0, 3.0));
        let range = RangeImage::new(1, 1, vec![Point3::new(4.0, 5.0, 6.0)]).unwrap();
        let file = RangeFile::from(range.with_world_from_camera(Some(pose)));
        let turned = file.normalize(1.0, Axes::YUp).unwrap();
        let position = turned.world_from_camera().unwrap().transform_point(&turned.points()[0]);
        assert_eq!(position, Point3::new(5.0, 7.0, 9.0));
    }

    #[test]
    fn properties_stated_by_the_file_take_precedence() {
        let range = RangeImage::new(1, 1, vec![Point3::new(1.0, 2.0, 3.0)]).unwrap();
        let file = RangeFile { unit: Some(10.0), axes: Some(Axes::YUp), ..range.into() };
        let normal = file.normalize(1000.0, Axes::Camera).unwrap();
        assert_eq!(normal.points()[0], Point3::new(10.0, -20.0, -30.0));
    }

    #[test]
    fn an_unknown_extension_is_an_error_that_lists_the_known_ones() {
        let error = read(b"", "xyz", None).unwrap_err();
        let text = "cannot read a range grid from `.xyz`: expected one of pcd, ply, ptx, abs, png, tiff, tif, exr";
        assert_eq!(error.to_string(), text);
    }
}
