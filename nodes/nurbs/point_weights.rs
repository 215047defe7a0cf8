//! Weights of single control points.

use maquette_node::{Error, bail};
use maquette_value as value;

/// Returns the given rows of weights or factors as one list, for the points of `net` row by row.
///
/// # Errors
/// Returns an error if there is not one number for each point, or a number is not greater than 0.
pub(crate) fn point_weights(
    net: &value::ControlNet,
    weights: &[Vec<f64>],
) -> Result<Vec<f64>, Error> {
    if weights.len() != net.rows() {
        bail!("{} rows of weights are given, the net has {} rows", weights.len(), net.rows());
    }
    for (row, weights) in weights.iter().enumerate() {
        if weights.len() != net.columns() {
            bail!("row {row} has {} weights, the net has {} columns", weights.len(), net.columns());
        }
        if let Some(column) =
            weights.iter().position(|weight| !(*weight > 0.0 && weight.is_finite()))
        {
            return Err(not_positive(row, column, weights[column]));
        }
    }
    Ok(weights.concat())
}

pub(crate) fn not_positive(row: usize, column: usize, weight: f64) -> Error {
    Error::new(format!(
        "the weight of control point ({row}, {column}) is {weight}; expected a weight greater than 0"
    ))
}
