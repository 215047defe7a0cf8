//! Camera models of captures: the pinhole, the registration of picture and range grid, and the frame of meshes.

use nalgebra::{Matrix4, Point3};

use super::content::{Content, content_of_fields};
use super::{ElementKind, Meaning, Part, Parts, PartsError};

/// A pinhole camera: column = `focal[0] * x / z + center[0]`, row = `focal[1] * y / z + center[1]`, in pixels, with pixel centers at
/// integers. Camera axes: x right, y down, z away from the camera.
///
/// ```text
///        z (away)
///       /
///      o----> x (columns)
///      |
///      v y (rows)
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// The focal lengths in pixels: columns, rows.
    pub focal: [f64; 2],
    /// The principal point in pixels: column, row.
    pub center: [f64; 2],
}

impl Pinhole {
    /// The pixel (column, row) at which the camera sees `point`. The result is not finite for a point in the plane z = 0.
    pub fn project(&self, point: Point3<f64>) -> [f64; 2] {
        [
            self.focal[0] * point.x / point.z + self.center[0],
            self.focal[1] * point.y / point.z + self.center[1],
        ]
    }

    /// The point at depth `z` that is seen at a pixel (column, row).
    pub fn unproject(&self, [column, row]: [f64; 2], z: f64) -> Point3<f64> {
        Point3::new(
            (column - self.center[0]) / self.focal[0] * z,
            (row - self.center[1]) / self.focal[1] * z,
            z,
        )
    }

    /// The four numbers: focal lengths, then the principal point.
    pub(super) fn numbers(&self) -> Vec<f64> {
        [self.focal, self.center].concat()
    }

    /// Reads a pinhole from the part with this name; `None` if there is no such part.
    ///
    /// # Errors
    /// If the part does not have four numbers.
    pub(super) fn from_parts(parts: &Parts<'_>, name: &str) -> Result<Option<Self>, PartsError> {
        let numbers = parts.find(ElementKind::Whole, name).map(Part::single::<4>).transpose()?;
        Ok(numbers.map(|[fx, fy, cx, cy]| Self { focal: [fx, fy], center: [cx, cy] }))
    }
}

impl Content for Pinhole {
    content_of_fields! { focal center }
}

/// The map from a range grid to the picture taken with it. Columns and rows are mapped separately by pixel = `scale * cell + offset`; the
/// centers of cells and pixels have integer coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Registration {
    /// The number of pixels per range cell: columns, rows. Greater than 0.
    pub scale: [f64; 2],
    /// The pixel at the center of cell (0, 0): column, row.
    pub offset: [f64; 2],
    /// The size of the picture: width, height.
    pub picture: [usize; 2],
}

impl Registration {
    /// The registration that aligns the outer corners of the range grid and the picture, not the centers of their corner pixels. It is the
    /// right choice if no camera file exists.
    pub fn corners(range: [usize; 2], picture: [usize; 2]) -> Self {
        let scale = [0, 1].map(|axis| picture[axis] as f64 / range[axis].max(1) as f64);
        Self { scale, offset: scale.map(|scale| (scale - 1.0) / 2.0), picture }
    }

    /// The registration for two pinhole cameras at the same position. The map is K_picture K_range^-1, where K is a camera's matrix.
    pub fn pinholes(range: &Pinhole, color: &Pinhole, picture: [usize; 2]) -> Self {
        let scale = [0, 1].map(|axis| color.focal[axis] / range.focal[axis]);
        let offset = [0, 1].map(|axis| color.center[axis] - range.center[axis] * scale[axis]);
        Self { scale, offset, picture }
    }

    /// The pixel (column, row) of the picture that a range cell (column, row) sees.
    pub fn picture_from_range(&self, cell: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| self.scale[axis] * cell[axis] + self.offset[axis])
    }

    /// The range cell (column, row) that sees the pixel (column, row) of the picture.
    pub fn range_from_picture(&self, pixel: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| (pixel[axis] - self.offset[axis]) / self.scale[axis])
    }

    /// The pinhole camera of the picture, computed from the pinhole camera `range` of the range grid.
    pub fn pinhole_of_picture(&self, range: &Pinhole) -> Pinhole {
        Pinhole {
            focal: [0, 1].map(|axis| range.focal[axis] * self.scale[axis]),
            center: self.picture_from_range(range.center),
        }
    }

    /// The texture coordinate of a range cell (column, row): (0, 0) is the picture's lower left corner, (1, 1) its upper right corner.
    pub fn uv_from_range(&self, cell: [f64; 2]) -> [f64; 2] {
        let [column, row] = self.picture_from_range(cell);
        let [width, height] = self.picture.map(|size| size as f64);
        [(column + 0.5) / width, 1.0 - (row + 0.5) / height]
    }
}

impl Content for Registration {
    content_of_fields! { scale offset picture }
}

