//! The level set of a function as quads: a vertex in each finest cell that it runs through, a quad across each edge of the grid that it
//! cuts.
//!
//! Gibson, "Constrained elastic surface nets" (1998). With one vertex in a cell, the mesh is closed, but two sheets may meet in a vertex or
//! an edge. They cannot if in each cell the inner nodes are connected along the cell's edges, and the outer nodes, too (Latecki, "3D
//! well-composed pictures", 1997). Where they are not, the outer node nearest to the surface is counted as an inner one until they are.

use std::collections::{BTreeMap, BTreeSet};

use maquette_node::{Cancelled, Limit, Progress};
use maquette_value::parallel::*;
use nalgebra::Point3;

use super::cells::{CellIndex, Places};
use super::poisson::{Field, SURFACE, SolveError};

/// Faces of a skin; with normals and attributes some 2 GB while it is made.
pub(super) const FACES: Limit = Limit {
    most: 1 << 24,
    of: "faces",
    help: "choose a larger `spacing`, or points of a smaller part",
};

/// Quads that turn counter-clockwise seen from outside.
pub(super) struct Skin {
    pub(super) positions: Vec<Point3<f64>>,
    pub(super) quads: Vec<[u32; 4]>,
}

/// The closed skin of a function.
pub(super) fn contour(field: &Field, progress: &Progress<'_>) -> Result<Skin, SolveError> {
    let (cells, nodes) = crossed(field, progress)?;
    let depth = field.cube.depth;
    let mut values: Vec<f64> = (0..nodes.len())
        .into_par_iter()
        .map(|node: usize| field.at_node(nodes.place(node), depth, depth + 1) - SURFACE)
        .collect();
    // A node on the surface is outside, so that each edge that is cut has two different ends.
    values.par_iter_mut().for_each(|x| *x = if *x == 0.0 { -f64::MIN_POSITIVE } else { *x });
    progress.tick(0.5)?;
    let taken_in = compose(field, &cells, &nodes, &values, progress)?;
    let signs = Signs { field, nodes: &nodes, values: &values, taken_in: &taken_in };
    let cells = if taken_in.is_empty() { cells } else { signs.cells(&cells) };
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

fn is_mixed(values: &[f64; 8]) -> bool {
    let inside = values.iter().filter(|&&x| x > 0.0).count();
    0 < inside && inside < 8
}

/// The finest cells that the surface runs through, and all nodes of these.
fn crossed(field: &Field, progress: &Progress<'_>) -> Result<(Places, Places), SolveError> {
    let depth = field.cube.depth;
    let mut coarse: Vec<CellIndex> = Vec::new();
    for from in 0..=depth {
        let grid = &field.grids[from as usize];
        // Cells of this grid and those within cells of coarser ones.
        let own = (0..grid.nodes.len()).into_par_iter().filter_map(|node| {
            let place = grid.nodes.place(node);
            let corners = grid.nodes.corners(place)?;
            is_mixed(&corners.map(|node| grid.values[node] - SURFACE)).then_some(place)
        });
        let own: Vec<CellIndex> = own.collect();
        let inherited = coarse.par_iter().copied().filter(|&cell| {
            grid.nodes.corners(cell).is_none()
                && is_mixed(&around(cell).map(|node| field.at_node(node, from, from) - SURFACE))
        });
        let mut cells: Vec<CellIndex> = inherited.collect();
        cells.extend(own);
        FACES.check("the skin", cells.len() as f64)?;
        progress.check().map_err(SolveError::Cancelled)?;
        coarse = if from < depth {
            cells.par_iter().flat_map_iter(|cell| around(cell.map(|x| 2 * x))).collect()
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

/// The corners of a cell; corner `k` has the bits of `k` added, x first.
fn around([x, y, z]: CellIndex) -> [CellIndex; 8] {
    std::array::from_fn(|k| {
        fn bit(axis: usize, k: usize) -> i32 {
            (k >> axis & 1) as i32
        }
        [x + bit(0, k), y + bit(1, k), z + bit(2, k)]
    })
}

/// What is inside (above 0) and outside.
struct Signs<'a> {
    field: &'a Field,
    nodes: &'a Places,
    values: &'a [f64],
    taken_in: &'a BTreeSet<CellIndex>,
}

impl Signs<'_> {
    fn of_node(&self, place: CellIndex) -> f64 {
        if self.taken_in.contains(&place) {
            return f64::MIN_POSITIVE;
        }
        let depth = self.field.cube.depth;
        match self.nodes.find(place) {
            Some(node) => self.values[node],
            None => self.field.at_node(place, depth, depth + 1) - SURFACE,
        }
    }

    fn of_cell(&self, place: CellIndex) -> [f64; 8] {
        if self.taken_in.is_empty()
            && let Some(corners) = self.nodes.corners(place)
        {
            return corners.map(|node| self.values[node]);
        }
        around(place).map(|node| self.of_node(node))
    }

    /// The cells that the surface runs through now.
    fn cells(&self, before: &Places) -> Places {
        let mut cells: BTreeMap<[i32; 3], CellIndex> = BTreeMap::new();
        let changed = self.taken_in.iter().flat_map(|&[x, y, z]| around([x - 1, y - 1, z - 1]));
        for cell in (0..before.len()).map(|cell| before.place(cell)).chain(changed) {
            if is_mixed(&self.of_cell(cell)) {
                cells.insert([cell[2], cell[1], cell[0]], cell);
            }
        }
        let places = cells.into_values().map(|place| place.map(|x| x as u16)).collect();
        Places::new(before.side(), places)
    }
}

/// The nodes to take in, so that no two sheets meet.
fn compose(
    field: &Field,
    cells: &Places,
    nodes: &Places,
    values: &[f64],
    progress: &Progress<'_>,
) -> Result<BTreeSet<CellIndex>, Cancelled> {
    let mut taken_in = BTreeSet::new();
    let composed: Vec<bool> = (0..=255).map(is_composed).collect();
    let none = BTreeSet::new();
    let signs = Signs { field, nodes, values, taken_in: &none };
    let bad: Vec<usize> = (0..cells.len())
        .into_par_iter()
        .filter(|&cell| !composed[mask(&signs.of_cell(cells.place(cell)))])
        .collect();
    let mut cells: Vec<CellIndex> = bad.into_iter().rev().map(|cell| cells.place(cell)).collect();
    // Each step takes in one more node, so that there is an end.
    while let Some(cell) = cells.pop() {
        progress.check()?;
        let signs = Signs { field, nodes, values, taken_in: &taken_in };
        let corners = signs.of_cell(cell);
        if composed[mask(&corners)] {
            continue;
        }
        // The border of the cube stays outside, so that the skin is closed.
        let last = 1 << field.cube.depth;
        let outside = (0..8)
            .filter(|&k| corners[k] <= 0.0)
            .filter(|k| around(cell)[*k].iter().all(|&x| 0 < x && x < last));
        let Some(nearest) = outside.max_by(|&a, &b| corners[a].total_cmp(&corners[b])) else {
            continue;
        };
        let node = around(cell)[nearest];
        taken_in.insert(node);
        cells.extend(around(node.map(|x| x - 1)));
    }
    Ok(taken_in)
}

fn mask(values: &[f64; 8]) -> usize {
    (0..8).filter(|&k| values[k] > 0.0).map(|k| 1 << k).sum()
}

/// Whether the inner corners of a cell are connected along its edges, and the outer ones, too.
fn is_composed(mask: u32) -> bool {
    fn is_one(mask: u32) -> bool {
        let mut reached = mask & mask.wrapping_neg();
        for _ in 0..8 {
            let near = [1, 2, 4].map(|bit| {
                (0..8).filter(|k| reached >> k & 1 == 1).map(|k| 1 << (k ^ bit)).sum::<u32>()
            });
            reached |= (near[0] | near[1] | near[2]) & mask;
        }
        reached == mask
    }
    is_one(mask) && is_one(!mask & 255)
}

/// The mean of where the surface cuts the edges of a cell.
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
                // Ends that nearly are on the surface would pull the vertices of several cells to one place.
                let at =
                    if i == axis { (a / (a - b)).clamp(0.05, 0.95) } else { (k >> i & 1) as f64 };
                *sum += at;
            }
        }
    }
    [0, 1, 2].map(|axis| f64::from(place[axis]) + sum[axis] / count)
}

/// The quads across those edges of a cell that begin at its lowest node.
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
        // Counter-clockwise seen from the end of the edge.
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
