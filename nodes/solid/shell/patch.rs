//! Shells: a layer, and material where the layer is too thin.

use std::collections::BTreeSet;

use maquette_base::topology::union_find::UnionFind;
use maquette_node::{Error, Progress};
use maquette_value::{Mesh, TriangleTree};
use nalgebra::Point3;

use super::backs::{Backs, Motion};
use super::behind::Behind;
use crate::combine::boolean;
use crate::offset::{Clip, offset_surface};
use crate::operation::Operation;
use crate::transfer_attributes::transfer_attributes;
use crate::volume::volume;

/// Number of cells of the grid per thickness.
const CELLS: f64 = 2.0;

/// Factor by which the distance of the added volume is multiplied, as its flat faces are closer than its vertices.
const DISTANCE_FACTOR: f64 = 1.06;

/// Fraction of the thickness that a layer must have to need no addition.
const ENOUGH: f64 = 0.99;

/// Fraction of the faces with a layer that is too thin, from which on a surface is too rough for a layer along its normals.
const ROUGH: f64 = 0.25;

/// Number of faces of the added volume per thin area of a cell's side, if the whole surface is thin.
const FACES_OF_CELL: f64 = 20.0;

/// Maximum number of faces of the added volume, as a multiple of those of the surface, and at least.
const MAX_GROWTH: f64 = 8.0;
const MAX_ADDED: f64 = 240_000.0;

/// Distance in cells by which the added volume extends beyond the front of the surface, where it is cut off.
const BEYOND: f64 = 0.75;

/// Distance in cells between the added volume and the walls at borders.
const INSET: f64 = 0.05;

/// Distance in cells by which the layer that cuts off the added volume extends beyond borders.
const SKIRT: f64 = 0.3;

/// Fraction of the layer's height at which the added volume is cut off.
const CUT: f64 = 0.5;

/// Returns the shell of the given thickness behind a surface, which keeps its faces.
///
/// # Errors
/// Returns an error if the surface intersects itself, the grid has too many cells, or the evaluation is cancelled.
pub(super) fn one_sided(
    mesh: &Mesh,
    thickness: f64,
    progress: &Progress<'_>,
) -> Result<Mesh, Error> {
    let tree = TriangleTree::new(mesh);
    let backs = Backs::new(mesh, 1.0);
    let (mut motion, mut probes) =
        progress.part(0.0..0.2, |progress| backs.fit(&tree, thickness, progress))?;
    let layer = progress.part(0.2..0.3, |progress| backs.settle(&mut None, &mut motion, progress));
    progress.check()?;
    let layer = match layer {
        Ok(layer) => layer,
        // Some vertices of a rough scan have no direction that all of their faces look away from.
        Err(why) => {
            return recede(&backs, &tree, thickness, progress)?.map(|it| it.0).ok_or(why);
        }
    };
    let thin = probes.thin_faces(&motion, &layer, ENOUGH * thickness);
    if thin.is_empty() {
        return Ok(layer);
    }
    if (ROUGH * mesh.faces().len() as f64) < thin.len() as f64 {
        let receded = recede(&backs, &tree, thickness, progress)?;
        if let Some((receded, _)) = receded.filter(|it| 2 * it.1 < thin.len()) {
            return Ok(receded);
        }
    }
    if !is_small(mesh, &thin, thickness / CELLS) {
        return Ok(layer);
    }
    let cell = thickness / CELLS;
    let behind = Behind::new(mesh, &tree)?;
    let added = progress.part(0.4..0.7, |progress| {
        let depths = |points: &[Point3<f64>]| {
            let located = behind.locate(points).into_iter();
            located
                .map(|at| (at.depth + BEYOND * cell).min(at.inset - INSET * cell))
                .collect::<Vec<_>>()
        };
        added(mesh, (&tree, &thin), thickness, &depths, progress)
    })?;
    let cutter = progress.part(0.7..0.75, |progress| {
        let mut below = Motion { shifts: backs.shifts(SKIRT * cell), ..motion.clone() };
        below.heights.iter_mut().for_each(|height| *height *= CUT);
        let mut above = Some(Motion {
            directions: Backs::new(mesh, -1.0).directions(),
            heights: motion.heights.iter().map(|height| height.min(0.1 * cell)).collect(),
            shifts: below.shifts.clone(),
        });
        backs.settle(&mut above, &mut below, progress)
    });
    progress.check()?;
    // The layer alone is thin in places, for which there is a warning.
    let Ok(cutter) = cutter else { return Ok(layer) };
    let patched = progress.part(0.75..1.0, |progress| {
        // The cutter is a thin layer around the surface, which separates the added volume behind the surface from that in front of it.
        let parts = boolean(&added, &[&cutter], Operation::Difference, progress)?;
        let parts = keep_components(&parts, |vertices, _| {
            let points: Vec<_> =
                vertices.iter().map(|&it| parts.positions()[it as usize]).collect();
            let depths = behind.locate(&points).into_iter().map(|it| it.depth);
            depths.max_by(|a, b| a.abs().total_cmp(&b.abs())).is_some_and(|depth| 0.0 < depth)
        });
        boolean(&layer, &[&parts], Operation::Union, progress)
    });
    progress.check()?;
    let is_surface = positions(mesh);
    Ok(match patched {
        Ok(patched) if positions(&patched).is_superset(&is_surface) => {
            let bubble = thickness * thickness * thickness / 8.0;
            keep_components(&patched, |vertices, volume| {
                let mut places = vertices.iter().map(|&it| bits(&patched.positions()[it as usize]));
                bubble <= volume.abs() || places.any(|it| is_surface.contains(&it))
            })
        }
        // The layer alone is thin in places, for which there is a warning.
        _ => layer,
    })
}

