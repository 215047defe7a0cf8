//! Repairs the closed surface of a solid that crosses itself.

use maquette_node::{Error, Limit, Progress, bail};
use maquette_value::parallel::*;
use maquette_value::{Bounds, BoxTree, Faces, Mesh, TriangleTree};
use nalgebra::{Point3, Vector3};

use crate::combine::{unite, winding_number};
use crate::contour::Contour;
use crate::transfer_attributes::transfer_attributes;
use crate::volume::volume;

/// Maximum number of grid cells that triangles of the surface may reach; measuring the distances at this many takes half a minute.
const CELLS: Limit = Limit {
    max: 6_000_000,
    items: "cells of a grid",
    help: "choose a larger `size`, or a smaller part of the mesh",
};

/// Minimum distance of a vertex from a grid node, as a fraction of a grid edge.
const NEAREST: f64 = 0.1;

/// Fraction of the surface's extent that a cell has at least by default.
const SMALLEST_CELL: f64 = 1.0 / 200.0;

/// A repaired surface.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Repaired {
    pub(crate) mesh: Mesh,
    /// The size of the voxels in mm from which the whole surface was rebuilt; `None` if it was divided along the crossings only.
    pub(crate) voxels: Option<f64>,
    /// The largest distance and the root mean square distance from the new vertices to the old surface, in mm.
    pub(crate) largest: f64,
    pub(crate) rms: f64,
}

/// Returns the surface of all places with a positive winding number inside of a closed mesh.
///
/// First the mesh is divided along its crossings, and what is inside is removed, so that nothing moves. If rounding makes that impossible,
/// the whole surface is rebuilt from voxels of `size` mm (if 0: the mean edge length, at least 1/200 of the extent).
///
/// # Errors
/// Returns an error if nothing remains, there are too many voxels, or the evaluation is cancelled.
pub(crate) fn repair(mesh: &Mesh, size: f64, progress: &Progress<'_>) -> Result<Repaired, Error> {
    let united = progress.part(0.0..0.5, |progress| unite(mesh, progress));
    progress.check()?;
    let tree = TriangleTree::new(mesh);
    let (made, voxels) = match united {
        Ok(made) => (made, None),
        Err(_) => {
            let size = if size > 0.0 { size } else { default_size(mesh) };
            let made = progress.part(0.5..1.0, |progress| rebuild(mesh, &tree, size, progress))?;
            (made, Some(size))
        }
    };
    if made.bounds().is_none_or(|(low, _)| volume(&made, low) <= 0.0) {
        bail!("nothing is left of the solid: most of its faces look inward; use `Orient` before");
    }
    let nearest = tree.nearest_to_all(made.positions()).into_iter().flatten();
    let squares: Vec<f64> = nearest.map(|it| it.distance_sq).collect();
    let largest = squares.iter().copied().fold(0.0, f64::max).sqrt();
    let rms = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
    Ok(Repaired { mesh: made, voxels, largest, rms })
}

fn default_size(mesh: &Mesh) -> f64 {
    let edges = mesh.edges().vertices;
    let lengths = edges.iter().map(|ends| {
        let [a, b] = ends.map(|it| mesh.positions()[it as usize]);
        (b - a).norm()
    });
    let mean = lengths.sum::<f64>() / edges.len().max(1) as f64;
    let extent = mesh.bounds().map_or(0.0, |(low, high)| (high - low).amax());
    mean.max(SMALLEST_CELL * extent)
}

