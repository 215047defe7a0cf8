//! Measures the error of thin plates as fills: removes the centers of exemplars (patches of the input surface), fills them with thin
//! plates, and compares these with the known heights.

use maquette_base::linear::cholesky::{Cholesky, Symmetric};

use super::exemplars::Exemplars;
use super::heights::{Lattice, NODES, SIDE};

/// Maximum number of exemplars that are measured.
const MAX_EXEMPLARS: usize = 512;

/// Radius of the part of an exemplar that is treated as a hole, divided by the radius of the exemplar's disk. It equals the ratio of a
/// hole's radius to the radius of a patch that spans the hole.
pub(super) const HOLE_RATIO: f64 = 0.5;

/// The equations of a thin plate over the nodes at the center of a lattice; the other nodes have known heights.
pub(super) struct LatticePlate {
    /// The nodes of the plate.
    pub(super) missing: Vec<usize>,
    /// For each node of the lattice, its index in `missing`.
    unknown: [Option<u32>; NODES],
    factors: Cholesky,
}

impl LatticePlate {
    /// Creates a plate over the nodes within [`HOLE_RATIO`] of the lattice's center. Returns `None` if the equations have no solution.
    pub(super) fn new(lattice: &Lattice) -> Option<Self> {
        let missing = lattice.nodes_within(HOLE_RATIO);
        let mut unknown = [None; NODES];
        (0..).zip(&missing).for_each(|(k, &node)| unknown[node] = Some(k));
        let mut matrix = Symmetric { starts: vec![0], indices: vec![], entries: vec![] };
        for &node in &missing {
            for &(offset, weight) in &PLATE {
                if let Some(column) = unknown[neighbor(node, offset)] {
                    matrix.indices.push(column);
                    matrix.entries.push(weight);
                }
            }
            matrix.starts.push(matrix.indices.len() as u32);
        }
        Some(Self { missing, unknown, factors: Cholesky::new(&matrix)? })
    }

    /// Returns the differences between the given heights and the plate that replaces them; NaN where heights around the plate are unknown.
    pub(super) fn residuals<'a>(&'a self, heights: &'a [f32]) -> impl Iterator<Item = f64> + 'a {
        let mut plate: Vec<[f64; 3]> = self
            .missing
            .iter()
            .map(|&node| {
                let known =
                    PLATE.iter().filter(|(off, _)| self.unknown[neighbor(node, *off)].is_none());
                let load =
                    known.map(|&(off, weight)| -weight * f64::from(heights[neighbor(node, off)]));
                [load.sum::<f64>(), 0.0, 0.0]
            })
            .collect();
        self.factors.solve(&mut plate);
        self.missing.iter().zip(plate).map(|(&node, [plate, ..])| f64::from(heights[node]) - plate)
    }
}

/// Returns the root mean square difference between exemplars and thin plates that fill their centers; infinite if there are no exemplars.
pub(super) fn plate_error(exemplars: &Exemplars) -> f64 {
    let Some(plate) = LatticePlate::new(&exemplars.lattice) else { return f64::INFINITY };
    let every = exemplars.len().div_ceil(MAX_EXEMPLARS).max(1);
    let (mut sum, mut count) = (0.0, 0_usize);
    for exemplar in (0..exemplars.len() as u32).step_by(every) {
        for off in plate.residuals(exemplars.heights(exemplar)).filter(|off| off.is_finite()) {
            sum += off * off;
            count += 1;
        }
    }
    if count == 0 { f64::INFINITY } else { (sum / count as f64).sqrt() }
}

/// Returns the index of the node at an offset from another.
fn neighbor(node: usize, offset: i32) -> usize {
    (node as i32 + offset) as usize
}

/// The finite-difference stencil of a thin plate on a square lattice: index offsets of nodes and their weights.
const PLATE: [(i32, f64); 13] = {
    let row = SIDE as i32;
    [
        (0, 20.0),
        (1, -8.0),
        (-1, -8.0),
        (row, -8.0),
        (-row, -8.0),
        (row + 1, 2.0),
        (row - 1, 2.0),
        (-row + 1, 2.0),
        (-row - 1, 2.0),
        (2, 1.0),
        (-2, 1.0),
        (2 * row, 1.0),
        (-2 * row, 1.0),
    ]
};
