//! Moves something as an alignment moved a scan.

use maquette_mesh::Movable;
use maquette_node::{Carry, Context, Error, Fate, In, Node, Promise};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::align_error::AlignError;
use super::alignment::Alignment;
use super::moved::moved;

/// Moves something as `Align` or `AlignAll` moved a scan: what was left out for the alignment, or the scan as it is now.
///
/// It then lies in the axes of the scan that stayed, and knows that scan's pose, if there is one.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct MoveAligned {
    /// What is moved: a mesh, a range image, points, a curve or a control net.
    pub mesh: In<Movable>,
    /// What `Align` or `AlignAll` found.
    pub alignment: In<Alignment>,
    /// As which scan it is moved: for `AlignAll` its place in the list, from 1; for `Align` 2 is the one that was moved.
    #[schemars(range(min = 1))]
    #[serde(default = "two")]
    pub scan: u32,
}

fn two() -> u32 {
    2
}

impl Node for MoveAligned {
    type Outputs = (Movable,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] =
        &[Carry::all("mesh", "mesh", Fate::Kept).and_cells(Fate::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let alignment = cx.get(&self.alignment);
        let none = AlignError::NoScan { scan: self.scan, count: alignment.count() };
        let motion = alignment.motion(self.scan).ok_or(none)?;
        let moved = moved(&cx.get(&self.mesh), &motion, alignment.frame().as_ref());
        Ok((moved.map_err(AlignError::from)?,))
    }
}
