//! Changes how strongly control points attract their surface.

use maquette::value::{self, ControlNetError};
use maquette::{Context, Error, In, Node};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Changes how strongly control points attract their surface.
///
/// Each weight is multiplied by `all`, by its row's factor and by its column's factor. Only ratios count: the same factor for
/// all points changes nothing. 0 takes a point's effect away.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Weights {
    /// The net.
    pub net: In<value::ControlNet>,
    /// A factor for every point.
    #[schemars(range(min = 0.0, max = 1000.0))]
    #[serde(default = "one")]
    pub all: f64,
    /// A factor per row, from the first row on; empty leaves them as they are.
    #[schemars(inner(range(min = 0.0, max = 1000.0)))]
    #[serde(default)]
    pub rows: Vec<f64>,
    /// A factor per column, from the first column on; empty leaves them as they are.
    #[schemars(inner(range(min = 0.0, max = 1000.0)))]
    #[serde(default)]
    pub columns: Vec<f64>,
}

fn one() -> f64 {
    1.0
}

/// Why weights cannot be changed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WeightsError {
    /// Factors for another net.
    #[error("{factors} factors are given for {count} {what}")]
    Count {
        /// `rows` or `columns`.
        what: &'static str,
        /// How many factors.
        factors: usize,
        /// How many rows or columns the net has.
        count: usize,
    },
    /// Weights that are no weights.
    #[error(transparent)]
    Net(#[from] ControlNetError),
}

impl Node for Weights {
    type Outputs = (value::ControlNet,);
    const OUTPUTS: [&'static str; 1] = ["net"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((weights(cx.get(&self.net), self.all, &self.rows, &self.columns)?,))
    }
}

/// The net with each weight multiplied by `all`, by its row's factor and by its column's; an empty list means factors of 1.
///
/// # Errors
/// If a list is neither empty nor as long as the net has rows or columns, or a weight becomes negative or not finite.
pub fn weights(
    net: &value::ControlNet,
    all: f64,
    rows: &[f64],
    columns: &[f64],
) -> Result<value::ControlNet, WeightsError> {
    for (what, factors, count) in
        [("rows", rows.len(), net.rows()), ("columns", columns.len(), net.columns())]
    {
        if factors != 0 && factors != count {
            return Err(WeightsError::Count { what, factors, count });
        }
    }
    let factor = |factors: &[f64], k: usize| factors.get(k).copied().unwrap_or(1.0);
    let changed = net.weights().iter().enumerate().map(|(index, weight)| {
        let (row, column) = (index / net.columns(), index % net.columns());
        weight * (all * factor(rows, row) * factor(columns, column))
    });
    Ok(net.clone().with_weights(changed.collect())?)
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    fn net() -> value::ControlNet {
        value::ControlNet::new(2, 2, vec![Point3::origin(); 4]).unwrap()
    }

    #[test]
    fn factors_multiply() {
        let once = weights(&net(), 0.5, &[1.0, 2.0], &[3.0, 0.0]).unwrap();
        assert_eq!(once.weights(), [1.5, 0.0, 3.0, 0.0]);
        let twice = weights(&once, 2.0, &[], &[]).unwrap();
        assert_eq!(twice.weights(), [3.0, 0.0, 6.0, 0.0]);
    }

    #[test]
    fn factors_for_another_net_are_refused() {
        let count = WeightsError::Count { what: "columns", factors: 3, count: 2 };
        assert_eq!(weights(&net(), 1.0, &[], &[1.0; 3]), Err(count));
        assert!(weights(&net(), -1.0, &[], &[]).is_err());
        assert!(weights(&net(), f64::NAN, &[], &[]).is_err());
    }
}
