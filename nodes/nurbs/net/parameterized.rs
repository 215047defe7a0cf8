//! Control nets with net coordinates for the cells of their region.

use maquette_node::Error;
use maquette_value as value;
use maquette_value::{Chart, RangeImage};
use nalgebra::Point3;

/// Makes the net of `points` with the given number of rows and columns. `fixed` returns true if the point at a row and column is fixed.
/// `coordinates` has a net coordinate for each of the `cells` of the range image.
pub(crate) fn parameterize(
    range: &RangeImage,
    [rows, columns]: [usize; 2],
    points: Vec<Point3<f64>>,
    fixed: impl Fn(usize, usize) -> bool,
    cells: Vec<u32>,
    coordinates: Vec<[f64; 2]>,
) -> Result<value::ControlNet, Error> {
    let grid = [range.width(), range.height()];
    let chart = Chart { grid, cells: cells.into(), coordinates: coordinates.into() };
    let fixed = (0..rows * columns).map(|at| u8::from(fixed(at / columns, at % columns))).collect();
    Ok(value::ControlNet::new(rows, columns, points)?.with_fixed(fixed)?.with_chart(chart))
}

/// Returns a function that is true for points on the border of a net with the given number of rows and columns.
pub(crate) fn on_border([rows, columns]: [usize; 2]) -> impl Fn(usize, usize) -> bool {
    move |row, column| row == 0 || row + 1 == rows || column == 0 || column + 1 == columns
}