/// Returns the surface between grid nodes with a positive winding number and all others, with the attributes of the nearest points. The
/// distances of the nodes from the surface, whose signs are those of the winding numbers, determine the vertices on grid edges.
fn rebuild(
    mesh: &Mesh,
    tree: &TriangleTree,
    size: f64,
    progress: &Progress<'_>,
) -> Result<Mesh, Error> {
    let Some((low, _)) = mesh.bounds() else { return Ok(mesh.clone()) };
    // Shift the grid, differently along each axis, so that its nodes and the rays from them avoid round coordinates and diagonals.
    let low = low - Vector3::new(1.37, 1.29, 1.41) * size;
    let place = |at: [usize; 3]| low + Vector3::from(at.map(|k| k as f64)) * size;
    let cells = cells_at_surface(mesh, low, size)?;
    progress.tick(0.2)?;
    let mut nodes: Vec<[usize; 3]> =
        cells.iter().flat_map(|cell| (0..8).map(|k| corner(*cell, k))).collect();
    nodes.sort_unstable();
    nodes.dedup();
    let places: Vec<_> = nodes.iter().map(|node| place(*node)).collect();
    let distances = tree.nearest_to_all(&places);
    progress.tick(0.5)?;
    let triangles: Vec<[Point3<f64>; 3]> = (0..mesh.faces().len())
        .flat_map(|number: usize| {
            let face = mesh.faces().face(number);
            let triangles = mesh.face_triangles(number);
            triangles.map(|it| it.map(|k| mesh.positions()[face[k as usize] as usize]))
        })
        .collect();
    let boxes = BoxTree::new(triangles.iter().map(|it| Bounds::from_points(it)));
    let depths: Vec<f64> = (0..nodes.len())
        .into_par_iter()
        .map(|k: usize| {
            let distance = distances[k].map_or(size, |it| it.distance_sq.sqrt());
            let is_inside = 0 < winding_number(places[k], 1e-6 * size, (&triangles, &boxes));
            if is_inside { distance } else { -distance }
        })
        .collect();
    progress.tick(0.9)?;
    let mut contour = Contour::new(NEAREST);
    for cell in cells {
        let depths = std::array::from_fn(|k| {
            depths[nodes.binary_search(&corner(cell, k)).expect("the nodes of all cells are known")]
        });
        contour.add(cell, depths, place);
    }
    // The faces of the contour look to the side of positive depth, which is the inside.
    let faces = contour.triangles.into_iter().map(|[a, b, c]| [a, c, b]).collect();
    let made = Mesh::new(contour.points, Faces::triangles(faces))?;
    Ok(transfer_attributes(mesh, tree, made)?.with_frame(mesh.frame().copied()))
}

/// Returns the node at a corner of a cell; the bits of `k` are the steps along x, y and z.
fn corner([x, y, z]: [usize; 3], k: usize) -> [usize; 3] {
    [x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)]
}

/// Returns the cells that overlap the box of a triangle, in ascending order.
fn cells_at_surface(mesh: &Mesh, low: Point3<f64>, size: f64) -> Result<Vec<[usize; 3]>, Error> {
    let mut cells: Vec<[usize; 3]> = Vec::new();
    let what = "the space around the faces";
    for face in mesh.faces().iter() {
        let corners: Vec<_> = face.iter().map(|&it| mesh.positions()[it as usize]).collect();
        let bounds = Bounds::from_points(&corners);
        let range = [0, 1, 2].map(|axis| {
            [bounds.low[axis], bounds.high[axis]]
                .map(|at| ((at - low[axis]) / size).max(0.0) as usize)
        });
        CELLS.check(what, range.iter().map(|[from, to]| (to - from + 1) as f64).product())?;
        for x in range[0][0]..=range[0][1] {
            for y in range[1][0]..=range[1][1] {
                cells.extend((range[2][0]..=range[2][1]).map(|z| [x, y, z]));
            }
        }
        if 4 * CELLS.max <= cells.len() {
            cells.sort_unstable();
            cells.dedup();
            CELLS.check(what, cells.len() as f64)?;
        }
    }
    cells.sort_unstable();
    cells.dedup();
    CELLS.check(what, cells.len() as f64)?;
    Ok(cells)
}

#[cfg(test)]
mod tests {
    use maquette_mesh::{Poses, merge};

    use super::*;

    /// Returns a box of quads.
    fn cuboid(low: [f64; 3], size: [f64; 3]) -> Mesh {
        let faces =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let corners = (0..8).map(|k: usize| {
            Point3::from([0, 1, 2].map(|axis| low[axis] + size[axis] * (k >> axis & 1) as f64))
        });
        let faces = Faces::uniform(4, faces.as_flattened().to_vec()).unwrap();
        Mesh::new(Vec::from_iter(corners), faces).unwrap()
    }

    #[test]
    fn voxels_make_one_surface_of_boxes_that_overlap() {
        let boxes = [cuboid([0.0; 3], [10.0; 3]), cuboid([5.0, 6.0, 7.0], [10.0; 3])];
        let both = merge(&[&boxes[0], &boxes[1]], Poses::Ignore).unwrap();
        let made = rebuild(&both, &TriangleTree::new(&both), 0.7, &Progress::silent()).unwrap();
        let edges = made.edges();
        assert!(edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2));
        assert_eq!(made.crossings(|| Progress::silent().check()).unwrap(), Vec::<[u32; 2]>::new());
        let found = volume(&made, Point3::origin());
        assert!((found - 1940.0).abs() < 20.0, "{found}");
    }
}
