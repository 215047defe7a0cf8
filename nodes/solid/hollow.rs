//! Makes a solid hollow.

use maquette::value::{Faces, Mesh, MeshError, TriangleTree};
use maquette::{
    Cancelled, Carry, Context, Error, Fate, In, Node, Progress, Promise, TooMuch, Want,
};
use maquette_mesh::{MergeError, Poses, merge};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::crossings::crossings;
use crate::lend::lend;
use crate::volume::volume;
use depth::Depth;

mod contour;
mod depth;

/// Makes a solid hollow: inside of it, as far from its skin as the wall is thick, there is a cavity.
///
/// The skin stays as it is. The skin of the cavity is made on a grid, so that it nowhere runs through itself, and where the solid is
/// too thin there is none; where it is just thick enough, thin sheets may part two cavities. What lies on the skin lies on the nearest
/// place of the cavity, too. A cavity that nothing leads out of keeps its resin or powder.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Hollow {
    /// The solid.
    pub mesh: In<Mesh>,
    /// How thick the wall is at least.
    #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
    #[serde(default = "two")]
    pub thickness: f64,
    /// The edge of the grid's cells, at most half of `thickness`; 0 takes that half.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub spacing: f64,
}

fn two() -> f64 {
    2.0
}

/// Why a solid cannot be made hollow.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum HollowError {
    /// A wall that is none.
    #[error("`thickness` is {0}, but must be a number above 0")]
    Thickness(f64),
    /// Cells that are too large.
    #[error(
        "`spacing` is {spacing}, but must be at least 0, and at most {most}, half of `thickness`"
    )]
    Spacing {
        /// What was given.
        spacing: f64,
        /// The most.
        most: f64,
    },
    /// A mesh with a border.
    #[error("the mesh is not closed: {count} of its edges have not two faces; `Solid` closes it")]
    Open {
        /// How many edges.
        count: usize,
    },
    /// Faces that cross.
    #[error("the mesh runs through itself: {count} pairs of faces cross, such as {} and {}; `Reconstruct` makes one skin of such data", faces[0], faces[1])]
    Crossing {
        /// How many pairs.
        count: usize,
        /// The first one.
        faces: [u32; 2],
    },
    /// A side that is none.
    #[error("the mesh is inside out: `Orient` turns it")]
    InsideOut,
    /// More cells than memory should hold.
    #[error(transparent)]
    TooMuch(#[from] TooMuch),
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

impl Node for Hollow {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const WANTS: &'static [Want<Self>] = &[
        Want::new("mesh", "Closed"),
        Want::new("mesh", "Manifold"),
        Want::new("mesh", "Oriented"),
    ];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::always("mesh", "Closed"),
        Promise::always("mesh", "Manifold"),
        Promise::always("mesh", "Oriented"),
        Promise::from("mesh", "Triangles", "mesh"),
        Promise::from("mesh", "NonEmpty", "mesh"),
    ];

    const CARRIES: &'static [Carry] = &[Carry::all("mesh", "mesh", Fate::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let hollow = hollow(mesh, self.thickness, self.spacing, cx.progress())?;
        if hollow.faces().len() == mesh.faces().len() {
            cx.warn(format!("the solid stays whole: nowhere is it thick enough for a cavity behind walls of {} mm", self.thickness));
        }
        Ok((hollow,))
    }
}

/// A solid with a cavity `thickness` mm behind its skin, on a grid of cells with the edge `spacing` (half of that if 0).
///
/// Distances are measured at the nodes of the grid, where it is not clear from afar that they are larger. What is inside is known where nodes hang together
/// without coming near to the skin: one winding number for each such part (Jacobson, Kavan and Sorkine-Hornung, "Robust inside-outside segmentation using
/// generalized winding numbers", 2013). The surface at the distance is made of tetrahedra, six for each cell (Doi and Koide, "An efficient method of
/// triangulating equi-valued surfaces by using tetrahedral cells", 1991), and so always a closed manifold. Cost grows with the number of cells.
///
/// # Errors
/// If the mesh is no solid, a parameter is out of range, there would be too many cells, or the evaluation is told to stop.
pub fn hollow(
    mesh: &Mesh,
    thickness: f64,
    spacing: f64,
    progress: &Progress<'_>,
) -> Result<Mesh, HollowError> {
    if !(thickness > 0.0 && thickness.is_finite()) {
        return Err(HollowError::Thickness(thickness));
    }
    let most = thickness / 2.0;
    if !(0.0..=most).contains(&spacing) {
        return Err(HollowError::Spacing { spacing, most });
    }
    let spacing = if spacing == 0.0 { most } else { spacing };
    let open = mesh.edges().faces.iter().filter(|faces| **faces != 2).count();
    if open > 0 {
        return Err(HollowError::Open { count: open });
    }
    let crossing = progress.part(0.0..0.1, |progress| crossings(mesh, progress))?;
    if let Some(&faces) = crossing.first() {
        return Err(HollowError::Crossing { count: crossing.len(), faces });
    }
    let Some((low, high)) = mesh.bounds() else { return Ok(mesh.clone()) };
    if volume(mesh, low) < 0.0 {
        return Err(HollowError::InsideOut);
    }
    let tree = TriangleTree::new(mesh);
    let counts = depth::counts([low, high], spacing)?;
    let depth = progress.part(0.1..0.8, |progress| {
        Depth::new((mesh, &tree), low, (counts, spacing), thickness, progress)
    })?;
    let (points, triangles) = contour::contour(&depth, thickness, progress)?;
    if triangles.is_empty() {
        return Ok(mesh.clone());
    }
    let cavity = Mesh::new(points, Faces::triangles(triangles))?;
    let cavity = lend(mesh, &tree, cavity)?.with_frame(mesh.frame().copied());
    Ok(merge(&[mesh, &cavity], Poses::Ignore)?.with_creases(mesh.creases())?)
}

#[cfg(test)]
mod tests;
