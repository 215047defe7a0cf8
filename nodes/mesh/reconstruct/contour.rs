//! Extracts the level set of a function as quads. The mesh has a vertex in each cell of one depth that the level set intersects, and a quad
//! across each grid edge that the level set crosses.
//!
//! Gibson, "Constrained elastic surface nets" (1998). With one vertex per cell, the mesh is closed, but two sheets may share a vertex or an
//! edge. This cannot happen if, in each cell, the inner nodes are connected along the cell's edges, and the outer nodes, too (Latecki, "3D
//! well-composed pictures", 1997). Where the condition fails, the outer node nearest to the surface is made an inner one, until the
//! condition holds.

use std::collections::{BTreeMap, BTreeSet};

use maquette_node::{CancelledError, Error, Limit, Progress};
use maquette_value::parallel::*;
use maquette_value::{Faces, MeshError};
use nalgebra::Point3;

use super::cells::{CellIndex, Places};
use super::poisson::{Field, SURFACE};

/// Maximum number of faces; with normals and attributes, the computation then needs about 2 GB.
pub(super) const FACES: Limit = Limit {
    max: 1 << 24,
    items: "faces",
    help: "choose a larger `spacing`, or points of a smaller part",
};

/// A mesh of quads that are counter-clockwise seen from outside.
pub(super) struct Skin {
    pub(super) positions: Vec<Point3<f64>>,
    pub(super) quads: Vec<[u32; 4]>,
}

impl Skin {
    /// Returns the quads, or two triangles for each quad, split along the shorter diagonal.
    pub(super) fn faces(&self, are_quads: bool) -> Result<Faces, MeshError> {
        if are_quads {
            return Faces::uniform(4, self.quads.concat());
        }
        let between = |a: u32, b: u32| {
            (self.positions[a as usize] - self.positions[b as usize]).norm_squared()
        };
        let triangles = self.quads.par_iter().flat_map_iter(|&[a, b, c, d]| {
            match between(a, c) <= between(b, d) {
                true => [[a, b, c], [a, c, d]],
                false => [[a, b, d], [b, c, d]],
            }
        });
        Ok(Faces::triangles(triangles.collect()))
    }
}

/// Returns the closed surface at which a function has the value [`super::poisson::SURFACE`], with one vertex in each cell of `depth` that
/// it intersects.
pub(super) fn contour(field: &Field, depth: u32, progress: &Progress<'_>) -> Result<Skin, Error> {
    let (mut cells, mut nodes) = intersected_cells(field, progress)?;
    let halvings = field.cube.depth - depth;
    progress.check()?;
    if halvings > 0 {
        cells = coarser(&cells, halvings).spread(1 << depth, -1..=1);
        nodes = cells.spread((1 << depth) + 1, 0..=1);
    }
    let mut values: Vec<f64> = (0..nodes.len())
        .into_par_iter()
        .map(|node: usize| mean_value(field, nodes.place(node), depth) - SURFACE)
        .collect();
    // A node on the surface counts as outside, so that the two ends of each crossed edge have different signs.
    values.par_iter_mut().for_each(|x| *x = if *x == 0.0 { -f64::MIN_POSITIVE } else { *x });
    progress.tick(0.5)?;
    let taken_in = compose(field, depth, &cells, &nodes, &values, progress)?;
    let signs = Signs { field, depth, nodes: &nodes, values: &values, taken_in: &taken_in };
    progress.check()?;
    let is_exact = halvings == 0 && taken_in.is_empty();
    let cells = if is_exact { cells } else { signs.cells(&cells) };
    let corners: Vec<[f64; 8]> =
        (0..cells.len()).into_par_iter().map(|cell| signs.of_cell(cells.place(cell))).collect();
    let positions: Vec<Point3<f64>> = corners
        .par_iter()
        .enumerate()
        .map(|(cell, values)| field.cube.point(middle(cells.place(cell), values), depth))
        .collect();
    let quads: Vec<[u32; 4]> = corners
        .par_iter()
        .enumerate()
        .flat_map_iter(|(cell, values)| quads(&cells, cells.place(cell), values))
        .collect();
    progress.tick(1.0)?;
    Ok(Skin { positions, quads })
}

/// Returns the function at a node of a depth, averaged over a cell of that depth around the node. Where the field is finer than the
/// surface, single values would miss some thin parts and hit others.
fn mean_value(field: &Field, place: CellIndex, depth: u32) -> f64 {
    let last = field.cube.depth;
    let steps = match last - depth {
        0 => return field.at_node(place, depth, depth + 1),
        1 => 2,
        _ => 3,
    };
    let scale = f64::from(1_u32 << (last - depth));
    let count = steps * steps * steps;
    let values = (0..count).map(|k: i32| {
        let at = [k % steps, k / steps % steps, k / steps / steps]
            .map(|step| (f64::from(step) + 0.5) / f64::from(steps) - 0.5);
        let at = [0, 1, 2].map(|axis| (f64::from(place[axis]) + at[axis]) * scale);
        field.value(at, last, last + 1)
    });
    values.sum::<f64>() / f64::from(count)
}

