//! What an evaluation would do, without doing it.

use super::plan::{Plan, Task};
use super::run::Run;
use super::trace::Reason;
use super::{Evaluator, State};
use crate::graph::Graph;
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
    /// What would become of the nodes that these hang on, in the graph's order.
    pub(crate) fn forecast(&mut self, graph: &Graph, roots: &[usize]) -> Vec<Forecast> {
        self.recall(graph);
        let plan = Plan::new(self, graph, roots, &[]);
        let (observer, cancel) = ((), CancelToken::default());
        let run = Run::new(self, graph, &plan, &observer, &cancel);
        let wanted = (0..graph.nodes.len()).filter(|&index| plan.wanted[index]);
        let forecast = |index: usize| match plan.tasks[index] {
            Task::None => Forecast { index, outlook: Outlook::Cached, reason: Reason::Unchanged },
            Task::Restore => Forecast { index, outlook: Outlook::Runs, reason: Reason::Lost },
            Task::Verify => Forecast { index, outlook: Outlook::Runs, reason: Reason::Verified },
            Task::Look => run.forecast(index),
        };
        wanted.map(forecast).collect()
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
}
