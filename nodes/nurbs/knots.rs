//! Makes the knot vector of one direction of a surface.

use maquette_node::{Context, Error, FieldError, In, Node};
use maquette_value as value;
use maquette_value::{KnotVector, ParameterDirection};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::knot_vectors::knot_vector::knots;
use super::knots_kind::KnotsKind;

/// Makes the knot vector of one direction of a surface.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Knots {
    /// The net from which the surface will be made.
    pub net: In<value::ControlNet>,
    /// The direction.
    pub along: ParameterDirection,
    /// Order of the pieces, their degree plus one: 2 is linear, 3 quadratic, 4 cubic.
    #[schemars(range(min = 2, max = 10))]
    #[serde(default = "default_order")]
    pub order: usize,
    /// Kind of the knots.
    #[serde(default)]
    pub kind: KnotsKind,
}

fn default_order() -> usize {
    3
}

impl Node for Knots {
    type Outputs = (KnotVector,);
    const OUTPUTS: [&'static str; 1] = ["knots"];

    fn check(&self) -> Result<(), FieldError> {
        match (&self.kind, self.order) {
            (KnotsKind::Cylinder, order) if order != 3 => {
                let message = format!("`Cylinder` is for order 3, not {order}");
                Err(FieldError::new("order", message, "leave `order` out"))
            }
            (KnotsKind::Values(values), order) => {
                let help = "write as many knots as control points and order together, none below the one before it";
                let made = KnotVector::new(order.saturating_sub(1), values.clone());
                made.map(drop).map_err(|why| FieldError::new("kind", why, help))
            }
            _ => Ok(()),
        }
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((knots(cx.get(&self.net), self.along, self.order, &self.kind)?,))
    }
}
