//! Selects the points of a net that are in a part of the range grid.

use maquette_node::{Error, bail};
use maquette_value as value;
use maquette_value::Region;

/// Returns a flag for each point of the net: 1 if its cell is in `region`, else 0. The cell of a point is the cell whose net coordinate is
/// nearest. A fixed point has a cell only if no other point is nearer to that cell.
pub(crate) fn points_in_region(net: &value::ControlNet, region: &Region) -> Result<Vec<u8>, Error> {
    let chart = net
        .chart()
        .ok_or_else(|| Error::new("`region` needs a net that was made from a region"))?;
    let grid = [region.width(), region.height()];
    if grid != chart.grid {
        bail!("the region is part of a grid of {grid:?} cells, the net of one of {:?}", chart.grid);
    }
    let columns = net.columns();
    fn distance_sq(at: usize, [a, b]: [f64; 2], columns: usize) -> f64 {
        let (a, b) = (a - (at / columns) as f64, b - (at % columns) as f64);
        a * a + b * b
    }
    let cells = chart.cells.iter().zip(chart.coordinates.iter());
    let mut nearest: Vec<Option<(f64, u32)>> = vec![None; net.points().len()];
    for (&cell, &[a, b]) in cells.clone() {
        let (row, column) = (a.round() as usize, b.round() as usize);
        if row < net.rows() && column < columns {
            let at = row * columns + column;
            let distance = distance_sq(at, [a, b], columns);
            if nearest[at].is_none_or(|(least, _)| distance < least) {
                nearest[at] = Some((distance, cell));
            }
        }
    }

    Ok((0..net.points().len())
        .map(|at: usize| {
            // If cells are sparser than net points, a free point may have no cell of its own; use the cell nearest to the point then. This
            // does not apply to fixed points, which may be far from all cells.
            let cell = nearest[at].or_else(|| {
                let distances = cells
                    .clone()
                    .map(|(&cell, &at_cell)| (distance_sq(at, at_cell, columns), cell));
                distances.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|_| net.fixed_points()[at] == 0)
            });
            u8::from(cell.is_some_and(|(_, cell)| region.find(cell as usize).is_some()))
        })
        .collect())
}