fn is_mixed(values: &[f64; 8]) -> bool {
    let inside = values.iter().filter(|&&x| x > 0.0).count();
    0 < inside && inside < 8
}

/// Returns the finest cells that the surface intersects, and all of their nodes.
fn intersected_cells(field: &Field, progress: &Progress<'_>) -> Result<(Places, Places), Error> {
    let depth = field.cube.depth;
    let mut coarse: Vec<CellIndex> = Vec::new();
    for from in 0..=depth {
        let grid = &field.grids[from as usize];
        // The intersected cells of this depth's grid, and the cells of the same size inside of intersected cells of coarser grids.
        let own = (0..grid.nodes.len()).into_par_iter().filter_map(|node| {
            let place = grid.nodes.place(node);
            let corners = grid.nodes.corners(place)?;
            is_mixed(&corners.map(|node| grid.values[node] - SURFACE)).then_some(place)
        });
        let own: Vec<CellIndex> = own.collect();
        let inherited = coarse.par_iter().copied().filter(|&cell| {
            grid.nodes.corners(cell).is_none()
                && is_mixed(&corners_of(cell).map(|node| field.at_node(node, from, from) - SURFACE))
        });
        let mut cells: Vec<CellIndex> = inherited.collect();
        cells.extend(own);
        FACES.check("the surface", cells.len() as f64)?;
        progress.check()?;
        coarse = if from < depth {
            cells.par_iter().flat_map_iter(|cell| corners_of(cell.map(|x| 2 * x))).collect()
        } else {
            cells
        };
    }
    coarse.par_sort_unstable_by_key(|&[x, y, z]| [z, y, x]);
    coarse.dedup();
    let side = 1 << depth;
    let places = coarse.iter().map(|place| place.map(|x| x as u16)).collect();
    let cells = Places::new(side, places);
    let nodes = cells.spread(side + 1, 0..=1);
    Ok((cells, nodes))
}

/// Returns the cells of a coarser depth that contain some cells.
fn coarser(cells: &Places, halvings: u32) -> Places {
    let mut places: Vec<[u16; 3]> =
        (0..cells.len()).map(|cell| cells.place(cell).map(|x| (x >> halvings) as u16)).collect();
    places.sort_unstable_by_key(|&[x, y, z]| [z, y, x]);
    places.dedup();
    Places::new(cells.side() >> halvings, places)
}

/// Returns the corners of a cell; corner `k` is offset by the bits of `k`, x first.
fn corners_of([x, y, z]: CellIndex) -> [CellIndex; 8] {
    std::array::from_fn(|k| {
        fn bit(axis: usize, k: usize) -> i32 {
            (k >> axis & 1) as i32
        }
        [x + bit(0, k), y + bit(1, k), z + bit(2, k)]
    })
}

/// The values of the function at the nodes, minus the value at the surface: above 0 inside, below 0 outside.
struct Signs<'a> {
    field: &'a Field,
    depth: u32,
    nodes: &'a Places,
    values: &'a [f64],
    taken_in: &'a BTreeSet<CellIndex>,
}

impl Signs<'_> {
    fn of_node(&self, place: CellIndex) -> f64 {
        if self.taken_in.contains(&place) {
            return f64::MIN_POSITIVE;
        }
        match self.nodes.find(place) {
            Some(node) => self.values[node],
            None => mean_value(self.field, place, self.depth) - SURFACE,
        }
    }

    fn of_cell(&self, place: CellIndex) -> [f64; 8] {
        if self.taken_in.is_empty()
            && let Some(corners) = self.nodes.corners(place)
        {
            return corners.map(|node| self.values[node]);
        }
        corners_of(place).map(|node| self.of_node(node))
    }

    /// Returns the cells that the surface intersects after the nodes in `taken_in` have become inner nodes. `before` contains the cells
    /// that the surface intersects without this change.
    fn cells(&self, before: &Places) -> Places {
        let mut cells: BTreeMap<[i32; 3], CellIndex> = BTreeMap::new();
        let changed = self.taken_in.iter().flat_map(|&[x, y, z]| corners_of([x - 1, y - 1, z - 1]));
        for cell in (0..before.len()).map(|cell| before.place(cell)).chain(changed) {
            if is_mixed(&self.of_cell(cell)) {
                cells.insert([cell[2], cell[1], cell[0]], cell);
            }
        }
        let places = cells.into_values().map(|place| place.map(|x| x as u16)).collect();
        Places::new(before.side(), places)
    }
}

