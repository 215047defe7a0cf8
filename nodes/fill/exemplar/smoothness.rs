//! Measures the error of thin plates as fills: removes the centers of exemplars (patches of the input surface), fills them with thin
//! plates, and compares these with the known heights.

use maquette_base::linear::cholesky::{Cholesky, Symmetric};

use super::exemplars::Exemplars;
use super::heights::{NODES, SIDE};

/// Maximum number of exemplars that are measured.
const MAX_EXEMPLARS: usize = 512;

/// Radius of the part of an exemplar that is treated as a hole, divided by the radius of the exemplar's disk. It equals the ratio of a
/// hole's radius to the radius of a patch that spans the hole.
pub(super) const HOLE_RATIO: f64 = 0.5;

/// Returns the root mean square difference between exemplars and thin plates that fill their centers; infinite if there are no exemplars.
pub(super) fn plate_error(exemplars: &Exemplars) -> f64 {
    let missing = exemplars.lattice.nodes_within(HOLE_RATIO);
    let mut unknown = [None; NODES];
    (0..).zip(&missing).for_each(|(k, &node)| unknown[node] = Some(k));
    let stencil = &PLATE;
    fn neighbor(node: usize, offset: i32) -> usize {
        (node as i32 + offset) as usize
    }
    let mut matrix = Symmetric { starts: vec![0], indices: vec![], entries: vec![] };
    for &node in &missing {
        for &(offset, weight) in stencil {
            if let Some(column) = unknown[neighbor(node, offset)] {
                matrix.indices.push(column);
                matrix.entries.push(weight);
            }
        }
        matrix.starts.push(matrix.indices.len() as u32);
    }
    let Some(factors) = Cholesky::new(&matrix) else { return f64::INFINITY };
    let every = exemplars.len().div_ceil(MAX_EXEMPLARS).max(1);
    let (mut sum, mut count) = (0.0, 0_usize);
    for exemplar in (0..exemplars.len() as u32).step_by(every) {
        let heights = exemplars.heights(exemplar);
        let mut plate: Vec<[f64; 3]> = missing
            .iter()
            .map(|&node| {
                let known =
                    stencil.iter().filter(|(offset, _)| unknown[neighbor(node, *offset)].is_none());
                let load = known
                    .map(|&(offset, weight)| -weight * f64::from(heights[neighbor(node, offset)]));
                [load.sum::<f64>(), 0.0, 0.0]
            })
            .collect();
        factors.solve(&mut plate);
        for (&node, [plate, ..]) in missing.iter().zip(plate) {
            let off = f64::from(heights[node]) - plate;
            if off.is_finite() {
                sum += off * off;
                count += 1;
            }
        }
    }
    if count == 0 { f64::INFINITY } else { (sum / count as f64).sqrt() }
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
