//! How many elements each `ForEach` over data has: found by evaluating the data, before the rest of a graph.
//!
//! The last counts, also those in a note on disk, are a guess: the node that takes the data apart reports if the number is another one. So
//! nothing is evaluated first where nothing has changed. Guessed counts that no evaluation has confirmed are taken back.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;

use maquette_graph::{Count, Counts, Graph, Loop, OtherCount};
use maquette_node::CancelToken;
use maquette_syntax::error::Problem;

use super::{Session, Wanted};
use crate::eval::Observer;
use crate::expect;

/// The counts that a session found last, by the file of the graph.
pub(super) type Known = BTreeMap<PathBuf, Counts>;

impl Session {
    /// The graph with as many elements as its data have, as far as these nodes of it need to know. The data are evaluated for it; if
    /// they fail, the graph keeps one example for all.
    pub(crate) fn resolved(
        &mut self,
        graph: &Graph,
        wanted: &dyn Fn(&Graph) -> Vec<usize>,
        observer: &dyn Observer,
        cancel: &CancelToken,
    ) -> Graph {
        fn needed(graph: &Graph, wanted: &dyn Fn(&Graph) -> Vec<usize>) -> Vec<Loop> {
            let needed = graph.shape().needed_by(&wanted(graph));
            let loops = graph.loops().iter().filter(|it| needed[it.node]).cloned();
            loops.collect()
        }
        if needed(graph, wanted).iter().all(|it| graph.is_settled(&it.name)) {
            return graph.clone();
        }
        let mut counts = self.counts(graph);
        // Nothing hangs on data without elements, so that nobody would see if there were some, or if they failed.
        counts.retain(|_, count| matches!(count, Count::Of(1..)));
        let mut found = self.expanded(graph, &mut counts);
        let mut met = BTreeSet::new();
        // Those whose count nobody has found out yet: it is that of others.
        let mut guessed = BTreeSet::new();
        // Whether some data fail of which a number is known: it is that of other data.
        let mut failed = false;
        // Each time one more of those that hang on each other is known, and with it all that are guessed rightly.
        loop {
            let loops = needed(&found, &wanted);
            met.extend(loops.iter().map(|it| it.name.clone()));
            let roots: Vec<_> = loops.iter().map(|it| it.node).collect();
            if roots.is_empty() || self.evaluator.is_settled(&found, &roots) {
                guessed.clear();
                break;
            }
            let ends = self.evaluator.prepare(&found, &roots, observer, cancel);
            let mut news = Vec::new();
            for (it, end) in loops.iter().zip(ends) {
                let other = match &end {
                    Ok(()) => None,
                    Err(error) => error.as_ref().and_then(|error| error.downcast::<OtherCount>()),
                };
                if end.is_err() && other.is_none() {
                    failed |= !cancel.is_cancelled() && counts.remove(&it.name).is_some();
                    continue;
                }
                guessed.remove(&it.name);
                let Some(&OtherCount(count)) = other else { continue };
                let now = Some(Count::Of(count));
                if counts.insert(it.name.clone(), Count::Of(count)) != now {
                    news.push((it, count));
                }
            }
            if news.is_empty() || cancel.is_cancelled() {
                break;
            }
            let guesses = guesses(&found, &loops, &news, &counts);
            guessed.extend(guesses.keys().cloned());
            counts.extend(guesses);
            found = graph.expanded(&counts, &self.catalog).unwrap_or_else(|_| {
                counts.retain(|name, _| !guessed.contains(name));
                guessed.clear();
                self.expanded(graph, &mut counts)
            });
        }
        // What their data are is not known: one example stands for all.
        if failed || !guessed.is_empty() {
            counts.retain(|name, _| !guessed.contains(name));
            found = self.expanded(graph, &mut counts);
        }
        counts.retain(|name, _| found.loops().iter().any(|it| it.name == *name));
        self.keep_counts(graph, counts);
        found.settled(met)
    }

    /// The same for the nodes that somebody names.
    pub fn resolved_for(
        &mut self,
        graph: &Graph,
        names: &[&str],
        observer: &dyn Observer,
        cancel: &CancelToken,
    ) -> Graph {
        let wanted = |graph: &Graph| names.iter().flat_map(|name| graph.meant(name)).collect();
        self.resolved(graph, &wanted, observer, cancel)
    }

