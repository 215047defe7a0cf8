//! The equations `A P = S` of control points whose limit passes through given points, and their solution.
//!
//! Row `i` of `A` is the limit mask of vertex `i`. The masks of corners reach corners alone, those of borders and creases no
//! vertex beside them, so that `A` is solved block by block: corners, then curves, then smooth vertices. Within a block a
//! diagonal matrix `D` makes `D A` symmetric, and positive definite where there is one solution. That is what conjugate gradients
//! need; with the preconditioner `D` their residual is the distance `S - A P` itself.
//!
//! Hestenes and Stiefel, "Methods of conjugate gradients for solving linear systems" (1952).

use std::borrow::Cow;

use maquette_base::linear::cholesky::Cholesky;
use maquette_base::linear::columns::{self, Column};
use maquette_base::linear::missed::Missed;
use maquette_base::linear::stencils::Stencils;
use maquette_node::{Cancelled, Limit, Progress};
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::conjugate_gradients::Search;
use super::extent::diagonal;
use super::interpolation::{Interpolation, Solver};
use super::least_squares::least_squares;
use super::record::Record;
use super::solution::{End, Found, Solution};

/// After so many steps the residual is computed anew: the one of the recurrence drifts away from it by rounding.
const RESTART: u32 = 50;

/// Directions that the matrix shrinks more than this are those that it takes to zero: the residual has a part that it does not reach,
/// which the iteration would blow up.
const VANISHING: f64 = 1e-8;

/// Products of two entries of one row, of which the normal equations are made: some seconds and, where no two are added, some GB. Faces
/// with a thousand corners have a million for each corner.
pub(crate) const PRODUCTS: Limit = Limit {
    most: 1 << 30,
    of: "products",
    help: "take `solver: Pcg`, or divide faces with many corners",
};

/// The limit masks of all vertices, in blocks.
pub(crate) struct LimitMatrix {
    pub(crate) rows: Stencils,
    /// The vertices of each block, ascending; a row reaches vertices of its own block and of earlier ones. Vertices of no block
    /// stay where they are.
    pub(crate) blocks: Vec<Vec<u32>>,
    /// The factor of each row that makes its block symmetric; none if nothing does.
    pub(crate) scale: Option<Vec<f64>>,
}

impl LimitMatrix {
    /// The control points whose limits are `points`, by the solver that `how` names; none if it needs the only solution and there
    /// is not one.
    ///
    /// # Errors
    /// If the evaluation is told to stop.
    pub(crate) fn solve(
        &self,
        points: &[Point3<f64>],
        how: &Interpolation,
        progress: &Progress<'_>,
    ) -> Result<Option<Solution>, Cancelled> {
        match (how.solver, &self.scale) {
            (Solver::Direct, _) => Ok(self.direct(points, how)),
            (_, Some(_)) => self.conjugate_gradients(points, how, progress).map(Some),
            (_, None) => {
                let mut fixed = vec![true; points.len()];
                self.blocks.iter().flatten().for_each(|&vertex| fixed[vertex as usize] = false);
                least_squares(&self.rows, points, points, &fixed, how, progress).map(Some)
            }
        }
    }

    /// By factors of each block's equations; none if a block has no one solution.
    fn direct(&self, points: &[Point3<f64>], how: &Interpolation) -> Option<Solution> {
        let mut control = points.to_vec();
        let mut record = Record::new(how.norm, how.tolerance * diagonal(points));
        record.note(self.missed(&self.blocks, points, &control).distances());
        for members in &self.blocks {
            let block = Block::new(self, members, points, &control);
            let scale = self.scale_of(members);
            let solution = block.factored(scale.as_deref())?;
            for (&vertex, place) in members.iter().zip(solution) {
                control[vertex as usize] = place.into();
            }
        }
        let settled = record.note(self.missed(&self.blocks, points, &control).distances());
        let found = Found { control, trace: record.into_trace(), end: End::new(settled) };
        Some(Solution { found, unreachable: false })
    }

    /// By conjugate gradients; the three coordinates are solved side by side.
    fn conjugate_gradients(
        &self,
        points: &[Point3<f64>],
        how: &Interpolation,
        progress: &Progress<'_>,
    ) -> Result<Solution, Cancelled> {
        let mut control = points.to_vec();
        let mut record = Record::new(how.norm, how.tolerance * diagonal(points));
        record.note(self.missed(&self.blocks, points, &control).distances());
        let mut unreachable = false;
        let mut left = how.iterations;
        let mut last = None;
        for (index, members) in self.blocks.iter().enumerate() {
            let [before, after] = [&self.blocks[..index], &self.blocks[index + 1..]]
                .map(|blocks| self.missed(blocks, points, &control));
            let mut block = Block::new(self, members, points, &control);
            let scale = self.scale_of(members).unwrap_or_default();
            let others = before.and(after);
            let (stuck, missed) =
                block.iterate(&scale, &mut record, others, &mut left, progress)?;
            unreachable |= stuck;
            last = Some(missed);
            for (&vertex, place) in members.iter().zip(&block.unknown) {
                control[vertex as usize] = (*place).into();
            }
        }
        // What the recurrence says differs from the distances by rounding.
        let missed = last.filter(|_| self.blocks.len() == 1);
        let missed = missed.unwrap_or_else(|| self.missed(&self.blocks, points, &control));
        let settled = record.correct(missed.distances());
        let found = Found { control, trace: record.into_trace(), end: End::new(settled) };
        Ok(Solution { found, unreachable: unreachable && !settled })
    }