/// Returns true if the volume within the thickness of the given faces, which is made on a grid with cells of `cell` mm, has at most
/// [`MAX_GROWTH`] times as many faces as the mesh, or [`MAX_ADDED`].
fn is_small(mesh: &Mesh, thin: &[u32], cell: f64) -> bool {
    let areas = thin.iter().map(|&face| mesh.area_vector(mesh.faces().face(face as usize)).norm());
    let cells = areas.sum::<f64>() / 2.0 / (cell * cell);
    FACES_OF_CELL * cells <= (MAX_GROWTH * mesh.faces().len() as f64).max(MAX_ADDED)
}

/// Returns the layer behind a surface along the rays of its sensor, and the number of faces at which it is too thin; `None` if the surface
/// is not seen whole from there.
fn recede(
    backs: &Backs<'_>,
    tree: &TriangleTree,
    thickness: f64,
    progress: &Progress<'_>,
) -> Result<Option<(Mesh, usize)>, Error> {
    let motion = progress.part(0.3..0.35, |progress| backs.recede(tree, thickness, progress))?;
    let Some((mut motion, mut probes)) = motion else { return Ok(None) };
    let layer = progress.part(0.35..0.4, |progress| backs.settle(&mut None, &mut motion, progress));
    progress.check()?;
    let Ok(layer) = layer else { return Ok(None) };
    let thin = probes.thin_faces(&motion, &layer, ENOUGH * thickness).len();
    Ok(Some((layer, thin)))
}

