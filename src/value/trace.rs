//! Traces: the convergence of iterations.

use thiserror::Error;

use super::{
    DecodeError, Decoder, ElementKind, Encoder, Layer, Meaning, Parts, PartsError, Series, Summary,
    Value,
};

/// Error of building a trace. Contains the message.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct TraceError(String);

/// A step of a trace: the distances from the goal after some iterations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceStep {
    /// The number of completed iterations: 0 at the start.
    pub iteration: u64,
    /// The maximum distance from the goal. It is in mm if positions are compared.
    pub max: f64,
    /// The root mean square of the distances.
    pub rms: f64,
}

/// The convergence of an iterative computation: its distance from the goal, step by step. The last step describes the result.
///
/// Invariant, checked by [`Trace::new`]: iteration numbers increase from step to step. Distances are at least 0; they are infinite where
/// numbers overflow. A trace may be empty.
///
/// A trace of fillings of holes also has their bending energies: for each filling, the sum of A (2 H)^2 over its vertices and those of its
/// rim, where A is the area of a vertex and H its mean curvature. The energy has no unit: it is 0 for a plane and 16 pi for a whole sphere
/// of any size. Among fillings of the same hole, a lower energy is fairer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    steps: Vec<TraceStep>,
    /// Each at least 0, or infinite where numbers overflow.
    bending: Vec<f64>,
}

impl Trace {
    /// Builds a trace of the given steps.
    ///
    /// # Errors
    /// If the iteration number of a step is not greater than that of the previous step, or a distance is negative or NaN.
    pub fn new(steps: Vec<TraceStep>) -> Result<Self, TraceError> {
        if let Some(pair) = steps.windows(2).find(|pair| pair[1].iteration <= pair[0].iteration) {
            let iteration = pair[1].iteration;
            let why = format!("iteration {iteration} of the trace is not after the previous one");
            return Err(TraceError(why));
        }
        fn is_distance(x: f64) -> bool {
            x >= 0.0
        }
        match steps.iter().find(|step| !is_distance(step.max) || !is_distance(step.rms)) {
            None => Ok(Self { steps, bending: Vec::new() }),
            Some(&TraceStep { iteration, max, rms }) => {
                let why = format!(
                    "in iteration {iteration} the largest distance is {max} and the mean one {rms}"
                );
                Err(TraceError(why))
            }
        }
    }

    /// Sets the bending energies of fillings, see [`Trace`].
    ///
    /// # Errors
    /// If an energy is negative or NaN.
    pub fn with_bending(self, bending: Vec<f64>) -> Result<Self, TraceError> {
        match bending.iter().find(|energy| energy.is_nan() || **energy < 0.0) {
            None => Ok(Self { bending, ..self }),
            Some(energy) => Err(TraceError(format!("a bending energy is {energy}"))),
        }
    }

    /// Returns one number of each step, as a list.
    fn numbers(&self, number: fn(&TraceStep) -> f64) -> Vec<f64> {
        self.steps.iter().map(number).collect()
    }

    /// The steps, in order.
    pub fn steps(&self) -> &[TraceStep] {
        &self.steps
    }

    /// The bending energies of fillings, in the order of their rims; empty if the trace is not of fillings. See [`Trace`].
    pub fn bending(&self) -> &[f64] {
        &self.bending
    }
}

impl Value for Trace {
    const NAME: &'static str = "Trace";

    fn encode(&self, to: &mut Encoder) {
        to.counts(&[self.steps.len(), self.bending.len()]);
        for step in &self.steps {
            to.plain(&step.iteration).plain(&step.max).plain(&step.rms);
        }
        for energy in &self.bending {
            to.plain(energy);
        }
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let [n_steps, n_fillings] = from.counts()?;
        let steps = (0..n_steps).map(|_| {
            Ok(TraceStep { iteration: from.plain()?, max: from.plain()?, rms: from.plain()? })
        });
        let steps = steps.collect::<Result<_, _>>()?;
        let bending = (0..n_fillings).map(|_| from.plain());
        Ok(Self { steps, bending: bending.collect::<Result<_, _>>()? })
    }

    fn size(&self) -> usize {
        size_of::<Self>() + size_of_val(&*self.steps) + size_of_val(&*self.bending)
    }

