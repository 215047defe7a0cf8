//! Solves for a function that is 1 inside and 0 outside of the surface, from oriented surface elements (surfels).
//!
//! Two conditions define the function: its gradient should be the field of normals (Kazhdan, Bolitho and Hoppe, "Poisson surface
//! reconstruction", 2006), and it should be 1/2 at the points (Kazhdan and Hoppe, "Screened Poisson surface reconstruction", 2013, section
//! 4.1). It is a sum of trilinear functions on grids that are halved where the points are dense enough. Each depth is solved once, coarse
//! grids first, and only around the points (section 5 of the second paper), with the coarser function on the border; therefore the sum is
//! continuous. On the border of the cube the function is 0, which closes the surface (Kazhdan, Chuang, Rusinkiewicz and Hoppe, "Poisson
//! surface reconstruction with envelope constraints", 2020).
//!
//! Notation: `h` is the edge of a cell, `B_i` the trilinear function of node `i`, `K_ij` the integral of the product of the
//! gradients of `B_i` and `B_j`.

use maquette_base::topology::lists::Lists;
use maquette_node::{CancelledError, Error, Limit, Progress};
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::cells::{CellIndex, Cube, Places, bell, corner_weights};
use super::surfels::{Pyramid, Surfel};

/// The value of the function at the surface.
pub(super) const SURFACE: f64 = 0.5;

/// Maximum number of nodes of all depths together; each needs about 200 bytes in the solver.
pub(super) const NODES: Limit =
    Limit { max: 20_000_000, items: "nodes", help: "choose a larger `spacing`, or fewer points" };

/// Maximum depth at which the grid covers the whole cube; finer grids exist only around the points.
const WHOLE: u32 = 5;

/// Maximum distance of neighboring points, in cells, for which a grid is solved. A finer grid would find no surface between the points.
const SPARSEST: f64 = 1.6;

/// Maximum number of conjugate gradient steps on a grid. The remaining error is smooth, and the coarser grids have already corrected smooth
/// errors.
const STEPS: usize = 24;

/// The residual, relative to the initial one, at which the iteration on a grid stops.
const TOLERANCE: f64 = 2e-3;

/// The part of the function that is stored on the grid of one depth.
pub(super) struct Grid {
    pub(super) nodes: Places,
    pub(super) values: Vec<f64>,
}

/// The function on the grids of all depths; each finer grid exists only around the points.
pub(super) struct Field {
    pub(super) cube: Cube,
    pub(super) grids: Vec<Grid>,
}

impl Field {
    /// Solves for the function. `screening` is the weight of the condition that the function is 1/2 at the points.
    pub(super) fn solve(
        pyramid: &Pyramid,
        surfels: &[Surfel],
        screening: f64,
        progress: &Progress<'_>,
    ) -> Result<Self, Error> {
        let cube = pyramid.cube;
        let mut field = Self { cube, grids: Vec::new() };
        let mut count = 0;
        for depth in 0..=cube.depth {
            let side = (1 << depth) + 1;
            let sums = sums(pyramid, surfels, depth);
            progress.check()?;
            let (free, nodes) = if depth <= WHOLE {
                (None, Places::full(side))
            } else {
                let dense = sums.iter().filter(|sum| sum.spacing < SPARSEST * cube.edge_at(depth));
                let mut cells: Vec<[u16; 3]> = dense.map(|sum| sum.cell).collect();
                cells.extend(field.bridges(pyramid, depth - 1));
                cells.par_sort_unstable_by_key(|&[x, y, z]| [z, y, x]);
                cells.dedup();
                let cells = Places::new(side - 1, cells);
                progress.check()?;
                (Some(cells.spread(side, -1..=2)), cells.spread(side, -2..=3))
            };
            progress.check()?;
            count += nodes.len();
            NODES.check("the grid", count as f64)?;
            let values = field.values_at(&nodes, depth);
            let mut level = PoissonLevel::new(&cube, depth, nodes, free.as_ref(), values);
            progress.check()?;
            level.add_normals(&sums);
            progress.check()?;
            level.screen(&sums, screening);
            // The coarsest grids get more steps, because no coarser grid would correct the smooth part of the error.
            let steps = if depth <= WHOLE { 4 * STEPS } else { STEPS };
            level.solve(steps, progress)?;
            field.grids.push(Grid { nodes: level.nodes, values: level.values });
            let done = f64::from(depth + 1) / f64::from(cube.depth + 1);
            progress.tick(done * done * done)?;
        }
        Ok(field)
    }

