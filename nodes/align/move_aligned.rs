//! Applies the motion of an alignment to other data.

use maquette_mesh::Movable;
use maquette_node::{Carry, Context, Error, In, Node, Promise, Transfer, bail};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::alignment::Alignment;
use super::motion::move_item;

/// Applies the motion that `Align` or `AlignAll` found for a scan to other data, such as the full scan or a part that was not aligned.
///
/// The result is in the axes of the scan that stayed, and has its pose, if there is one.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct MoveAligned {
    /// Data to move: a mesh, a range image, points, a curve or a control net.
    pub mesh: In<Movable>,
    /// Output `alignment` of `Align` or `AlignAll`.
    pub alignment: In<Alignment>,
    /// Number of the scan whose motion is applied: for `AlignAll` its index in the list, from 1; for `Align` 2 is the scan that was moved.
    #[schemars(range(min = 1))]
    #[serde(default = "default_scan")]
    pub scan: u32,
}

fn default_scan() -> u32 {
    2
}

impl Node for MoveAligned {
    type Outputs = (Movable,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] =
        &[Carry::uniform("mesh", "mesh", Transfer::Kept).and_cells(Transfer::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let alignment = cx.get(&self.alignment);
        let Some(motion) = alignment.motion(self.scan) else {
            bail!("unknown scan {}: the alignment has {} scans", self.scan, alignment.count());
        };
        Ok((move_item(&cx.get(&self.mesh), &motion, alignment.frame().as_ref())?,))
    }
}
