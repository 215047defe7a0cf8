//! The least-squares equations of the control points.

use maquette_base::linear::cholesky::Cholesky;
use maquette_base::linear::columns::{self, Column};
use maquette_base::linear::stencils::Stencils;
use maquette_node::{CancelledError, Progress};
use nalgebra::Point3;

use super::feet::Feet;
use crate::limit::composed::ComposedLimit;

/// The overdetermined equations of the control points `P`. The first rows `A P = X` move the foot points `A P` to the given points `X`; the
/// other rows `weight^(1/2) L P = weight^(1/2) T` with the Laplacian `L` make the surface smooth. The targets `T` are 0, or the tangential
/// parts of the start's Laplacian vectors.
pub(super) struct System {
    rows: Stencils,
    transposed: Stencils,
    right: Vec<Column>,
}

/// The iterative solution ends when the residual is at most this fraction of the initial residual. The remaining error is far below the
/// change that the next search for nearest points causes.
const PRECISION: f64 = 1e-6;

/// The maximum number of steps of the iterative solution.
const MAX_STEPS: usize = 500;

impl System {
    pub(super) fn new(
        surface: &ComposedLimit,
        feet: &Feet,
        stiffness: &Stencils,
        targets: &[Column],
        weight: f64,
    ) -> Self {
        let rows = feet.rows.times(&surface.rows).stack(stiffness, weight.sqrt());
        let mut right = feet.points.clone();
        right.extend(targets.iter().map(|target| target.map(|part| part * weight.sqrt())));
        Self { transposed: rows.transpose(stiffness.len()), rows, right }
    }

    /// Solves for the control points: directly, or, if the equations do not determine all control points, by an iteration that finds the
    /// solution with the smallest change from `start`.
    pub(super) fn solve(
        &self,
        start: &[Point3<f64>],
        progress: &Progress<'_>,
    ) -> Result<Vec<Point3<f64>>, CancelledError> {
        progress.check()?;
        let Some(factors) = Cholesky::new(&self.rows.normal_matrix_with(&self.transposed)) else {
            return self.conjugate_gradients(start, progress);
        };
        let mut control = self.transposed.apply(&self.right);
        factors.solve(&mut control);
        Ok(control.into_iter().map(Point3::from).collect())
    }

    fn conjugate_gradients(
        &self,
        start: &[Point3<f64>],
        progress: &Progress<'_>,
    ) -> Result<Vec<Point3<f64>>, CancelledError> {
        let mut control: Vec<Column> = start.iter().map(|point| point.coords.into()).collect();
        let ones = vec![1.0; control.len()];
        let mut residual = self.transposed.apply(&self.right);
        columns::add(&mut residual, &self.apply(&control), [-1.0; 3]);
        let mut direction = residual.clone();
        let mut energy = columns::dot(&residual, &residual, &ones);
        let enough = energy.map(|energy| energy * PRECISION * PRECISION);
        for _ in 0..MAX_STEPS {
            let moves = [0, 1, 2].map(|k| energy[k] > enough[k]);
            if !moves.contains(&true) {
                break;
            }
            progress.check()?;
            let applied = self.apply(&direction);
            let curvature = columns::dot(&applied, &direction, &ones);
            let step = [0, 1, 2].map(|k| match moves[k] && curvature[k] > 0.0 {
                true => energy[k] / curvature[k],
                false => 0.0,
            });
            columns::add(&mut control, &direction, step);
            columns::add(&mut residual, &applied, step.map(|step| -step));
            let after = columns::dot(&residual, &residual, &ones);
            let ratio = [0, 1, 2].map(|k| if moves[k] { after[k] / energy[k] } else { 0.0 });
            columns::follow(&mut direction, &residual, ratio);
            energy = after;
        }
        Ok(control.into_iter().map(Point3::from).collect())
    }

    /// Multiplies the matrix of the normal equations by a vector.
    fn apply(&self, x: &[Column]) -> Vec<Column> {
        self.transposed.apply(&self.rows.apply(x))
    }
}
