//! Boolean operations on solids.
//!
//! The union of two spheres with 81 920 triangles each takes 70 ms. The C++ library Manifold takes 150 ms for the same meshes, and 53 ms
//! for meshes in its own data structure (`just peers union`). `boolmesh`, the only Rust library for Boolean operations on meshes, is a port
//! of Manifold under the MPL. It took 379 ms, merges vertices and coplanar faces far from the cut, and does not support named attributes.

use std::borrow::Cow;

use arrangement::arrange;
use cut::Cut;
use films::has_film;
use intersections::{NoInsideError, Pair};
use maquette_base::topology::flat_faces::remove_flat_faces;
use maquette_mesh::{Poses, merge};
use maquette_node::{Error, Progress, bail};
use maquette_value::{Mesh, MeshError, TriangleTree};
use parts::Defect;
use weld::weld;

use super::how_to_close::how_to_close;
use crate::operation::Operation;
use crate::transfer_attributes::transfer_attributes;
use crate::volume::volume;

mod arrangement;
mod assembly;
mod cut;
mod exact;
mod films;
mod intersections;
mod parts;
mod rays;
mod weld;

pub(crate) use parts::{Parts, winding_number};

/// Applies an [`Operation`] to `mesh` and each of `others`, in order.
///
/// Coordinates are rounded to a grid with 2^30 cells along the longest side. On this grid, the test whether an edge intersects a triangle
/// is exact. Ties are broken by symbolic perturbation (Edelsbrunner and Mucke, "Simulation of simplicity", 1990): the second solid grows by
/// an infinitesimal amount, or shrinks for an intersection. So no vertex is exactly on the surface of the other solid, and the surfaces
/// intersect in closed lines. The kept part of a cut triangle is triangulated with all of its corners and intersection points, so adjacent
/// triangles match without stitching. Only the positions of intersection points are rounded: faces beside the cut may be thin, or overlap
/// by about 1e-9 of the size. The cost is O(n log n), plus, for each cut face, a term quadratic in the number of its pieces.
///
/// If a solid consists of several parts that overlap or lie in each other, they are united first. If the perturbed surfaces do not bound a
/// solid, as with coinciding faces of opposite orientation, the exact arrangement of all triangles decides instead. Faces without area are
/// removed at last.
///
/// # Errors
/// Returns an error if a mesh is not a solid, the result is too large, or the evaluation is cancelled.
pub fn boolean(
    mesh: &Mesh,
    others: &[&Mesh],
    how: Operation,
    progress: &Progress<'_>,
) -> Result<Mesh, Error> {
    fn name(number: usize, others: &[&Mesh]) -> String {
        match (number, others.len()) {
            (0, _) => "`mesh`".to_owned(),
            (1, 1) => "`with`".to_owned(),
            _ => format!("mesh {number} of `with`"),
        }
    }
    for (number, mesh) in [mesh].iter().chain(others).enumerate() {
        let edges = mesh.edges();
        let count = edges.faces.iter().filter(|faces| **faces != 2).count();
        if count > 0 {
            bail!(
                "{} is not closed: {count} of its edges do not have two faces; {}",
                name(number, others),
                how_to_close(mesh)
            );
        }
        if mesh.bounds().is_some_and(|(low, _)| volume(mesh, low) < 0.0) {
            bail!("{} is inside out; use `Orient` to turn it outward", name(number, others));
        }
    }
    let mut solids = Vec::new();
    for (number, mesh) in [mesh].iter().chain(others).enumerate() {
        let [from, to] =
            [number, number + 1].map(|it| 0.05 * it as f64 / (others.len() + 1) as f64);
        let solid = progress
            .part(from..to, |progress| with_united_parts(mesh, progress))
            .map_err(|error| Error::new(format!("{}: {error}", name(number, others))))?;
        solids.push(solid);
    }
    let mut made = solids[0].clone().into_owned();
    if others.is_empty() && !made.crossings(|| progress.check())?.is_empty() {
        made = progress.part(0.05..1.0, |progress| unite(&made, progress))?;
    }
    for (number, other) in solids[1..].iter().enumerate() {
        let [from, to] =
            [number, number + 1].map(|it| 0.05 + 0.95 * it as f64 / others.len() as f64);
        let of_two = progress.part(from..to, |progress| of_two(&made, other, how, progress));
        made = of_two.map_err(|error| match error.downcast() {
            Some(&NoInsideError { solid, at }) => Error::new(format!(
                "{} intersects itself: it has no inside near ({:.3}, {:.3}, {:.3}); use `Solid(base: Keep, repair: Voxels())` to repair it",
                name(if solid == 0 { 0 } else { number + 1 }, others),
                at.x,
                at.y,
                at.z
            )),
            None => error,
        })?;
    }
    let made = without_flat_faces(made, progress)?;
    // A solid without a capture frame keeps its coordinates when it is combined with captured ones.
    let frames = others.iter().filter_map(|other| other.frame());
    let same_axes = frames.into_iter().all(|frame| Some(frame) == mesh.frame());
    Ok(if same_axes { made.with_frame(mesh.frame().copied()) } else { made })
}