    /// Returns the cells of the next depth, inside of those cells of a depth that the surface intersects far from all points. The function
    /// is smooth there, but a coarse grid would show steps.
    fn bridges(&self, pyramid: &Pyramid, depth: u32) -> Vec<[u16; 3]> {
        let grid = &self.grids[depth as usize];
        let points = &pyramid.layers[depth as usize].cells;
        let halves = |node: usize| {
            let place = grid.nodes.place(node);
            let corners = grid.nodes.corners(place)?;
            let inside = corners.iter().filter(|&&node| grid.values[node] > SURFACE).count();
            let is_bridge = 0 < inside && inside < 8 && points.neighbors(place).next().is_none();
            is_bridge.then(|| {
                (0..8)
                    .map(move |k| [0, 1, 2].map(|axis| (2 * place[axis] + (k >> axis & 1)) as u16))
            })
        };
        let nodes = (0..grid.nodes.len()).into_par_iter();
        nodes.flat_map_iter(|node| halves(node).into_iter().flatten()).collect()
    }

    /// Returns the values of the function at the nodes of a depth, interpolated from the coarser grids.
    fn values_at(&self, nodes: &Places, depth: u32) -> Vec<f64> {
        (0..nodes.len())
            .into_par_iter()
            .map(|node: usize| self.at_node(nodes.place(node), depth, depth))
            .collect()
    }

    /// Returns the function at a node of a depth, summed over the grids of depths less than `end`.
    pub(super) fn at_node(&self, place: CellIndex, depth: u32, end: u32) -> f64 {
        self.value(place.map(f64::from), depth, end)
    }

    /// Returns the value of the function at a position given in cells of a depth, summed over the grids of depths less than `end`.
    pub(super) fn value(&self, at: [f64; 3], depth: u32, end: u32) -> f64 {
        self.sample(at, depth, end).map_or(0.0, |sample| trilinear(&sample.corners, sample.within))
    }

    /// Returns the value and the gradient of the function at a position given in cells of a depth, summed over the grids of depths less
    /// than `end`. The gradient is per cell of the given depth.
    fn value_and_gradient(&self, at: [f64; 3], depth: u32, end: u32) -> (f64, Vector3<f64>) {
        let Some(Sample { corners, within, scale }) = self.sample(at, depth, end) else {
            return (0.0, Vector3::zeros());
        };
        (trilinear(&corners, within), gradient(&corners, within) * scale)
    }

    /// Returns the values from which the function is interpolated at a position: those of the finest grid of a depth less than `end` that
    /// has nodes there. `None` if there is no such grid.
    fn sample(&self, at: [f64; 3], depth: u32, end: u32) -> Option<Sample> {
        (0..end).rev().find_map(|from| {
            let grid = &self.grids[from as usize];
            let scale = libm::scalbn(1.0, from as i32 - depth as i32);
            let at = at.map(|x| x * scale);
            let cell = self.cube.cell(at, from);
            let corners = grid.nodes.corners(cell)?.map(|node| grid.values[node]);
            let within = [0, 1, 2].map(|axis| at[axis] - f64::from(cell[axis]));
            Some(Sample { corners, within, scale })
        })
    }

    /// Returns the value of the function at a point, and its gradient there in 1/mm, on the grids up to a depth.
    pub(super) fn at_point(&self, point: &Point3<f64>, depth: u32) -> (f64, Vector3<f64>) {
        let at = self.cube.in_cells(point, depth);
        let (value, gradient) = self.value_and_gradient(at, depth, depth + 1);
        (value, gradient / self.cube.edge_at(depth))
    }
}

/// The values at the corners of a cell, and a position in the cell.
struct Sample {
    corners: [f64; 8],
    /// The position, from 0 to 1 along each axis.
    within: [f64; 3],
    /// The number of cells of this size per cell of the requested depth.
    scale: f64,
}

fn trilinear(values: &[f64; 8], within: [f64; 3]) -> f64 {
    corner_weights(within).iter().zip(values).map(|(weight, value)| weight * value).sum()
}

