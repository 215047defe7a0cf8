//! A function that is 1 inside and 0 outside, from oriented pieces of the surface between.
//!
//! Its gradient is to be the field of normals: Kazhdan, Bolitho and Hoppe, "Poisson surface reconstruction" (2006); and it is to be
//! 1/2 at the points: Kazhdan and Hoppe, "Screened Poisson surface reconstruction" (2013), section 4.1. The functions are trilinear
//! on grids that are halved where the points are dense enough; each depth is solved for once, coarse ones first, and only around
//! the points (section 5 there), with the coarser function on the border. So the function is continuous. On the border of the
//! cube it is 0, so that its skin is closed (Kazhdan, Chuang, Rusinkiewicz and Hoppe, "Poisson surface reconstruction with
//! envelope constraints", 2020).
//!
//! Notation: `h` is the edge of a cell, `B_i` the trilinear function of node `i`, `K_ij` the integral of the product of the
//! gradients of `B_i` and `B_j`.

use maquette_base::topology::lists::Lists;
use maquette_node::{Cancelled, Limit, Progress, TooMuch};
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::cells::{CellIndex, Cube, Places, bell, corner_weights};
use super::surfels::{Pyramid, Surfel};

/// The value at the surface.
pub(super) const SURFACE: f64 = 0.5;

/// Nodes of all depths together; each has some 200 bytes while it is solved for.
pub(super) const NODES: Limit =
    Limit { most: 20_000_000, of: "nodes", help: "choose a larger `spacing`, or fewer points" };

/// Up to this depth all of the cube is solved for.
const WHOLE: u32 = 5;

/// Points that are farther apart than so many cells are not solved for on a grid: between them it would find nothing.
const SPARSEST: f64 = 1.6;

/// Steps of the conjugate gradients on a grid; what is left is smooth, and the coarser grids had it.
const STEPS: usize = 24;

/// A residual that is so small a part of the first is good enough.
const ENOUGH: f64 = 2e-3;

/// The function on the grid of one depth.
pub(super) struct Grid {
    pub(super) nodes: Places,
    pub(super) values: Vec<f64>,
}

/// The function on the grids of all depths, each finer one where there are points.
pub(super) struct Field {
    pub(super) cube: Cube,
    pub(super) grids: Vec<Grid>,
}

impl Field {
    /// Solves for the function; `screening` is how strongly it is held to 1/2 at the points.
    pub(super) fn solve(
        pyramid: &Pyramid,
        surfels: &[Surfel],
        screening: f64,
        progress: &Progress<'_>,
    ) -> Result<Self, SolveError> {
        let cube = pyramid.cube;
        let mut field = Self { cube, grids: Vec::new() };
        let mut count = 0;
        for depth in 0..=cube.depth {
            let side = (1 << depth) + 1;
            let sums = sums(pyramid, surfels, depth);
            let (free, nodes) = if depth <= WHOLE {
                (None, Places::all(side))
            } else {
                let dense = sums.iter().filter(|sum| sum.spacing < SPARSEST * cube.edge_at(depth));
                let mut cells: Vec<[u16; 3]> = dense.map(|sum| sum.cell).collect();
                cells.extend(field.bridges(pyramid, depth - 1));
                cells.par_sort_unstable_by_key(|&[x, y, z]| [z, y, x]);
                cells.dedup();
                let cells = Places::new(side - 1, cells);
                (Some(cells.spread(side, -1..=2)), cells.spread(side, -2..=3))
            };
            count += nodes.len();
            NODES.check("the grid", count as f64)?;
            let values = field.values_at(&nodes, depth);
            let mut level = PoissonLevel::new(&cube, depth, nodes, free.as_ref(), values);
            level.add_normals(&sums);
            level.screen(&sums, screening);
            // Coarse grids have nothing under them that would have found what is smooth.
            let steps = if depth <= WHOLE { 4 * STEPS } else { STEPS };
            level.solve(steps, progress)?;
            field.grids.push(Grid { nodes: level.nodes, values: level.values });
            let done = f64::from(depth + 1) / f64::from(cube.depth + 1);
            progress.tick(done * done * done)?;
        }
        Ok(field)
    }

    /// The halves of those cells of a depth that the surface runs through far from all points: there the function is smooth, but what
    /// a coarse grid makes of it has steps.
    fn bridges(&self, pyramid: &Pyramid, depth: u32) -> Vec<[u16; 3]> {
        let grid = &self.grids[depth as usize];
        let points = &pyramid.layers[depth as usize].cells;
        let halves = |node: usize| {
            let place = grid.nodes.place(node);
            let corners = grid.nodes.corners(place)?;
            let inside = corners.iter().filter(|&&node| grid.values[node] > SURFACE).count();
            let is_bridge = 0 < inside && inside < 8 && points.near(place).next().is_none();
            is_bridge.then(|| {
                (0..8)
                    .map(move |k| [0, 1, 2].map(|axis| (2 * place[axis] + (k >> axis & 1)) as u16))
            })
        };
        let nodes = (0..grid.nodes.len()).into_par_iter();
        nodes.flat_map_iter(|node| halves(node).into_iter().flatten()).collect()
    }

