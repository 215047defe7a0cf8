//! A rectangular net of control points.

use nalgebra::Point3;
use thiserror::Error;

use super::content::{Content, content_of_fields};
use super::{CaptureFrame, Column};

mod value;

/// Error of building a control net.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ControlNetError {
    /// The rows of a net have different lengths.
    #[error("row {row} has {length} points, the first row has {expected}")]
    Ragged {
        /// The index of the first row whose length differs.
        row: usize,
        /// The length of that row.
        length: usize,
        /// The length of the first row.
        expected: usize,
    },
    /// Any other violation of the invariant of [`ControlNet`]; contains the message.
    #[error("{0}")]
    Invalid(String),
}

/// A chart of a control net: the position on the net of each cell of a range grid.
///
/// A position is a *net coordinate*, a pair of real numbers (a, b). Control point (row, column) has the net coordinate (row, column);
/// between control points the coordinate is interpolated. [`Surface::parameters`](super::Surface::parameters) maps a net coordinate to a
/// surface's (u, v).
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// The width and height of the range grid.
    pub grid: [usize; 2],
    /// The indices of those cells of the range grid that are on the net, row by row from the top.
    pub cells: Column<u32>,
    /// The net coordinate of each entry of `cells`.
    pub coordinates: Column<[f64; 2]>,
}

impl Content for Chart {
    content_of_fields! { grid cells coordinates }
}

/// A rectangular net of control points: rows along u, columns along v.
///
/// ```text
///            columns, v ->
///        P(0,0)  P(0,1)  P(0,2)
/// rows   P(1,0)  P(1,1)  P(1,2)
/// u |    P(2,0)  P(2,1)  P(2,2)
///   v
/// ```
///
/// Invariant, checked by [`ControlNet::new`] and the `with_` methods: points, weights, flags, base points and distances from the rim have
/// rows x columns entries. All numbers are finite, also in single precision, and no weight is negative.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlNet {
    rows: usize,
    columns: usize,
    points: Column<Point3<f64>>,
    base: Column<Point3<f64>>,
    weights: Column<f64>,
    fixed: Column<u8>,
    chart: Option<Chart>,
    rim_distances: Option<Column<f64>>,
    interpolated: Option<Column<u8>>,
    frame: Option<CaptureFrame>,
}

impl ControlNet {
    /// A net of points, row by row. All weights are 1, no point is fixed, and the base points are the points themselves.
    ///
    /// # Errors
    /// If the number of points does not match the net, or one is not finite.
    pub fn new(
        rows: usize,
        columns: usize,
        points: impl Into<Column<Point3<f64>>>,
    ) -> Result<Self, ControlNetError> {
        let points = points.into();
        let net = Self {
            rows,
            columns,
            base: points.clone(),
            weights: vec![1.0; points.len()].into(),
            fixed: vec![0; points.len()].into(),
            points,
            chart: None,
            rim_distances: None,
            interpolated: None,
            frame: None,
        };
        net.check_points(&net.points)?;
        Ok(net)
    }

    /// Replaces the points. The base points do not change.
    ///
    /// # Errors
    /// If the number of points does not match the net, or one is not finite.
    pub fn with_points(
        mut self,
        points: impl Into<Column<Point3<f64>>>,
    ) -> Result<Self, ControlNetError> {
        let points = points.into();
        self.check_points(&points)?;
        self.points = points;
        Ok(self)
    }

    /// Replaces the weights, row by row.
    ///
    /// # Errors
    /// If the number of weights does not match the net, or one is negative or not finite.
    pub fn with_weights(mut self, weights: Vec<f64>) -> Result<Self, ControlNetError> {
        self.check_size(weights.len())?;
        for (index, &weight) in weights.iter().enumerate() {
            let (row, column) = (index / self.columns, index % self.columns);
            if !is_finite(weight) {
                return Err(not_finite(row, column));
            }
            if weight < 0.0 {
                return Err(ControlNetError::Invalid(format!(
                    "the weight of control point ({row}, {column}) is {weight}; weights must not be negative"
                )));
            }
        }
        self.weights = weights.into();
        Ok(self)
    }

    /// Sets the flag of each point: 1 fixes the point, so that an offset does not move it.
    ///
    /// # Errors
    /// If the number of flags does not match the net.
    pub fn with_fixed(mut self, fixed: Vec<u8>) -> Result<Self, ControlNetError> {
        self.check_size(fixed.len())?;
        self.fixed = fixed.into();
        Ok(self)
    }

    /// Sets the chart: the positions of a range grid's cells on the net.
    #[must_use]
    pub fn with_chart(mut self, chart: Chart) -> Self {
        self.chart = Some(chart);
        self
    }

