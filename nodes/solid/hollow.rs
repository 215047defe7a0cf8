//! Makes a solid hollow.

use std::collections::BTreeSet;

use depth::Depth;
use maquette_base::topology::union_find::UnionFind;
use maquette_mesh::{MergeError, Poses, merge};
use maquette_node::{
    Cancelled, Carry, Context, Error, Fate, FieldError, In, Node, Progress, Promise, TooMuch, Want,
};
use maquette_value::{Faces, Mesh, MeshError, TriangleTree};
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::combine::{BooleanError, boolean};
use crate::contour::Contour;
use crate::lend::lend;
use crate::operation::Operation;
use crate::volume::volume;

mod depth;
mod walls;

/// Makes a solid hollow: inside of it, as far from its skin as the wall is thick, there is a cavity.
///
/// The skin stays as it is. The skin of the cavity is made on a grid, so that it nowhere runs through itself, and where the solid is
/// too thin there is none; where it is just thick enough, thin sheets may part two cavities. What would be smaller than a cube half as wide as
/// the wall is thick stays filled. What lies on the skin lies on the nearest place of the cavity, too. A cavity that nothing leads out of keeps its
/// resin or powder: `outlets` are drilled through the wall.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Hollow {
    /// The solid.
    pub mesh: In<Mesh>,
    /// How thick the wall is: nowhere thinner, but for up to a thirtieth in tight places.
    #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
    #[serde(default = "two")]
    pub thickness: f64,
    /// The edge of the grid's cells, at most half of `thickness`; 0 takes that half.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub spacing: f64,
    /// Holes through the wall, through which resin or powder leaves the cavity; a second one lets air in.
    #[serde(default)]
    pub outlets: Vec<Outlet>,
}

/// A round hole from the skin to the cavity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Outlet {
    /// Where: it begins where the skin is nearest to this place, and runs the shortest way to the cavity.
    #[schemars(extend("unit" = "mm"))]
    pub at: [f64; 3],
    /// How wide it is.
    #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
    #[serde(default = "three")]
    pub diameter: f64,
}

