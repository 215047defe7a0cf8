//! Sheets of material between two cavities, or between two places of a cavity.
//!
//! Where a solid is just too thin for a cavity, the cavities on both sides of that neck may be closer to each other than a wall must be
//! thick, although both have a wall of the right thickness to the outer surface.

use maquette_mesh::{Poses, merge};
use maquette_node::{CancelledError, Error, Progress};
use maquette_value::parallel::*;
use maquette_value::{Bounds, BoxTree, Mesh, TriangleTree};
use nalgebra::{Point3, Vector3};

use super::depth::Depth;
use crate::contour::Contour;
use crate::thicken::middle_surface;

/// Maximum number of rounds in which sheets are thickened: what is added for one sheet may come near to another cavity.
const ROUNDS: usize = 5;

/// Thickness to which a sheet is thickened, as a multiple of the requested one: the flat faces of a cavity cut into round sheets, and tips
/// of them are cut off.
const AIM: f64 = 1.16;

/// Added to that multiple in each round, so that no narrow cavity remains beside what was added.
const GROWTH: f64 = 0.15;

/// Maximum area of a sliver, as a fraction of the squared thickness.
const SLIVER: f64 = 5e-4;

/// Fraction of the thickness that a sheet must have to stay as it is.
const ENOUGH: f64 = 0.99;

/// Minimum cosine of the angle between the normal of a face and the reversed normal of the face behind it, at which both are the sides of a
/// sheet. At greater angles they meet in an edge nearby.
const MIN_COSINE: f64 = 0.5;

/// Number of faces that are measured between two checks for cancellation.
const CHUNK: usize = 16_384;

/// The middle surface of thin sheets.
pub(super) struct Sheet {
    mesh: Mesh,
    tree: TriangleTree,
    boxes: BoxTree,
}

impl Sheet {
    fn new(mesh: Mesh) -> Self {
        let boxes = BoxTree::new(mesh.faces().iter().map(|face| bounds(&mesh, face, 0.0)));
        Self { tree: TriangleTree::new(&mesh), boxes, mesh }
    }

    fn is_near(&self, bounds: &Bounds) -> bool {
        let mut is_near = false;
        self.boxes.visit_overlapping(bounds, |_| is_near = true);
        is_near
    }

    /// Returns the distances of those points that may be within `reach` mm, by the index of the point.
    pub(super) fn distances(&self, points: &[Point3<f64>], reach: f64) -> Vec<(usize, f64)> {
        let is_near = points.par_iter().map(|at| {
            let reach = Vector3::repeat(reach);
            self.is_near(&Bounds { low: at - reach, high: at + reach })
        });
        let is_near: Vec<bool> = is_near.collect();
        let near: Vec<usize> = (0..points.len()).filter(|&point| is_near[point]).collect();
        let places: Vec<_> = near.iter().map(|&point| points[point]).collect();
        let found = self.tree.nearest_to_all(&places);
        let distances = found.iter().map(|it| it.map_or(f64::INFINITY, |it| it.distance_sq.sqrt()));
        near.into_iter().zip(distances).collect()
    }
}

/// Returns the box around a face, grown by `reach` mm.
fn bounds(mesh: &Mesh, face: &[u32], reach: f64) -> Bounds {
    let corners: Vec<_> = face.iter().map(|&it| mesh.positions()[it as usize]).collect();
    let Bounds { low, high } = Bounds::from_points(&corners);
    Bounds { low: low - Vector3::repeat(reach), high: high + Vector3::repeat(reach) }
}

