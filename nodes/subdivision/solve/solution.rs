//! What interpolation gives: control points, and how they were found.

use maquette_node::Context;
use maquette_value::Trace;
use nalgebra::Point3;

use super::extent::Stray;

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
    /// They grew and were never small, or the curve or surface left the neighborhood of the points.
    Diverged(Diverged),
}

impl End {
    /// That of distances which are within the tolerance, or are not.
    pub(crate) fn new(settled: bool) -> Self {
        if settled { Self::Settled } else { Self::Short }
    }
}

/// An iteration that leads away from the points.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Diverged {
    /// The distances do not become small.
    #[error(
        "the iteration diverged: at its best, after {iteration} iterations, it misses a point by {missed:.3e} mm; increase `iterations`, or \
         use `foot: Vertex` with `direction: Residual`"
    )]
    Missed {
        /// The iteration that came nearest.
        iteration: u32,
        /// The distance then, in mm.
        missed: f64,
    },
    /// The curve or surface leaves the neighborhood of the points.
    #[error(
        "the iteration diverged: after {iteration} iterations it leads {distance:.3e} mm away from the points, whose bounding box has a \
         diagonal of {diagonal:.3e} mm; increase `iterations`, or use `foot: Vertex` with `direction: Residual`"
    )]
    Strayed {
        /// The iteration that came nearest.
        iteration: u32,
        /// The largest distance of the curve or surface from the bounding box then, in mm.
        distance: f64,
        /// The diagonal of the bounding box, in mm.
        diagonal: f64,
    },
}

impl Diverged {
    /// The error of a curve or surface that is too far from its points after some iterations.
    pub(crate) fn strayed(iteration: u32, Stray { distance, diagonal }: Stray) -> Self {
        Self::Strayed { iteration, distance, diagonal }
    }
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
    /// If the iteration diverged, and those of `shape`.
    pub(crate) fn shaped<T, E: From<Diverged>>(
        self,
        shape: impl FnOnce(Vec<Point3<f64>>) -> Result<T, E>,
    ) -> Result<Interpolated<T>, E> {
        if let End::Diverged(error) = self.end {
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
