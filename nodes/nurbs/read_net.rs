//! Reads a control net from a file.

use maquette_node::{Context, Error, FilePath, Node};
use maquette_value as value;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Reads a control net with its weights from a JSON file, as the output of a net to `.json` writes it.
///
/// `{"points": [[[0, 0, 0], [1, 0, 0]], [[0, 1, 0], [1, 1, 0]]], "weights": [[1, 1], [1, 2]]}`: lists of rows, coordinates in mm. `weights`
/// (greater than 0, default 1), `base` (the points before an offset) and `fixed` (1 for points that `OffsetNet` does not move) may be
/// omitted. The file has no relation to a capture, so `Blend` cannot write the surface of such a net back.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ReadNet {
    /// The file: `json`.
    #[schemars(extend("reads" = "ControlNet"))]
    pub path: FilePath,
}

impl Node for ReadNet {
    type Outputs = (value::ControlNet,);
    const OUTPUTS: [&'static str; 1] = ["net"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((cx.read(&self.path)?,))
    }
}