    /// The graph with as many elements as its data had last. Nothing is evaluated.
    pub fn as_last_known(&self, graph: &Graph) -> Graph {
        let mut counts = if graph.loops().is_empty() { Counts::new() } else { self.counts(graph) };
        self.expanded(graph, &mut counts)
    }

    /// The graph with these counts. Those with which something is wrong say so when they are evaluated.
    fn expanded(&self, graph: &Graph, counts: &mut Counts) -> Graph {
        fn refused(problems: Vec<Problem>) -> Count {
            let first = problems.into_iter().next().map(|problem| problem.message);
            Count::Refused(first.unwrap_or_else(|| "the graph would have too many nodes".into()))
        }
        let found = graph.expanded(counts, &self.catalog).or_else(|problems| {
            let why = refused(problems);
            counts.values_mut().for_each(|count| *count = why.clone());
            graph.expanded(counts, &self.catalog)
        });
        found.unwrap_or_else(|_| graph.clone())
    }

    /// What was found last of the graph in this file, in this process or another one.
    fn counts(&self, graph: &Graph) -> Counts {
        let file = &graph.source().name;
        self.known
            .get(file)
            .cloned()
            .or_else(|| {
                let note = self.note(&file.with_extension("elements"))?;
                let counts: BTreeMap<String, usize> = serde_json::from_slice(&note).ok()?;
                Some(counts.into_iter().map(|(name, count)| (name, Count::Of(count))).collect())
            })
            .unwrap_or_default()
    }

    fn keep_counts(&mut self, graph: &Graph, counts: Counts) {
        let file = &graph.source().name;
        if self.known.get(file) == Some(&counts) {
            return;
        }
        let note =
            BTreeMap::from_iter(counts.iter().filter_map(|(name, count): (&String, &Count)| {
                match count {
                    Count::Of(count) => Some((name.clone(), *count)),
                    Count::Refused(_) => None,
                }
            }));
        self.keep_note(&file.with_extension("elements"), || {
            serde_json::to_vec(&note).unwrap_or_default()
        });
        self.known.insert(file.clone(), counts);
    }
}

/// More elements than this are not guessed at a time: where that is wrong, it was for nothing.
const MOST_GUESSED: usize = 10_000;

/// How many elements those have whose number is not known yet: as many as one that stands at the same place of the same file, which
/// several use. If it is so, a chain of them takes no more rounds than one of them.
fn guesses(graph: &Graph, open: &[Loop], found: &[(&Loop, usize)], known: &Counts) -> Counts {
    fn place(it: &Loop, graph: &Graph) -> (*const maquette_syntax::Sheet, maquette_syntax::Span) {
        let node = &graph.nodes()[it.node];
        (Arc::as_ptr(&node.sheet), node.span)
    }
    let found = BTreeMap::from_iter(found.iter().map(|&(it, count)| (place(it, graph), count)));
    let mut left = MOST_GUESSED;
    let open = open.iter().filter(|it| !known.contains_key(&it.name));
    open.filter_map(|it| {
        let count =
            found.get(&place(it, graph)).copied().filter(|count| (1..=left).contains(count))?;
        left -= count;
        Some((it.name.clone(), Count::Of(count)))
    })
    .collect()
}

/// The nodes that are wanted, as far as the graph has them by now.
pub(super) fn wanted_nodes(graph: &Graph, wanted: &Wanted) -> Vec<usize> {
    let outputs = || graph.outputs().iter().map(|output| output.node);
    fn meant(names: &[String], graph: &Graph) -> Vec<usize> {
        names.iter().flat_map(|name| graph.meant(name)).collect()
    }
    match wanted {
        Wanted::Outputs => judged_too(graph, outputs().collect()),
        Wanted::OutputsAnd(names) => {
            judged_too(graph, outputs().chain(meant(names, graph)).collect())
        }
        Wanted::Named(names) | Wanted::Nodes(names) => meant(names, graph),
        Wanted::Everything => (0..graph.nodes().len()).collect(),
    }
}

/// These nodes, and those that what is expected speaks of.
pub(super) fn judged_too(graph: &Graph, mut nodes: Vec<usize>) -> Vec<usize> {
    nodes.extend(expect::nodes_of(&graph.expected(&nodes)));
    nodes
}
