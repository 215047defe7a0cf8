//! Changes the weights of control points.

use maquette_node::{Context, Error, In, Node, bail};
use maquette_value as value;
use maquette_value::Region;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::grid::within::points_in_region;
use super::point_weights::{not_positive, point_weights};

/// Changes the weights of control points: how strongly they attract the surface.
///
/// Each weight is multiplied by `all`, by its row's factor, by its column's factor, by its own factor in `points`, and inside `region` by
/// `inside`. Only ratios matter: the same factor for all points has no effect. A weight that is not greater than 0 is an error; a factor of
/// 1e-6 all but removes the effect of a point.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Weights {
    /// The net.
    pub net: In<value::ControlNet>,
    /// The part of the range grid whose control points get the factor `inside`.
    pub region: Option<In<Region>>,
    /// Factor for every point.
    #[schemars(range(min = 0.0, max = 1000.0))]
    #[serde(default = "default_factor")]
    pub all: f64,
    /// Factors for the rows, from the first on; empty means 1.
    #[schemars(inner(range(min = 0.0, max = 1000.0)))]
    #[serde(default)]
    pub rows: Vec<f64>,
    /// Factors for the columns, from the first on; empty means 1.
    #[schemars(inner(range(min = 0.0, max = 1000.0)))]
    #[serde(default)]
    pub columns: Vec<f64>,
    /// Factor for each control point, greater than 0: a list of rows, as the net has; empty means 1.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<Vec<f64>>,
    /// Factor for every point whose cell is in `region`.
    #[schemars(range(min = 0.0, max = 1000.0))]
    #[serde(default = "default_factor")]
    pub inside: f64,
}

fn default_factor() -> f64 {
    1.0
}

impl Node for Weights {
    type Outputs = (value::ControlNet,);
    const OUTPUTS: [&'static str; 1] = ["net"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let net = cx.get(&self.net);
        let mut changed = weights(net, self.all, &self.rows, &self.columns)?;
        if !self.points.is_empty() {
            let factors = point_weights(net, &self.points)?;
            let pairs = changed.weights().iter().zip(factors);
            let product = pairs.map(|(weight, factor)| weight * factor).collect();
            changed = changed.with_weights(product)?;
        }
        let Some(region) = &self.region else {
            if self.inside != 1.0 {
                cx.warn("`inside` changes nothing without a region");
            }
            check_positive(&changed)?;
            return Ok((changed,));
        };
        let region = cx.get(region);
        if !points_in_region(net, region)?.contains(&1) {
            cx.warn("no control point is in the region");
        }
        let changed = weights_inside(&changed, region, self.inside)?;
        check_positive(&changed)?;
        Ok((changed,))
    }
}

/// Checks that all weights of a net are greater than 0.
fn check_positive(net: &value::ControlNet) -> Result<(), Error> {
    match net.weights().iter().position(|weight| *weight <= 0.0) {
        Some(index) => {
            Err(not_positive(index / net.columns(), index % net.columns(), net.weights()[index]))
        }
        None => Ok(()),
    }
}

/// Returns the net with each weight multiplied by `all`, by its row's factor and by its column's factor; an empty list means factors of 1.
///
/// # Errors
/// Returns an error if a list is neither empty nor as long as the net has rows or columns, or a weight becomes negative or not finite.
pub fn weights(
    net: &value::ControlNet,
    all: f64,
    rows: &[f64],
    columns: &[f64],
) -> Result<value::ControlNet, Error> {
    for (what, factors, count) in
        [("rows", rows.len(), net.rows()), ("columns", columns.len(), net.columns())]
    {
        if factors != 0 && factors != count {
            bail!("{factors} factors are given for {count} {what}");
        }
    }
    fn factor(factors: &[f64], k: usize) -> f64 {
        factors.get(k).copied().unwrap_or(1.0)
    }
    let changed = net.weights().iter().enumerate().map(|(index, weight)| {
        let (row, column) = (index / net.columns(), index % net.columns());
        weight * (all * factor(rows, row) * factor(columns, column))
    });
    Ok(net.clone().with_weights(changed.collect())?)
}