/// The frame of a mesh that was made from a capture. Its axes are those of [`Pinhole`]: x right, y down, z away from the sensor.
///
/// A mesh without a frame has y up, like meshes that are read from files.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaptureFrame {
    /// The camera of the picture, if known.
    pub camera: Option<Pinhole>,
    /// The size of the picture: width, height.
    pub picture: [usize; 2],
    /// The median depth of the capture's valid cells, in mm.
    pub depth: f64,
    /// The rigid motion from the sensor's frame to the world's frame, in mm, if known.
    pub world_from_camera: Option<Matrix4<f64>>,
}

impl CaptureFrame {
    /// Adds the frame to the parts of a value whose coordinates are in this frame: the camera (NaN if unknown), the picture's size, the
    /// depth, and the pose. The pose is a column that tests ignore.
    pub(super) fn push(&self, to: &mut Parts<'_>) {
        let camera = self.camera.map_or(vec![f64::NAN; 4], |camera| camera.numbers());
        let picture = self.picture.map(|size| size as f64);
        let numbers = [&camera[..], &picture, &[self.depth]].concat();
        to.push("frame", ElementKind::Whole, Meaning::Number, 7, numbers);
        if let Some(pose) = self.world_from_camera {
            to.push_hidden(POSE, ElementKind::Whole, Meaning::Number, 16, pose.as_slice().to_vec());
        }
    }

    /// Reads the frame from the parts of a value, if it has one.
    ///
    /// # Errors
    /// If the part has the wrong number of numbers, or the picture's size is not a pair of whole numbers.
    pub(super) fn from_parts(parts: &Parts<'_>) -> Result<Option<Self>, PartsError> {
        let Some(part) = parts.find(ElementKind::Whole, "frame") else { return Ok(None) };
        let [fx, fy, cx, cy, width, height, depth] = part.single()?;
        let camera = Pinhole { focal: [fx, fy], center: [cx, cy] };
        let is_known = ![fx, fy, cx, cy].iter().all(|x| x.is_nan());
        Ok(Some(Self {
            camera: is_known.then_some(camera),
            picture: counts(part, 4, [width, height])?,
            depth,
            world_from_camera: pose_of(parts, POSE)?,
        }))
    }
}

impl Content for CaptureFrame {
    content_of_fields! { camera picture depth world_from_camera }
}

/// The name of the part that holds the pose of the frame in the world.
const POSE: &str = "frame pose";

/// Converts the numbers of a part to counts, beginning with the number at the index `first`.
///
/// # Errors
/// If a number is not a whole number from 0 to 4294967295.
pub(super) fn counts<const N: usize>(
    part: &Part<'_>,
    first: usize,
    numbers: [f64; N],
) -> Result<[usize; N], PartsError> {
    let mut counts = [0; N];
    for (k, (count, x)) in counts.iter_mut().zip(numbers).enumerate() {
        if !(0.0..=f64::from(u32::MAX)).contains(&x) || x.fract() != 0.0 {
            return Err(part.number_error(first + k, x, "a count"));
        }
        *count = x as usize;
    }
    Ok(counts)
}

/// Reads a motion, a matrix stored column by column, from the part with this name. `None` if there is no such part.
///
/// # Errors
/// If the part does not have sixteen numbers.
pub(super) fn pose_of(parts: &Parts<'_>, name: &str) -> Result<Option<Matrix4<f64>>, PartsError> {
    let numbers = parts.find(ElementKind::Whole, name).map(Part::single::<16>).transpose()?;
    Ok(numbers.map(|numbers| Matrix4::from_column_slice(&numbers)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_aligned_at_double_size_see_the_corner_shared_by_four_pixels() {
        let map = Registration::corners([200, 200], [400, 400]);
        assert_eq!(map.picture_from_range([0.0, 10.0]), [0.5, 20.5]);
        assert_eq!(map.range_from_picture([0.5, 20.5]), [0.0, 10.0]);
    }

    #[test]
    fn pinholes_at_the_same_position_give_the_published_doubling() {
        let range = Pinhole { focal: [1400.0; 2], center: [99.5; 2] };
        let color = Pinhole { focal: [2800.0; 2], center: [199.0; 2] };
        let map = Registration::pinholes(&range, &color, [400, 400]);
        assert_eq!(map.picture_from_range([7.0, 9.0]), [14.0, 18.0]);
    }

    #[test]
    fn a_point_projects_back_onto_its_pixel() {
        let camera = Pinhole { focal: [1400.0, 1390.0], center: [99.5, 98.0] };
        let pixel = camera.project(camera.unproject([12.25, 170.5], 733.0));
        assert!((pixel[0] - 12.25).abs() < 1e-12 && (pixel[1] - 170.5).abs() < 1e-12);
    }

    #[test]
    fn the_upper_left_texel_has_the_upper_left_texture_coordinate() {
        let map = Registration { scale: [1.0; 2], offset: [0.0; 2], picture: [4, 2] };
        assert_eq!(map.uv_from_range([0.0, 0.0]), [0.125, 0.75]);
    }
}