/// Reduces depths until all sheets between cavities at the depth `thickness` mm are as thick. Returns the surface of the cavities, and the
/// middle surface of the sheets that were too thin.
///
/// # Errors
/// Returns an error if the evaluation is cancelled.
pub(super) fn thicken_sheets(
    depth: &mut Depth,
    thickness: f64,
    progress: &Progress<'_>,
) -> Result<(Contour, Option<Sheet>), Error> {
    let mut sheets: Vec<Sheet> = Vec::new();
    let mut contour = depth.contour(thickness, progress)?;
    for round in 0..ROUNDS {
        let surface = contour.mesh()?;
        let faces = match sheets.last() {
            Some(last) => faces_near(&surface, last, thickness),
            None => faces_before_cavities(&surface, depth, thickness),
        };
        if faces.is_empty() {
            break;
        }
        let tree = TriangleTree::new(&surface);
        let thin = thin_sheets(&surface, &tree, &faces, ENOUGH * thickness, progress)?;
        if thin.is_empty() {
            break;
        }
        let sheet = Sheet::new(middle_surface(&surface, &tree, &thin, (thickness, None))?);
        let radius = (AIM + GROWTH * round as f64) * thickness / 2.0;
        depth.fill_around((&sheet.mesh, &sheet.tree), (radius, thickness), progress)?;
        // Elsewhere the surface stays as it is.
        contour = depth.contour_near(&sheet.mesh, thickness, 2.0 * thickness);
        sheets.push(sheet);
    }
    if sheets.is_empty() {
        return Ok((contour, None));
    }
    let meshes: Vec<&Mesh> = sheets.iter().map(|sheet| &sheet.mesh).collect();
    let all = Sheet::new(merge(&meshes, Poses::Ignore)?);
    Ok((depth.contour(thickness, progress)?, Some(all)))
}

/// Returns the faces of a surface behind which there may be a cavity within `thickness` mm, according to the nodes beside the way there.
fn faces_before_cavities(surface: &Mesh, depth: &Depth, thickness: f64) -> Vec<u32> {
    let faces = (0..surface.faces().len() as u32).into_par_iter();
    let found = faces.filter(|&face| {
        let corners = surface.faces().face(face as usize);
        let Some(inward) = (-surface.area_vector(corners)).try_normalize(0.0) else { return false };
        depth.is_cavity_ahead(surface.first_triangle_center(corners), inward, thickness)
    });
    found.collect()
}

/// Returns the faces of a surface that are within `reach` mm of a sheet.
fn faces_near(surface: &Mesh, sheet: &Sheet, reach: f64) -> Vec<u32> {
    let faces = (0..surface.faces().len() as u32).into_par_iter();
    let near = faces.filter(|&face| {
        sheet.is_near(&bounds(surface, surface.faces().face(face as usize), reach))
    });
    near.collect()
}

/// Returns the faces near a sheet behind which the material up to another face of the cavities is thinner than `thickness` mm, each with
/// the thickness there.
pub(super) fn remaining_thin_sheets(
    surface: &Mesh,
    sheet: &Sheet,
    thickness: f64,
    progress: &Progress<'_>,
) -> Result<Vec<(usize, f64)>, CancelledError> {
    let faces = faces_near(surface, sheet, thickness);
    if faces.is_empty() {
        return Ok(Vec::new());
    }
    thin_sheets(surface, &TriangleTree::new(surface), &faces, thickness, progress)
}

/// Measures the material behind the given faces of a cavity by rays against their normals, which point into the cavity. Slivers, whose
/// normals depend on rounding, are left out.
fn thin_sheets(
    surface: &Mesh,
    tree: &TriangleTree,
    faces: &[u32],
    thickness: f64,
    progress: &Progress<'_>,
) -> Result<Vec<(usize, f64)>, CancelledError> {
    let mut thin = Vec::new();
    for faces in faces.chunks(CHUNK) {
        progress.check()?;
        let of_faces = faces.par_iter().filter_map(|&face| {
            let corners = surface.faces().face(face as usize);
            let normal = surface.area_vector(corners);
            let inward = -normal.try_normalize(0.0)?;
            if normal.norm() / 2.0 < SLIVER * thickness * thickness {
                return None;
            }
            let start = surface.first_triangle_center(corners) + inward * (1e-6 * thickness);
            let hit = tree.first_hit(start, inward).filter(|hit| hit.along < thickness)?;
            let other = surface.area_vector(surface.faces().face(hit.face as usize));
            let is_opposite = other.dot(&inward) > MIN_COSINE * other.norm();
            is_opposite.then_some((face as usize, hit.along))
        });
        thin.extend(of_faces.collect::<Vec<_>>());
    }
    Ok(thin)
}
