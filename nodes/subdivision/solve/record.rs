//! The record of the distances in an iteration.

use maquette_value::{Trace, TraceStep};

use super::interpolation::Norm;

/// The history of an iteration: the distances in each step, and the tolerance that they must reach.
pub(crate) struct Record {
    norm: Norm,
    tolerance: f64,
    steps: Vec<TraceStep>,
}

impl Record {
    /// Creates an empty record; `tolerance` is in mm.
    pub(crate) fn new(norm: Norm, tolerance: f64) -> Self {
        Self { norm, tolerance, steps: Vec::new() }
    }

    /// The tolerance, in mm.
    pub(crate) fn tolerance(&self) -> f64 {
        self.tolerance
    }

    /// Returns the maximum or the root mean square of the distances, depending on the chosen norm.
    pub(crate) fn distance(&self, [max, rms]: [f64; 2]) -> f64 {
        match self.norm {
            Norm::Max => max,
            Norm::Mean => rms,
        }
    }

    /// The distance before the first iteration, in the chosen norm.
    pub(crate) fn initial_distance(&self) -> f64 {
        self.steps.first().map_or(0.0, |step| self.distance([step.max, step.rms]))
    }

    /// Removes the entries of all iterations after `iteration`.
    pub(crate) fn truncate(mut self, iteration: u32) -> Self {
        self.steps.truncate(iteration as usize + 1);
        self
    }

    /// Returns true if the distances are within the tolerance.
    pub(crate) fn is_within_tolerance(&self, distances: [f64; 2]) -> bool {
        self.distance(distances) <= self.tolerance
    }

    /// Records the distances after an iteration; the first call records them before the first iteration. Returns true if the distances are
    /// within the tolerance.
    pub(crate) fn record(&mut self, [max, rms]: [f64; 2]) -> bool {
        self.steps.push(TraceStep { iteration: self.steps.len() as u64, max, rms });
        self.is_within_tolerance([max, rms])
    }

    /// Replaces the distances of the last entry. Returns true if the new distances are within the tolerance.
    pub(crate) fn replace_last(&mut self, distances: [f64; 2]) -> bool {
        self.steps.pop();
        self.record(distances)
    }

    /// Returns true if the last ten iterations made almost no progress. No control points can then remove the remaining distance.
    pub(crate) fn has_stalled(&self) -> bool {
        let Some(last) = self.steps.len().checked_sub(1).filter(|&last| last >= STALL_ITERATIONS)
        else {
            return false;
        };
        let [before, now] = [last - STALL_ITERATIONS, last].map(|step| self.steps[step]);
        now.rms > 0.999 * before.rms
    }

    pub(crate) fn into_trace(self) -> Trace {
        // Distances that have overflowed are NaN; the trace ends before the first NaN.
        let sound = self.steps.into_iter().take_while(|step| step.max >= 0.0 && step.rms >= 0.0);
        Trace::new(sound.collect()).expect("iterations are counted up and distances not negative")
    }
}

/// The number of iterations over which progress is measured.
pub(crate) const STALL_ITERATIONS: usize = 10;
