//! Determines how many elements each `ForEach` loop over data has. The data is evaluated before the rest of the graph.
//!
//! The last known counts, from this process or from a note on disk, are used as guesses. If nothing has changed, the guesses are right and
//! no data has to be evaluated first. If a count is wrong, the node that splits the data into elements reports the real one. Guesses that
//! no evaluation has confirmed are dropped.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;

use maquette_graph::{Count, Counts, ElementCountChanged, Graph, Loop};
use maquette_node::CancelToken;
use maquette_syntax::error::Diagnostic;

use super::{Session, Targets};
use crate::eval::Observer;
use crate::expect;

/// For each graph file, by path: the last known number of elements of each loop of the graph.
pub(super) type KnownCounts = BTreeMap<PathBuf, Counts>;

impl Session {
    /// Expands the loops on which the nodes `wanted` depend, so that each loop has as many elements as its data. To count the elements,
    /// evaluates the data. If this evaluation fails, the loop gets a single example element.
    pub(crate) fn resolve(
        &mut self,
        graph: &Graph,
        wanted: &dyn Fn(&Graph) -> Vec<usize>,
        observer: &dyn Observer,
        cancel: &CancelToken,
    ) -> Graph {
        fn needed_loops(graph: &Graph, wanted: &dyn Fn(&Graph) -> Vec<usize>) -> Vec<Loop> {
            let needed = graph.topology().needed_by(&wanted(graph));
            let loops = graph.loops().iter().filter(|it| needed[it.node]).cloned();
            loops.collect()
        }
        if needed_loops(graph, wanted).iter().all(|it| graph.is_settled(&it.name)) {
            return graph.clone();
        }
        let mut counts = self.counts(graph);
        // Drop counts of zero, so that these loops are counted again. No node depends on the data of a loop without elements, so an
        // evaluation would not notice that the data has elements now, or that it fails.
        counts.retain(|_, count| matches!(count, Count::Of(1..)));
        let mut found = self.expand(graph, &mut counts);
        let mut confirmed = BTreeSet::new();
        // The loops whose counts are guesses, taken from similar loops.
        let mut guessed = BTreeSet::new();
        // True if the data of a loop with a known count cannot be evaluated. Such a count is outdated.
        let mut has_failed = false;
        // Each round finds the count of one more loop in a chain of dependent loops. It also finds the counts of all loops whose guesses
        // were right.
        loop {
            let loops = needed_loops(&found, &wanted);
            confirmed.extend(loops.iter().map(|it| it.name.clone()));
            let roots: Vec<_> = loops.iter().map(|it| it.node).collect();
            if roots.is_empty() || self.evaluator.is_settled(&found, &roots) {
                guessed.clear();
                break;
            }
            let results = self.evaluator.prepare(&found, &roots, observer, cancel);
            let mut changed = Vec::new();
            for (it, end) in loops.iter().zip(results) {
                let other = match &end {
                    Ok(()) => None,
                    Err(error) => {
                        error.as_ref().and_then(|error| error.downcast::<ElementCountChanged>())
                    }
                };
                if end.is_err() && other.is_none() {
                    has_failed |= !cancel.is_cancelled() && counts.remove(&it.name).is_some();
                    continue;
                }
                guessed.remove(&it.name);
                let Some(&ElementCountChanged(count)) = other else { continue };
                let now = Some(Count::Of(count));
                if counts.insert(it.name.clone(), Count::Of(count)) != now {
                    changed.push((it, count));
                }
            }
            if changed.is_empty() || cancel.is_cancelled() {
                break;
            }
            let guesses = guesses(&found, &loops, &changed, &counts);
            guessed.extend(guesses.keys().cloned());
            counts.extend(guesses);
            found = graph.expand(&counts, &self.catalog).unwrap_or_else(|_| {
                counts.retain(|name, _| !guessed.contains(name));
                guessed.clear();
                self.expand(graph, &mut counts)
            });
        }
        // Drop the guesses that were not confirmed, so that the loops they belong to get a single example element.
        if has_failed || !guessed.is_empty() {
            counts.retain(|name, _| !guessed.contains(name));
            found = self.expand(graph, &mut counts);
        }
        counts.retain(|name, _| found.loops().iter().any(|it| it.name == *name));
        self.keep_counts(graph, counts);
        found.with_counted(confirmed)
    }

