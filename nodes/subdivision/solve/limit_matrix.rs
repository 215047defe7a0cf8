//! The interpolation equations `A P = S` for control points `P` whose limits are the points `S`, and their solution.
//!
//! Row `i` of `A` is the limit mask of vertex `i`. The masks of corners refer only to corners, and the masks of vertices on a border or
//! crease only to vertices of the same curve. So `A` is solved block by block: first corners, then curves, then smooth vertices. Within a
//! block there is a diagonal matrix `D` that makes `D A` symmetric, and positive definite if the solution is unique; conjugate gradients
//! require both. With the preconditioner `D` the residual is the distance `S - A P` itself.
//!
//! The method of conjugate gradients: Hestenes and Stiefel, "Methods of conjugate gradients for solving linear systems" (1952).

use std::borrow::Cow;

use maquette_base::linear::cholesky::Cholesky;
use maquette_base::linear::columns::{self, Column};
use maquette_base::linear::residuals::Residuals;
use maquette_base::linear::stencils::Stencils;
use maquette_node::{CancelledError, Limit, Progress};
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::conjugate_gradients::Search;
use super::extent::absolute_tolerance;
use super::interpolation::{Interpolation, Solver};
use super::least_squares::least_squares;
use super::record::Record;
use super::solution::{End, Outcome, Solution};

/// Number of steps after which the residual is computed anew from the equations, because updating it from step to step accumulates rounding
/// errors.
const RESTART: u32 = 50;

/// Directions that the matrix multiplies by less than this factor belong to its null space. If the matrix has such directions, a part of
/// the residual is outside of the range of the matrix, and the iteration would amplify this part.
const VANISHING: f64 = 1e-8;

/// The maximum number of products of two entries of one row when the normal equations are formed. This many products take some seconds, and
/// some GB if each contributes to a different entry. A face with a thousand corners has a million products for each corner.
pub(crate) const PRODUCTS: Limit = Limit {
    max: 1 << 30,
    items: "products",
    help: "take `solver: Pcg`, or divide faces with many corners",
};

/// The limit masks of all vertices, grouped in blocks that are solved one after another.
pub(crate) struct LimitMatrix {
    pub(crate) rows: Stencils,
    /// The vertices of each block, ascending. The rows of a block refer only to vertices of this block and of earlier blocks. Vertices that
    /// are in no block do not move.
    pub(crate) blocks: Vec<Vec<u32>>,
    /// The factors that make each block symmetric, one per row; `None` if there are no such factors.
    pub(crate) scale: Option<Vec<f64>>,
}

impl LimitMatrix {
    /// Computes the control points whose limits are `points`, by the solver in `options`. Returns `None` if the direct solver finds a
    /// singular matrix.
    ///
    /// # Errors
    /// If the evaluation is cancelled.
    pub(crate) fn solve(
        &self,
        points: &[Point3<f64>],
        options: &Interpolation,
        progress: &Progress<'_>,
    ) -> Result<Option<Solution>, CancelledError> {
        match (options.solver, &self.scale) {
            (Solver::Direct, _) => Ok(self.direct(points, options)),
            (_, Some(_)) => self.conjugate_gradients(points, options, progress).map(Some),
            (_, None) => {
                let mut fixed = vec![true; points.len()];
                self.blocks.iter().flatten().for_each(|&vertex| fixed[vertex as usize] = false);
                least_squares(&self.rows, points, points, &fixed, options, progress).map(Some)
            }
        }
    }

    /// Solves each block by a factorization. Returns `None` if a block is singular.
    fn direct(&self, points: &[Point3<f64>], options: &Interpolation) -> Option<Solution> {
        let mut control = points.to_vec();
        let mut record = Record::new(options.norm, absolute_tolerance(options.tolerance, points));
        record.record(self.block_residuals(&self.blocks, points, &control).distances());
        for members in &self.blocks {
            let block = Block::new(self, members, points, &control);
            let scale = self.scale_of(members);
            let solution = block.solve_directly(scale.as_deref())?;
            for (&vertex, position) in members.iter().zip(solution) {
                control[vertex as usize] = position.into();
            }
        }
        let settled =
            record.record(self.block_residuals(&self.blocks, points, &control).distances());
        let outcome = Outcome { control, trace: record.into_trace(), end: End::new(settled) };
        Some(Solution { outcome, unreachable: false })
    }

