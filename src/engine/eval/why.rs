//! Forecasts: predicts which nodes an evaluation would run, and why.

use std::fmt::Write;
use std::sync::Arc;

use maquette_graph::{Graph, PINNED};
use maquette_node::CancelToken;

use super::cache::Outcome;
use super::disk::MIN_SECONDS_TO_KEEP;
use super::key::Change;
use super::plan::{Plan, Task};
use super::run::Run;
use super::snapshot::NodeRecord;
use super::trace::Reason;
use super::{Evaluator, State};

/// The forecast for a node: its expected state, and the reason.
#[derive(Clone, Debug, PartialEq)]
pub struct Forecast {
    pub index: usize,
    pub(crate) outlook: Outlook,
    pub(crate) reason: Reason,
}

impl Forecast {
    /// Returns true if the node may be computed.
    pub fn may_run(&self) -> bool {
        matches!(self.outlook, Outlook::Runs | Outlook::MayRun)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outlook {
    /// The node's result is in the cache.
    Cached,
    /// The node would certainly run.
    Runs,
    /// The node may run. It depends on a node that would run, and is computed only if that node's result changes.
    MayRun,
    /// The node would fail: a file cannot be read, or no pack defines the type of the node.
    Fails,
    /// The node depends on a node that would fail.
    Skipped,
}

/// Facts about the last result of a node, without its values.
#[derive(Clone, Debug, PartialEq)]
pub struct LastResult {
    /// A short description of each output, such as `1024 x 768`.
    pub descriptions: Vec<String>,
    pub bytes: usize,
    pub seconds: f64,
    /// True if the node would give the same result again. This is determined without running a node.
    pub is_current: bool,
}

impl Evaluator {
    /// Returns facts about the last result of each node, from this process or another one; `None` for a node without a known result. No
    /// node is run.
    pub(crate) fn last_results(&mut self, graph: &Graph) -> Vec<Option<LastResult>> {
        // Read the record on disk again, because another process may have evaluated the graph in the meantime.
        self.last = None;
        let all = Vec::from_iter(0..graph.nodes().len());
        let forecasts = self.forecast(graph, &all, &[]);
        let Some(last) = self.last.clone() else { return vec![None; all.len()] };
        forecasts
            .iter()
            .map(|forecast| {
                let name = &graph.nodes()[forecast.index].name;
                let outcome = &last.last_result(name, forecast.index)?.outcome;
                Some(LastResult {
                    descriptions: outcome.descriptions.to_vec(),
                    bytes: outcome.bytes,
                    seconds: outcome.seconds,
                    is_current: matches!(
                        forecast.reason,
                        Reason::Unchanged | Reason::Lost | Reason::Cheap
                    ),
                })
            })
            .collect()
    }

    /// Returns the forecasts of the nodes `roots` and of all their dependencies, in the order of the graph. The forecast assumes that the
    /// values of the nodes `values` are requested. Large files are not read.
    pub(crate) fn forecast(
        &mut self,
        graph: &Graph,
        roots: &[usize],
        values: &[usize],
    ) -> Vec<Forecast> {
        self.forecast_with_outcomes(graph, roots, values).0
    }

    /// Like [`forecast`](Self::forecast). Also returns the known results of the nodes, `None` for a node that would run.
    pub(super) fn forecast_with_outcomes(
        &mut self,
        graph: &Graph,
        roots: &[usize],
        values: &[usize],
    ) -> (Vec<Forecast>, Vec<Option<Arc<Outcome>>>) {
        self.recall(graph);
        let plan = Plan::new(self, graph, roots, values);
        let (observer, cancel) = ((), CancelToken::default());
        let mut run = Run::new(self, graph, &plan, &[], &observer, &cancel);
        run.files = run.files.with_forecast_limit();
        let wanted = (0..graph.nodes().len()).filter(|&index| plan.wanted[index]);
        let mut forecasts = Vec::new();
        for index in wanted {
            let (outlook, reason) = match plan.tasks[index] {
                Task::None => (Outlook::Cached, Reason::Unchanged),
                Task::Restore => (Outlook::Runs, run.lost_reason(index)),
                Task::Verify => (Outlook::Runs, Reason::Verified),
                Task::Look => match failing_input(graph, index, &forecasts) {
                    Some(cause) => (Outlook::Skipped, Reason::DependsOn(cause)),
                    None => run.forecast(index),
                },
            };
            forecasts.push(Forecast { index, outlook, reason });
        }
        // Go through the nodes in reverse order: a node that runs needs the values of its dependencies. If they have been dropped, the
        // dependencies run, too.
        let mut needs = vec![None; graph.nodes().len()];
        values.iter().for_each(|&node| needs[node] = Some(Outlook::Runs));
        for Forecast { index, outlook, reason } in forecasts.iter_mut().rev() {
            if let (Outlook::Cached, Some(need)) = (*outlook, needs[*index])
                && run.result_of(*index).is_some_and(|done| !self.holds_values(done))
            {
                (*outlook, *reason) = (need, run.lost_reason(*index));
            }
            if matches!(outlook, Outlook::Runs | Outlook::MayRun) {
                for source in graph.topology().sources(*index) {
                    // A node that certainly runs certainly needs the values of its inputs.
                    let is_sure = needs[source] == Some(Outlook::Runs);
                    needs[source] = Some(if is_sure { Outlook::Runs } else { *outlook });
                }
            }
        }
        let outcomes = forecasts.iter().map(|it| Some(run.result_of(it.index)?.outcome.clone()));
        let outcomes = outcomes.collect();
        (forecasts, outcomes)
    }

    /// Returns true if the values of a result are in memory or on disk. Large columns are not read for this check.
    fn holds_values(&self, done: &NodeRecord) -> bool {
        done.outcome.has_values()
            || self.known_results().is_some_and(|disk| disk.has_whole_entry(done.key))
    }
}

/// Returns the forecast of the node `index`, or `None`. `forecasts` is sorted by the index of the node.
fn forecast_of(forecasts: &[Forecast], index: usize) -> Option<&Forecast> {
    forecasts.binary_search_by_key(&index, |it| it.index).ok().map(|place| &forecasts[place])
}

/// Returns the first dependency of a node that would fail or be skipped, or `None` if no dependency would.
fn failing_input(graph: &Graph, index: usize, forecasts: &[Forecast]) -> Option<usize> {
    let mut links = graph.nodes()[index].links.iter().map(|link| link.node);
    links.find(|&link| {
        forecast_of(forecasts, link)
            .is_some_and(|it| matches!(it.outlook, Outlook::Fails | Outlook::Skipped))
    })
}

impl Run<'_> {
    /// Returns the reason why a known result must be computed again.
    fn lost_reason(&self, index: usize) -> Reason {
        match self.result_of(index) {
            Some(done) if done.outcome.seconds <= MIN_SECONDS_TO_KEEP => Reason::Cheap,
            _ => Reason::Lost,
        }
    }

    /// Returns the forecast of a node that has changed or depends on a changed node. The forecasts of its dependencies must exist already.
    /// If the node would not run, its cached result is stored in its slot.
    fn forecast(&self, index: usize) -> (Outlook, Reason) {
        let node = &self.graph.nodes()[index];
        if let Some(why) = node.node.missing_reason() {
            return (Outlook::Fails, Reason::Error(why));
        }
        let unknown = node.links.iter().find(|link| self.result_of(link.node).is_none());
        let before = self.last_result(index);
        if let Some(file) =
            node.files.iter().position(|file| self.files.is_too_large_for_forecast(file))
        {
            return match before {
                None => (Outlook::Runs, Reason::First),
                Some(_) => (Outlook::MayRun, Reason::Unread(file)),
            };
        }
        let mut parts = match self.parts(index) {
            Ok(parts) => parts,
            Err(error) => return (Outlook::Fails, Reason::Error(error.to_string())),
        };
        if let Some(unknown) = unknown {
            // The inputs are unknown, so compare everything else.
            parts.inputs = before.map_or_else(Box::default, |before| before.parts.inputs.clone());
            return match before.map(|before| parts.change(&before.parts)) {
                None => (Outlook::Runs, Reason::First),
                Some(Some(change)) => (Outlook::Runs, Reason::Changed(change)),
                Some(None) => (Outlook::MayRun, Reason::DependsOn(unknown.node)),
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
        let (outlook, reason) = match &found {
            Some(_) if self.evaluator.verifies(key) => (Outlook::Runs, Reason::Verified),
            Some(_) => (Outlook::Cached, reason),
            None => (Outlook::Runs, reason),
        };
        if let Some((outcome, slot)) = found.zip(self.slot(index)) {
            let _ = slot.result.set(Some(Arc::new(NodeRecord { parts, key, outcome })));
        }
        (outlook, reason)
    }
}

/// Explains why a node would run or not, and follows its dependencies back to the change that causes it. `forecasts` must contain the node
/// and all its dependencies.
pub fn explanation(graph: &Graph, node: usize, forecasts: &[Forecast]) -> String {
    let Some(forecast) = forecast_of(forecasts, node) else { return String::new() };
    let (name, reason) = (&graph.nodes()[node].name, forecast.reason_in(graph));
    if graph.nodes()[node].kind() == PINNED {
        return format!("`{name}` does not run: its result is pinned\n");
    }
    match forecast.outlook {
        Outlook::Cached => format!("`{name}` does not run: {reason}\n"),
        Outlook::Fails => format!("`{name}` cannot run: {reason}\n"),
        Outlook::Skipped => {
            let mut cause = forecast;
            while let Reason::DependsOn(above) = cause.reason {
                let Some(above) = forecast_of(forecasts, above) else { break };
                cause = above;
            }
            let (above, reason) = (&graph.nodes()[cause.index].name, cause.reason_in(graph));
            format!("`{name}` is skipped: it depends on `{above}`, which cannot run: {reason}\n")
        }
        Outlook::Runs => format!("`{name}` runs: {reason}\n"),
        Outlook::MayRun if !matches!(forecast.reason, Reason::DependsOn(_)) => {
            format!("`{name}` may run: {reason}\n")
        }
        Outlook::MayRun => {
            let mut text = format!("`{name}` runs if the result of a dependency changes:\n");
            for cause in forecasts.iter().filter(|it| {
                matches!(it.outlook, Outlook::Runs | Outlook::Fails)
                    || matches!(it.reason, Reason::Unread(_))
            }) {
                let (name, word) = (&graph.nodes()[cause.index].name, cause.word());
                let _ = writeln!(text, "  `{name}` {word}: {}", cause.reason_in(graph));
            }
            text
        }
    }
}

impl Forecast {
    /// Returns the word for the forecast in a table, such as `runs`.
    pub fn word(&self) -> &'static str {
        match self.outlook {
            Outlook::Cached => State::Cached.word(),
            Outlook::Runs => "runs",
            Outlook::MayRun => "may run",
            Outlook::Fails => State::Failed.word(),
            Outlook::Skipped => State::Skipped.word(),
        }
    }

    /// Returns the reason for the forecast in words. If a parameter has changed, the reason contains the parameter's position in the graph
    /// file.
    pub fn reason_in(&self, graph: &Graph) -> String {
        let node = &graph.nodes()[self.index];
        let text = self.reason.in_words(node, graph.nodes());
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
