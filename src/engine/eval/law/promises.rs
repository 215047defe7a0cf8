//! Checks that an evaluation is right, by comparing it with a reference evaluation without a cache.

use std::collections::{HashMap, HashSet};

use maquette_graph::Graph;
use maquette_value::{AnyValue, Hash};

use super::LastParts;
use super::plain::Truth;
use crate::eval::trace::Reason;
use crate::eval::why::Outlook;
use crate::eval::{Evaluation, Forecast, State};

/// Returns an error with a formatted message if the condition is false.
macro_rules! promise {
    ($kept:expr, $($words:tt)+) => {
        if !$kept {
            return Err(format!($($words)+));
        }
    };
}

pub(super) use promise;

/// Checks that everything that an evaluation returns is right. If the evaluation was not cancelled, also checks that nothing is missing.
pub(super) fn agree(
    graph: &Graph,
    truths: &[Truth],
    evaluation: &Evaluation,
    values: &[usize],
    cancelled: bool,
) -> Result<(), String> {
    for (index, node) in
        graph.nodes().iter().enumerate().filter(|(index, _)| truths[*index].is_wanted())
    {
        let name = &node.name;
        for output in 0..node.outputs.len() {
            let (found, truth) = (evaluation.hash(index, output), truths[index].hash(output));
            let stopped = cancelled && found.is_none();
            promise!(stopped || found == truth, "`{name}` is {found:?}, but {truth:?} in truth");
            let value = evaluation.value(index, output).map(AnyValue::hash);
            let asked = values.contains(&index) && !cancelled;
            promise!(value.is_none() || value == truth, "`{name}` has a wrong value");
            promise!(!asked || value == truth, "the value of `{name}` is missing");
        }
    }
    Ok(())
}

/// An evaluation that was not cancelled, with the right results.
pub(super) struct CompletedEvaluation<'a> {
    pub(super) graph: &'a Graph,
    pub(super) truths: &'a [Truth],
    pub(super) evaluation: &'a Evaluation,
}

impl CompletedEvaluation<'_> {
    /// Checks that the trace lists the requested nodes in order, each in a possible state. Also checks that the trace and the observer
    /// agree on which nodes ran.
    pub(super) fn states(&self, started: &[String]) -> Result<(), String> {
        let trace = self.evaluation.trace();
        let nodes =
            self.graph.nodes().iter().zip(self.truths).filter(|(_, truth)| truth.is_wanted());
        promise!(
            nodes.clone().map(|(node, _)| &node.name).eq(trace.0.iter().map(|node| &node.name)),
            "the trace has other nodes"
        );
        let diagnostics = self.evaluation.diagnostics();
        for ((_, truth), node) in nodes.zip(&trace.0) {
            let (name, state) = (&node.name, node.state);
            let possible = match truth {
                Truth::Given { .. } => {
                    matches!(state, State::Computed | State::Cached | State::Equal)
                }
                Truth::Fails => state == State::Failed,
                Truth::Skipped => state == State::Skipped,
                Truth::Unwanted => false,
            };
            promise!(possible, "`{name}` is {state:?}");
            let ran = started.contains(name);
            promise!(ran || state != State::Computed, "`{name}` did not run");
            promise!(!ran || matches!(state, State::Computed | State::Failed), "`{name}` ran");
            let failed = format!("`{name}` cannot be computed");
            let reported =
                diagnostics.iter().filter(|diagnostic| diagnostic.message.starts_with(&failed));
            promise!(
                reported.count() == usize::from(state == State::Failed),
                "`{name}`: diagnostics"
            );
        }
        Ok(())
    }

    /// Checks that of all nodes with the same key exactly one ran, and only if no process had computed that result before.
    pub(super) fn runs(&self, known: &HashSet<Hash>, started: &[String]) -> Result<(), String> {
        let mut runs: HashMap<Hash, usize> = HashMap::new();
        let mut above = vec![false; self.truths.len()];
        let trace = self.evaluation.trace();
        for (index, truth) in self.truths.iter().enumerate() {
            let node = &self.graph.nodes()[index];
            let Truth::Given { parts, .. } = truth else { continue };
            let ran = started.contains(&node.name);
            let ran_above = node.links.iter().any(|link| above[link.node]);
            above[index] = ran || ran_above;
            let count = runs.entry(parts.key()).or_default();
            *count += usize::from(ran);
            let state = trace.0.iter().find(|node| node.name == self.graph.nodes()[index].name);
            let state = state.map(|node| node.state);
            let expected = if ran_above { State::Equal } else { State::Cached };
            promise!(
                ran || state == Some(expected),
                "`{}` is {state:?} where {expected:?} is true",
                node.name
            );
        }
        for truth in self.truths {
            let Truth::Given { parts, .. } = truth else { continue };
            let (key, count) = (parts.key(), runs[&parts.key()]);
            let expected = usize::from(!known.contains(&key));
            promise!(count == expected, "{count} runs of one work, {expected} expected: {parts:?}");
        }
        Ok(())
    }

    /// Checks that the forecasts made before the evaluation agree with its trace.
    pub(super) fn forecast(&self, forecasts: &[Forecast]) -> Result<(), String> {
        let trace = self.evaluation.trace();
        let names = forecasts.iter().map(|forecast| &self.graph.nodes()[forecast.index].name);
        promise!(
            names.eq(trace.0.iter().map(|node| &node.name)),
            "other nodes are forecast than visited"
        );
        fn outlook(index: usize, forecasts: &[Forecast]) -> Option<&Forecast> {
            forecasts.iter().find(|forecast| forecast.index == index)
        }
        for (forecast, node) in forecasts.iter().zip(&trace.0) {
            let state = node.state;
            let inputs_are_known = self.graph.nodes()[forecast.index].links.iter().all(|link| {
                outlook(link.node, forecasts)
                    .is_some_and(|forecast| forecast.outlook == Outlook::Cached)
            });
            let possible = match forecast.outlook {
                Outlook::Cached => matches!(state, State::Cached),
                // A state other than `Computed` is possible: another node with the same key may have been computed first.
                Outlook::Runs => state != State::Skipped || !inputs_are_known,
                Outlook::MayRun => true,
                Outlook::Fails => state == State::Failed,
                Outlook::Skipped => state == State::Skipped,
            };
            promise!(
                possible,
                "`{}` was forecast {:?} and is {state:?}",
                node.name,
                forecast.outlook
            );
        }
        Ok(())
    }

    /// Checks that the reason in each trace names what has changed since the last evaluation.
    pub(super) fn reasons(&self, last: &LastParts) -> Result<(), String> {
        let trace = self.evaluation.trace();
        let mut trace = trace.0.iter();
        for (index, truth) in self.truths.iter().enumerate().filter(|(_, truth)| truth.is_wanted())
        {
            let node = &self.graph.nodes()[index];
            let Some(found) = trace.next() else { continue };
            let Truth::Given { parts, .. } = truth else { continue };
            let change = last.get(&node.name).map(|before| parts.change(before));
            let expected = match (found.state, change) {
                (State::Equal, _) => Reason::SameInputs,
                (State::Computed, None) => Reason::First,
                (State::Computed, Some(None)) => Reason::Lost,
                (State::Computed, Some(Some(change))) => Reason::Changed(change),
                (_, Some(Some(change))) => Reason::Before(change),
                (_, None | Some(None)) => Reason::Unchanged,
            };
            let expected = expected.in_words(node, self.graph.nodes());
            promise!(found.reason == expected, "`{}`: {}, but {expected}", node.name, found.reason);
        }
        Ok(())
    }
}