    /// Expands the loops on which the named nodes depend, like `resolve`.
    pub fn resolve_for(
        &mut self,
        graph: &Graph,
        names: &[&str],
        observer: &dyn Observer,
        cancel: &CancelToken,
    ) -> Graph {
        let wanted =
            |graph: &Graph| names.iter().flat_map(|name| graph.resolve_nodes(name)).collect();
        self.resolve(graph, &wanted, observer, cancel)
    }

    /// Returns the graph with its loops expanded to the last known counts. Nothing is evaluated.
    pub fn with_last_counts(&self, graph: &Graph) -> Graph {
        let mut counts = if graph.loops().is_empty() { Counts::new() } else { self.counts(graph) };
        self.expand(graph, &mut counts)
    }

    /// Returns the graph with its loops expanded to the given numbers of elements. If a number is wrong, the evaluation reports it.
    fn expand(&self, graph: &Graph, counts: &mut Counts) -> Graph {
        fn refusal(diagnostics: Vec<Diagnostic>) -> Count {
            let first = diagnostics.into_iter().next().map(|diagnostic| diagnostic.message);
            Count::Refused(first.unwrap_or_else(|| "the graph would have too many nodes".into()))
        }
        let found = graph.expand(counts, &self.catalog).or_else(|diagnostics| {
            let why = refusal(diagnostics);
            counts.values_mut().for_each(|count| *count = why.clone());
            graph.expand(counts, &self.catalog)
        });
        found.unwrap_or_else(|_| graph.clone())
    }

    /// Returns the last known counts of the graph's loops, from this process or from a note on disk.
    fn counts(&self, graph: &Graph) -> Counts {
        let file = &graph.source().name;
        self.known_counts
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
        if self.known_counts.get(file) == Some(&counts) {
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
        self.known_counts.insert(file.clone(), counts);
    }
}

/// The maximum number of elements that are guessed in one round, summed over all loops. The number is limited because a wrong guess wastes
/// work.
const MAX_GUESSED: usize = 10_000;

/// Guesses the unknown counts of loops. If several graphs use the same file, a loop in it is assumed to have equal counts in all of them.
/// If the guesses are right, a chain of such loops needs no more rounds than one loop.
fn guesses(graph: &Graph, open: &[Loop], found: &[(&Loop, usize)], known: &Counts) -> Counts {
    fn place(
        it: &Loop,
        graph: &Graph,
    ) -> (*const maquette_syntax::SourceMap, maquette_syntax::Span) {
        let node = &graph.nodes()[it.node];
        (Arc::as_ptr(&node.source_map), node.span)
    }
    let found = BTreeMap::from_iter(found.iter().map(|&(it, count)| (place(it, graph), count)));
    let mut left = MAX_GUESSED;
    let open = open.iter().filter(|it| !known.contains_key(&it.name));
    open.filter_map(|it| {
        let count =
            found.get(&place(it, graph)).copied().filter(|count| (1..=left).contains(count))?;
        left -= count;
        Some((it.name.clone(), Count::Of(count)))
    })
    .collect()
}

/// Returns the indices of the requested nodes. Nodes that exist only after a loop is expanded are left out.
pub(super) fn wanted_nodes(graph: &Graph, wanted: &Targets) -> Vec<usize> {
    let output_nodes = || graph.outputs().iter().map(|output| output.node);
    fn nodes_of_names(names: &[String], graph: &Graph) -> Vec<usize> {
        names.iter().flat_map(|name| graph.resolve_nodes(name)).collect()
    }
    match wanted {
        Targets::Outputs => with_expected_nodes(graph, output_nodes().collect()),
        Targets::OutputsAnd(names) => {
            with_expected_nodes(graph, output_nodes().chain(nodes_of_names(names, graph)).collect())
        }
        Targets::Named(names) | Targets::Nodes(names) => nodes_of_names(names, graph),
        Targets::Everything => (0..graph.nodes().len()).collect(),
    }
}

/// Adds the nodes whose values are needed to check the expectations about `nodes`.
pub(super) fn with_expected_nodes(graph: &Graph, mut nodes: Vec<usize>) -> Vec<usize> {
    nodes.extend(expect::nodes_of(&graph.expectations_for(&nodes)));
    nodes
}
