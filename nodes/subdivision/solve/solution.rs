//! The results of interpolation.

use std::fmt::Display;

use maquette_node::{Context, Error, bail};
use maquette_value::Trace;
use nalgebra::Point3;

use super::extent::{Stray, relative_reach};

/// The computed control points, with the trace of the iteration.
#[derive(Clone, Debug)]
pub(crate) struct Outcome {
    pub(crate) control: Vec<Point3<f64>>,
    pub(crate) trace: Trace,
    pub(crate) end: End,
}

/// The reason why an iteration ended.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum End {
    /// The distances are within the tolerance.
    Settled,
    /// The distances are still greater than the tolerance.
    Short,
    /// The distances grew and were never small, or the curve or surface left the neighborhood of the points. Holds the message.
    Diverged(String),
}

impl End {
    /// Returns `Settled` if `settled` is true, else `Short`.
    pub(crate) fn new(settled: bool) -> Self {
        if settled { Self::Settled } else { Self::Short }
    }

    /// Returns [`End::Diverged`] for an iteration whose distances do not decrease. `iteration` is the number of the best iteration, and
    /// `missed` the largest distance after that iteration, in mm.
    pub(crate) fn missed(iteration: u32, missed: f64) -> Self {
        Self::Diverged(format!(
            "the iteration diverged: at its best, after {iteration} iterations, the largest distance from a point is {missed:.3e} mm; \
             increase `iterations`, or use `foot: Vertex` with `direction: Residual`"
        ))
    }

    /// Returns [`End::Diverged`] for a curve or surface that was too far from its points after `iteration` iterations.
    pub(crate) fn strayed(iteration: u32, Stray { distance, diagonal }: Stray) -> Self {
        Self::Diverged(format!(
            "the iteration diverged: after {iteration} iterations the result is {distance:.3e} mm away from the points, whose bounding box \
             has a diagonal of {diagonal:.3e} mm; increase `iterations`, or use `foot: Vertex` with `direction: Residual`"
        ))
    }
}

/// The result of a solver for control points.
pub(crate) struct Solution {
    pub(crate) outcome: Outcome,
    /// True if no control points can reduce the remaining distances.
    pub(crate) unreachable: bool,
}

/// The result of an interpolation: a control mesh, a curve or a surface, with the trace of the iteration.
#[derive(Clone, Debug, PartialEq)]
pub struct InterpolationResult<T> {
    /// The mesh, curve or surface.
    pub shape: T,
    /// The distances before each iteration and at the end, in mm.
    pub trace: Trace,
    /// True if the distances are within the tolerance.
    pub settled: bool,
    /// The largest distance of a control point from the bounding box of the given points, relative to the diagonal of the box.
    pub reach: f64,
}

/// Control points beyond this multiple of the diagonal from the box of the given points cause a warning.
const MAX_REACH: f64 = 3.0;

impl Outcome {
    /// Converts the control points, whose curve or surface passes through `points`, to a mesh, curve or surface by `shape`.
    ///
    /// # Errors
    /// If the iteration diverged, or `shape` fails because a control point became infinite.
    pub(crate) fn try_map<T, E: Display>(
        self,
        points: &[Point3<f64>],
        shape: impl FnOnce(Vec<Point3<f64>>) -> Result<T, E>,
    ) -> Result<InterpolationResult<T>, Error> {
        let settled = match self.end {
            End::Diverged(message) => return Err(Error::new(message)),
            end => end == End::Settled,
        };
        let reach = relative_reach(&self.control, points);
        match shape(self.control) {
            Ok(shape) => Ok(InterpolationResult { shape, trace: self.trace, settled, reach }),
            Err(error) => bail!("the iteration diverged: {error}"),
        }
    }
}

impl<T> InterpolationResult<T> {
    /// Returns the outputs of a node. Warns if the curve or surface is too far from the points, or its control points are; `what` names the
    /// curve or surface in the warning.
    pub(crate) fn outputs(self, cx: &Context<'_>, what: &str) -> (T, Trace) {
        if !self.settled {
            let last = self.trace.steps().last();
            let (iterations, missed) = last.map_or((0, 0.0), |step| (step.iteration, step.max));
            cx.warn(format!(
                "the {what} is not within the tolerance after {iterations} iterations: the largest distance from a point is {missed:.3e} mm"
            ));
        }
        if self.reach > MAX_REACH {
            cx.warn(format!(
                "the control points of the {what} are up to {:.1} diagonals outside of the bounding box of the points: check that the {what} does not \
                 swing too far between points, and add points where neighbors alternate between high and low",
                self.reach
            ));
        }
        (self.shape, self.trace)
    }
}
