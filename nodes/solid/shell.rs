//! Gives a surface a thickness.
//!
//! Moving each vertex along its normal would fold the surface where its radius of curvature is smaller than the thickness. So a layer is
//! made first whose vertices move only as far as there is room, and the volume within the thickness of the surface is added where the
//! layer is too thin. That volume comes from a grid, and is cut off at the surface by `Boolean`, so that the surface itself does not
//! change.

use maquette_base::topology::flat_faces::remove_flat_faces;
use maquette_mesh::{Outside, orient};
use maquette_node::{Carry, Context, Error, In, Node, Progress, Promise, Transfer, Want, bail};
use maquette_value::{Mesh, TriangleTree};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::thicken::{ThinWalls, thin};
use crate::volume::volume;

mod backs;
mod behind;
mod layer;
mod patch;
mod probes;
mod settle;

/// Gives a surface a thickness: an open scan becomes a shell that can be printed, as a mask is.
///
/// The surface itself does not change, unless it is in the middle. The other side is at least at the distance `thickness`, farther only
/// behind sharp edges, and is missing where there is no room for it: a finger becomes solid. Borders get upright walls, which lean outward
/// beside bends that are tighter than `thickness`. The other side of a rough scan is made along the rays of its sensor. Places where the
/// shell is still too thin are named in a warning; with a thickness far below the edge length they are left as they are. The other side has
/// the attributes of the place from which it was moved, or of the nearest point of the surface.
///
/// In other programs: solidify, thicken, extrude.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Shell {
    /// The surface.
    pub mesh: In<Mesh>,
    /// Minimum thickness in mm.
    #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
    #[serde(default = "default_thickness")]
    pub thickness: f64,
    /// The side of the surface on which the shell is added.
    #[serde(default)]
    pub side: Side,
}

fn default_thickness() -> f64 {
    2.0
}

/// Position of a shell relative to its surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Side {
    /// Behind the surface, which is the visible front.
    #[default]
    Inside,
    /// In front of the surface.
    Outside,
    /// Half of the thickness on each side.
    Middle,
}

impl Node for Shell {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const WANTS: &'static [Want<Self>] = &[
        Want::new("mesh", "NonEmpty"),
        Want::new("mesh", "Manifold"),
        Want::new("mesh", "Oriented"),
    ];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::always("mesh", "Closed"),
        Promise::always("mesh", "Manifold"),
        Promise::always("mesh", "Oriented"),
        Promise::always("mesh", "NonEmpty"),
        Promise::from("mesh", "Triangles", "mesh"),
    ];

    const CARRIES: &'static [Carry] = &[Carry::per_domain(
        "mesh",
        "mesh",
        [Transfer::Interpolated, Transfer::Interpolated, Transfer::Kept, Transfer::Kept],
    )];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (shell, thin) = shell(cx.get(&self.mesh), self.thickness, self.side, cx.progress())?;
        if let Some(thin) = thin {
            cx.warn(thin.warning(self.thickness));
        }
        Ok((shell,))
    }
}

/// Returns the shell of a surface, see [`Shell`], and the walls that are thinner than requested.
///
/// The cost grows with the number of faces, and with the area of those parts where the layer is too thin, in squares of the thickness.
///
/// # Errors
/// Returns an error if the thickness is invalid, the surface intersects itself, there are too many cells around it, or the evaluation is
/// cancelled.
pub fn shell(
    mesh: &Mesh,
    thickness: f64,
    side: Side,
    progress: &Progress<'_>,
) -> Result<(Mesh, Option<ThinWalls>), Error> {
    if !(thickness > 0.0 && thickness.is_finite()) {
        bail!("`thickness` is {thickness}, but must be a number above 0");
    }
    if mesh.faces().is_empty() {
        bail!("the shell is empty: the surface has no faces");
    }
    let edges = mesh.edges();
    let count = edges.misoriented + edges.faces.iter().filter(|faces| 2 < **faces).count();
    if count > 0 {
        bail!(
            "the faces are not a surface: {count} edges have more than two faces, or two with different orientations{}; use `Orient` to turn faces",
            first_bad_edge(mesh)
        );
    }
    let size = mesh.bounds().map_or(0.0, |(low, high)| (high - low).norm());
    if !(1e-9..=1e3).contains(&(thickness / size)) {
        bail!(
            "the shell is empty: `thickness`, {thickness} mm, is too large or too small for the surface's size of {size} mm; {:.1e} to {:.1e} mm are possible",
            1e-9 * size,
            1e3 * size
        );
    }
    if side != Side::Middle && !edges.faces.contains(&1) && volume(mesh, mesh.positions()[0]) <= 0.0
    {
        bail!(
            "the surface has no inside behind it: use `Orient` to make its faces look outward, or `side: Middle`, which needs no inside"
        );
    }
    // Faces without area have no side, and layers would follow the angles of their corners.
    let cleaned = remove_flat_faces(mesh, |_| true)?;
    let bare = cleaned.as_ref().unwrap_or(mesh).clone().without_attribute("normal");
    let shell = match side {
        Side::Inside => patch::one_sided(&bare, thickness, progress)?,
        Side::Outside => {
            patch::one_sided(&orient(&bare, Outside::Flip)?.mesh, thickness, progress)?
        }
        Side::Middle => patch::two_sided(&bare, thickness, progress)?,
    };
    let thin = ThinWalls::new(&shell, &thin(&shell, &TriangleTree::new(&shell), thickness));
    Ok((shell, thin))
}

/// Returns the place of the first edge of a mesh with more than two faces, as a part of a sentence; empty if there is none.
fn first_bad_edge(mesh: &Mesh) -> String {
    let edges = mesh.edges();
    let Some(bad) = edges.faces.iter().position(|faces| 2 < *faces) else { return String::new() };
    let [a, b] = edges.vertices[bad].map(|vertex| mesh.positions()[vertex as usize]);
    let at = nalgebra::center(&a, &b);
    format!("; one with {} faces is at ({:.3}, {:.3}, {:.3})", edges.faces[bad], at.x, at.y, at.z)
}

#[cfg(test)]
mod tests;
