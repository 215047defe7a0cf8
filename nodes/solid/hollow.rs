//! Makes a solid hollow.

use std::collections::BTreeSet;

use depth::Depth;
use maquette_base::topology::union_find::UnionFind;
use maquette_mesh::{Poses, merge};
use maquette_node::{
    Carry, Context, Error, FieldError, In, Node, Progress, Promise, Transfer, Want, bail,
};
use maquette_value::{Faces, Mesh, MeshError, TriangleTree};
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sheets::{Sheet, thicken_sheets};
use walls::Walls;

use crate::combine::{Parts, boolean};
use crate::contour::Contour;
use crate::how_to_close::{first_open_edge, how_to_close};
use crate::operation::Operation;
use crate::thicken::ThinWalls;
use crate::transfer_attributes::transfer_attributes;
use crate::volume::volume;

mod depth;
mod sheets;
mod walls;

/// Missing fraction of the thickness of a wall from which on there is a warning.
const MISSING: f64 = 1.0 / 30.0;

/// Hollows a solid: adds a cavity inside, at a distance of the wall's thickness from its surface.
///
/// The outer surface does not change. The surface of the cavity is made on a grid, so that it never intersects itself. Where the solid is
/// too thin, it stays filled; two cavities beside such a place are separated by a wall of the same thickness. A cavity smaller than a cube
/// of half the wall's thickness is filled. The cavity gets the attributes of the nearest point of the outer surface. A cavity without an
/// opening keeps its resin or powder: `outlets` are drilled through the wall. Parts that overlap, or lie in each other and both face
/// outward, are an error, which names the part.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Hollow {
    /// The solid.
    pub mesh: In<Mesh>,
    /// Minimum thickness of the wall in mm; in tight places up to a thirtieth less.
    #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
    #[serde(default = "default_thickness")]
    pub thickness: f64,
    /// Edge length of the grid's cells in mm, at most half of `thickness`; 0 means that half.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub spacing: f64,
    /// Holes through the wall, through which resin or powder leaves the cavity; a second one lets air in.
    #[serde(default)]
    pub outlets: Vec<Outlet>,
}

/// A round hole from the outer surface to the cavity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Outlet {
    /// A point near the hole, in mm: the hole begins at the point of the surface nearest to it, and runs the shortest way to the cavity.
    #[schemars(extend("unit" = "mm"))]
    pub at: [f64; 3],
    /// Diameter in mm.
    #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
    #[serde(default = "default_diameter")]
    pub diameter: f64,
}

fn default_diameter() -> f64 {
    3.0
}

fn default_thickness() -> f64 {
    2.0
}

/// Returns the error for a `spacing` that is negative or greater than `most`, which is half of the thickness.
fn spacing_error(spacing: f64, most: f64) -> Error {
    Error::new(format!(
        "`spacing` is {spacing}, but must be at least 0, and at most {most}, half of `thickness`"
    ))
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

    const CARRIES: &'static [Carry] = &[Carry::per_domain(
        "mesh",
        "mesh",
        [Transfer::Interpolated, Transfer::Interpolated, Transfer::Kept, Transfer::Kept],
    )];

    fn check(&self) -> Result<(), FieldError> {
        let (spacing, most) = (self.spacing, self.thickness / 2.0);
        if most < spacing {
            let help = "write 0, which takes that half, or a thicker wall";
            return Err(FieldError::new("spacing", spacing_error(spacing, most), help));
        }
        Ok(())
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let how = (self.thickness, self.spacing);
        let (hollow, thin) = hollow(mesh, how, &self.outlets, cx.progress())?;
        if let Some(thin) = thin {
            let spacing = if self.spacing == 0.0 { self.thickness / 2.0 } else { self.spacing };
            cx.warn(format!(
                "{}; or use `spacing: {}`",
                thin.warning(self.thickness),
                spacing / 2.0
            ));
        }
        let closed = parts(&hollow).saturating_sub(parts(mesh));
        if !self.outlets.is_empty() && closed > 0 {
            let cavities = if closed == 1 { "cavity has" } else { "cavities have" };
            cx.warn(format!("{closed} {cavities} no outlet: resin or powder stays there"));
        }
        if hollow.faces().len() == mesh.faces().len() {
            cx.warn(format!(
                "no cavity was made: the solid is nowhere thick enough for walls of {} mm",
                self.thickness
            ));
        }
        Ok((hollow,))
    }
}

