//! Turns the faces of a mesh over.

use maquette_node::{Carry, Context, Error, Fate, In, Node, Promise};
use maquette_value::Mesh;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::turned_faces::turned_faces;

/// Turns each face of a mesh over, so that the other side is its front.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct TurnOver {
    /// The mesh.
    pub mesh: In<Mesh>,
}

impl Node for TurnOver {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] = &[Carry::all("mesh", "mesh", Fate::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let all = vec![true; mesh.faces().len()];
        Ok((turned_faces(mesh, &all)?,))
    }
}