/// Returns the shell of the given thickness around a surface, with half of it on each side.
///
/// # Errors
/// Returns an error if the grid has too many cells, or the evaluation is cancelled.
pub(super) fn two_sided(
    mesh: &Mesh,
    thickness: f64,
    progress: &Progress<'_>,
) -> Result<Mesh, Error> {
    let tree = TriangleTree::new(mesh);
    let half = thickness / 2.0;
    let [front, back] = [-1.0, 1.0].map(|sign| Backs::new(mesh, sign));
    let (above, mut of_front) =
        progress.part(0.0..0.2, |progress| front.fit(&tree, half, progress))?;
    let (mut below, mut of_back) =
        progress.part(0.2..0.4, |progress| back.fit(&tree, half, progress))?;
    let mut above = Some(above);
    let layer = progress.part(0.4..0.5, |progress| back.settle(&mut above, &mut below, progress));
    progress.check()?;
    let Ok(layer) = layer else {
        // The surface intersects itself, so there is no layer around it, but there is a volume.
        let all: Vec<_> = (0..mesh.faces().len() as u32).collect();
        fn everywhere(points: &[Point3<f64>]) -> Vec<f64> {
            vec![f64::INFINITY; points.len()]
        }
        return added(mesh, (&tree, &all), half, &everywhere, progress);
    };
    let mut thin = of_back.thin_faces(&below, &layer, ENOUGH * half);
    if let Some(above) = &above {
        thin.extend(of_front.thin_faces(above, &layer, ENOUGH * half));
    }
    thin.sort_unstable();
    thin.dedup();
    if thin.is_empty() || !is_small(mesh, &thin, half / CELLS) {
        return Ok(layer);
    }
    let behind = Behind::new(mesh, &tree)?;
    let added = progress.part(0.5..0.8, |progress| {
        let depths = |points: &[Point3<f64>]| {
            let located = behind.locate(points).into_iter();
            located.map(|at| at.inset - INSET * half / CELLS).collect::<Vec<_>>()
        };
        added(mesh, (&tree, &thin), half, &depths, progress)
    })?;
    let patched =
        progress.part(0.8..1.0, |progress| boolean(&layer, &[&added], Operation::Union, progress));
    progress.check()?;
    Ok(patched.map_or(layer, |patched| {
        let bubble = half * half * half;
        keep_components(&patched, |_, volume| bubble <= volume.abs())
    }))
}

/// Returns the volume within `thickness` mm of the given faces of a mesh where `depths` are positive, with the attributes of the mesh.
fn added(
    mesh: &Mesh,
    (tree, faces): (&TriangleTree, &[u32]),
    thickness: f64,
    depths: &(dyn Fn(&[Point3<f64>]) -> Vec<f64> + Sync),
    progress: &Progress<'_>,
) -> Result<Mesh, Error> {
    let size = (DISTANCE_FACTOR * thickness, CELLS);
    let added = offset_surface(&mesh.select(faces), size, Clip::Depths(depths), progress)?;
    Ok(transfer_attributes(mesh, tree, added)?.with_frame(mesh.frame().copied()))
}

/// Returns the bits of the positions of all vertices of a mesh.
fn positions(mesh: &Mesh) -> BTreeSet<[u64; 3]> {
    mesh.faces().corners().iter().map(|&it| bits(&mesh.positions()[it as usize])).collect()
}

fn bits(at: &Point3<f64>) -> [u64; 3] {
    <[f64; 3]>::from(at.coords).map(f64::to_bits)
}

/// Returns the mesh with those of its connected surfaces for which `is_kept` is true. It is called with the vertices of a surface, and the
/// volume inside of it in mm^3, which is negative around a cavity.
fn keep_components(mesh: &Mesh, is_kept: impl Fn(&[u32], f64) -> bool) -> Mesh {
    let mut sets = UnionFind::new(mesh.positions().len());
    for face in mesh.faces().iter() {
        face[1..].iter().for_each(|&vertex| sets.union(face[0], vertex));
    }
    let (labels, firsts) = sets.into_labels();
    let (mut vertices, mut faces) =
        (vec![Vec::new(); firsts.len()], vec![Vec::new(); firsts.len()]);
    for (vertex, &label) in labels.iter().enumerate() {
        vertices[label as usize].push(vertex as u32);
    }
    for (number, face) in (0..).zip(mesh.faces().iter()) {
        faces[labels[face[0] as usize] as usize].push(number);
    }
    let mut kept = Vec::with_capacity(mesh.faces().len());
    for (vertices, faces) in vertices.iter().zip(faces).filter(|it| !it.1.is_empty()) {
        let part = mesh.select(&faces);
        if is_kept(vertices, volume(&part, part.positions()[0])) {
            kept.extend(faces);
        }
    }
    kept.sort_unstable();
    mesh.select(&kept)
}