    /// The factors of some rows.
    fn scale_of(&self, members: &[u32]) -> Option<Vec<f64>> {
        let scale = self.scale.as_ref()?;
        Some(members.iter().map(|&vertex| scale[vertex as usize]).collect())
    }

    /// The distances of the vertices of some blocks.
    fn missed(
        &self,
        blocks: &[Vec<u32>],
        points: &[Point3<f64>],
        control: &[Point3<f64>],
    ) -> Missed {
        let missed = blocks.iter().map(|block| {
            let parts = block.par_chunks(columns::CHUNK).map(|chunk| {
                chunk
                    .iter()
                    .map(|&vertex| {
                        let vertex = vertex as usize;
                        (points[vertex] - self.rows.apply_row(vertex, control)).norm_squared()
                    })
                    .fold(Missed::none(), Missed::and_by)
            });
            parts.collect::<Vec<_>>().into_iter().fold(Missed::none(), Missed::and)
        });
        missed.fold(Missed::none(), Missed::and)
    }
}

/// The equations of one block.
struct Block<'a> {
    rows: Cow<'a, Stencils>,
    /// What the rows are to give: the points, without what earlier blocks add.
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
        let mut place = vec![OUTSIDE; points.len()];
        (0..).zip(members).for_each(|(own, &vertex)| place[vertex as usize] = own);
        let (rows, _) = Stencils::build(members.len(), |_: &mut (), own, rows| {
            let (indices, weights) = matrix.rows.row(members[own] as usize);
            for (&vertex, &weight) in indices.iter().zip(weights) {
                if place[vertex as usize] != OUTSIDE {
                    rows.push(place[vertex as usize], weight);
                }
            }
            rows.end();
        });
        let right = members.iter().map(|&vertex| {
            let (indices, weights) = matrix.rows.row(vertex as usize);
            let outside =
                indices.iter().zip(weights).filter(|(k, _)| place[**k as usize] == OUTSIDE);
            let known = outside.map(|(&k, &weight)| control[k as usize].coords * weight);
            (points[vertex as usize].coords - known.sum::<Vector3<f64>>()).into()
        });
        Self { right: right.collect(), rows: Cow::Owned(rows), unknown }
    }

    /// Iterates until `record` is content with the block's distances, and notes them with the `others`; whether it ended because
    /// what is left is beyond the reach of the matrix, and the distances.
    fn iterate(
        &mut self,
        scale: &[f64],
        record: &mut Record,
        others: Missed,
        left: &mut u32,
        progress: &Progress<'_>,
    ) -> Result<(bool, Missed), Cancelled> {
        let least_scale = scale.iter().copied().fold(f64::INFINITY, f64::min);
        // A coordinate that is far below the tolerance is done: what is left of it is rounding.
        let done = least_scale * record.tolerance() * record.tolerance() * 1e-6;
        let mut residual = self.residual();
        let mut missed = columns::missed(&residual);
        while 0 < *left && !record.allows(missed.distances()) {
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
                record.note(others.and(near).distances());
                if record.allows(near.distances()) {
                    break;
                }
                ratio = [0, 1, 2].map(|k| if moves[k] { after[k] / energy[k] } else { 0.0 });
                energy = after;
            }
            search.add_to(&mut self.unknown);
            residual = self.residual();
            missed = columns::missed(&residual);
            if !reaches {
                return Ok((true, missed));
            }
        }
        Ok((false, missed))
    }

    /// The solution by factors: of `D A`, or where no `scale` makes that symmetric of the normal equations `A^T A x = A^T s`; none
    /// if there is not one.
    fn factored(&self, scale: Option<&[f64]>) -> Option<Vec<Column>> {
        let transposed = scale.is_none().then(|| self.rows.transposed(self.unknown.len()));
        let factors = Cholesky::new(&match scale {
            Some(scale) => self.rows.scaled(scale),
            None => self.rows.squared(self.unknown.len()),
        })?;
        fn solve(
            right: &[Column],
            scale: &Option<&[f64]>,
            transposed: &Option<Stencils>,
            factors: &Cholesky,
        ) -> Vec<[f64; 3]> {
            let mut x = match (*scale, transposed) {
                (_, Some(transposed)) => transposed.apply(right),
                (scale, None) => {
                    let rows = right.iter().zip(scale.unwrap_or_default());
                    rows.map(|(right, scale)| right.map(|right| right * scale)).collect()
                }
            };
            factors.solve(&mut x);
            x
        }
        let mut x = solve(&self.right, &scale, &transposed, &factors);
        // One step of refinement gives back the digits that the condition took.
        let mut residual = self.right.clone();
        columns::add(&mut residual, &self.rows.apply(&x), [-1.0; 3]);
        columns::add(&mut x, &solve(&residual, &scale, &transposed, &factors), [1.0; 3]);
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
