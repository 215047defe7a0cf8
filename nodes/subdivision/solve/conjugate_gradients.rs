//! The steps of conjugate gradients, each in two passes over memory.
//!
//! Three coordinates are solved side by side, in lists of four numbers each, which one instruction loads, multiplies or adds.

use maquette::simd::{Kernel, widest};
use rayon::prelude::*;

use crate::linear::columns::{CHUNK, Column};
use crate::linear::missed::Missed;
use crate::linear::stencils::Stencils;

/// Three coordinates and a zero.
type Four = [f64; 4];

/// A walk to the solution of symmetric equations.
pub(crate) struct Walk<'a> {
    rows: &'a Stencils,
    /// The factors of the rows that make them symmetric.
    scale: &'a [f64],
    /// How far it has led.
    moved: Vec<Four>,
    /// What is left of the right side.
    residual: Vec<Four>,
    /// The direction of the next step, and the rows times it.
    way: Vec<Four>,
    bent: Vec<Four>,
}

impl<'a> Walk<'a> {
    pub(crate) fn new(rows: &'a Stencils, scale: &'a [f64], residual: &[Column]) -> Self {
        let zeros = vec![[0.0; 4]; residual.len()];
        let residual = residual.iter().map(|&[x, y, z]| [x, y, z, 0.0]).collect();
        Self { rows, scale, moved: zeros.clone(), residual, way: zeros.clone(), bent: zeros }
    }

    /// Adds how far it has led.
    pub(crate) fn add_to(&self, unknown: &mut [Column]) {
        for (unknown, moved) in unknown.iter_mut().zip(&self.moved) {
            (0..3).for_each(|k| unknown[k] += moved[k]);
        }
    }

    /// Turns to the residual and this share of the last direction; how the rows bend the new direction, and how long it is.
    ///
    /// The rows times the new direction are those times the residual and the same share of what they were, so that one pass does both.
    pub(crate) fn turn(&mut self, ratio: Column) -> [Column; 2] {
        let Self { rows, scale, residual, way, bent, .. } = self;
        let chunks = way.par_chunks_mut(CHUNK).zip(bent.par_chunks_mut(CHUNK));
        let parts = chunks.zip(scale.par_chunks(CHUNK)).enumerate();
        let parts = parts.map(|(chunk, ((way, bent), scale))| {
            let (mut sums, ratio) = ([[0.0; 4]; 2], four(ratio));
            let (rows, sums_of) = (rows.rows_from(chunk * CHUNK), &mut sums);
            widest(Turn { rows, residual, scale, ratio, way, bent, sums: sums_of });
            sums
        });
        let parts: Vec<[Four; 2]> = parts.collect();
        let add = |a: Column, b: Four| [0, 1, 2].map(|k| a[k] + b[k]);
        parts.into_iter().fold([[0.0; 3]; 2], |[a, b], [c, d]| [add(a, c), add(b, d)])
    }

    /// Takes steps of this length, coordinate by coordinate; the distances that are left, and the sums of their squares with the factors.
    pub(crate) fn go(&mut self, step: Column) -> (Missed, Column) {
        let Self { scale, moved, residual, way, bent, .. } = self;
        let to = moved.par_chunks_mut(CHUNK).zip(residual.par_chunks_mut(CHUNK));
        let by = way.par_chunks(CHUNK).zip(bent.par_chunks(CHUNK)).zip(scale.par_chunks(CHUNK));
        let parts = to.zip(by).map(|((moved, residual), ((way, bent), scale))| {
            let (mut energy, step) = ([0.0; 4], four(step));
            widest(Go { step, scale, way, bent, moved, residual, energy: &mut energy });
            let lengths_sq = residual.iter().map(|[x, y, z, _]| x * x + y * y + z * z);
            (lengths_sq.fold(Missed::none(), Missed::and_by), energy)
        });
        let parts: Vec<(Missed, Four)> = parts.collect();
        parts.into_iter().fold((Missed::none(), [0.0; 3]), |(missed, sum), (more, energy)| {
            (missed.and(more), [0, 1, 2].map(|k| sum[k] + energy[k]))
        })
    }
}

fn four([x, y, z]: Column) -> Four {
    [x, y, z, 0.0]
}

/// Some rows of [`Walk::turn`].
struct Turn<'a, R> {
    rows: R,
    residual: &'a [Four],
    scale: &'a [f64],
    ratio: Four,
    way: &'a mut [Four],
    bent: &'a mut [Four],
    sums: &'a mut [Four; 2],
}

impl<'r, R: Iterator<Item = (usize, &'r [u32], &'r [f64])>> Kernel for Turn<'_, R> {
    #[inline(always)]
    fn run(self) {
        let [mut curving, mut length] = [[0.0; 4]; 2];
        let ours = self.way.iter_mut().zip(self.bent).zip(self.scale);
        for ((row, indices, weights), ((way, bent), &scale)) in self.rows.zip(ours) {
            let mut product = [0.0; 4];
            for (&index, &weight) in indices.iter().zip(weights) {
                let entry = &self.residual[index as usize];
                for k in 0..4 {
                    product[k] += weight * entry[k];
                }
            }
            let own = &self.residual[row];
            for k in 0..4 {
                way[k] = way[k] * self.ratio[k] + own[k];
                bent[k] = bent[k] * self.ratio[k] + product[k];
                curving[k] += scale * bent[k] * way[k];
                length[k] += scale * way[k] * way[k];
            }
        }
        *self.sums = [curving, length];
    }
}

/// Some rows of [`Walk::go`].
struct Go<'a> {
    step: Four,
    scale: &'a [f64],
    way: &'a [Four],
    bent: &'a [Four],
    moved: &'a mut [Four],
    residual: &'a mut [Four],
    energy: &'a mut Four,
}

impl Kernel for Go<'_> {
    #[inline(always)]
    fn run(self) {
        let mut energy = [0.0; 4];
        let to = self.moved.iter_mut().zip(self.residual);
        let by = self.way.iter().zip(self.bent).zip(self.scale);
        for ((moved, residual), ((way, bent), &scale)) in to.zip(by) {
            for k in 0..4 {
                moved[k] += way[k] * self.step[k];
                residual[k] -= bent[k] * self.step[k];
                energy[k] += scale * residual[k] * residual[k];
            }
        }
        *self.energy = energy;
    }
}
