//! Unwraps a mesh: makes texture coordinates.

use maquette_node::{Carry, Context, Error, FieldError, In, Node, Promise, Transfer};
use maquette_value::Mesh;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::layout::{Layout, lay_out};

/// Unwraps a mesh: gives it texture coordinates `uv` in charts that do not overlap.
///
/// The surface is cut into charts, which are flattened with little stretch and packed into the square from (0, 0) to (1, 1), all at one
/// scale. No face is inverted or overlaps another one, so that each point of the surface has its own position in a texture. The coordinates
/// are at the corners of faces: at a seam a vertex has several. An existing texture is removed, since it no longer fits.
///
/// In other programs: UV flatten, parameterize.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Unwrap {
    /// The mesh.
    pub mesh: In<Mesh>,
    /// Parameters of the layout.
    #[serde(flatten)]
    pub layout: Layout,
}

impl Node for Unwrap {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] =
        &[Carry::uniform("mesh", "mesh", Transfer::Kept).excluding(&["uv"])];

    fn check(&self) -> Result<(), FieldError> {
        self.layout.check_fields()
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((lay_out(cx.get(&self.mesh), &self.layout, cx.progress())?.mesh,))
    }
}
