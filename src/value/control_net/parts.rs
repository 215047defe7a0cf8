//! The parts, layers and edge cases of control nets.

use super::{Chart, ControlNet};
use crate::edge_cases::point_sets;
use crate::frame::counts;
use crate::{Axes, CaptureFrame, ElementKind, Layer, Lines, Meaning, Part, Parts, PartsError};

/// The part that holds the size of the chart's grid. Tests ignore this part, because the fact `chart` contains the size too.
const GRID: &str = "chart grid";

pub(super) fn parts(net: &ControlNet) -> Parts<'_> {
    let mut parts = Parts { row: Some(net.columns), ..Parts::default() };
    if let Some(frame) = &net.frame {
        frame.push(&mut parts);
    }
    parts.fact("control points", [net.rows, net.columns]);
    parts.push("point", ElementKind::Point, Meaning::Position, 3, &net.points[..]);
    parts.push("base", ElementKind::Point, Meaning::Position, 3, &net.base[..]);
    parts.push("weight", ElementKind::Point, Meaning::Number, 1, &net.weights[..]);
    parts.push("fixed", ElementKind::Point, Meaning::Exact, 1, &net.fixed[..]);
    if let Some(chart) = &net.chart {
        parts.fact("chart", format!("{} of {:?} cells", chart.cells.len(), chart.grid));
        parts.push("chart cell", ElementKind::Entry, Meaning::Index, 1, &chart.cells[..]);
        let coordinates = &chart.coordinates[..];
        parts.push("chart coordinate", ElementKind::Entry, Meaning::Number, 2, coordinates);
        let grid = chart.grid.map(|size| size as f64).to_vec();
        parts.push_hidden(GRID, ElementKind::Whole, Meaning::Exact, 2, grid);
    }
    parts
}

/// Builds a net from parts. Without the part `base`, the base points equal the points. Without `weight`, all weights are 1. Without
/// `fixed`, no point is fixed.
pub(super) fn made_of(parts: &Parts<'_>) -> Result<ControlNet, PartsError> {
    let [rows, columns] = parts.size_of("control points")?;
    let points = parts.require("point", 3)?.to_points()?;
    let mut net = match parts.column_of("base", 3)? {
        Some(base) => {
            let base = base.with_count(points.len())?.to_points()?;
            let net = ControlNet::new(rows, columns, base).map_err(PartsError::from_error)?;
            net.with_points(points).map_err(PartsError::from_error)?
        }
        None => ControlNet::new(rows, columns, points).map_err(PartsError::from_error)?,
    };
    if let Some(weight) = parts.column_of("weight", 1)? {
        let weights = weight.items.numbers().into_owned();
        net = net.with_weights(weights).map_err(PartsError::from_error)?;
    }
    if let Some(fixed) = parts.column_of("fixed", 1)? {
        net = net.with_fixed(fixed.to_u8(1)?).map_err(PartsError::from_error)?;
    }
    if let Some(cells) = parts.column_of("chart cell", 1)? {
        net = net.with_chart(chart(parts, cells)?);
    }
    Ok(net.with_frame(CaptureFrame::from_parts(parts)?))
}

fn chart(parts: &Parts<'_>, part: &Part<'_>) -> Result<Chart, PartsError> {
    let grid = parts.require(GRID, 2)?;
    let grid = counts(grid, 0, grid.single()?)?;
    let cells = part.to_u32()?;
    if let Some(index) =
        cells.iter().position(|&cell| grid[0].saturating_mul(grid[1]) <= cell as usize)
    {
        return Err(part.number_error(
            index,
            f64::from(cells[index]),
            "a cell of the chart's grid",
        ));
    }
    let coordinates = parts.require("chart coordinate", 2)?.with_count(cells.len())?.elements()?;
    Ok(Chart { grid, cells: cells.into(), coordinates: coordinates.into() })
}

/// Draws the rows and columns of the net as lines.
pub(super) fn show(net: &ControlNet) -> Vec<Layer> {
    let (rows, columns) = (net.rows as u32, net.columns as u32);
    let along_rows = (0..rows).map(|row| (row * columns..(row + 1) * columns).collect());
    let along_columns =
        (0..columns).map(|column| (0..rows).map(|row| row * columns + column).collect());
    let axes = if net.frame.is_some() { Axes::Sensor } else { Axes::Upright };
    let chains: Vec<Vec<u32>> = along_rows.chain(along_columns).collect();
    vec![Layer::Lines(Lines { points: net.points.clone(), chains, axes })]
}

pub(super) fn edge_cases() -> Vec<ControlNet> {
    let sizes = [[1, 1], [1, 4], [2, 2], [3, 3], [5, 9]];
    let nets = sizes.into_iter().flat_map(|[rows, columns]| {
        point_sets(rows * columns)
            .into_iter()
            .map(move |points| ControlNet::new(rows, columns, points))
    });
    nets.flatten().collect()
}
