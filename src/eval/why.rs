//! What an evaluation would do, without doing it.

use std::fmt::Write;
use std::sync::Arc;

use super::disk::WORTH_A_FILE;
use super::key::Change;
use super::plan::{Plan, Task};
use super::run::Run;
use super::snapshot::Done;
use super::trace::Reason;
use super::{Evaluator, State};
use crate::graph::{Graph, PINNED};
use crate::node::CancelToken;

/// What would become of a node.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Forecast {
    pub(crate) index: usize,
    pub(crate) outlook: Outlook,
    pub(crate) reason: Reason,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outlook {
    /// Its result is in the cache.
    Cached,
    /// It would be computed.
    Runs,
    /// It hangs on a node that would be computed: it runs if that gives another result.
    MayRun,
    /// It would fail: a file cannot be read.
    Fails,
}

impl Evaluator {
    /// What would become of the nodes that these hang on, in the graph's order, if the values of the nodes `values` were wanted
    /// afterwards.
    pub(crate) fn forecast(
        &mut self,
        graph: &Graph,
        roots: &[usize],
        values: &[usize],
    ) -> Vec<Forecast> {
        self.recall(graph);
        let plan = Plan::new(self, graph, roots, values);
        let (observer, cancel) = ((), CancelToken::default());
        let run = Run::new(self, graph, &plan, &[], &observer, &cancel);
        let lost = |index: usize| match plan.known.get(index) {
            Some(done) if done.outcome.seconds <= WORTH_A_FILE => Reason::Cheap,
            _ => Reason::Lost,
        };
        let wanted = (0..graph.nodes.len()).filter(|&index| plan.wanted[index]);
        let forecast = |index: usize| match plan.tasks[index] {
            Task::None => Forecast { index, outlook: Outlook::Cached, reason: Reason::Unchanged },
            Task::Restore => Forecast { index, outlook: Outlook::Runs, reason: lost(index) },
            Task::Verify => Forecast { index, outlook: Outlook::Runs, reason: Reason::Verified },
            Task::Look => run.forecast(index),
        };
        wanted.map(forecast).collect()
    }
}

impl Run<'_> {
    /// What would become of a node that must be looked at; those that it hangs on have been asked about before. A node that
    /// would not run has its result from then on.
    fn forecast(&self, index: usize) -> Forecast {
        let node = &self.graph.nodes[index];
        let tell = |outlook, reason| Forecast { index, outlook, reason };
        let unknown = node.links.iter().find(|link| self.done(link.node).is_none());
        let before = self.before(index);
        let mut parts = match self.parts(node) {
            Ok(parts) => parts,
            Err(error) => return tell(Outlook::Fails, Reason::Error(error.to_string())),
        };
        if let Some(unknown) = unknown {
            // What it is apart from its inputs.
            parts.inputs = before.map_or_else(Box::default, |before| before.parts.inputs.clone());
            return match before.map(|before| parts.change(&before.parts)) {
                None => tell(Outlook::Runs, Reason::First),
                Some(Some(change)) => tell(Outlook::Runs, Reason::Changed(change)),
                Some(None) => tell(Outlook::MayRun, Reason::HangsOn(unknown.node)),
            };
        }
        let key = parts.key();
        let change = before.map(|before| parts.change(&before.parts));
        let found = self.find(index, key);
        let reason = match (found.is_some(), change) {
            (true, None | Some(None)) => Reason::Unchanged,
            (true, Some(Some(change))) => Reason::Before(change),
            (false, None) => Reason::First,
            (false, Some(None)) => Reason::Lost,
            (false, Some(Some(change))) => Reason::Changed(change),
        };
        let outlook = if found.is_some() { Outlook::Cached } else { Outlook::Runs };
        if let Some((outcome, slot)) = found.zip(self.slot(index)) {
            let _ = slot.done.set(Some(Arc::new(Done { parts, key, outcome })));
        }
        tell(outlook, reason)
    }
}

/// Why a node would run, or why not, back to what was changed; `forecasts` has it and what it hangs on.
pub(crate) fn explanation(graph: &Graph, node: usize, forecasts: &[Forecast]) -> String {
    let of_node = |forecast: &&Forecast| forecast.index == node;
    let Some(forecast) = forecasts.iter().find(of_node) else { return String::new() };
    let (name, reason) = (&graph.nodes[node].name, forecast.reason_in(graph));
    if graph.nodes[node].kind() == PINNED {
        return format!("`{name}` does not run: its result is pinned\n");
    }
    match forecast.outlook {
        Outlook::Cached => format!("`{name}` does not run: {reason}\n"),
        Outlook::Fails => format!("`{name}` fails: {reason}\n"),
        Outlook::Runs => format!("`{name}` runs: {reason}\n"),
        Outlook::MayRun => {
            let mut text = format!("`{name}` runs if what it hangs on comes out different:\n");
            let is_cause = |it: &&Forecast| matches!(it.outlook, Outlook::Runs | Outlook::Fails);
            for cause in forecasts.iter().filter(is_cause) {
                let (name, word) = (&graph.nodes[cause.index].name, cause.word());
                let _ = writeln!(text, "  `{name}` {word}: {}", cause.reason_in(graph));
            }
            text
        }
    }
}

impl Forecast {
    /// `would run`, as a column of a table.
    pub(crate) fn word(&self) -> &'static str {
        match self.outlook {
            Outlook::Cached => State::Cached.word(),
            Outlook::Runs => "runs",
            Outlook::MayRun => "may run",
            Outlook::Fails => State::Failed.word(),
        }
    }

    /// The reason in words, and where in the graph file a changed parameter stands.
    pub(crate) fn reason_in(&self, graph: &Graph) -> String {
        let node = &graph.nodes[self.index];
        let text = self.reason.in_words(node, &graph.nodes);
        let place = match &self.reason {
            Reason::Changed(change) | Reason::Before(change) => match change {
                Change::Parameter { path, .. } => Some(node.place_of(path)),
                Change::Kind { .. } => Some(node.place_of(&[])),
                Change::Input(_) | Change::File(_) => None,
            },
            _ => None,
        };
        place.map_or(text.clone(), |place| format!("{text}, {place}"))
    }
}
