//! Makes a control net from points in the graph file.

use maquette_node::{Context, Error, FieldError, Node};
use maquette_value as value;
use maquette_value::ControlNetError;
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::point_weights::point_weights;

/// Makes a control net from given points.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct PointNet {
    /// The points (x, y, z) in mm: a list of rows of equal length. Rows run along u, the points of a row along v.
    #[schemars(extend("unit" = "mm"))]
    pub points: Vec<Vec<[f64; 3]>>,
    /// The weight of each point, greater than 0: a list of rows, as `points`. Empty means 1 for all.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub weights: Vec<Vec<f64>>,
}

impl Node for PointNet {
    type Outputs = (value::ControlNet,);
    const OUTPUTS: [&'static str; 1] = ["net"];

    fn check(&self) -> Result<(), FieldError> {
        let help = "write at least two rows of equally many points, as `[[(0, 0, 0), (1, 0, 0)], [(0, 1, 0), (1, 1, 0)]]`";
        fn field_error(why: &dyn std::fmt::Display, help: &str) -> FieldError {
            FieldError::new("points", why, help)
        }
        let net = point_net(&self.points).map_err(|why| field_error(&why, help))?;
        let help = "write as many rows of weights as of points, and one weight greater than 0 for each point";
        with_point_weights(net.clone(), &self.weights)
            .map_err(|why| FieldError::new("weights", why, help))?;
        let help = "write at least two rows of equally many points, as `[[(0, 0, 0), (1, 0, 0)], [(0, 1, 0), (1, 1, 0)]]`";
        // A net of a single row or column makes no surface.
        match (net.rows(), net.columns()) {
            (2.., 2..) => Ok(()),
            (rows, columns) => {
                let wanted = "expected at least 2 rows and 2 columns";
                Err(field_error(&format!("{wanted}, found {rows} and {columns}"), help))
            }
        }
    }

    fn eval(&self, _: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((with_point_weights(point_net(&self.points)?, &self.weights)?,))
    }
}

/// Returns the net with the given rows of weights; an empty list keeps its weights.
///
/// # Errors
/// Returns an error if there is not one weight for each point, or a weight is not greater than 0.
fn with_point_weights(
    net: value::ControlNet,
    weights: &[Vec<f64>],
) -> Result<value::ControlNet, Error> {
    if weights.is_empty() {
        return Ok(net);
    }
    let weights = point_weights(&net, weights)?;
    Ok(net.with_weights(weights)?)
}

/// Makes the control net of the given rows of points; all weights are 1, and no point is fixed.
///
/// # Errors
/// Returns an error if the rows differ in length, there is no point, or a point is not finite.
pub fn point_net(points: &[Vec<[f64; 3]>]) -> Result<value::ControlNet, ControlNetError> {
    let expected = points.first().map_or(0, Vec::len);
    if let Some(row) = points.iter().position(|row| row.len() != expected) {
        return Err(ControlNetError::Ragged { row, length: points[row].len(), expected });
    }
    let all = points.iter().flatten().copied().map(Point3::from);
    value::ControlNet::new(points.len(), expected, all.collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_rows() {
        let net = point_net(&[vec![[0.0; 3], [1.0, 2.0, 3.0]], vec![[4.0; 3], [5.0; 3]]]).unwrap();
        assert_eq!((net.rows(), net.columns()), (2, 2));
        assert_eq!(net.points()[1], Point3::new(1.0, 2.0, 3.0));
    }

    #[test]
    fn every_point_may_have_a_weight() {
        let net = point_net(&[vec![[0.0; 3], [1.0, 2.0, 3.0]], vec![[4.0; 3], [5.0; 3]]]).unwrap();
        let weighted = |weights: &[Vec<f64>]| with_point_weights(net.clone(), weights);
        let heavy = weighted(&[vec![1.0, 2.0], vec![0.5, 1.0]]).unwrap();
        assert_eq!(heavy.weights(), [1.0, 2.0, 0.5, 1.0]);
        assert_eq!(weighted(&[]).unwrap(), net);
        let zero = weighted(&[vec![1.0, 2.0], vec![0.0, 1.0]]).unwrap_err().to_string();
        assert_eq!(
            zero,
            "the weight of control point (1, 0) is 0; expected a weight greater than 0"
        );
        let short = weighted(&[vec![1.0, 2.0], vec![1.0]]).unwrap_err().to_string();
        assert_eq!(short, "row 1 has 1 weights, the net has 2 columns");
    }

    #[test]
    fn rows_that_make_no_net_are_refused() {
        let ragged = point_net(&[vec![[0.0; 3]; 2], vec![[0.0; 3]]]);
        assert_eq!(ragged, Err(ControlNetError::Ragged { row: 1, length: 1, expected: 2 }));
        assert!(point_net(&[]).is_err());
        assert!(point_net(&[vec![], vec![]]).is_err());
        assert!(point_net(&[vec![[f64::NAN; 3]]]).is_err());
    }
}
