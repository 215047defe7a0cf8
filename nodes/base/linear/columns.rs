//! Long lists of three numbers, as iterative solvers add and multiply them.
//!
//! Sums are taken of fixed chunks and added in their order, so that they are the same for any number of threads.

use maquette_value::parallel::*;

use super::missed::Missed;

/// A right side, an unknown or a residual: three coordinates, solved side by side.
pub type Column = [f64; 3];

/// Entries of a chunk.
pub const CHUNK: usize = 1024;

/// `to + direction * step`, coordinate by coordinate.
pub fn add(to: &mut [Column], direction: &[Column], step: Column) {
    to.par_chunks_mut(CHUNK).zip(direction.par_chunks(CHUNK)).for_each(|(to, direction)| {
        for (to, direction) in to.iter_mut().zip(direction) {
            (0..3).for_each(|k| to[k] += direction[k] * step[k]);
        }
    });
}

/// `direction * ratio + residual`, coordinate by coordinate: the next direction of conjugate gradients.
pub fn follow(direction: &mut [Column], residual: &[Column], ratio: Column) {
    direction.par_chunks_mut(CHUNK).zip(residual.par_chunks(CHUNK)).for_each(
        |(direction, residual)| {
            for (direction, residual) in direction.iter_mut().zip(residual) {
                (0..3).for_each(|k| direction[k] = direction[k] * ratio[k] + residual[k]);
            }
        },
    );
}

/// The sums of `scale a b`, coordinate by coordinate; without `scale` it is 1.
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

/// How long the entries are as vectors.
pub fn missed(residual: &[Column]) -> Missed {
    let parts = residual.par_chunks(CHUNK).map(|chunk| {
        let lengths_sq = chunk.iter().map(|[x, y, z]| x * x + y * y + z * z);
        lengths_sq.fold(Missed::none(), Missed::and_by)
    });
    let parts: Vec<Missed> = parts.collect();
    parts.into_iter().fold(Missed::none(), Missed::and)
}