    /// The function at the nodes of a depth, from the coarser grids.
    fn values_at(&self, nodes: &Places, depth: u32) -> Vec<f64> {
        (0..nodes.len())
            .into_par_iter()
            .map(|node: usize| self.at_node(nodes.place(node), depth, depth))
            .collect()
    }

    /// The function at a node of a depth, from the grids below `end`.
    pub(super) fn at_node(&self, place: CellIndex, depth: u32, end: u32) -> f64 {
        self.at(place.map(f64::from), depth, end).0
    }

    /// The function at a place in cells of a depth, from the grids below depth `end`, and its gradient there, in cells of that
    /// depth.
    pub(super) fn at(&self, at: [f64; 3], depth: u32, end: u32) -> (f64, Vector3<f64>) {
        for from in (0..end).rev() {
            let grid = &self.grids[from as usize];
            let scale = libm::scalbn(1.0, from as i32 - depth as i32);
            let at = at.map(|x| x * scale);
            let cell = self.cube.cell(at, from);
            if let Some(corners) = grid.nodes.corners(cell) {
                let values = corners.map(|node| grid.values[node]);
                let within = [0, 1, 2].map(|axis| at[axis] - f64::from(cell[axis]));
                return (trilinear(&values, within), gradient(&values, within) * scale);
            }
        }
        (0.0, Vector3::zeros())
    }

    /// The function at a point and its gradient, in 1/mm.
    pub(super) fn at_point(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        let depth = self.cube.depth;
        let (value, gradient) = self.at(self.cube.in_cells(point, depth), depth, depth + 1);
        (value, gradient / self.cube.edge)
    }
}

fn trilinear(values: &[f64; 8], within: [f64; 3]) -> f64 {
    corner_weights(within).iter().zip(values).map(|(weight, value)| weight * value).sum()
}

fn gradient(values: &[f64; 8], within: [f64; 3]) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| {
        let [low, high] = [0.0, 1.0].map(|x| {
            let mut at = within;
            at[axis] = x;
            trilinear(values, at)
        });
        high - low
    })
}

