//! Nets with the chart of their region.

use maquette_value as value;
use maquette_value::{Chart, RangeImage};
use nalgebra::Point3;

use crate::net_error::NetError;

/// The net of so many rows and columns of points, with the flag `fixed` by row and column, and a net coordinate for each of
/// `cells` of the range.
pub(crate) fn charted(
    range: &RangeImage,
    [rows, columns]: [usize; 2],
    points: Vec<Point3<f64>>,
    fixed: impl Fn(usize, usize) -> bool,
    cells: Vec<u32>,
    coordinates: Vec<[f64; 2]>,
) -> Result<value::ControlNet, NetError> {
    let grid = [range.width(), range.height()];
    let chart = Chart { grid, cells: cells.into(), coordinates: coordinates.into() };
    let fixed = (0..rows * columns).map(|at| u8::from(fixed(at / columns, at % columns))).collect();
    Ok(value::ControlNet::new(rows, columns, points)?.with_fixed(fixed)?.with_chart(chart))
}

/// Whether a point lies on the border of a net of so many rows and columns.
pub(crate) fn on_border([rows, columns]: [usize; 2]) -> impl Fn(usize, usize) -> bool {
    move |row, column| row == 0 || row + 1 == rows || column == 0 || column + 1 == columns
}