/// Returns the outer nodes that become inner ones, so that two sheets of the surface never meet in a cell.
fn compose(
    field: &Field,
    depth: u32,
    cells: &Places,
    nodes: &Places,
    values: &[f64],
    progress: &Progress<'_>,
) -> Result<BTreeSet<CellIndex>, CancelledError> {
    let mut taken_in = BTreeSet::new();
    let composed: Vec<bool> = (0..=255).map(is_composed).collect();
    let none = BTreeSet::new();
    let signs = Signs { field, depth, nodes, values, taken_in: &none };
    let bad: Vec<usize> = (0..cells.len())
        .into_par_iter()
        .filter(|&cell| !composed[mask(&signs.of_cell(cells.place(cell)))])
        .collect();
    let mut cells: Vec<CellIndex> = bad.into_iter().rev().map(|cell| cells.place(cell)).collect();
    // Each step adds one inner node, so the loop terminates.
    while let Some(cell) = cells.pop() {
        progress.check()?;
        let signs = Signs { field, depth, nodes, values, taken_in: &taken_in };
        let corners = signs.of_cell(cell);
        if composed[mask(&corners)] {
            continue;
        }
        // Nodes at the border of the cube must stay outside; otherwise the surface would be open.
        let last = 1 << depth;
        let outside = (0..8)
            .filter(|&k| corners[k] <= 0.0)
            .filter(|k| corners_of(cell)[*k].iter().all(|&x| 0 < x && x < last));
        let Some(nearest) = outside.max_by(|&a, &b| corners[a].total_cmp(&corners[b])) else {
            continue;
        };
        let node = corners_of(cell)[nearest];
        taken_in.insert(node);
        cells.extend(corners_of(node.map(|x| x - 1)));
    }
    Ok(taken_in)
}

fn mask(values: &[f64; 8]) -> usize {
    (0..8).filter(|&k| values[k] > 0.0).map(|k| 1 << k).sum()
}

/// Returns true if, along the edges of a cell, the inner corners are connected, and the outer corners, too.
fn is_composed(mask: u32) -> bool {
    fn is_connected(mask: u32) -> bool {
        let mut reached = mask & mask.wrapping_neg();
        for _ in 0..8 {
            let near = [1, 2, 4].map(|bit| {
                (0..8).filter(|k| reached >> k & 1 == 1).map(|k| 1 << (k ^ bit)).sum::<u32>()
            });
            reached |= (near[0] | near[1] | near[2]) & mask;
        }
        reached == mask
    }
    is_connected(mask) && is_connected(!mask & 255)
}

/// Returns the mean of the points at which the surface intersects the edges of a cell.
fn middle(place: CellIndex, values: &[f64; 8]) -> [f64; 3] {
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for axis in 0..3 {
        for k in (0..8).filter(|k| k >> axis & 1 == 0) {
            let [a, b] = [values[k], values[k | 1 << axis]];
            if (a > 0.0) == (b > 0.0) {
                continue;
            }
            count += 1.0;
            for (i, sum) in sum.iter_mut().enumerate() {
                // The intersection is kept away from the ends of the edge; otherwise vertices of several cells could coincide.
                let at =
                    if i == axis { (a / (a - b)).clamp(0.05, 0.95) } else { (k >> i & 1) as f64 };
                *sum += at;
            }
        }
    }
    [0, 1, 2].map(|axis| f64::from(place[axis]) + sum[axis] / count)
}

/// Returns one quad for each edge that the surface crosses, of the three edges of a cell that begin at its lowest node.
fn quads(cells: &Places, place: CellIndex, values: &[f64; 8]) -> Vec<[u32; 4]> {
    let mut quads = Vec::new();
    for axis in 0..3 {
        let is_inside = values[0] > 0.0;
        if is_inside == (values[1 << axis] > 0.0) {
            continue;
        }
        fn step(moved: &[usize], place: &[i32; 3], cells: &Places) -> Option<u32> {
            let mut place = *place;
            moved.iter().for_each(|&axis| place[axis] -= 1);
            cells.find(place).map(|cell| cell as u32)
        }
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        // The four cells around the edge, counter-clockwise seen from the end of the edge.
        let around = [
            step(&[], &place, cells),
            step(&[u], &place, cells),
            step(&[u, v], &place, cells),
            step(&[v], &place, cells),
        ];
        if let [Some(a), Some(b), Some(c), Some(d)] = around {
            quads.push(if is_inside { [a, b, c, d] } else { [d, c, b, a] });
        }
    }
    quads
}
