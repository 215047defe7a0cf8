//! Evaluations on the way to another one: they find out how many elements a `ForEach` over data has.

use std::collections::HashMap;

use maquette_graph::Graph;
use maquette_node::CancelToken;
use maquette_syntax::error::Error;

use super::plan::Plan;
use super::run::News;
use super::{Evaluation, Evaluator, Observer, State};

/// What the next evaluation tells as if it had happened in it: by the name of the node.
pub(super) type Staged = HashMap<String, News>;

/// Passes on what happened for good: what has failed on the way will be tried again.
struct OnTheWay<'a>(&'a dyn Observer);

impl Observer for OnTheWay<'_> {
    fn started(&self, node: &str) {
        self.0.started(node);
    }

    fn progress(&self, node: &str, share: f64) {
        self.0.progress(node, share);
    }

    fn finished(&self, node: &str, state: State, seconds: f64) {
        if !matches!(state, State::Failed | State::Skipped) {
            self.0.finished(node, state, seconds);
        }
    }
}

impl Evaluator {
    /// Whether nothing has to be looked at to know that these nodes are as they were.
    pub(crate) fn is_settled(&mut self, graph: &Graph, roots: &[usize]) -> bool {
        self.recall(graph);
        !Plan::new(self, graph, roots, &[]).has_work()
    }

    /// Evaluates what these nodes need, and says of each whether it has a result, or its error; those that hang on one that failed
    /// have none. The next evaluation tells what happened.
    pub(crate) fn prepare(
        &mut self,
        graph: &Graph,
        roots: &[usize],
        observer: &dyn Observer,
        cancel: &CancelToken,
    ) -> Vec<Result<(), Option<Error>>> {
        let found = self.evaluate_alone(graph, roots, &[], &OnTheWay(observer), cancel);
        let ends = roots
            .iter()
            .map(|root| match found.found.current(*root) {
                Some(_) => Ok(()),
                None => {
                    let news = found.news.iter().find(|news| news.index == *root);
                    Err(news.and_then(|news| news.error.clone()))
                }
            })
            .collect();
        for news in found
            .news
            .into_iter()
            .filter(|news| !matches!(news.state, State::Failed | State::Skipped))
        {
            let name = graph.nodes()[news.index].name.clone();
            // What was computed on the way is not told as found in the cache.
            let before = self.staged.get(&name).is_none_or(|old| old.state != State::Computed);
            if before {
                self.staged.insert(name, news);
            }
        }
        ends
    }
}

impl Evaluation {
    /// Takes over what happened on the way, of nodes to which nothing happened since.
    pub(super) fn take_over(&mut self, graph: &Graph, mut staged: Staged) {
        if staged.is_empty() {
            return;
        }
        fn is_new(news: &News) -> bool {
            news.state != State::Cached
        }
        let mut told = std::mem::take(&mut self.news).into_iter().peekable();
        for (index, name) in graph.shape().names.iter().enumerate().filter(|it| self.wanted[it.0]) {
            let own = told.next_if(|news| news.index == index);
            let before = staged.remove(name).map(|news| News { index, ..news });
            let news = match own {
                Some(own) if is_new(&own) => Some(own),
                own => before.or(own),
            };
            self.news.extend(news);
        }
    }
}