/// Returns the gradient of the trilinear function, per cell: along each axis, the difference between its values on two sides of the cell.
fn gradient(values: &[f64; 8], within: [f64; 3]) -> Vector3<f64> {
    let [x, y, z] = within.map(|x| [1.0 - x, x]);
    let mut difference = Vector3::zeros();
    for (axis, [a, b]) in [[y, z], [x, z], [x, y]].into_iter().enumerate() {
        // The corners of the side through the cell's first corner; the next axes change the lower and the higher bit.
        let (low, high) = ([2, 1, 1][axis], [4, 4, 2][axis]);
        let weights = [a[0] * b[0], a[1] * b[0], a[0] * b[1], a[1] * b[1]];
        let [mut first, mut last] = [0.0; 2];
        for (corner, weight) in [0, low, high, low + high].into_iter().zip(weights) {
            first += weight * values[corner];
            last += weight * values[corner + (1 << axis)];
        }
        difference[axis] = last - first;
    }
    difference
}

/// The sums over the surfels in a cell of one depth.
#[derive(Clone, Copy)]
struct Sum {
    cell: [u16; 3],
    /// The mean position of the surfels, in units of the cell size at the current octree depth.
    at: [f64; 3],
    area: f64,
    /// The sum of normals times areas, in mm^2.
    normal: Vector3<f64>,
    spacing: f64,
}

fn sums(pyramid: &Pyramid, surfels: &[Surfel], depth: u32) -> Vec<Sum> {
    let cube = &pyramid.cube;
    let of_surface = surfels.par_iter().enumerate().filter(|(_, s)| s.normal != Vector3::zeros());
    let mut keys: Vec<(u64, u32)> = of_surface
        .map(|(place, surfel)| {
            let [x, y, z] = cube.cell(cube.in_cells(&surfel.at, depth), depth).map(|x| x as u64);
            (z << 32 | y << 16 | x, place as u32)
        })
        .collect();
    keys.par_sort_unstable();
    let cells: Vec<&[(u64, u32)]> = keys.chunk_by(|a, b| a.0 == b.0).collect();
    let cells = cells.par_iter().with_min_len(BLOCK).map(|cell: &&[(u64, u32)]| {
        let of_cell = cell.iter().map(|&(_, place)| &surfels[place as usize]);
        let area: f64 = of_cell.clone().map(|surfel| surfel.area).sum();
        let mean: Vector3<f64> =
            of_cell.clone().map(|surfel| surfel.at.coords * (surfel.area / area)).sum();
        Sum {
            cell: [cell[0].0 as u16, (cell[0].0 >> 16) as u16, (cell[0].0 >> 32) as u16],
            at: cube.in_cells(&Point3::from(mean), depth),
            area,
            normal: of_cell.clone().map(|surfel| surfel.normal * surfel.area).sum(),
            spacing: of_cell.clone().map(|surfel| surfel.spacing).fold(f64::INFINITY, f64::min),
        }
    });
    cells.collect()
}

/// The linear equations for the grid of one depth.
struct PoissonLevel {
    depth: u32,
    edge: f64,
    nodes: Places,
    values: Vec<f64>,
    /// The free nodes, which are the unknowns, and the 27 nodes around each of them, x first.
    free: Vec<u32>,
    around: Vec<[u32; 27]>,
    /// The right sides of the equations of the free nodes.
    right: Vec<f64>,
    /// The cells in which the function is pulled to the surface value at a point: their corners, and the interpolation weights times the
    /// square root of the cell's weight.
    held: Vec<([u32; 8], [f64; 8])>,
    /// For each node, the cells in `held` that have the node as a corner, each with the number of that corner.
    held_at: Lists<(u32, u8)>,
}

/// Number of nodes per parallel task.
const BLOCK: usize = 4096;

impl PoissonLevel {
    /// Makes the equations of the free nodes. These are the nodes `free`, or, if `free` is `None`, all nodes whose neighbors all exist.
    fn new(
        cube: &Cube,
        depth: u32,
        nodes: Places,
        free: Option<&Places>,
        values: Vec<f64>,
    ) -> Self {
        let last = nodes.side() - 1;
        let free: Vec<u32> = (0..nodes.len())
            .into_par_iter()
            .filter(|node| {
                let place = nodes.place(*node);
                place.iter().all(|&x| 0 < x && x < last)
                    && free.is_none_or(|free| free.find(place).is_some())
            })
            .map(|node| node as u32)
            .collect();
        let around = free
            .par_iter()
            .map(|&node| {
                let [x, y, z] = nodes.place(node as usize);
                let mut around = [node; 27];
                for k in 0..9 {
                    let row = nodes.row(y + k % 3 - 1, z + k / 3 - 1);
                    let first = nodes.from(row, x - 1) as u32;
                    around[3 * k as usize..][..3].copy_from_slice(&[first, first + 1, first + 2]);
                }
                around
            })
            .collect();
        let right = vec![0.0; free.len()];
        let edge = cube.edge_at(depth);
        let held = Vec::new();
        let held_at = Lists::group(nodes.len(), std::iter::empty);
        Self { depth, edge, nodes, values, free, around, right, held, held_at }
    }

