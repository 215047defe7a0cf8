//! Preflight evaluations: before the main evaluation, they determine how many elements each `ForEach` loop over data has.

use std::collections::HashMap;

use maquette_graph::Graph;
use maquette_node::CancelToken;
use maquette_syntax::error::Error;

use super::plan::Plan;
use super::run::NodeEvent;
use super::{Evaluation, Evaluator, Observer, State};

/// The events of preflight evaluations, by the name of the node. The next main evaluation reports them as its own.
pub(super) type PreflightEvents = HashMap<String, NodeEvent>;

/// An observer that passes on all events except failures, because the main evaluation runs failed nodes again.
struct PreflightObserver<'a>(&'a dyn Observer);

impl Observer for PreflightObserver<'_> {
    fn on_start(&self, node: &str) {
        self.0.on_start(node);
    }

    fn on_progress(&self, node: &str, fraction: f64) {
        self.0.on_progress(node, fraction);
    }

    fn on_finish(&self, node: &str, state: State, seconds: f64) {
        if !matches!(state, State::Failed | State::Skipped) {
            self.0.on_finish(node, state, seconds);
        }
    }
}

impl Evaluator {
    /// Returns true if the nodes `roots` and their dependencies are unchanged, so that they need no work.
    pub(crate) fn is_settled(&mut self, graph: &Graph, roots: &[usize]) -> bool {
        self.recall(graph);
        !Plan::new(self, graph, roots, &[]).has_work()
    }

    /// Evaluates the nodes `roots` before the main evaluation. Returns `Ok` for each node that has a result, and otherwise its error. The
    /// error is `None` for a node that depends on a failed node. The main evaluation reports the events.
    pub(crate) fn prepare(
        &mut self,
        graph: &Graph,
        roots: &[usize],
        observer: &dyn Observer,
        cancel: &CancelToken,
    ) -> Vec<Result<(), Option<Error>>> {
        let found = self.evaluate_once(graph, roots, &[], &PreflightObserver(observer), cancel);
        let results = roots
            .iter()
            .map(|root| match found.snapshot.current(*root) {
                Some(_) => Ok(()),
                None => {
                    let event = found.events.iter().find(|event| event.index == *root);
                    Err(event.and_then(|event| event.error.clone()))
                }
            })
            .collect();
        for event in found
            .events
            .into_iter()
            .filter(|event| !matches!(event.state, State::Failed | State::Skipped))
        {
            let name = graph.nodes()[event.index].name.clone();
            // Keep the event `Computed` of an earlier preflight evaluation, so that the node is not reported as cached.
            let before =
                self.preflight_events.get(&name).is_none_or(|old| old.state != State::Computed);
            if before {
                self.preflight_events.insert(name, event);
            }
        }
        results
    }
}

impl Evaluation {
    /// Adds the events of preflight evaluations. If a node also has a newer event that is not `Cached`, the newer event is kept.
    pub(super) fn merge_preflight(&mut self, graph: &Graph, mut preflight_events: PreflightEvents) {
        if preflight_events.is_empty() {
            return;
        }
        fn is_new(event: &NodeEvent) -> bool {
            event.state != State::Cached
        }
        let mut own_events = std::mem::take(&mut self.events).into_iter().peekable();
        for (index, name) in
            graph.topology().names.iter().enumerate().filter(|it| self.wanted[it.0])
        {
            let own = own_events.next_if(|event| event.index == index);
            let before = preflight_events.remove(name).map(|event| NodeEvent { index, ..event });
            let event = match own {
                Some(own) if is_new(&own) => Some(own),
                own => before.or(own),
            };
            self.events.extend(event);
        }
    }
}