/// Returns the net with the weights of all points whose cell is in `region` multiplied by `factor`.
///
/// # Errors
/// Returns an error if the net was not made from a region of the same range grid, or a weight becomes negative or not finite.
pub fn weights_inside(
    net: &value::ControlNet,
    region: &Region,
    factor: f64,
) -> Result<value::ControlNet, Error> {
    let pairs = net.weights().iter().zip(points_in_region(net, region)?);
    let changed = pairs.map(|(weight, within)| if within == 1 { weight * factor } else { *weight });
    Ok(net.clone().with_weights(changed.collect())?)
}

#[cfg(test)]
mod tests {
    use maquette_node::Progress;
    use nalgebra::Point3;

    use super::super::control_net::tests::{range, region};
    use super::super::control_net::{NetMethod, control_net};
    use super::*;

    #[test]
    fn a_region_has_its_own_factor() {
        let range = range(12, 10, |_, _| 1.0);
        let whole = region(&range, |x, y| (2..10).contains(&x) && (2..8).contains(&y));
        let part = region(&range, |x, y| (2..5).contains(&x) && y < 4);
        let net = control_net(&whole, &range, NetMethod::Grid, 0, 0, &Progress::silent()).unwrap();
        let heavy = weights_inside(&net, &part, 3.0).unwrap();
        for (at, weight) in heavy.weights().iter().enumerate() {
            let (row, column) = (at / net.columns(), at % net.columns());
            // Net points in the padding belong to no cell of the region, so they keep their weights, even if `region` reaches into the
            // padding.
            let inside = (2..4).contains(&row) && (2..5).contains(&column);
            assert_eq!(*weight, if inside { 3.0 } else { 1.0 }, "({row}, {column})");
        }
        let fine =
            control_net(&whole, &range, NetMethod::Rows, 11, 15, &Progress::silent()).unwrap();
        let heavy = weights_inside(&fine, &part, 3.0).unwrap();
        assert_eq!((heavy.weights()[16], heavy.weights()[15 * 9 + 7]), (3.0, 1.0));
    }

    #[test]
    fn a_region_needs_a_net_of_its_grid() {
        let (here, there) = (range(12, 10, |_, _| 1.0), range(11, 10, |_, _| 1.0));
        fn part(range: &maquette_value::RangeImage) -> Region {
            region(range, |x, y| x < 5 && y < 4)
        }
        let error = weights_inside(&net(), &part(&here), 2.0).unwrap_err();
        assert_eq!(error.to_string(), "`region` needs a net that was made from a region");
        let made =
            control_net(&part(&here), &here, NetMethod::Grid, 0, 0, &Progress::silent()).unwrap();
        let error = weights_inside(&made, &part(&there), 2.0).unwrap_err();
        let size = "the region is part of a grid of [11, 10] cells, the net of one of [12, 10]";
        assert_eq!(error.to_string(), size);
    }

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
    fn weights_that_are_not_positive_are_named() {
        let zero = weights(&net(), 1.0, &[1.0, 0.0], &[]).unwrap();
        let error = check_positive(&zero).unwrap_err().to_string();
        assert_eq!(
            error,
            "the weight of control point (1, 0) is 0; expected a weight greater than 0"
        );
        assert!(check_positive(&net()).is_ok());
        let negative = point_weights(&net(), &[vec![1.0, 2.0], vec![3.0, -0.5]]).unwrap_err();
        assert_eq!(
            negative.to_string(),
            "the weight of control point (1, 1) is -0.5; expected a weight greater than 0"
        );
        assert!(point_weights(&net(), &[vec![1.0, f64::NAN], vec![1.0, 1.0]]).is_err());
        assert!(point_weights(&net(), &[vec![1.0, 1.0]]).is_err());
    }

    #[test]
    fn factors_for_another_net_are_refused() {
        let error = weights(&net(), 1.0, &[], &[1.0; 3]).unwrap_err();
        assert_eq!(error.to_string(), "3 factors are given for 2 columns");
        assert!(weights(&net(), -1.0, &[], &[]).is_err());
        assert!(weights(&net(), f64::NAN, &[], &[]).is_err());
    }
}
