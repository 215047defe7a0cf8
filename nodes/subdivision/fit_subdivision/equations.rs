//! The equations of control points whose surface is near to points.

use maquette_base::linear::cholesky::Cholesky;
use maquette_base::linear::columns::{self, Column};
use maquette_base::linear::stencils::Stencils;
use maquette_node::{Cancelled, Progress};
use nalgebra::Point3;

use super::feet::Feet;
use crate::limit::composed::Composed;

/// The equations `A P = X` of the feet of points and `weight^(1/2) L P = 0` below them, which least squares meet as nearly as possible.
pub(super) struct System {
    rows: Stencils,
    transposed: Stencils,
    right: Vec<Column>,
}

/// The residual that is left of the one at the start where the equations are solved step by step: far below what the next nearest
/// places change.
const PRECISION: f64 = 1e-6;

/// Most steps.
const MOST_STEPS: usize = 500;

impl System {
    pub(super) fn new(surface: &Composed, feet: &Feet, stiffness: &Stencils, weight: f64) -> Self {
        let rows = feet.rows.times(&surface.rows).above(stiffness, weight.sqrt());
        let mut right = feet.points.clone();
        right.resize(rows.len(), [0.0; 3]);
        Self { transposed: rows.transposed(stiffness.len()), rows, right }
    }

    /// The control points: by factors, or where these do not determine them all, with the least change from those that are known.
    pub(super) fn solve(
        &self,
        start: &[Point3<f64>],
        progress: &Progress<'_>,
    ) -> Result<Vec<Point3<f64>>, Cancelled> {
        progress.check()?;
        let Some(factors) = Cholesky::new(&self.rows.squared_with(&self.transposed)) else {
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
    ) -> Result<Vec<Point3<f64>>, Cancelled> {
        let mut control: Vec<Column> = start.iter().map(|point| point.coords.into()).collect();
        let ones = vec![1.0; control.len()];
        let mut residual = self.transposed.apply(&self.right);
        columns::add(&mut residual, &self.apply(&control), [-1.0; 3]);
        let mut direction = residual.clone();
        let mut energy = columns::dot(&residual, &residual, &ones);
        let enough = energy.map(|energy| energy * PRECISION * PRECISION);
        for _ in 0..MOST_STEPS {
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

    /// The matrix of the normal equations times a column.
    fn apply(&self, x: &[Column]) -> Vec<Column> {
        self.transposed.apply(&self.rows.apply(x))
    }
}
