//! What interpolation gives: control points, and how they were found.

use maquette::Context;
use maquette::value::Trace;
use nalgebra::Point3;

/// The control points that were found, and how.
#[derive(Clone, Debug)]
pub(crate) struct Found {
    pub(crate) control: Vec<Point3<f64>>,
    pub(crate) trace: Trace,
    pub(crate) end: End,
}

/// How looking for control points ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum End {
    /// The distances are within the tolerance.
    Settled,
    /// They are not yet, or cannot be.
    Short,
    /// They grew, and were never small, or control points went too far.
    RanAway(RanAway),
}

impl End {
    /// That of distances which are within the tolerance, or are not.
    pub(crate) fn new(settled: bool) -> Self {
        if settled { Self::Settled } else { Self::Short }
    }
}

/// An iteration that leads away from the points.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "the iteration runs away: at its best, after {iteration} iterations, it misses a point by {missed:.3e} mm or has control points farther \
     away than the points from each other; take more iterations, or `foot: Vertex` with `direction: Residual`"
)]
pub struct RanAway {
    /// The iteration that came nearest.
    pub iteration: u32,
    /// The distance then, in mm.
    pub missed: f64,
}

/// Control points, and whether the limits of any are nearer to the given points.
pub(crate) struct Solution {
    pub(crate) found: Found,
    /// Whether what is left of the distances is beyond the reach of the matrix.
    pub(crate) unreachable: bool,
}

/// What passes through points: the control points of a mesh, a curve or a surface, and how they were found.
#[derive(Clone, Debug, PartialEq)]
pub struct Interpolated<T> {
    /// The mesh, curve or surface.
    pub shape: T,
    /// The distances before each iteration and at the end, in mm.
    pub trace: Trace,
    /// Whether the distances are within the tolerance.
    pub settled: bool,
}

impl Found {
    /// What `shape` makes of the control points.
    ///
    /// # Errors
    /// If the iteration ran away, and those of `shape`.
    pub(crate) fn shaped<T, E: From<RanAway>>(
        self,
        shape: impl FnOnce(Vec<Point3<f64>>) -> Result<T, E>,
    ) -> Result<Interpolated<T>, E> {
        if let End::RanAway(error) = self.end {
            return Err(error.into());
        }
        let settled = self.end == End::Settled;
        Ok(Interpolated { shape: shape(self.control)?, trace: self.trace, settled })
    }
}

impl<T> Interpolated<T> {
    /// The outputs of a node, which warns if its curve or surface is too far from the points.
    pub(crate) fn outputs(self, cx: &Context<'_>, what: &str) -> (T, Trace) {
        if !self.settled {
            let last = self.trace.steps().last();
            let (iterations, missed) = last.map_or((0, 0.0), |step| (step.iteration, step.max));
            cx.warn(format!(
                "the {what} is not within the tolerance after {iterations} iterations: it misses a point by {missed:.3e} mm"
            ));
        }
        (self.shape, self.trace)
    }
}