    /// Adds the right sides: the integrals of the field of normals times the gradients of `B_i`. The field is trilinear; a surfel is
    /// distributed to the nodes around it by a quadratic B-spline.
    fn add_normals(&mut self, sums: &[Sum]) {
        let volume = self.edge * self.edge * self.edge;
        let cells = Places::new(1 << self.depth, sums.iter().map(|sum| sum.cell).collect());
        let field: Vec<Vector3<f64>> = (0..self.nodes.len())
            .into_par_iter()
            .with_min_len(BLOCK)
            .map(|node: usize| {
                let place = self.nodes.place(node);
                let mut normal = Vector3::zeros();
                for k in 0..16 {
                    let row = cells.row(place[1] + k % 4 - 2, place[2] + k / 4 - 2);
                    let first = cells.from(row.clone(), place[0] - 2);
                    for sum in &sums[first..row.end] {
                        if i32::from(sum.cell[0]) > place[0] + 1 {
                            break;
                        }
                        let weights =
                            [0, 1, 2].map(|axis| bell(sum.at[axis] - f64::from(place[axis])));
                        normal += sum.normal * (weights[0] * weights[1] * weights[2] / volume);
                    }
                }
                normal
            })
            .collect();
        // Integrals along one axis: of the product of slope and value, and of the product of two values.
        let slope = [0.5, 0.0, -0.5];
        let value = [1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0];
        let square = self.edge * self.edge;
        self.right = self
            .around
            .par_iter()
            .with_min_len(BLOCK)
            .map(|around| {
                let mut sum = 0.0;
                for (k, &node) in around.iter().enumerate() {
                    let [x, y, z] = [k % 3, k / 3 % 3, k / 9];
                    let normal = field[node as usize];
                    // The sign is negative because the function decreases along the normals.
                    sum -= normal.x * slope[x] * value[y] * value[z]
                        + normal.y * value[x] * slope[y] * value[z]
                        + normal.z * value[x] * value[y] * slope[z];
                }
                sum * square
            })
            .collect();
    }

    /// Adds the equations that pull the function to the surface value at the surfels. The weight of these equations grows as cells become
    /// smaller, in the same way as the integrals.
    fn screen(&mut self, sums: &[Sum], screening: f64) {
        self.held = sums
            .par_iter()
            .filter_map(|sum| {
                let corners = self.nodes.corners(sum.cell.map(i32::from))?;
                let within = [0, 1, 2].map(|axis| sum.at[axis] - f64::from(sum.cell[axis]));
                let root = (screening * sum.area / self.edge).sqrt();
                Some((corners.map(|node| node as u32), corner_weights(within).map(|w| w * root)))
            })
            .collect();
        let held = &self.held;
        self.held_at = Lists::group_all(self.nodes.len(), held.len(), |cell| {
            let numbered = held[cell].0.into_iter().zip(0u8..);
            numbered.map(move |(node, corner)| (node, (cell as u32, corner)))
        });
        let root = (screening / self.edge).sqrt();
        let target: Vec<f64> = sums
            .par_iter()
            .with_min_len(BLOCK)
            .filter(|sum: &&Sum| self.nodes.corners(sum.cell.map(i32::from)).is_some())
            .map(|sum| SURFACE * root * sum.area.sqrt())
            .collect();
        let free = self.free.par_iter().with_min_len(BLOCK);
        let pulls: Vec<f64> = free.map(|&node| self.pull(node, &target)).collect();
        self.right.iter_mut().zip(pulls).for_each(|(right, pull)| *right += pull);
    }

    fn held_by(&self, node: u32) -> &[(u32, u8)] {
        self.held_at.list(node as usize)
    }

    /// Returns the sum of `of_cells` over the pulled cells of a node, weighted by the node's weight in each cell.
    fn pull(&self, node: u32, of_cells: &[f64]) -> f64 {
        let held = self.held_by(node).iter();
        held.map(|&(cell, corner)| {
            of_cells[cell as usize] * self.held[cell as usize].1[usize::from(corner)]
        })
        .sum()
    }

