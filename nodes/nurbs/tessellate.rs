//! Makes a mesh of a surface.

use maquette::value::{Mesh, Surface};
use maquette::{Context, Error, In, Node};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Makes a mesh of quads of a surface, with its exact normals and its parameters, scaled to 0..1, as `uv`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Tessellate {
    /// The surface.
    pub surface: In<Surface>,
    /// Quads along u, evenly spaced in the parameter. 0 chooses: each span is divided evenly, so that all quads stay within 1/1000
    /// of the diagonal of the net's box.
    #[schemars(range(max = 8192))]
    #[serde(default)]
    pub u: usize,
    /// Quads along v, in the same way.
    #[schemars(range(max = 8192))]
    #[serde(default)]
    pub v: usize,
}

impl Node for Tessellate {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((cx.get(&self.surface).tessellate(self.u, self.v)?,))
    }
}
