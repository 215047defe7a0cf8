//! The distances of an iteration.

use maquette_value::{Trace, TraceStep};

use super::interpolation::Norm;

/// The distances of an iteration, and whether they are small enough.
pub(crate) struct Record {
    norm: Norm,
    tolerance: f64,
    steps: Vec<TraceStep>,
}

impl Record {
    /// Nothing yet; `tolerance` in mm.
    pub(crate) fn new(norm: Norm, tolerance: f64) -> Self {
        Self { norm, tolerance, steps: Vec::new() }
    }

    /// The distance that is small enough, in mm.
    pub(crate) fn tolerance(&self) -> f64 {
        self.tolerance
    }

    /// The one of these distances that counts.
    pub(crate) fn distance(&self, [max, rms]: [f64; 2]) -> f64 {
        match self.norm {
            Norm::Max => max,
            Norm::Mean => rms,
        }
    }

    /// The distance at the beginning.
    pub(crate) fn first(&self) -> f64 {
        self.steps.first().map_or(0.0, |step| self.distance([step.max, step.rms]))
    }

    /// Without what was noted after an iteration.
    pub(crate) fn until(mut self, iteration: u32) -> Self {
        self.steps.truncate(iteration as usize + 1);
        self
    }

    /// Whether these distances are small enough.
    pub(crate) fn allows(&self, distances: [f64; 2]) -> bool {
        self.distance(distances) <= self.tolerance
    }

    /// Notes the distances after the next iteration, the first time before all; whether they are small enough.
    pub(crate) fn note(&mut self, [max, rms]: [f64; 2]) -> bool {
        self.steps.push(TraceStep { iteration: self.steps.len() as u64, max, rms });
        self.allows([max, rms])
    }

    /// Puts these distances in place of the last ones; whether they are small enough.
    pub(crate) fn correct(&mut self, distances: [f64; 2]) -> bool {
        self.steps.pop();
        self.note(distances)
    }

    /// Whether the last ten iterations took next to nothing away: the rest is what no control points reach.
    pub(crate) fn stalls(&self) -> bool {
        let Some(last) = self.steps.len().checked_sub(1).filter(|&last| last >= STALL) else {
            return false;
        };
        let [before, now] = [last - STALL, last].map(|step| self.steps[step]);
        now.rms > 0.999 * before.rms
    }

    pub(crate) fn into_trace(self) -> Trace {
        // Distances that overflowed are no numbers; the trace ends before them.
        let sound = self.steps.into_iter().take_while(|step| step.max >= 0.0 && step.rms >= 0.0);
        Trace::new(sound.collect()).expect("iterations are counted up and distances not negative")
    }
}

/// So many iterations tell whether next to nothing is taken away any more.
pub(crate) const STALL: usize = 10;