    /// Solves by conjugate gradients, for three coordinates in parallel.
    fn conjugate_gradients(
        &self,
        points: &[Point3<f64>],
        options: &Interpolation,
        progress: &Progress<'_>,
    ) -> Result<Solution, CancelledError> {
        let mut control = points.to_vec();
        let mut record = Record::new(options.norm, absolute_tolerance(options.tolerance, points));
        record.record(self.block_residuals(&self.blocks, points, &control).distances());
        let mut unreachable = false;
        let mut left = options.iterations;
        let mut last = None;
        for (index, members) in self.blocks.iter().enumerate() {
            let [before, after] = [&self.blocks[..index], &self.blocks[index + 1..]]
                .map(|blocks| self.block_residuals(blocks, points, &control));
            let mut block = Block::new(self, members, points, &control);
            let scale = self.scale_of(members).unwrap_or_default();
            let others = before.merge(after);
            let (stuck, missed) =
                block.iterate(&scale, &mut record, others, &mut left, progress)?;
            unreachable |= stuck;
            last = Some(missed);
            for (&vertex, position) in members.iter().zip(&block.unknown) {
                control[vertex as usize] = (*position).into();
            }
        }
        // The distances of the recurrence differ from the exact distances by rounding errors.
        let missed = last.filter(|_| self.blocks.len() == 1);
        let missed = missed.unwrap_or_else(|| self.block_residuals(&self.blocks, points, &control));
        let settled = record.replace_last(missed.distances());
        let outcome = Outcome { control, trace: record.into_trace(), end: End::new(settled) };
        Ok(Solution { outcome, unreachable: unreachable && !settled })
    }

    /// Returns the symmetry factors of the rows `members`.
    fn scale_of(&self, members: &[u32]) -> Option<Vec<f64>> {
        let scale = self.scale.as_ref()?;
        Some(members.iter().map(|&vertex| scale[vertex as usize]).collect())
    }

    /// Returns the distances at the vertices of some blocks.
    fn block_residuals(
        &self,
        blocks: &[Vec<u32>],
        points: &[Point3<f64>],
        control: &[Point3<f64>],
    ) -> Residuals {
        let missed = blocks.iter().map(|block| {
            let parts = block.par_chunks(columns::CHUNK).map(|chunk| {
                chunk
                    .iter()
                    .map(|&vertex| {
                        let vertex = vertex as usize;
                        (points[vertex] - self.rows.apply_row(vertex, control)).norm_squared()
                    })
                    .fold(Residuals::empty(), Residuals::with_distance_sq)
            });
            parts.collect::<Vec<_>>().into_iter().fold(Residuals::empty(), Residuals::merge)
        });
        missed.fold(Residuals::empty(), Residuals::merge)
    }
}

/// The equations of one block.
struct Block<'a> {
    rows: Cow<'a, Stencils>,
    /// The right side of the equations: the points minus the contribution of the vertices in earlier blocks.
    right: Vec<Column>,
    unknown: Vec<Column>,
}

impl<'a> Block<'a> {
    fn new(
        matrix: &'a LimitMatrix,
        members: &[u32],
        points: &[Point3<f64>],
        control: &[Point3<f64>],
    ) -> Self {
        let unknown = members.iter().map(|&vertex| points[vertex as usize].coords.into()).collect();
        if members.len() == points.len() {
            let right = points.iter().map(|point| point.coords.into()).collect();
            return Self { rows: Cow::Borrowed(&matrix.rows), right, unknown };
        }
        const OUTSIDE: u32 = u32::MAX;
        let mut index_in_block = vec![OUTSIDE; points.len()];
        (0..).zip(members).for_each(|(own, &vertex)| index_in_block[vertex as usize] = own);
        let (rows, _) = Stencils::build(members.len(), |_: &mut (), own, rows| {
            let (indices, weights) = matrix.rows.row(members[own] as usize);
            for (&vertex, &weight) in indices.iter().zip(weights) {
                if index_in_block[vertex as usize] != OUTSIDE {
                    rows.push(index_in_block[vertex as usize], weight);
                }
            }
            rows.end();
        });
        let right = members.iter().map(|&vertex| {
            let (indices, weights) = matrix.rows.row(vertex as usize);
            let outside = indices
                .iter()
                .zip(weights)
                .filter(|(k, _)| index_in_block[**k as usize] == OUTSIDE);
            let known = outside.map(|(&k, &weight)| control[k as usize].coords * weight);
            (points[vertex as usize].coords - known.sum::<Vector3<f64>>()).into()
        });
        Self { right: right.collect(), rows: Cow::Owned(rows), unknown }
    }

