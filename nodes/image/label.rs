//! Numbers the connected parts of a mask.

use maquette_node::{Context, Error, In, Node};
use maquette_value::{Labels, Mask};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::connectivity::Connectivity;
use super::segment::components::label;

/// Numbers the connected parts of a mask: 1, 2, ... in the order of their first pixels, row by row from the top.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Label {
    /// Mask to divide.
    pub mask: In<Mask>,
    /// Neighborhood that connects pixels.
    #[serde(default)]
    pub connectivity: Connectivity,
}

impl Node for Label {
    type Outputs = (Labels,);
    const OUTPUTS: [&'static str; 1] = ["labels"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((label(cx.get(&self.mask), self.connectivity),))
    }
}