    fn describe(&self) -> Summary {
        let mut summary = Summary::default().with_fact("steps", self.steps.len());
        if !self.bending.is_empty() {
            let sum: f64 = self.bending.iter().sum();
            summary = summary.with_fact("bending", format!("{sum:.3e}"));
        }
        let (Some(first), Some(last)) = (self.steps.first(), self.steps.last()) else {
            return summary;
        };
        fn distances(step: &TraceStep) -> String {
            format!("max {:.3e}, rms {:.3e}", step.max, step.rms)
        }
        summary
            .with_fact("iterations", last.iteration)
            .with_fact("first", distances(first))
            .with_fact("last", distances(last))
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.fact("steps", self.steps.len());
        parts.push(
            "iteration",
            ElementKind::Step,
            Meaning::Exact,
            1,
            self.numbers(|step| step.iteration as f64),
        );
        parts.push("max", ElementKind::Step, Meaning::Number, 1, self.numbers(|step| step.max));
        parts.push("rms", ElementKind::Step, Meaning::Number, 1, self.numbers(|step| step.rms));
        if !self.bending.is_empty() {
            parts.push("bending", ElementKind::Entry, Meaning::Number, 1, self.bending.clone());
        }
        parts
    }

    /// Builds a trace from parts. Iteration numbers are exact up to 2^53.
    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let iterations = parts.require("iteration", 1)?;
        let column = |name: &str| {
            let column = parts.require(name, 1)?.with_count(iterations.count())?;
            Ok(column.items.numbers().into_owned())
        };
        let (max, rms) = (column("max")?, column("rms")?);
        let numbers = iterations.items.numbers();
        let steps = numbers.iter().enumerate().map(|(k, &x)| {
            if !(0.0..=u64::MAX as f64).contains(&x) || x.fract() != 0.0 {
                return Err(iterations.number_error(k, x, "a count"));
            }
            Ok(TraceStep { iteration: x as u64, max: max[k], rms: rms[k] })
        });
        let bending = parts.column_of("bending", 1)?;
        let bending = bending.map(|part| part.items.numbers().into_owned()).unwrap_or_default();
        Self::new(steps.collect::<Result<_, _>>()?)
            .and_then(|trace| trace.with_bending(bending))
            .map_err(PartsError::from_error)
    }

    fn show(&self) -> Vec<Layer> {
        let at: Vec<_> = self.steps.iter().map(|step| step.iteration as f64).collect();
        vec![Layer::Plot(vec![
            Series { name: "max".into(), at: at.clone(), numbers: self.numbers(|step| step.max) },
            Series { name: "rms".into(), at, numbers: self.numbers(|step| step.rms) },
        ])]
    }

    fn edge_cases() -> Vec<Self> {
        fn step(iteration: u64, max: f64) -> TraceStep {
            TraceStep { iteration, max, rms: 0.0 }
        }
        let steps = [
            vec![],
            vec![step(u64::MAX, f64::INFINITY)],
            vec![step(0, 0.0), step(1, 1e300), step(1 << 60, 1e-300)],
        ];
        let fillings = Self::default().with_bending(vec![0.0, 1e300, f64::INFINITY]);
        steps.into_iter().map(Self::new).chain([fillings]).flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(iteration: u64, max: f64, rms: f64) -> TraceStep {
        TraceStep { iteration, max, rms }
    }

    #[test]
    fn iterations_grow_and_distances_are_not_negative() {
        assert!(Trace::new(vec![step(0, 2.0, 1.0), step(3, f64::INFINITY, 0.0)]).is_ok());
        assert_eq!(
            Trace::new(vec![step(1, 0.0, 0.0), step(1, 0.0, 0.0)]),
            Err(TraceError("iteration 1 of the trace is not after the previous one".into()))
        );
        for (max, rms) in [(-1.0, 0.0), (0.0, f64::NAN)] {
            let refused = Trace::new(vec![step(7, max, rms)]);
            let why =
                format!("in iteration 7 the largest distance is {max} and the mean one {rms}");
            assert_eq!(refused, Err(TraceError(why)));
        }
    }

    #[test]
    fn bending_energies_are_not_negative() {
        assert_eq!(Trace::default().with_bending(vec![0.0, 2.5]).unwrap().bending(), [0.0, 2.5]);
        for energy in [-1.0, f64::NAN] {
            let why = format!("a bending energy is {energy}");
            assert_eq!(Trace::default().with_bending(vec![energy]), Err(TraceError(why)));
        }
    }

    #[test]
    fn a_trace_is_described_by_its_ends() {
        assert_eq!(Trace::default().describe(), Summary::default().with_fact("steps", 0));
        let trace = Trace::new(vec![step(0, 2.0, 1.0), step(4, 0.5, 0.25)]).unwrap();
        let expected = Summary::default()
            .with_fact("steps", 2)
            .with_fact("iterations", 4)
            .with_fact("first", "max 2.000e0, rms 1.000e0")
            .with_fact("last", "max 5.000e-1, rms 2.500e-1");
        assert_eq!(trace.describe(), expected);
    }
}