    /// Iterates until `record` accepts the block's distances. In each iteration `record` gets these distances, combined with the distances
    /// `others` of the other blocks. Returns true if the iteration ended because the residual is outside of the range of the matrix, and
    /// the distances.
    fn iterate(
        &mut self,
        scale: &[f64],
        record: &mut Record,
        others: Residuals,
        left: &mut u32,
        progress: &Progress<'_>,
    ) -> Result<(bool, Residuals), CancelledError> {
        let least_scale = scale.iter().copied().fold(f64::INFINITY, f64::min);
        // A coordinate needs no further iterations if its residual is far below the tolerance.
        let done = least_scale * record.tolerance() * record.tolerance() * 1e-6;
        let mut residual = self.residual();
        let mut missed = columns::residual_lengths(&residual);
        while 0 < *left && !record.is_within_tolerance(missed.distances()) {
            let mut search = Search::new(&self.rows, scale, &residual);
            let mut energy = columns::dot(&residual, &residual, scale);
            let (mut ratio, mut reaches) = ([0.0; 3], true);
            for _ in 0..RESTART.min(*left) {
                progress.check()?;
                *left -= 1;
                let [curvature, length] = search.next_direction(ratio);
                let moves = [0, 1, 2].map(|k| energy[k] > done);
                reaches = (0..3).all(|k| !moves[k] || curvature[k] > VANISHING * length[k]);
                if !reaches {
                    break;
                }
                let step = [0, 1, 2].map(|k| if moves[k] { energy[k] / curvature[k] } else { 0.0 });
                let (near, after) = search.step(step);
                record.record(others.merge(near).distances());
                if record.is_within_tolerance(near.distances()) {
                    break;
                }
                ratio = [0, 1, 2].map(|k| if moves[k] { after[k] / energy[k] } else { 0.0 });
                energy = after;
            }
            search.add_to(&mut self.unknown);
            residual = self.residual();
            missed = columns::residual_lengths(&residual);
            if !reaches {
                return Ok((true, missed));
            }
        }
        Ok((false, missed))
    }

    /// Solves by a factorization of `D A`, where `scale` is the diagonal of `D`; without `scale` by a factorization of the normal equations
    /// `A^T A x = A^T s`. Returns `None` if the matrix is singular.
    fn solve_directly(&self, scale: Option<&[f64]>) -> Option<Vec<Column>> {
        let transposed = scale.is_none().then(|| self.rows.transpose(self.unknown.len()));
        let factors = Cholesky::new(&match scale {
            Some(scale) => self.rows.scale_rows(scale),
            None => self.rows.normal_matrix(self.unknown.len()),
        })?;
        let solve = |right: &[Column]| {
            let mut x = match &transposed {
                Some(transposed) => transposed.apply(right),
                None => {
                    let rows = right.iter().zip(scale.unwrap_or_default());
                    rows.map(|(right, scale)| right.map(|right| right * scale)).collect()
                }
            };
            factors.solve(&mut x);
            x
        };
        let mut x = solve(&self.right);
        // One step of iterative refinement recovers the digits that a high condition number costs.
        let mut residual = self.right.clone();
        columns::add(&mut residual, &self.rows.apply(&x), [-1.0; 3]);
        columns::add(&mut x, &solve(&residual), [1.0; 3]);
        Some(x)
    }

    fn residual(&self) -> Vec<Column> {
        (0..self.right.len())
            .into_par_iter()
            .with_min_len(columns::CHUNK)
            .map(|row: usize| {
                let limit = self.rows.apply_row(row, &self.unknown);
                [0, 1, 2].map(|k| self.right[row][k] - limit[k])
            })
            .collect()
    }
}