/// Why there is no function.
#[derive(Debug, thiserror::Error)]
pub(super) enum SolveError {
    #[error(transparent)]
    TooMuch(#[from] TooMuch),
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// The surfels of a cell of some depth as one.
#[derive(Clone, Copy)]
struct Sum {
    cell: [u16; 3],
    /// In cells of the depth.
    at: [f64; 3],
    area: f64,
    /// Normals times areas, in mm^2.
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
    let mut sums = Vec::new();
    for cell in keys.chunk_by(|a, b| a.0 == b.0) {
        let of_cell = || cell.iter().map(|&(_, place)| &surfels[place as usize]);
        let area: f64 = of_cell().map(|surfel| surfel.area).sum();
        let mean: Vector3<f64> =
            of_cell().map(|surfel| surfel.at.coords * (surfel.area / area)).sum();
        sums.push(Sum {
            cell: [cell[0].0 as u16, (cell[0].0 >> 16) as u16, (cell[0].0 >> 32) as u16],
            at: cube.in_cells(&Point3::from(mean), depth),
            area,
            normal: of_cell().map(|surfel| surfel.normal * surfel.area).sum(),
            spacing: of_cell().map(|surfel| surfel.spacing).fold(f64::INFINITY, f64::min),
        });
    }
    sums
}

/// What is solved for at one depth.
struct PoissonLevel {
    depth: u32,
    edge: f64,
    nodes: Places,
    values: Vec<f64>,
    /// The nodes that are solved for, and the 27 nodes around each, x first.
    free: Vec<u32>,
    around: Vec<[u32; 27]>,
    /// The right sides of the free nodes.
    right: Vec<f64>,
    /// Cells that are held to the surface at one place: corners, and their weights times the root of the cell's weight.
    held: Vec<([u32; 8], [f64; 8])>,
    /// The held cells at each node, and its corner there.
    held_at: Lists<(u32, u8)>,
}

/// Nodes that one task looks at.
const BLOCK: usize = 4096;

impl PoissonLevel {
    /// All nodes that have neighbors are free, or those of `free`.
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

    /// Right sides: the integrals of the field of normals times the gradients of `B_i`. The field is trilinear; a surfel is spread
    /// over the nodes around it by a quadratic B-spline.
    fn add_normals(&mut self, sums: &[Sum]) {
        let volume = self.edge * self.edge * self.edge;
        let cells = Places::new(1 << self.depth, sums.iter().map(|sum| sum.cell).collect());
        let spread = |node: usize| {
            let place = self.nodes.place(node);
            let mut normal = Vector3::zeros();
            for k in 0..16 {
                let row = cells.row(place[1] + k % 4 - 2, place[2] + k / 4 - 2);
                let first = cells.from(row.clone(), place[0] - 2);
                for sum in &sums[first..row.end] {
                    if i32::from(sum.cell[0]) > place[0] + 1 {
                        break;
                    }
                    let weights = [0, 1, 2].map(|axis| bell(sum.at[axis] - f64::from(place[axis])));
                    normal += sum.normal * (weights[0] * weights[1] * weights[2] / volume);
                }
            }
            normal
        };
        let field: Vec<Vector3<f64>> =
            (0..self.nodes.len()).into_par_iter().with_min_len(BLOCK).map(spread).collect();
        // Integrals of products along one axis: slope and value, value and value.
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
                    // The function falls along the normals.
                    sum -= normal.x * slope[x] * value[y] * value[z]
                        + normal.y * value[x] * slope[y] * value[z]
                        + normal.z * value[x] * value[y] * slope[z];
                }
                sum * square
            })
            .collect();
    }

    /// Holds the function to the surface's value at the places of the surfels; the weight grows as cells become smaller, as the
    /// integrals do.
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
        self.held_at = Lists::group(self.nodes.len(), || {
            (0..held.len()).flat_map(|cell: usize| {
                let numbered = held[cell].0.into_iter().zip(0u8..);
                numbered.map(move |(node, corner)| (node, (cell as u32, corner)))
            })
        });
        let root = (screening / self.edge).sqrt();
        let target: Vec<f64> = sums
            .iter()
            .filter(|sum| self.nodes.corners(sum.cell.map(i32::from)).is_some())
            .map(|sum| SURFACE * root * sum.area.sqrt())
            .collect();
        let pulls: Vec<f64> = self.free.iter().map(|&node| self.pull(node, &target)).collect();
        self.right.iter_mut().zip(pulls).for_each(|(right, pull)| *right += pull);
    }

    fn held_by(&self, node: u32) -> &[(u32, u8)] {
        self.held_at.of(node as usize)
    }

    /// The sum of what its held cells have, by the weights of this node in them.
    fn pull(&self, node: u32, of_cells: &[f64]) -> f64 {
        let held = self.held_by(node).iter();
        held.map(|&(cell, corner)| {
            of_cells[cell as usize] * self.held[cell as usize].1[usize::from(corner)]
        })
        .sum()
    }

    /// The left sides of all free nodes for these values of all nodes.
    fn left(&self, values: &[f64]) -> Vec<f64> {
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
                fn at(k: usize, values: &[f64], around: &[u32; 27]) -> f64 {
                    values[around[k] as usize]
                }
                let edges: f64 = EDGES.iter().map(|&k| at(k, values, around)).sum();
                let corners: f64 = CORNERS.iter().map(|&k| at(k, values, around)).sum();
                let stiff = 8.0 / 3.0 * at(13, values, around) - edges / 6.0 - corners / 12.0;
                stiff * self.edge + self.pull(node, &in_cells)
            })
            .collect()
    }

    /// Conjugate gradients, each equation divided by its diagonal: Hestenes and Stiefel (1952).
    fn solve(&mut self, steps: usize, progress: &Progress<'_>) -> Result<(), Cancelled> {
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
        let left = self.left(&self.values);
        let mut residual: Vec<f64> = self.right.iter().zip(&left).map(|(r, l)| r - l).collect();
        let mut way = vec![0.0; self.values.len()];
        let (mut squared, mut first) = (0.0, 0.0);
        for step in 0..steps {
            progress.check()?;
            let scaled: Vec<f64> = residual.iter().zip(&diagonal).map(|(r, d)| r / d).collect();
            let last = squared;
            squared = dot(&residual, &scaled);
            if step == 0 {
                first = squared;
            }
            if squared <= ENOUGH * ENOUGH * first || squared == 0.0 {
                break;
            }
            let ratio = if step == 0 { 0.0 } else { squared / last };
            for (&node, scaled) in self.free.iter().zip(&scaled) {
                way[node as usize] = way[node as usize] * ratio + scaled;
            }
            let left = self.left(&way);
            let on_way: Vec<f64> = self.free.iter().map(|&node| way[node as usize]).collect();
            let length = squared / dot(&on_way, &left);
            for (k, &node) in self.free.iter().enumerate() {
                self.values[node as usize] += length * on_way[k];
                residual[k] -= length * left[k];
            }
        }
        Ok(())
    }
}

/// The nodes across an edge and across a corner, among 27; those across a face have no part in `K`.
const EDGES: [usize; 12] = [1, 3, 5, 7, 9, 11, 15, 17, 19, 21, 23, 25];
const CORNERS: [usize; 8] = [0, 2, 6, 8, 18, 20, 24, 26];

/// The same for any number of threads.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let blocks = a.par_chunks(BLOCK).zip(b.par_chunks(BLOCK));
    let sums: Vec<f64> =
        blocks.map(|(a, b)| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>()).collect();
    sums.iter().sum()
}
