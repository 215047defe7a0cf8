//! Range images: grids of points from a range finder.

use nalgebra::{Matrix4, Point3};
use thiserror::Error;

use super::content::{Content, content_of_fields};
use super::image::{SizeError, check_size};
use super::{CaptureFrame, Column, Pinhole, Registration, Rgb};
use crate::parallel::*;

mod update;
mod value;

/// An error in building or measuring a range image.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum RangeError {
    /// The length of a list is not the number of cells.
    #[error(transparent)]
    Size(#[from] SizeError),
    /// No cell is valid, so there is no depth to measure.
    #[error("the range image has no valid cell")]
    NoValidRange,
}

/// A grid of points in the sensor's frame: x right, y down, z away from the sensor, in mm. Row 0 is the top.
///
/// Invariant, checked by [`RangeImage::new`]: there are width x height points. Either a point is finite, and its cell is *valid*, or all
/// three coordinates are NaN.
#[derive(Clone, Debug, PartialEq)]
pub struct RangeImage {
    width: usize,
    height: usize,
    points: Column<Point3<f64>>,
    /// The flags of the cells: 1 where the point was computed, not measured. Empty if all points were measured.
    filled: Column<u8>,
    /// The forced triangles of the cells: see [`RangeImage::forced_triangles`]. Empty if there are none.
    joined: Column<u8>,
    /// The colors of the cells. Empty if there are none.
    colors: Column<Rgb>,
    camera: Option<Pinhole>,
    registration: Registration,
    world_from_camera: Option<Matrix4<f64>>,
    seam: Option<SeamGaps>,
}

/// The continuity of a redesigned region with the rest of a range image, measured across the border of the region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeamGaps {
    /// The largest angle between the normals on both sides, in degrees: 0 if the surface is G1 continuous.
    pub angle: f64,
    /// The largest difference between the normal curvatures across the border, in 1/mm: 0 if the surface is G2 continuous, too.
    pub curvature: f64,
}

impl Content for SeamGaps {
    content_of_fields! { angle curvature }
}

const NO_POINT: Point3<f64> = Point3::new(f64::NAN, f64::NAN, f64::NAN);

impl RangeImage {
    /// Builds a grid of `width` x `height` points, row by row from the top. A point that is not finite makes its cell invalid. The grid is
    /// registered to a picture of the same size, so that each cell is on one pixel.
    ///
    /// # Errors
    /// If the number of points is not `width` x `height`.
    pub fn new(
        width: usize,
        height: usize,
        mut points: Vec<Point3<f64>>,
    ) -> Result<Self, SizeError> {
        check_size(width, height, points.len())?;
        without_half_points(&mut points);
        Ok(Self {
            width,
            height,
            points: points.into(),
            filled: Column::default(),
            joined: Column::default(),
            colors: Column::default(),
            camera: None,
            registration: Registration::corners([width, height], [width, height]),
            world_from_camera: None,
            seam: None,
        })
    }

    /// Replaces the points. All other data of the range image is kept, except for the measured seam.
    ///
    /// # Errors
    /// If the number of points differs from the number of cells.
    pub fn with_points(&self, points: Vec<Point3<f64>>) -> Result<Self, SizeError> {
        let moved = Self::new(self.width, self.height, points)?;
        Ok(Self { points: moved.points, seam: None, ..self.clone() })
    }

    /// Sets the flag of each cell: 1 if the cell was filled, 0 if it was measured.
    ///
    /// # Errors
    /// If the number of entries differs from the number of cells.
    pub fn with_filled(mut self, filled: Vec<u8>) -> Result<Self, SizeError> {
        check_size(self.width, self.height, filled.len())?;
        self.filled = if filled.contains(&1) { filled.into() } else { Column::default() };
        Ok(self)
    }

    /// Sets the triangles that belong to the surface in any case; see [`forced_triangles`](Self::forced_triangles).
    ///
    /// # Errors
    /// If the number of entries differs from the number of cells.
    pub fn with_joined(mut self, joined: Vec<u8>) -> Result<Self, SizeError> {
        check_size(self.width, self.height, joined.len())?;
        let none = joined.iter().all(|&triangles| triangles == 0);
        self.joined = if none { Column::default() } else { joined.into() };
        Ok(self)
    }

    /// Sets a color per cell.
    ///
    /// # Errors
    /// If the number of colors differs from the number of cells.
    pub fn with_colors(mut self, colors: Vec<Rgb>) -> Result<Self, SizeError> {
        check_size(self.width, self.height, colors.len())?;
        self.colors = colors.into();
        Ok(self)
    }

    /// Sets or removes the camera of the range grid.
    #[must_use]
    pub fn with_camera(mut self, camera: Option<Pinhole>) -> Self {
        self.camera = camera;
        self
    }

