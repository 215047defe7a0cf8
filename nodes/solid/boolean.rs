//! Unites solids, cuts them out of each other, or takes what they have in common.

use maquette::value::{Mesh, MeshError};
use maquette::{Cancelled, Carry, Context, Error, Fate, In, Node, Progress, Promise, Want};
use maquette_mesh::{MergeError, Poses, merge};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::volume::volume;
use cut::Cut;
use meet::{NoSolid, Pair};

mod cut;
mod exact;
mod meet;
mod weld;

/// Unites solids, cuts solids out of another one, or takes what all have in common.
///
/// Faces away from where skins meet stay as they are, polygons too; those that are cut become triangles. The result is closed and manifold,
/// also where walls lie in one plane. What lies on the solids is kept as `Merge` keeps it, and mixed where edges are cut; normals are dropped,
/// since they are others at the cut.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Boolean {
    /// The solid.
    pub mesh: In<Mesh>,
    /// The others, one after the other.
    pub with: Vec<In<Mesh>>,
    /// What becomes of them.
    #[serde(default)]
    pub operation: Operation,
}

/// What becomes of solids.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Operation {
    /// What is in any of them.
    #[default]
    Union,
    /// What is in the first one, and not in the others.
    Difference,
    /// What is in all of them.
    Intersection,
}

/// Why solids make no other one.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum BooleanError {
    /// A mesh with a border.
    #[error("{mesh} is not closed: {count} of its edges have not two faces; `Solid` closes it")]
    Open {
        /// Which mesh.
        mesh: String,
        /// How many edges.
        count: usize,
    },
    /// A side that is none.
    #[error("{mesh} is inside out: `Orient` turns it")]
    InsideOut {
        /// Which mesh.
        mesh: String,
    },
    /// A mesh that crosses itself.
    #[error("{mesh} runs through itself, or one of its parts lies in another one: seen from ({:.3}, {:.3}, {:.3}) it has no inside; `Reconstruct` makes one skin of it", at[0], at[1], at[2])]
    Crossing {
        /// Which mesh.
        mesh: String,
        /// Where.
        at: [f64; 3],
    },
    /// Too much for a mesh.
    #[error(transparent)]
    Merge(#[from] MergeError),
    /// Too much for a mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl Node for Boolean {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const WANTS: &'static [Want<Self>] = &[
        Want::new("mesh", "Closed"),
        Want::new("mesh", "Manifold"),
        Want::new("mesh", "Oriented"),
        Want::new("with", "Closed"),
        Want::new("with", "Manifold"),
        Want::new("with", "Oriented"),
    ];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::always("mesh", "Closed"),
        Promise::always("mesh", "Manifold"),
        Promise::always("mesh", "Oriented"),
    ];

    const CARRIES: &'static [Carry] = &[
        Carry::each(
            "mesh",
            "mesh",
            [Fate::Interpolated, Fate::Interpolated, Fate::Kept, Fate::Kept],
        ),
        Carry::each(
            "with",
            "mesh",
            [Fate::Interpolated, Fate::Interpolated, Fate::Kept, Fate::Kept],
        ),
    ];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let others = Vec::from_iter(self.with.iter().map(|mesh| cx.get(mesh)));
        let made = boolean(cx.get(&self.mesh), &others, self.operation, cx.progress())?;
        if made.faces().is_empty() {
            cx.warn("nothing is left: the mesh is empty");
        }
        Ok((made,))
    }
}

/// What [`Operation`] makes of a solid and others.
///
/// Which edge goes through which triangle is decided on a grid of 2^30 cells along the longest side, exactly, and without ties, since the other
/// solid grows by infinitely little, or shrinks for an intersection (Edelsbrunner and Mucke, "Simulation of simplicity", 1990). Both skins meet
/// in closed lines, therefore; what these leave of a triangle is triangulated with all of its corners, and nothing has to be sewn together.
/// Only the places of meetings are rounded: faces next to the cut may be thin, or overlap by some 1e-9 of the size. Cost grows with n log n, and
/// of a face that is cut with the square of its pieces.
///
/// # Errors
/// If a mesh is no solid, the result is too large, or the evaluation is told to stop.
pub fn boolean(
    mesh: &Mesh,
    others: &[&Mesh],
    how: Operation,
    progress: &Progress<'_>,
) -> Result<Mesh, BooleanError> {
    let name = |number: usize| match (number, others.len()) {
        (0, _) => "`mesh`".to_owned(),
        (1, 1) => "`with`".to_owned(),
        _ => format!("mesh {number} of `with`"),
    };
    for (number, mesh) in [mesh].iter().chain(others).enumerate() {
        let edges = mesh.edges();
        let count = edges.faces.iter().filter(|faces| **faces != 2).count();
        if count > 0 {
            return Err(BooleanError::Open { mesh: name(number), count });
        }
        if mesh.bounds().is_some_and(|(low, _)| volume(mesh, low) < 0.0) {
            return Err(BooleanError::InsideOut { mesh: name(number) });
        }
    }
    let mut made = mesh.clone();
    for (number, other) in others.iter().enumerate() {
        let [from, to] = [number, number + 1].map(|it| it as f64 / others.len() as f64);
        let of_two = progress.part(from..to, |progress| of_two(&made, other, how, progress));
        made = of_two.map_err(|why| match why {
            NoSolid::Crossing(0, at) => {
                BooleanError::Crossing { mesh: name(0), at: at.coords.into() }
            }
            NoSolid::Crossing(_, at) => {
                BooleanError::Crossing { mesh: name(number + 1), at: at.coords.into() }
            }
            NoSolid::Merge(why) => why.into(),
            NoSolid::Mesh(why) => why.into(),
            NoSolid::Cancelled(why) => why.into(),
        })?;
    }
    Ok(made)
}

fn of_two(
    first: &Mesh,
    second: &Mesh,
    how: Operation,
    progress: &Progress<'_>,
) -> Result<Mesh, NoSolid> {
    let both = merge(&[first, second], Poses::Ignore)?;
    let counts = (first.positions().len(), first.faces().len());
    let made = |grows: bool, progress: &Progress<'_>| -> Result<Mesh, NoSolid> {
        let pair = Pair::new(&both, counts, grows);
        let meet = progress.part(0.0..0.5, |progress| pair.meet(progress))?;
        let inside = pair.inside(&meet)?;
        progress.tick(0.7)?;
        let cut = Cut::new(&pair, &meet, &inside, how);
        progress.tick(0.9)?;
        Ok(cut.mesh()?)
    };
    // Walls in one plane become one, or nothing. A solid that touches itself runs into itself where it grows, and shrinks instead.
    let grows = how != Operation::Intersection;
    match progress.part(0.0..0.9, |progress| made(grows, progress)) {
        Err(why @ NoSolid::Crossing(..)) => {
            match progress.part(0.9..1.0, |progress| made(!grows, progress)) {
                Err(NoSolid::Crossing(..)) => Err(why),
                made => made,
            }
        }
        made => made,
    }
}

#[cfg(test)]
mod tests;