/// Returns a solid with a cavity `thickness` mm inside its surface. Distances are computed on a grid with cells of the edge length
/// `spacing` (if 0: half of the thickness).
///
/// Distances are measured at grid nodes, except where a coarse test shows that they are larger than needed. Away from the surface, the
/// nodes of a connected component are all inside or all outside, so one winding number decides for each component (Jacobson, Kavan and
/// Sorkine-Hornung, "Robust inside-outside segmentation using generalized winding numbers", 2013). The surface of the cavity is extracted
/// from tetrahedra, so that it is a closed manifold. The cost grows with the number of cells. Also returns the walls that are thinner than
/// requested by more than a thirtieth.
///
/// # Errors
/// Returns an error if the mesh is not a solid, a parameter is out of range, there are too many cells, or the evaluation is cancelled.
pub fn hollow(
    mesh: &Mesh,
    (thickness, spacing): (f64, f64),
    outlets: &[Outlet],
    progress: &Progress<'_>,
) -> Result<(Mesh, Option<ThinWalls>), Error> {
    if !(thickness > 0.0 && thickness.is_finite()) {
        bail!("`thickness` is {thickness}, but must be a number above 0");
    }
    for (number, &Outlet { at, diameter }) in (1..).zip(outlets) {
        let is_one = diameter > 0.0 && diameter.is_finite() && at.iter().all(|x| x.is_finite());
        if !is_one {
            let [x, y, z] = at;
            bail!(
                "outlet {number} has the diameter {diameter} at ({x}, {y}, {z}), but must have finite numbers, and a diameter above 0"
            );
        }
    }
    let most = thickness / 2.0;
    if !(0.0..=most).contains(&spacing) {
        return Err(spacing_error(spacing, most));
    }
    let spacing = if spacing == 0.0 { most } else { spacing };
    let open = mesh.edges().faces.iter().filter(|faces| **faces != 2).count();
    if open > 0 {
        bail!(
            "the mesh is not closed: {open} of its edges do not have two faces, the first one at {}; {}",
            first_open_edge(mesh),
            how_to_close(mesh)
        );
    }
    let crossing = progress.part(0.0..0.1, |progress| mesh.crossings(|| progress.check()))?;
    if let Some([first, second]) = crossing.first() {
        if let Some(part) = Parts::new(mesh).crossing(progress)? {
            bail!("{}", part.describe());
        }
        let at = mesh.first_triangle_center(mesh.faces().face(*first as usize));
        bail!(
            "the mesh intersects itself: {} pairs of faces cross, such as {first} and {second} at ({:.3}, {:.3}, {:.3}); use `Solid(base: Keep, repair: Voxels())` to repair it",
            crossing.len(),
            at.x,
            at.y,
            at.z
        );
    }
    let Some((low, high)) = mesh.bounds() else { return Ok((mesh.clone(), None)) };
    if volume(mesh, low) < 0.0 {
        bail!("the mesh is inside out; use `Orient` to turn it outward");
    }
    if let Some(part) = Parts::new(mesh).misplaced(progress)? {
        bail!("{}", part.describe());
    }
    let tree = TriangleTree::new(mesh);
    let counts = depth::counts([low, high], spacing).map_err(|error| {
        let possible = depth::smallest_spacing([low, high]);
        let value = match possible <= most {
            true => format!("`spacing: {possible:.3}`"),
            false => format!("`thickness: {:.3}`", 2.0 * possible),
        };
        Error::new(format!("{error}, such as {value}"))
    })?;
    let mut depth = progress.part(0.1..0.6, |progress| {
        Depth::new((mesh, &tree), low, (counts, spacing), thickness, progress)
    })?;
    let (contour, sheet) = thicken_sheets(&mut depth, thickness, progress)?;
    drop(depth);
    let least = most * most * most;
    let Some((cavity, thin)) =
        cavity(contour, (&tree, sheet.as_ref()), (thickness, least), progress)?
    else {
        return Ok((mesh.clone(), None));
    };
    let cavity = transfer_attributes(mesh, &tree, cavity)?.with_frame(mesh.frame().copied());
    let hollow = merge(&[mesh, &cavity], Poses::Ignore)?.with_creases(mesh.creases())?;
    let drilled = drill_outlets((mesh, &tree), &cavity, hollow, outlets, progress)?;
    let thin = thin.map(|thin| {
        let nearest = TriangleTree::new(&drilled).nearest_to_all(&[thin.at])[0];
        ThinWalls { face: nearest.map_or(thin.face, |it| it.face as usize), ..thin }
    });
    Ok((drilled, thin))
}