    /// Sets the registration: the map from cells to the picture.
    #[must_use]
    pub fn with_registration(mut self, registration: Registration) -> Self {
        self.registration = registration;
        self
    }

    /// Sets or removes the pose: a rigid motion from the sensor's frame to the world's, in mm.
    #[must_use]
    pub fn with_world_from_camera(mut self, pose: Option<Matrix4<f64>>) -> Self {
        self.world_from_camera = pose;
        self
    }

    /// Sets or removes the measured continuity of a redesigned region.
    #[must_use]
    pub fn with_seam(mut self, seam: Option<SeamGaps>) -> Self {
        self.seam = seam;
        self
    }

    /// The continuity of the region that was redesigned last, if it was measured.
    pub fn seam(&self) -> Option<SeamGaps> {
        self.seam
    }

    /// The number of columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All points, row by row from the top; NaN where a cell is invalid.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// The point of a cell, if the cell is valid. The index of the cell counts row by row from the top.
    pub fn point(&self, cell: usize) -> Option<Point3<f64>> {
        self.points.get(cell).copied().filter(|point| !point.x.is_nan())
    }

    /// Returns true if a cell's point was computed, not measured.
    pub fn is_filled(&self, cell: usize) -> bool {
        self.filled.get(cell) == Some(&1)
    }

    /// The forced triangles: they belong to the surface however long or steep they are, because they were redesigned or filled. The value
    /// of a cell describes the quad between the cell (a), its right neighbor (b), its lower right neighbor (c) and its lower neighbor (d).
    /// If the quad is cut along a c, bit 0 is the triangle a d c, and bit 1 is a c b. If it is cut along b d, bit 2 is a d b, and bit 3 is
    /// b d c.
    pub fn forced_triangles(&self, cell: usize) -> u8 {
        self.joined.get(cell).copied().unwrap_or(0)
    }

    /// The colors of all cells, row by row from the top, if there are any.
    pub fn colors(&self) -> Option<&[Rgb]> {
        (!self.colors.is_empty()).then_some(&*self.colors)
    }

    /// The camera of the range grid, if known.
    pub fn camera(&self) -> Option<&Pinhole> {
        self.camera.as_ref()
    }

    /// The map from cells to the picture.
    pub fn registration(&self) -> &Registration {
        &self.registration
    }

    /// The rigid motion from the sensor's frame to the world's, if known.
    pub fn world_from_camera(&self) -> Option<&Matrix4<f64>> {
        self.world_from_camera.as_ref()
    }

    /// The number of valid cells.
    pub fn n_valid(&self) -> usize {
        self.points.iter().filter(|point| !point.x.is_nan()).count()
    }

    /// The median depth z of the valid cells, in mm. If the number of depths is even, the larger of the two middle ones.
    ///
    /// # Errors
    /// If no cell is valid.
    pub fn median_depth(&self) -> Result<f64, RangeError> {
        let mut depths: Vec<f64> =
            self.points.iter().map(|point| point.z).filter(|z| !z.is_nan()).collect();
        if depths.is_empty() {
            return Err(RangeError::NoValidRange);
        }
        let middle = depths.len() / 2;
        Ok(*depths.select_nth_unstable_by(middle, f64::total_cmp).1)
    }

    /// The frame of meshes that are made from this grid.
    ///
    /// # Errors
    /// If no cell is valid.
    pub fn capture_frame(&self) -> Result<CaptureFrame, RangeError> {
        let map = &self.registration;
        let camera = self.camera.map(|camera| map.pinhole_of_picture(&camera));
        Ok(CaptureFrame {
            camera,
            picture: map.picture,
            depth: self.median_depth()?,
            world_from_camera: self.world_from_camera,
        })
    }
}

/// Sets all three coordinates of a point to NaN if one of them is not finite.
fn without_half_points(points: &mut [Point3<f64>]) {
    points.par_iter_mut().with_min_len(16384).for_each(|point| {
        if !point.coords.iter().all(|x| x.is_finite()) {
            *point = NO_POINT;
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_with_one_bad_coordinate_makes_its_cell_invalid() {
        let points = vec![Point3::new(1.0, f64::INFINITY, 2.0), Point3::new(0.0, 0.0, 5.0)];
        let range = RangeImage::new(2, 1, points).unwrap();
        assert_eq!((range.n_valid(), range.point(0), range.median_depth()), (1, None, Ok(5.0)));
        assert!(range.points()[0].coords.iter().all(|x| x.is_nan()));
    }

    #[test]
    fn a_grid_without_valid_cells_has_no_depth() {
        let range = RangeImage::new(1, 1, vec![NO_POINT]).unwrap();
        assert_eq!(range.median_depth(), Err(RangeError::NoValidRange));
    }
}
