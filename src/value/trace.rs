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
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    steps: Vec<TraceStep>,
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
            None => Ok(Self { steps }),
            Some(&TraceStep { iteration, max, rms }) => {
                let why = format!(
                    "in iteration {iteration} the largest distance is {max} and the mean one {rms}"
                );
                Err(TraceError(why))
            }
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
}

impl Value for Trace {
    const NAME: &'static str = "Trace";

    fn encode(&self, to: &mut Encoder) {
        to.counts(&[self.steps.len()]);
        for step in &self.steps {
            to.plain(&step.iteration).plain(&step.max).plain(&step.rms);
        }
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let [count] = from.counts()?;
        let steps = (0..count).map(|_| {
            Ok(TraceStep { iteration: from.plain()?, max: from.plain()?, rms: from.plain()? })
        });
        Ok(Self { steps: steps.collect::<Result<_, _>>()? })
    }

    fn size(&self) -> usize {
        size_of::<Self>() + size_of_val(&*self.steps)
    }

    fn describe(&self) -> Summary {
        let summary = Summary::default().with_fact("steps", self.steps.len());
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
        Self::new(steps.collect::<Result<_, _>>()?).map_err(PartsError::from_error)
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
        steps.into_iter().flat_map(Self::new).collect()
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
