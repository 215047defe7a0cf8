//! What an evaluation would do, without doing it.

use std::fmt::Write;
use std::sync::Arc;

use maquette_graph::{Graph, PINNED};
use maquette_node::CancelToken;

use super::disk::WORTH_A_FILE;
use super::key::Change;
use super::plan::{Plan, Task};
use super::run::Run;
use super::snapshot::Done;
use super::trace::Reason;
use super::{Evaluator, State};

/// What would become of a node.
#[derive(Clone, Debug, PartialEq)]
pub struct Forecast {
    pub index: usize,
    pub(crate) outlook: Outlook,
    pub(crate) reason: Reason,
}

impl Forecast {
    /// Whether the node may be computed.
    pub fn may_run(&self) -> bool {
        matches!(self.outlook, Outlook::Runs | Outlook::MayRun)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outlook {
    /// Its result is in the cache.
    Cached,
    /// It would be computed.
    Runs,
    /// It hangs on a node that would be computed: it runs if that gives another result.
    MayRun,
    /// It would fail: a file cannot be read, or no pack has such a node.
    Fails,
    /// It hangs on a node that would fail.
    Skipped,
}

/// What is known of a node's last result, without its values.
#[derive(Clone, Debug, PartialEq)]
pub struct Remembered {
    /// What each output is in a few words: `1024 x 768`.
    pub shapes: Vec<String>,
    pub bytes: usize,
    pub seconds: f64,
    /// Whether the node would give it again now, as far as that is known without running one.
    pub is_current: bool,
}

impl Evaluator {
    /// What is known of the last result of each node, by this process or another one; nothing is run.
    pub(crate) fn remembered(&mut self, graph: &Graph) -> Vec<Option<Remembered>> {
        // Another process may have evaluated it since.
        self.last = None;
        let all = Vec::from_iter(0..graph.nodes().len());
        let forecasts = self.forecast(graph, &all, &[]);
        let Some(last) = self.last.clone() else { return vec![None; all.len()] };
        let remembered = |forecast: &Forecast| {
            let done = last.before(&graph.nodes()[forecast.index].name, forecast.index)?;
            let outcome = &done.outcome;
            Some(Remembered {
                shapes: outcome.shapes.to_vec(),
                bytes: outcome.bytes,
                seconds: outcome.seconds,
                is_current: matches!(
                    forecast.reason,
                    Reason::Unchanged | Reason::Lost | Reason::Cheap
                ),
            })
        };
        forecasts.iter().map(remembered).collect()
    }

    /// What would become of the nodes that these hang on, in the graph's order, if the values of the nodes `values` were wanted
    /// afterwards. Large files are not read for it.
    pub(crate) fn forecast(
        &mut self,
        graph: &Graph,
        roots: &[usize],
        values: &[usize],
    ) -> Vec<Forecast> {
        self.recall(graph);
        let plan = Plan::new(self, graph, roots, values);
        let (observer, cancel) = ((), CancelToken::default());
        let mut run = Run::new(self, graph, &plan, &[], &observer, &cancel);
        run.files = run.files.sparing();
        let lost = |index: usize| match run.done(index) {
            Some(done) if done.outcome.seconds <= WORTH_A_FILE => Reason::Cheap,
            _ => Reason::Lost,
        };
        let wanted = (0..graph.nodes().len()).filter(|&index| plan.wanted[index]);
        let mut told = Vec::new();
        for index in wanted {
            let (outlook, reason) = match plan.tasks[index] {
                Task::None => (Outlook::Cached, Reason::Unchanged),
                Task::Restore => (Outlook::Runs, lost(index)),
                Task::Verify => (Outlook::Runs, Reason::Verified),
                Task::Look => match failing(graph, index, &told) {
                    Some(cause) => (Outlook::Skipped, Reason::HangsOn(cause)),
                    None => run.forecast(index),
                },
            };
            told.push(Forecast { index, outlook, reason });
        }
        // Backwards: what is computed needs the values of what it depends on, which may have been dropped.
        let mut needs = vec![None; graph.nodes().len()];
        values.iter().for_each(|&node| needs[node] = Some(Outlook::Runs));
        for Forecast { index, outlook, reason } in told.iter_mut().rev() {
            if let (Outlook::Cached, Some(need)) = (*outlook, needs[*index])
                && run.done(*index).is_some_and(|done| !self.holds_values(done))
            {
                (*outlook, *reason) = (need, lost(*index));
            }
            if matches!(outlook, Outlook::Runs | Outlook::MayRun) {
                for source in graph.shape().sources(*index) {
                    // Who surely runs surely needs it.
                    let is_sure = needs[source] == Some(Outlook::Runs);
                    needs[source] = Some(if is_sure { Outlook::Runs } else { *outlook });
                }
            }
        }
        told
    }

    /// Returns true if a result's values can be had without computing them, as far as that is known without reading large ones.
    fn holds_values(&self, done: &Done) -> bool {
        let is_kept = || self.known_results().is_some_and(|disk| disk.holds(done.key));
        done.outcome.has_values() || is_kept()
    }
}

/// What is told of a node, if it is: the list is in the graph's order.
fn told_of(told: &[Forecast], index: usize) -> Option<&Forecast> {
    told.binary_search_by_key(&index, |it| it.index).ok().map(|place| &told[place])
}

/// The first of a node's inputs that there will not be.
fn failing(graph: &Graph, index: usize, told: &[Forecast]) -> Option<usize> {
    let mut links = graph.nodes()[index].links.iter().map(|link| link.node);
    links.find(|&link| {
        told_of(told, link)
            .is_some_and(|it| matches!(it.outlook, Outlook::Fails | Outlook::Skipped))
    })
}

impl Run<'_> {
    /// What would become of a node that must be looked at; those that it hangs on have been asked about before. A node that
    /// would not run has its result from then on.
    fn forecast(&self, index: usize) -> (Outlook, Reason) {
        let node = &self.graph.nodes()[index];
        if let Some(why) = node.node.lacks() {
            return (Outlook::Fails, Reason::Error(why));
        }
        let unknown = node.links.iter().find(|link| self.done(link.node).is_none());
        let before = self.before(index);
        if let Some(file) = node.files.iter().position(|file| self.files.is_spared(file)) {
            return match before {
                None => (Outlook::Runs, Reason::First),
                Some(_) => (Outlook::MayRun, Reason::Unread(file)),
            };
        }
        let mut parts = match self.parts(node) {
            Ok(parts) => parts,
            Err(error) => return (Outlook::Fails, Reason::Error(error.to_string())),
        };
        if let Some(unknown) = unknown {
            // What it is apart from its inputs.
            parts.inputs = before.map_or_else(Box::default, |before| before.parts.inputs.clone());
            return match before.map(|before| parts.change(&before.parts)) {
                None => (Outlook::Runs, Reason::First),
                Some(Some(change)) => (Outlook::Runs, Reason::Changed(change)),
                Some(None) => (Outlook::MayRun, Reason::HangsOn(unknown.node)),
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
            let _ = slot.done.set(Some(Arc::new(Done { parts, key, outcome })));
        }
        (outlook, reason)
    }
}

/// Why a node would run, or why not, back to what was changed; `forecasts` has it and what it hangs on.
pub fn explanation(graph: &Graph, node: usize, forecasts: &[Forecast]) -> String {
    let Some(forecast) = told_of(forecasts, node) else { return String::new() };
    let (name, reason) = (&graph.nodes()[node].name, forecast.reason_in(graph));
    if graph.nodes()[node].kind() == PINNED {
        return format!("`{name}` does not run: its result is pinned\n");
    }
    match forecast.outlook {
        Outlook::Cached => format!("`{name}` does not run: {reason}\n"),
        Outlook::Fails => format!("`{name}` cannot run: {reason}\n"),
        Outlook::Skipped => {
            let mut cause = forecast;
            while let Reason::HangsOn(above) = cause.reason {
                let Some(above) = told_of(forecasts, above) else { break };
                cause = above;
            }
            let (above, reason) = (&graph.nodes()[cause.index].name, cause.reason_in(graph));
            format!("`{name}` is skipped: it hangs on `{above}`, which cannot run: {reason}\n")
        }
        Outlook::Runs => format!("`{name}` runs: {reason}\n"),
        Outlook::MayRun if !matches!(forecast.reason, Reason::HangsOn(_)) => {
            format!("`{name}` may run: {reason}\n")
        }
        Outlook::MayRun => {
            let mut text = format!("`{name}` runs if what it hangs on comes out different:\n");
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
    /// `would run`, as a column of a table.
    pub fn word(&self) -> &'static str {
        match self.outlook {
            Outlook::Cached => State::Cached.word(),
            Outlook::Runs => "runs",
            Outlook::MayRun => "may run",
            Outlook::Fails => State::Failed.word(),
            Outlook::Skipped => State::Skipped.word(),
        }
    }

    /// The reason in words, and where in the graph file a changed parameter stands.
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
