//! Which points of a net lie in a part of the range grid.

use maquette_value as value;
use maquette_value::Region;

/// Why a region does not tell points of a net apart.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WithinError {
    /// A net that does not know the range grid.
    #[error("`region` needs a net that was made from a region")]
    NoChart,
    /// A region of another grid.
    #[error("the region is part of a grid of {region:?} cells, the net of one of {net:?}")]
    Size {
        /// Size of the region's grid.
        region: [usize; 2],
        /// Size of the net's range grid.
        net: [usize; 2],
    },
}

/// 1 for each point of the net whose cell lies in `region`. A point's cell is the one next to it on the net's chart; a fixed
/// point has one only if that is nearer to it than to other points.
pub(crate) fn within(net: &value::ControlNet, region: &Region) -> Result<Vec<u8>, WithinError> {
    let chart = net.chart().ok_or(WithinError::NoChart)?;
    let grid = [region.width(), region.height()];
    if grid != chart.grid {
        return Err(WithinError::Size { region: grid, net: chart.grid });
    }
    let columns = net.columns();
    fn distance_sq(at: usize, [a, b]: [f64; 2], columns: usize) -> f64 {
        let (a, b) = (a - (at / columns) as f64, b - (at % columns) as f64);
        a * a + b * b
    }
    let cells = || chart.cells.iter().zip(chart.coordinates.iter());
    let mut nearest: Vec<Option<(f64, u32)>> = vec![None; net.points().len()];
    for (&cell, &[a, b]) in cells() {
        let (row, column) = (a.round() as usize, b.round() as usize);
        if row < net.rows() && column < columns {
            let at = row * columns + column;
            let distance = distance_sq(at, [a, b], columns);
            if nearest[at].is_none_or(|(least, _)| distance < least) {
                nearest[at] = Some((distance, cell));
            }
        }
    }
    // Where cells are sparser than the net, a point may have no cell of its own. Fixed points may lie far from all cells.
    let search = |at: usize| {
        let distances = cells().map(|(&cell, &at_cell)| (distance_sq(at, at_cell, columns), cell));
        distances.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|_| net.fixed()[at] == 0)
    };
    Ok((0..net.points().len())
        .map(|at: usize| {
            let cell = nearest[at].or_else(|| search(at));
            u8::from(cell.is_some_and(|(_, cell)| region.find(cell as usize).is_some()))
        })
        .collect())
}