/// Unites the parts of a mesh that overlap or lie in each other. Crossings inside of one part are not looked for.
fn with_united_parts<'a>(mesh: &'a Mesh, progress: &Progress<'_>) -> Result<Cow<'a, Mesh>, Error> {
    let parts = Parts::new(mesh);
    let bad = match parts.crossing(progress)? {
        Some(bad) => Some(bad),
        None => parts.misplaced(progress)?,
    };
    match bad {
        None => Ok(Cow::Borrowed(mesh)),
        Some(bad) if bad.defect == Defect::InsideOut => bail!("{}", bad.describe()),
        Some(_) => Ok(Cow::Owned(unite(mesh, progress)?)),
    }
}

/// Returns the surface of the volume inside of a closed mesh, which may cross itself: of all places with a positive winding number. Faces
/// away from the crossings stay as they are.
///
/// # Errors
/// Returns an error if the mesh is not closed, rounding makes the result cross itself, or the evaluation is cancelled.
pub(crate) fn unite(mesh: &Mesh, progress: &Progress<'_>) -> Result<Mesh, Error> {
    arrange(mesh, &[0], |windings| 0 < windings[0], progress)
}

/// Removes faces without area. Where solids touch in a vertex or an edge, such faces connect them: the exact arrangement, which separates
/// what touches, is then taken.
fn without_flat_faces(mesh: Mesh, progress: &Progress<'_>) -> Result<Mesh, Error> {
    let mesh = remove_flat_faces(&mesh, |_| true)?.unwrap_or(mesh);
    let count = mesh.flat_faces().len();
    if count == 0 {
        return Ok(mesh);
    }
    let separated = progress.part(0.99..1.0, |progress| unite(&mesh, progress));
    progress.check()?;
    let Ok(separated) = separated else { return Ok(mesh) };
    let separated = remove_flat_faces(&separated, |_| true)?.unwrap_or(separated);
    Ok(if separated.flat_faces().len() < count { separated } else { mesh })
}

/// Transfers to the mesh `to` the attributes that `from` has and `to` lacks.
fn with_missing_attributes(from: &Mesh, to: &Mesh) -> Result<Mesh, MeshError> {
    fn has(mesh: &Mesh, name: &str) -> bool {
        mesh.vertex().get(name).is_some() || mesh.corner().get(name).is_some()
    }
    let mut names = from.vertex().iter().chain(from.corner().iter()).map(|it| it.0);
    let of_faces = from.face().iter().any(|(name, _)| to.face().get(name).is_none());
    let is_bare = to.materials().is_empty() && !from.materials().is_empty();
    match is_bare || of_faces || names.any(|name| name != "normal" && !has(to, name)) {
        true if !from.faces().is_empty() => {
            transfer_attributes(from, &TriangleTree::new(from), to.clone())
        }
        _ => Ok(to.clone()),
    }
}

fn of_two(
    first: &Mesh,
    second: &Mesh,
    how: Operation,
    progress: &Progress<'_>,
) -> Result<Mesh, Error> {
    // Transfer an attribute that only one of the solids has to the other solid, from the nearest points.
    let [first, second] =
        [&with_missing_attributes(second, first)?, &with_missing_attributes(first, second)?];
    let both = merge(&[first, second], Poses::Ignore)?;
    let counts = (first.positions().len(), first.faces().len());
    let perturbed = |grows: bool, progress: &Progress<'_>| -> Result<Perturbed, Error> {
        let pair = Pair::new(&both, counts, grows);
        let meet = progress.part(0.0..0.5, |progress| pair.meet(progress))?;
        let inside = pair.find_inside(&meet)?;
        progress.tick(0.7)?;
        let mut cut = Cut::new(&pair, &meet, &inside, how);
        weld(&mut cut);
        progress.tick(0.9)?;
        Ok(Perturbed { has_film: has_film(&cut), mesh: cut.mesh()? })
    };
    // The second solid grows or shrinks by an infinitesimal amount. This decides the result where faces of both solids are coplanar. A
    // solid that touches itself may intersect itself after this growth; then a second attempt exchanges growing and shrinking.
    let grows = how != Operation::Intersection;
    let mut found = progress.part(0.0..0.8, |progress| perturbed(grows, progress));
    progress.check()?;
    if found.as_ref().is_err_and(|error| error.downcast::<NoInsideError>().is_some())
        && let Ok(other) = progress.part(0.8..0.9, |progress| perturbed(!grows, progress))
    {
        found = Ok(other);
    }
    progress.check()?;
    if let Ok(Perturbed { mesh, has_film: false }) = found {
        return Ok(mesh);
    }
    // Faces that coincide, and solids that cross themselves, need the slower exact arrangement.
    let first_faces = [0, first.faces().len()];
    let arranged = progress.part(0.9..1.0, |progress| {
        arrange(&both, &first_faces, |windings| how.contains(windings), progress)
    });
    progress.check()?;
    match (arranged, found) {
        (Ok(mesh), _) | (Err(_), Ok(Perturbed { mesh, .. })) => Ok(mesh),
        (Err(_), Err(error)) if error.downcast::<NoInsideError>().is_some() => Err(error),
        (Err(why), Err(_)) => bail!(
            "the solids touch in a way that cannot be resolved: {why}; move one of them slightly"
        ),
    }
}

/// The result for perturbed solids.
struct Perturbed {
    mesh: Mesh,
    /// True if faces of both solids lie on each other in the result.
    has_film: bool,
}

#[cfg(test)]
mod tests;
