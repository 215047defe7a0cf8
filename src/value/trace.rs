//! How an iteration went.

use thiserror::Error;

use super::{
    DecodeError, Decoder, Encoder, Layer, Meaning, On, Parts, PartsError, Series, Summary, Value,
};

/// Why steps make no trace.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum TraceError {
    /// A step that is not after the one before it.
    #[error("iteration {iteration} of the trace is not after the one before it")]
    Order {
        /// The offending iteration.
        iteration: u64,
    },
    /// A distance that is none.
    #[error("in iteration {iteration} the largest distance is {max} and the mean one {rms}")]
    Distance {
        /// The offending iteration.
        iteration: u64,
        /// The largest distance.
        max: f64,
        /// The root of the mean square.
        rms: f64,
    },
}

/// How far from its goal an iteration was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceStep {
    /// How many iterations were done by then: 0 at the start.
    pub iteration: u64,
    /// The largest distance of anything from where it should be; in mm where places are compared.
    pub max: f64,
    /// The root of the mean of the distances' squares.
    pub rms: f64,
}

/// How an iteration went: how far from its goal it was, step by step. The last step tells how far the result is.
///
/// Invariant, checked by [`Trace::new`]: iterations grow from step to step; distances are 0 or more, or infinite where numbers
/// overflow. There may be no step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    steps: Vec<TraceStep>,
}

impl Trace {
    /// A trace of these steps.
    ///
    /// # Errors
    /// If a step is not after the one before it, or a distance is negative or NaN.
    pub fn new(steps: Vec<TraceStep>) -> Result<Self, TraceError> {
        if let Some(pair) = steps.windows(2).find(|pair| pair[1].iteration <= pair[0].iteration) {
            return Err(TraceError::Order { iteration: pair[1].iteration });
        }
        fn is_distance(x: f64) -> bool {
            x >= 0.0
        }
        match steps.iter().find(|step| !is_distance(step.max) || !is_distance(step.rms)) {
            None => Ok(Self { steps }),
            Some(&TraceStep { iteration, max, rms }) => {
                Err(TraceError::Distance { iteration, max, rms })
            }
        }
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
        let step =
            |_| Ok(TraceStep { iteration: from.plain()?, max: from.plain()?, rms: from.plain()? });
        Ok(Self { steps: (0..count).map(step).collect::<Result<_, _>>()? })
    }

    fn size(&self) -> usize {
        size_of::<Self>() + size_of_val(&*self.steps)
    }

    fn describe(&self) -> Summary {
        let summary = Summary::default().with("steps", self.steps.len());
        let (Some(first), Some(last)) = (self.steps.first(), self.steps.last()) else {
            return summary;
        };
        fn distances(step: &TraceStep) -> String {
            format!("max {:.3e}, rms {:.3e}", step.max, step.rms)
        }
        summary
            .with("iterations", last.iteration)
            .with("first", distances(first))
            .with("last", distances(last))
    }

    fn parts(&self) -> Parts<'_> {
        fn column(of: fn(&TraceStep) -> f64, steps: &[TraceStep]) -> Vec<f64> {
            steps.iter().map(of).collect::<Vec<_>>()
        }
        let mut parts = Parts::default();
        parts.fact("steps", self.steps.len());
        parts.push(
            "iteration",
            On::Step,
            Meaning::Exact,
            1,
            column(|step| step.iteration as f64, &self.steps),
        );
        parts.push("max", On::Step, Meaning::Number, 1, column(|step| step.max, &self.steps));
        parts.push("rms", On::Step, Meaning::Number, 1, column(|step| step.rms, &self.steps));
        parts
    }

    /// Iterations are exact up to 2^53.
    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let iterations = parts.need("iteration", 1)?;
        let column = |name: &str| {
            let column = parts.need(name, 1)?.with_count(iterations.count())?;
            Ok(column.items.numbers().into_owned())
        };
        let (max, rms) = (column("max")?, column("rms")?);
        let numbers = iterations.items.numbers();
        let steps = numbers.iter().enumerate().map(|(k, &x)| {
            if !(0.0..=u64::MAX as f64).contains(&x) || x.fract() != 0.0 {
                return Err(iterations.wrong(k, x, "a count"));
            }
            Ok(TraceStep { iteration: x as u64, max: max[k], rms: rms[k] })
        });
        Self::new(steps.collect::<Result<_, _>>()?).map_err(PartsError::refused)
    }

    fn show(&self) -> Vec<Layer> {
        let at: Vec<_> = self.steps.iter().map(|step| step.iteration as f64).collect();
        fn series(
            name: &str,
            of: fn(&TraceStep) -> f64,
            at: &[f64],
            steps: &[TraceStep],
        ) -> Series {
            Series {
                name: name.to_owned(),
                at: at.to_vec(),
                numbers: steps.iter().map(of).collect(),
            }
        }
        vec![Layer::Plot(vec![
            series("max", |step| step.max, &at, &self.steps),
            series("rms", |step| step.rms, &at, &self.steps),
        ])]
    }

    fn hostile() -> Vec<Self> {
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
            Err(TraceError::Order { iteration: 1 })
        );
        for (max, rms) in [(-1.0, 0.0), (0.0, f64::NAN)] {
            let refused = Trace::new(vec![step(7, max, rms)]);
            assert!(matches!(refused, Err(TraceError::Distance { iteration: 7, .. })));
        }
    }

    #[test]
    fn a_trace_is_described_by_its_ends() {
        assert_eq!(Trace::default().describe(), Summary::default().with("steps", 0));
        let trace = Trace::new(vec![step(0, 2.0, 1.0), step(4, 0.5, 0.25)]).unwrap();
        let expected = Summary::default()
            .with("steps", 2)
            .with("iterations", 4)
            .with("first", "max 2.000e0, rms 1.000e0")
            .with("last", "max 5.000e-1, rms 2.500e-1");
        assert_eq!(trace.describe(), expected);
    }
}
