//! The error of thin plates, measured by filling exemplars, whose middles are known.

use maquette_base::linear::cholesky::{Cholesky, Symmetric};

use super::exemplars::Exemplars;
use super::heights::{NODES, SIDE};

/// Exemplars that are tried.
const MOST: usize = 512;

/// The part of the disk that is taken for missing, in radii of it: as much as a hole is of the patch that sees across it.
pub(super) const HOLE: f64 = 0.5;

/// The root of the mean square of the differences between exemplars and the thin plates that would fill them if their middles were
/// missing; infinite without exemplars.
pub(super) fn plate_error(exemplars: &Exemplars) -> f64 {
    let missing = exemplars.lattice.inside(HOLE);
    let mut unknown = [None; NODES];
    (0..).zip(&missing).for_each(|(k, &node)| unknown[node] = Some(k));
    let stencil = &PLATE;
    fn beside(node: usize, offset: i32) -> usize {
        (node as i32 + offset) as usize
    }
    let mut matrix = Symmetric { starts: vec![0], indices: vec![], entries: vec![] };
    for &node in &missing {
        for &(offset, weight) in stencil {
            if let Some(column) = unknown[beside(node, offset)] {
                matrix.indices.push(column);
                matrix.entries.push(weight);
            }
        }
        matrix.starts.push(matrix.indices.len() as u32);
    }
    let Some(factors) = Cholesky::new(&matrix) else { return f64::INFINITY };
    let every = exemplars.len().div_ceil(MOST).max(1);
    let (mut sum, mut count) = (0.0, 0_usize);
    for exemplar in (0..exemplars.len() as u32).step_by(every) {
        let heights = exemplars.heights(exemplar);
        let mut plate: Vec<[f64; 3]> = missing
            .iter()
            .map(|&node| {
                let known =
                    stencil.iter().filter(|(offset, _)| unknown[beside(node, *offset)].is_none());
                let load = known
                    .map(|&(offset, weight)| -weight * f64::from(heights[beside(node, offset)]));
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

/// The thin plate on a square lattice: offsets of nodes and their weights.
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
