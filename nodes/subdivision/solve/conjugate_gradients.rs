//! The conjugate gradient method, with two passes over memory per step.
//!
//! Three coordinates are solved in parallel. Each entry has four numbers, which suits SIMD instructions.

use maquette_base::linear::columns::{CHUNK, Column};
use maquette_base::linear::residuals::Residuals;
use maquette_base::linear::stencils::Stencils;
use maquette_value::parallel::*;
use maquette_value::simd::{Kernel, widest};

/// Three coordinates, padded with a zero.
type Four = [f64; 4];

/// The state of the iteration: iterate, residual and search direction.
pub(crate) struct Search<'a> {
    rows: &'a Stencils,
    /// The factors by which the rows are multiplied to make the matrix symmetric.
    scale: &'a [f64],
    /// The iterate, as the difference from the start.
    moved: Vec<Four>,
    /// The residual of the iterate.
    residual: Vec<Four>,
    /// The search direction; `applied` is the product of the matrix and the search direction.
    direction: Vec<Four>,
    applied: Vec<Four>,
}

impl<'a> Search<'a> {
    pub(crate) fn new(rows: &'a Stencils, scale: &'a [f64], residual: &[Column]) -> Self {
        let zeros = vec![[0.0; 4]; residual.len()];
        let residual = residual.iter().map(|&[x, y, z]| [x, y, z, 0.0]).collect();
        Self {
            rows,
            scale,
            moved: zeros.clone(),
            residual,
            direction: zeros.clone(),
            applied: zeros,
        }
    }

    /// Adds the iterate, which is relative to the start, to `unknown`.
    pub(crate) fn add_to(&self, unknown: &mut [Column]) {
        for (unknown, moved) in unknown.iter_mut().zip(&self.moved) {
            (0..3).for_each(|k| unknown[k] += moved[k]);
        }
    }

    /// Sets the new search direction to the residual plus `ratio` times the last direction, which makes it conjugate to all previous
    /// directions. For the new direction `d` and the matrix `A` returns the products of `d` with `A d` and of `d` with `d`.
    ///
    /// The product of the matrix with the new direction is its product with the residual plus `ratio` times its old product. So one pass
    /// over memory computes both the direction and its product.
    pub(crate) fn next_direction(&mut self, ratio: Column) -> [Column; 2] {
        let Self { rows, scale, residual, direction, applied, .. } = self;
        let chunks = direction.par_chunks_mut(CHUNK).zip(applied.par_chunks_mut(CHUNK));
        let parts = chunks.zip(scale.par_chunks(CHUNK)).enumerate();
        let parts = parts.map(|(chunk, ((direction, applied), scale))| {
            let (mut sums, ratio) = ([[0.0; 4]; 2], four(ratio));
            let (rows, sums_of) = (rows.rows_from(chunk * CHUNK), &mut sums);
            widest(NextDirection {
                rows,
                residual,
                scale,
                ratio,
                direction,
                applied,
                sums: sums_of,
            });
            sums
        });
        let parts: Vec<[Four; 2]> = parts.collect();
        fn add(a: Column, b: Four) -> [f64; 3] {
            [0, 1, 2].map(|k| a[k] + b[k])
        }
        parts.into_iter().fold([[0.0; 3]; 2], |[a, b], [c, d]| [add(a, c), add(b, d)])
    }

    /// Takes a step along the search direction; `step` has the step length of each coordinate. Returns the remaining distances, and for
    /// each coordinate the sum of the squared residuals weighted by `scale`.
    pub(crate) fn step(&mut self, step: Column) -> (Residuals, Column) {
        let Self { scale, moved, residual, direction, applied, .. } = self;
        let to = moved.par_chunks_mut(CHUNK).zip(residual.par_chunks_mut(CHUNK));
        let by =
            direction.par_chunks(CHUNK).zip(applied.par_chunks(CHUNK)).zip(scale.par_chunks(CHUNK));
        let parts = to.zip(by).map(|((moved, residual), ((direction, applied), scale))| {
            let (mut energy, step) = ([0.0; 4], four(step));
            widest(Step { step, scale, direction, applied, moved, residual, energy: &mut energy });
            let lengths_sq = residual.iter().map(|[x, y, z, _]| x * x + y * y + z * z);
            (lengths_sq.fold(Residuals::empty(), Residuals::with_distance_sq), energy)
        });
        let parts: Vec<(Residuals, Four)> = parts.collect();
        parts.into_iter().fold((Residuals::empty(), [0.0; 3]), |(missed, sum), (more, energy)| {
            (missed.merge(more), [0, 1, 2].map(|k| sum[k] + energy[k]))
        })
    }
}

fn four([x, y, z]: Column) -> Four {
    [x, y, z, 0.0]
}

/// The inner loop of [`Search::next_direction`] for some rows.
struct NextDirection<'a, R> {
    rows: R,
    residual: &'a [Four],
    scale: &'a [f64],
    ratio: Four,
    direction: &'a mut [Four],
    applied: &'a mut [Four],
    sums: &'a mut [Four; 2],
}

impl<'r, R: Iterator<Item = (usize, &'r [u32], &'r [f64])>> Kernel for NextDirection<'_, R> {
    #[inline(always)]
    fn run(self) {
        let [mut curvature, mut length] = [[0.0; 4]; 2];
        let ours = self.direction.iter_mut().zip(self.applied).zip(self.scale);
        for ((row, indices, weights), ((direction, applied), &scale)) in self.rows.zip(ours) {
            let mut product = [0.0; 4];
            for (&index, &weight) in indices.iter().zip(weights) {
                let entry = &self.residual[index as usize];
                for k in 0..4 {
                    product[k] += weight * entry[k];
                }
            }
            let own = &self.residual[row];
            for k in 0..4 {
                direction[k] = direction[k] * self.ratio[k] + own[k];
                applied[k] = applied[k] * self.ratio[k] + product[k];
                curvature[k] += scale * applied[k] * direction[k];
                length[k] += scale * direction[k] * direction[k];
            }
        }
        *self.sums = [curvature, length];
    }
}

/// The inner loop of [`Search::step`] for some rows.
struct Step<'a> {
    step: Four,
    scale: &'a [f64],
    direction: &'a [Four],
    applied: &'a [Four],
    moved: &'a mut [Four],
    residual: &'a mut [Four],
    energy: &'a mut Four,
}

impl Kernel for Step<'_> {
    #[inline(always)]
    fn run(self) {
        let mut energy = [0.0; 4];
        let to = self.moved.iter_mut().zip(self.residual);
        let by = self.direction.iter().zip(self.applied).zip(self.scale);
        for ((moved, residual), ((direction, applied), &scale)) in to.zip(by) {
            for k in 0..4 {
                moved[k] += direction[k] * self.step[k];
                residual[k] -= applied[k] * self.step[k];
                energy[k] += scale * residual[k] * residual[k];
            }
        }
        *self.energy = energy;
    }
}
