//! The implementation of `Value` for control nets.

use super::{Chart, ControlNet};
use crate::content::content_of_fields;
use crate::edge_cases::point_sets;
use crate::frame::counts;
use crate::mesh::describe_bounds;
use crate::{
    Axes, CaptureFrame, ElementKind, Layer, Lines, Meaning, Part, Parts, PartsError, Summary, Value,
};

/// The name of the part that holds the size of the chart's grid. Tests ignore this part, because the fact `chart` contains the size too.
const GRID: &str = "chart grid";

/// The names of the parts with the distances from the region's rim, and with the flags of interpolated points. Tests ignore them, because
/// the points that an offset moves contain their effect.
const RIM_DISTANCES: &str = "rim distance";
const INTERPOLATED: &str = "interpolated";

impl Value for ControlNet {
    const NAME: &'static str = "ControlNet";

    content_of_fields! { rows columns points base weights fixed chart rim_distances interpolated frame }

    fn describe(&self) -> Summary {
        let moved = self.points.iter().zip(&*self.base).filter(|(point, base)| point != base);
        let farthest = moved.clone().map(|(point, base)| (point - base).norm()).fold(0.0, f64::max);
        let summary = Summary::default()
            .with_fact("net", format!("{} rows x {} columns", self.rows, self.columns))
            .with_fact("fixed", self.fixed.iter().filter(|&&fixed| fixed == 1).count())
            .with_fact("moved", moved.count())
            .with_fact("farthest move", farthest);
        describe_bounds(summary, self.points.iter())
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts { row: Some(self.columns), ..Parts::default() };
        if let Some(frame) = &self.frame {
            frame.push(&mut parts);
        }
        parts.fact("control points", [self.rows, self.columns]);
        parts.push("point", ElementKind::Point, Meaning::Position, 3, &self.points[..]);
        parts.push("base", ElementKind::Point, Meaning::Position, 3, &self.base[..]);
        parts.push("weight", ElementKind::Point, Meaning::Number, 1, &self.weights[..]);
        parts.push("fixed", ElementKind::Point, Meaning::Exact, 1, &self.fixed[..]);
        if let Some(chart) = &self.chart {
            parts.fact("chart", format!("{} of {:?} cells", chart.cells.len(), chart.grid));
            parts.push("chart cell", ElementKind::Entry, Meaning::Index, 1, &chart.cells[..]);
            let coordinates = &chart.coordinates[..];
            parts.push("chart coordinate", ElementKind::Entry, Meaning::Number, 2, coordinates);
            let grid = chart.grid.map(|size| size as f64).to_vec();
            parts.push_hidden(GRID, ElementKind::Whole, Meaning::Exact, 2, grid);
        }
        if let Some(distances) = &self.rim_distances {
            let distances = &distances[..];
            parts.push_hidden(RIM_DISTANCES, ElementKind::Point, Meaning::Number, 1, distances);
        }
        if let Some(flags) = &self.interpolated {
            parts.push_hidden(INTERPOLATED, ElementKind::Point, Meaning::Exact, 1, &flags[..]);
        }
        parts
    }

    /// Builds a net from parts. Without the part `base`, the base points equal the points. Without `weight`, all weights are 1. Without
    /// `fixed`, no point is fixed.
    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let [rows, columns] = parts.size_of("control points")?;
        let points = parts.require("point", 3)?.to_points()?;
        let mut net = match parts.column_of("base", 3)? {
            Some(base) => {
                let base = base.with_count(points.len())?.to_points()?;
                let net = Self::new(rows, columns, base).map_err(PartsError::from_error)?;
                net.with_points(points).map_err(PartsError::from_error)?
            }
            None => Self::new(rows, columns, points).map_err(PartsError::from_error)?,
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
        if let Some(distances) = parts.column_of(RIM_DISTANCES, 1)? {
            let distances = distances.items.numbers().into_owned();
            net = net.with_rim_distances(distances).map_err(PartsError::from_error)?;
        }
        if let Some(flags) = parts.column_of(INTERPOLATED, 1)? {
            net = net.with_interpolated(flags.to_u8(1)?).map_err(PartsError::from_error)?;
        }
        Ok(net.with_frame(CaptureFrame::from_parts(parts)?))
    }

    /// Draws the rows and columns of the net as lines.
    fn show(&self) -> Vec<Layer> {
        let (rows, columns) = (self.rows as u32, self.columns as u32);
        let along_rows = (0..rows).map(|row| (row * columns..(row + 1) * columns).collect());
        let along_columns =
            (0..columns).map(|column| (0..rows).map(|row| row * columns + column).collect());
        let axes = if self.frame.is_some() { Axes::Sensor } else { Axes::Upright };
        let chains: Vec<Vec<u32>> = along_rows.chain(along_columns).collect();
        vec![Layer::Lines(Lines { points: self.points.clone(), chains, axes })]
    }

    fn edge_cases() -> Vec<Self> {
        let sizes = [[1, 1], [1, 4], [2, 2], [3, 3], [5, 9]];
        let nets = sizes.into_iter().flat_map(|[rows, columns]| {
            point_sets(rows * columns)
                .into_iter()
                .map(move |points| Self::new(rows, columns, points))
        });
        nets.flatten().collect()
    }
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