    /// Returns the left sides of the equations of all free nodes, for the given values of all nodes.
    fn left_sides(&self, values: &[f64]) -> Vec<f64> {
        let in_cells: Vec<f64> = self
            .held
            .par_iter()
            .with_min_len(BLOCK)
            .map(|(corners, weights)| -> f64 {
                corners
                    .iter()
                    .zip(weights)
                    .map(|(&node, weight)| values[node as usize] * weight)
                    .sum()
            })
            .collect();
        let nodes = self.free.par_iter().zip(&self.around);
        nodes
            .with_min_len(BLOCK)
            .map(|(&node, around): (&u32, &[u32; 27])| {
                fn value(k: usize, values: &[f64], around: &[u32; 27]) -> f64 {
                    values[around[k] as usize]
                }
                let edges: f64 = EDGES.iter().map(|&k| value(k, values, around)).sum();
                let corners: f64 = CORNERS.iter().map(|&k| value(k, values, around)).sum();
                let stiff = 8.0 / 3.0 * value(13, values, around) - edges / 6.0 - corners / 12.0;
                stiff * self.edge + self.pull(node, &in_cells)
            })
            .collect()
    }

    /// Solves the equations by conjugate gradients with the diagonal as preconditioner: Hestenes and Stiefel (1952).
    fn solve(&mut self, steps: usize, progress: &Progress<'_>) -> Result<(), CancelledError> {
        let diagonal: Vec<f64> = self
            .free
            .par_iter()
            .map(|&node| {
                let held = self.held_by(node).iter();
                let weight = held.map(|&(cell, corner)| {
                    let weight = self.held[cell as usize].1[usize::from(corner)];
                    weight * weight
                });
                8.0 / 3.0 * self.edge + weight.sum::<f64>()
            })
            .collect();
        let left = self.left_sides(&self.values);
        let mut residual = combine(&self.right, &left, |r, l| r - l);
        let mut way = vec![0.0; self.values.len()];
        let (mut squared, mut first) = (0.0, 0.0);
        for step in 0..steps {
            progress.check()?;
            let scaled = combine(&residual, &diagonal, |r, d| r / d);
            let last = squared;
            squared = dot(&residual, &scaled);
            if step == 0 {
                first = squared;
            }
            if squared <= TOLERANCE * TOLERANCE * first || squared == 0.0 {
                break;
            }
            let ratio = if step == 0 { 0.0 } else { squared / last };
            update(&self.free, &mut way, |way, k| way * ratio + scaled[k]);
            let left = self.left_sides(&way);
            let free = self.free.par_iter().with_min_len(BLOCK);
            let on_way: Vec<f64> = free.map(|&node| way[node as usize]).collect();
            let length = squared / dot(&on_way, &left);
            update(&self.free, &mut self.values, |value, k| value + length * on_way[k]);
            residual = combine(&residual, &left, |r, l| r - length * l);
        }
        Ok(())
    }
}

/// Indices, among the 27 nodes around a node, of the neighbors across an edge and across a corner of a cell. For neighbors across a face,
/// `K` is 0.
const EDGES: [usize; 12] = [1, 3, 5, 7, 9, 11, 15, 17, 19, 21, 23, 25];
const CORNERS: [usize; 8] = [0, 2, 6, 8, 18, 20, 24, 26];

/// Combines the entries of two lists.
fn combine(a: &[f64], b: &[f64], f: impl Fn(f64, f64) -> f64 + Sync) -> Vec<f64> {
    let f = &f;
    a.par_iter().zip(b).with_min_len(BLOCK).map(|(&a, &b): (&f64, &f64)| f(a, b)).collect()
}

/// Replaces the values of the nodes `free`, which are ascending. The arguments of `f` are a value and its position in `free`.
fn update(free: &[u32], values: &mut [f64], f: impl Fn(f64, usize) -> f64 + Sync) {
    values.par_chunks_mut(BLOCK).enumerate().for_each(|(block, values): (usize, &mut [f64])| {
        let first = block * BLOCK;
        let begin = free.partition_point(|&node| (node as usize) < first);
        let end = first + values.len();
        let own = (begin..free.len()).zip(&free[begin..]);
        for (k, &node) in own.take_while(|(_, node)| (**node as usize) < end) {
            let value = &mut values[node as usize - first];
            *value = f(*value, k);
        }
    });
}

/// Returns a dot product whose rounding does not depend on the number of threads.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let blocks = a.par_chunks(BLOCK).zip(b.par_chunks(BLOCK));
    let sums: Vec<f64> =
        blocks.map(|(a, b)| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>()).collect();
    sums.iter().sum()
}
