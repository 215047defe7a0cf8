//! Vector operations of iterative solvers, for three right sides at a time.
//!
//! Sums are computed over fixed chunks and added in order, so results do not depend on the number of threads.

use maquette_value::parallel::*;

use super::residuals::Residuals;

/// One entry of a right side, solution or residual: three coordinates that are solved independently.
pub type Column = [f64; 3];

/// The number of entries per chunk.
pub const CHUNK: usize = 1024;

/// Adds `direction * step` to `to`, coordinate by coordinate.
pub fn add(to: &mut [Column], direction: &[Column], step: Column) {
    to.par_chunks_mut(CHUNK).zip(direction.par_chunks(CHUNK)).for_each(|(to, direction)| {
        for (to, direction) in to.iter_mut().zip(direction) {
            (0..3).for_each(|k| to[k] += direction[k] * step[k]);
        }
    });
}

/// Sets `direction` to `direction * ratio + residual`, coordinate by coordinate. In the conjugate gradient method this is the next search
/// direction.
pub fn follow(direction: &mut [Column], residual: &[Column], ratio: Column) {
    direction.par_chunks_mut(CHUNK).zip(residual.par_chunks(CHUNK)).for_each(
        |(direction, residual)| {
            for (direction, residual) in direction.iter_mut().zip(residual) {
                (0..3).for_each(|k| direction[k] = direction[k] * ratio[k] + residual[k]);
            }
        },
    );
}

/// Returns the sum over all entries of `scale * a * b`, for each coordinate.
pub fn dot(a: &[Column], b: &[Column], scale: &[f64]) -> Column {
    let parts = a.par_chunks(CHUNK).zip(b.par_chunks(CHUNK)).zip(scale.par_chunks(CHUNK)).map(
        |((a, b), scale)| {
            let mut sum = [0.0; 3];
            for ((a, b), scale) in a.iter().zip(b).zip(scale) {
                (0..3).for_each(|k| sum[k] += scale * a[k] * b[k]);
            }
            sum
        },
    );
    let parts: Vec<Column> = parts.collect();
    parts.into_iter().fold([0.0; 3], |sum, part| [0, 1, 2].map(|k| sum[k] + part[k]))
}

/// Summarizes the Euclidean lengths of the entries of `residual` by their maximum and the sum of their squares.
pub fn residual_lengths(residual: &[Column]) -> Residuals {
    let parts = residual.par_chunks(CHUNK).map(|chunk| {
        let lengths_sq = chunk.iter().map(|[x, y, z]| x * x + y * y + z * z);
        lengths_sq.fold(Residuals::empty(), Residuals::with_distance_sq)
    });
    let parts: Vec<Residuals> = parts.collect();
    parts.into_iter().fold(Residuals::empty(), Residuals::merge)
}