/// Returns the mesh of the cavities of at least `least` mm^3, whose walls are kept thick enough, and the walls that are not; `None` without
/// cavities.
fn cavity(
    mut contour: Contour,
    (tree, sheet): (&TriangleTree, Option<&Sheet>),
    (thickness, least): (f64, f64),
    progress: &Progress<'_>,
) -> Result<Option<(Mesh, Option<ThinWalls>)>, Error> {
    let edges = contour.mesh()?.edges().clone();
    let walls = Walls { skin: tree, sheet, thickness };
    let lacks = progress
        .part(0.7..0.9, |progress| walls::keep_walls(&mut contour, edges, &walls, progress))?;
    let is_large = walls::find_large_cavities(&contour, least);
    let faces: Vec<u32> =
        (0..is_large.len() as u32).filter(|&face| is_large[face as usize]).collect();
    if faces.is_empty() {
        return Ok(None);
    }
    let cavity = contour.mesh()?.select(&faces);
    let enough = (1.0 - MISSING) * thickness;
    let mut thin = match sheet {
        Some(sheet) => sheets::remaining_thin_sheets(&cavity, sheet, enough, progress)?,
        None => Vec::new(),
    };
    let of_skin = faces.iter().map(|&face| thickness - lacks[face as usize]).enumerate();
    thin.extend(of_skin.filter(|(_, wall)| *wall < enough));
    let walls = ThinWalls::new(&cavity, &thin);
    Ok(Some((cavity, walls)))
}

/// Returns the hollow solid with outlets through its wall, from the outer surface to the cavity.
fn drill_outlets(
    (mesh, tree): (&Mesh, &TriangleTree),
    cavity: &Mesh,
    hollow: Mesh,
    outlets: &[Outlet],
    progress: &Progress<'_>,
) -> Result<Mesh, Error> {
    if outlets.is_empty() {
        return Ok(hollow);
    }
    let inner = TriangleTree::new(cavity);
    // Drill an outlet only once if it is listed twice.
    let new = outlets.iter().enumerate().filter(|(k, outlet)| !outlets[..*k].contains(outlet));
    let drills: Vec<Mesh> = new
        .map(|(_, outlet)| {
            let drill = drill((mesh, tree), (cavity, &inner), outlet)?;
            Ok(transfer_attributes(mesh, tree, drill)?.with_frame(mesh.frame().copied()))
        })
        .collect::<Result<_, MeshError>>()?;
    let drills = Vec::from_iter(&drills);
    let drilled = boolean(&hollow, &drills, Operation::Difference, progress)?;
    let parts = parts(&drilled);
    if parts == 0 || self::parts(&hollow) < parts {
        let result = match parts {
            0 => "nothing is left of the solid".to_owned(),
            _ => format!("the solid falls into {parts} parts"),
        };
        bail!("{result}: the outlets are too wide, or go through more than the wall");
    }
    Ok(drilled)
}

/// Returns the number of connected surfaces of a mesh.
fn parts(mesh: &Mesh) -> usize {
    let mut sets = UnionFind::new(mesh.positions().len());
    for face in mesh.faces().iter() {
        face[1..].iter().for_each(|&vertex| sets.union(face[0], vertex));
    }
    let of_faces = mesh.faces().iter().map(|face| sets.find(face[0]));
    of_faces.collect::<BTreeSet<u32>>().len()
}

/// Number of sides of the prism that approximates a round hole.
const SIDES: u32 = 32;

/// Returns the volume that an outlet removes: a prism through the wall.
fn drill(
    skin: (&Mesh, &TriangleTree),
    cavity: (&Mesh, &TriangleTree),
    outlet: &Outlet,
) -> Result<Mesh, MeshError> {
    fn nearest((mesh, tree): (&Mesh, &TriangleTree), at: Point3<f64>) -> Point3<f64> {
        tree.nearest_to_all(&[at])[0].map_or(at, |nearest| nearest.position(mesh))
    }
    let start = nearest(skin, outlet.at.into());
    let end = nearest(cavity, start);
    let axis = (end - start).try_normalize(0.0).unwrap_or(Vector3::z());
    let across = axis.cross(&Vector3::ith(axis.iamin(), 1.0)).normalize();
    let other = axis.cross(&across);
    // The prism extends beyond both surfaces by the diameter of the hole, so that it passes completely through curved surfaces.
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