    /// Sets the distance of each point from the rim of the net's region, measured in points of the net: positive inside of the region and
    /// negative outside.
    ///
    /// # Errors
    /// If the number of distances does not match the net, or one is not finite.
    pub fn with_rim_distances(mut self, distances: Vec<f64>) -> Result<Self, ControlNetError> {
        self.check_size(distances.len())?;
        if let Some(index) = distances.iter().position(|&distance| !is_finite(distance)) {
            return Err(not_finite(index / self.columns, index % self.columns));
        }
        self.rim_distances = Some(distances.into());
        Ok(self)
    }

    /// Sets the flag of each point that completes the net where the scan has no point: 1 for an interpolated point.
    ///
    /// # Errors
    /// If the number of flags does not match the net.
    pub fn with_interpolated(mut self, flags: Vec<u8>) -> Result<Self, ControlNetError> {
        self.check_size(flags.len())?;
        self.interpolated = Some(flags.into());
        Ok(self)
    }

    /// Sets or removes the capture frame.
    #[must_use]
    pub fn with_frame(mut self, frame: Option<CaptureFrame>) -> Self {
        self.frame = frame;
        self
    }

    fn check_size(&self, count: usize) -> Result<(), ControlNetError> {
        let (rows, columns) = (self.rows, self.columns);
        match rows.checked_mul(columns) {
            Some(expected) if expected == count && count > 0 => Ok(()),
            _ => Err(ControlNetError::Invalid(format!(
                "{count} entries do not fill a net of {rows} rows and {columns} columns"
            ))),
        }
    }

    fn check_points(&self, points: &[Point3<f64>]) -> Result<(), ControlNetError> {
        self.check_size(points.len())?;
        match points.iter().position(|point| !point.coords.iter().copied().all(is_finite)) {
            None => Ok(()),
            Some(index) => Err(not_finite(index / self.columns, index % self.columns)),
        }
    }

    /// The number of rows: control points along u.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The number of columns: control points along v.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// All points, row by row.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// The base points: the points before any offset, row by row.
    pub fn base(&self) -> &[Point3<f64>] {
        &self.base
    }

    /// All weights, row by row.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// A flag per point, row by row: 1 if an offset does not move the point.
    pub fn fixed_points(&self) -> &[u8] {
        &self.fixed
    }

    /// The chart: the positions of a range grid's cells on the net. `None` if the net did not come from a region.
    pub fn chart(&self) -> Option<&Chart> {
        self.chart.as_ref()
    }

    /// The distance of each point from the rim of the net's region, in points of the net; positive inside. `None` if it is unknown.
    pub fn rim_distances(&self) -> Option<&[f64]> {
        self.rim_distances.as_deref()
    }

    /// A flag per point, row by row: 1 if the point was interpolated where the scan has none. `None` if it is unknown.
    pub fn interpolated_points(&self) -> Option<&[u8]> {
        self.interpolated.as_deref()
    }

    /// The frame of the capture that the net came from, if any. With a frame the net has the axes of the sensor; without a frame y points
    /// up.
    pub fn frame(&self) -> Option<&CaptureFrame> {
        self.frame.as_ref()
    }
}

fn not_finite(row: usize, column: usize) -> ControlNetError {
    ControlNetError::Invalid(format!(
        "control point ({row}, {column}) is not finite: a net's coordinates and weights stay below 3.4e38 in size, which files can hold"
    ))
}

/// Returns true if a number is finite in single precision. A number beyond that range would be infinite in a file, and its square would
/// overflow.
fn is_finite(number: f64) -> bool {
    (number as f32).is_finite()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_net_keeps_its_base_when_its_points_move() {
        let net = ControlNet::new(1, 2, vec![Point3::origin(); 2]).unwrap();
        let moved = net.clone().with_points(vec![Point3::new(0.0, 0.0, 1.0); 2]).unwrap();
        assert_eq!(moved.base(), net.points());
        assert_eq!(moved.points()[1].z, 1.0);
    }

    #[test]
    fn nets_with_invalid_numbers_are_refused() {
        let net = ControlNet::new(1, 1, vec![Point3::origin()]).unwrap();
        assert!(ControlNet::new(2, 1, vec![Point3::origin()]).is_err());
        assert!(ControlNet::new(0, 0, vec![]).is_err());
        assert!(net.clone().with_points(vec![Point3::new(f64::NAN, 0.0, 0.0)]).is_err());
        assert!(net.clone().with_weights(vec![-1.0]).is_err());
        assert!(net.with_weights(vec![f64::INFINITY]).is_err());
    }
}