fn three() -> f64 {
    3.0
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
    /// A hole that is none.
    #[error("outlet {number} has the diameter {diameter} at ({}, {}, {}), but must have finite numbers, and a diameter above 0", at[0], at[1], at[2])]
    Outlet {
        /// Which one, from 1.
        number: usize,
        /// Its diameter.
        diameter: f64,
        /// Its place.
        at: [f64; 3],
    },
    /// Holes that take too much.
    #[error("{}: the outlets are too wide, or go through more than the wall", match parts { 0 => "nothing is left of the solid".to_owned(), _ => format!("the solid falls into {parts} parts") })]
    Outlets {
        /// Into how many parts it falls.
        parts: usize,
    },
    /// A hole that cannot be cut.
    #[error(transparent)]
    Boolean(#[from] BooleanError),
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

    const CARRIES: &'static [Carry] = &[Carry::each(
        "mesh",
        "mesh",
        [Fate::Interpolated, Fate::Interpolated, Fate::Kept, Fate::Kept],
    )];

    fn check(&self) -> Result<(), FieldError> {
        let (spacing, most) = (self.spacing, self.thickness / 2.0);
        if most < spacing {
            let help = "write 0, which takes that half, or a thicker wall";
            return Err(FieldError::new("spacing", HollowError::Spacing { spacing, most }, help));
        }
        Ok(())
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let how = (self.thickness, self.spacing);
        let hollow = hollow(mesh, how, &self.outlets, cx.progress())?;
        let closed = parts(&hollow).saturating_sub(parts(mesh));
        if !self.outlets.is_empty() && closed > 0 {
            let cavities = if closed == 1 { "cavity has" } else { "cavities have" };
            cx.warn(format!("{closed} {cavities} no outlet: resin or powder stays there"));
        }
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
/// generalized winding numbers", 2013). The surface at the distance is made of tetrahedra, and so always a closed manifold. Cost grows with the number of
/// cells.
///
/// # Errors
/// If the mesh is no solid, a parameter is out of range, there would be too many cells, or the evaluation is told to stop.
pub fn hollow(
    mesh: &Mesh,
    (thickness, spacing): (f64, f64),
    outlets: &[Outlet],
    progress: &Progress<'_>,
) -> Result<Mesh, HollowError> {
    if !(thickness > 0.0 && thickness.is_finite()) {
        return Err(HollowError::Thickness(thickness));
    }
    for (number, &Outlet { at, diameter }) in (1..).zip(outlets) {
        let is_one = diameter > 0.0 && diameter.is_finite() && at.iter().all(|x| x.is_finite());
        if !is_one {
            return Err(HollowError::Outlet { number, diameter, at });
        }
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
    let crossing = progress.part(0.0..0.1, |progress| mesh.crossings(|| progress.check()))?;
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
    let mut contour = depth.contour(thickness, progress)?;
    walls::keep_walls(&mut contour, &tree, thickness, progress)?;
    walls::leave_out_bubbles(&mut contour, most * most * most);
    if contour.triangles.is_empty() {
        return Ok(mesh.clone());
    }
    let Contour { points, triangles, .. } = contour;
    let faces: Vec<_> = (0..triangles.len() as u32).collect();
    let cavity = Mesh::new(points, Faces::triangles(triangles))?.select(&faces);
    let cavity = lend(mesh, &tree, cavity)?.with_frame(mesh.frame().copied());
    let hollow = merge(&[mesh, &cavity], Poses::Ignore)?.with_creases(mesh.creases())?;
    if outlets.is_empty() {
        return Ok(hollow);
    }
    let inner = TriangleTree::new(&cavity);
    // What is drilled already is not drilled again.
    let new = outlets.iter().enumerate().filter(|(k, outlet)| !outlets[..*k].contains(outlet));
    let drills: Vec<Mesh> = new
        .map(|(_, outlet)| {
            let drill = drill((mesh, &tree), (&cavity, &inner), outlet)?;
            Ok(lend(mesh, &tree, drill)?.with_frame(mesh.frame().copied()))
        })
        .collect::<Result<_, MeshError>>()?;
    let drills = Vec::from_iter(&drills);
    let drilled = boolean(&hollow, &drills, Operation::Difference, progress)?;
    let parts = parts(&drilled);
    if parts == 0 || self::parts(&hollow) < parts {
        return Err(HollowError::Outlets { parts });
    }
    Ok(drilled)
}

/// How many skins there are.
fn parts(mesh: &Mesh) -> usize {
    let mut sets = UnionFind::new(mesh.positions().len());
    for face in mesh.faces().iter() {
        face[1..].iter().for_each(|&vertex| sets.join(face[0], vertex));
    }
    let of_faces = mesh.faces().iter().map(|face| sets.first(face[0]));
    of_faces.collect::<BTreeSet<u32>>().len()
}

/// Sides of a drill.
const SIDES: u32 = 32;

/// What an outlet takes away: a prism through the wall.
fn drill(
    skin: (&Mesh, &TriangleTree),
    cavity: (&Mesh, &TriangleTree),
    outlet: &Outlet,
) -> Result<Mesh, MeshError> {
    fn nearest((mesh, tree): (&Mesh, &TriangleTree), at: Point3<f64>) -> Point3<f64> {
        tree.nearest_to_all(&[at])[0].map_or(at, |nearest| nearest.place(mesh))
    }
    let start = nearest(skin, outlet.at.into());
    let end = nearest(cavity, start);
    let axis = (end - start).try_normalize(0.0).unwrap_or(Vector3::z());
    let across = axis.cross(&Vector3::ith(axis.iamin(), 1.0)).normalize();
    let other = axis.cross(&across);
    // As far beyond both as it is wide, so that it is through where the skins are bent.
    let ends = [start - axis * outlet.diameter, end + axis * outlet.diameter];
    let radius = outlet.diameter / 2.0;
    fn corner(k: u32, across: Vector3<f64>, other: Vector3<f64>, radius: f64) -> Vector3<f64> {
        let turn = std::f64::consts::TAU * f64::from(k) / f64::from(SIDES);
        (across * libm::cos(turn) + other * libm::sin(turn)) * radius
    }
    let places =
        ends.iter().flat_map(|end| (0..SIDES).map(move |k| end + corner(k, across, other, radius)));
    let sides = (0..SIDES).flat_map(|k| {
        let next = (k + 1) % SIDES;
        [k, next, SIDES + next, SIDES + k]
    });
    let lids = (0..SIDES).rev().chain(SIDES..2 * SIDES);
    let counts: Vec<_> = (0..SIDES).map(|_| 4).chain([SIDES as usize; 2]).collect();
    Mesh::new(Vec::from_iter(places), Faces::polygons(&counts, sides.chain(lids).collect())?)
}

#[cfg(test)]
mod tests;
