//! Lays a mesh out flat.

use maquette_node::{Carry, Context, Error, Fate, FieldError, In, Node, Promise};
use maquette_value::Mesh;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::layout::{Layout, lay_out};

/// Lays a mesh out flat: gives it texture coordinates `uv` of charts that do not overlap.
///
/// The surface is cut into charts, which are flattened with little stretch and lie side by side in the square from (0, 0) to (1, 1), all at
/// one scale. No face is turned over or lies on another one, so that each place of the surface has a place of its own in a picture.
/// The coordinates stand at the corners of faces: at a seam a vertex has several. A picture on the mesh is taken off, since it no longer
/// fits.
///
/// In other programs: UV flatten, parameterize.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Unwrap {
    /// The mesh.
    pub mesh: In<Mesh>,
    /// How it is laid out.
    #[serde(flatten)]
    pub layout: Layout,
}

impl Node for Unwrap {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] = &[Carry::all("mesh", "mesh", Fate::Kept).but(&["uv"])];

    fn check(&self) -> Result<(), FieldError> {
        self.layout.check_fields()
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((lay_out(cx.get(&self.mesh), &self.layout, cx.progress())?.mesh,))
    }
}
