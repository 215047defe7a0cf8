//! Plans an evaluation: before anything runs, finds the nodes that need work.
//!
//! The parts from which nodes were computed are scattered in memory; reading them for 10 000 nodes took four of five milliseconds. So a
//! single hash of the name, recipe and links of a node is compared first. If it and the dependencies are unchanged, the parts are not read.

use std::sync::{Arc, OnceLock};

use maquette_graph::Graph;
use maquette_value::Hash;

use super::key::Parts;
use super::snapshot::{NodeRecord, Snapshot, VisitedNodes};
use super::{Evaluator, lock};

/// The tasks of an evaluation, and the results that are known in advance.
pub(super) struct Plan {
    pub(super) wanted: Arc<[bool]>,
    pub(super) tasks: Vec<Task>,
    /// The results that are known before anything runs.
    pub(super) known: KnownResults,
    /// The number of nodes that have a task.
    active: usize,
}

/// The task of an evaluation for one node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Task {
    /// Nothing to do: the result of the node is known, or no requested node needs it.
    None,
    /// Visit the node, because it or one of its dependencies has changed. It is computed if its result is not in the cache.
    Look,
    /// Restore the values of the node. Its result is known, but its values are needed and lost.
    Restore,
    /// Compute the node again and compare the result with the known one.
    Verify,
}

/// The results of nodes that have not changed.
pub(super) enum KnownResults {
    /// Nothing has changed: the results of the last evaluation.
    All(Arc<Snapshot>),
    /// The result of each node, if the node has not changed.
    Some(Vec<Option<Arc<NodeRecord>>>),
}

impl KnownResults {
    pub(super) fn get(&self, index: usize) -> Option<&Arc<NodeRecord>> {
        match self {
            Self::All(snapshot) => snapshot.current(index),
            Self::Some(results) => results[index].as_ref(),
        }
    }

    /// Returns the snapshot after all nodes with tasks have been visited. It contains the last result of each node, from this evaluation or
    /// from an earlier one of the graph.
    pub(super) fn into_snapshot(
        self,
        visited: VisitedNodes,
        wanted: &[bool],
        graph: &Graph,
        last: Option<&Arc<Snapshot>>,
    ) -> Arc<Snapshot> {
        let mut results = match self {
            Self::All(last) if visited.is_empty() => return last,
            Self::All(last) => (0..wanted.len())
                .map(|index: usize| last.current(index).filter(|_| wanted[index]).cloned())
                .collect(),
            Self::Some(results) => results,
        };
        // If a node gave another result than the known one, other nodes may still have been computed from the known one.
        let mut agree = true;
        for (index, done) in visited {
            if let (Some(before), Some(done)) = (&results[index], &done) {
                agree &= done.outcome.equals(&before.outcome);
            }
            results[index] = done;
        }
        let mut found: Vec<_> = results.iter().map(Option::is_some).collect();
        let (name, shape) = (&graph.source().name, graph.topology());
        if let Some(last) = last.filter(|last| last.graph == *name) {
            for (index, result) in results.iter_mut().enumerate().filter(|(_, it)| it.is_none()) {
                *result = last.last_result(&shape.names[index], index).cloned();
            }
        }
        let mut names = shape.names.clone();
        if let Some(last) = last.filter(|last| last.graph == *name) {
            let kept = Vec::from_iter(last.elements(graph));
            if !kept.is_empty() {
                names = names
                    .iter()
                    .cloned()
                    .chain(kept.iter().map(|(name, _)| name.clone()))
                    .collect();
                results.extend(kept.into_iter().map(|(_, done)| Some(done)));
            }
        }
        found.resize(results.len(), false);
        Arc::new(Snapshot {
            graph: name.clone(),
            shape: shape.identity,
            identities: if agree { shape.identities.clone() } else { Arc::default() },
            names,
            results,
            is_current: found,
            positions: OnceLock::new(),
        })
    }
}

impl Plan {
    pub(super) fn new(
        evaluator: &Evaluator,
        graph: &Graph,
        roots: &[usize],
        values: &[usize],
    ) -> Self {
        let wanted: Arc<[bool]> = graph.topology().needed_by(roots).into();
        let known = evaluator.unchanged_results(graph, &wanted);
        let mut tasks = vec![Task::None; wanted.len()];
        for index in (0..wanted.len()).filter(|&index| wanted[index]) {
            tasks[index] = match known.get(index) {
                None => Task::Look,
                Some(done) if evaluator.verifies(done.key) => Task::Verify,
                Some(_) => Task::None,
            };
        }
        // Nodes are handled in reverse order, so the dependencies of a restored node are handled after it.
        let mut needed = vec![false; wanted.len()];
        values.iter().for_each(|&node| needed[node] = true);
        for index in (0..wanted.len()).rev() {
            if needed[index]
                && tasks[index] == Task::None
                && known.get(index).is_some_and(|done| !evaluator.has_values(done))
            {
                tasks[index] = Task::Restore;
            }
            if tasks[index] != Task::None {
                graph.topology().sources(index).for_each(|node| needed[node] = true);
            }
        }
        let active = tasks.iter().filter(|task| **task != Task::None).count();
        Self { wanted, tasks, known, active }
    }

    pub(super) fn has_work(&self) -> bool {
        0 < self.active
    }

    /// Returns the number of requested nodes that have no task.
    pub(super) fn unchanged_count(&self) -> usize {
        self.wanted.iter().filter(|wanted| **wanted).count() - self.active
    }
}

impl Evaluator {
    /// Returns the results of those requested nodes that are unchanged. A cached result never becomes invalid, because its key covers
    /// everything that it depends on. So it is enough to compare the parts of the key.
    fn unchanged_results(&self, graph: &Graph, wanted: &[bool]) -> KnownResults {
        let Some(last) = &self.last else { return KnownResults::Some(vec![None; wanted.len()]) };
        if self.nothing_changed(last, graph, wanted) {
            return KnownResults::All(last.clone());
        }
        let shape = graph.topology();
        let mut results: Vec<Option<Arc<NodeRecord>>> = vec![None; wanted.len()];
        // Marks the nodes that are unchanged since the last evaluation and whose dependencies are unchanged, too. Each of them was computed
        // in that evaluation from the results of its dependencies, so the results still belong together.
        let mut same = vec![false; wanted.len()];
        for index in (0..wanted.len()).filter(|&index| wanted[index]) {
            let known = match last
                .current_if_unchanged(graph, index)
                .filter(|_| shape.sources(index).all(|source| same[source]))
            {
                Some(done)
                    if !shape.reads_files(index) || self.has_files(&done.parts, graph, index) =>
                {
                    same[index] = true;
                    Some(done)
                }
                _ => last
                    .last_result(&shape.names[index], index)
                    .filter(|done| self.is_computed_from(&done.parts, graph, index, &results)),
            };
            results[index] = known.cloned();
        }
        KnownResults::Some(results)
    }

    /// Returns true if the graph and its files are unchanged, and every requested node has a result from the last evaluation.
    fn nothing_changed(&self, last: &Snapshot, graph: &Graph, wanted: &[bool]) -> bool {
        let same = last.shape == graph.topology().identity;
        let mut readers = graph.topology().readers.iter().filter(|&&index| wanted[index]);
        same && wanted.iter().zip(&last.is_current).all(|(wanted, found)| found | !wanted)
            && readers.all(|&index| {
                last.current(index).is_some_and(|done| self.has_files(&done.parts, graph, index))
            })
    }

    /// Returns true if the node would now be computed from the parts `parts`. Inputs whose results are unknown are not compared.
    fn is_computed_from(
        &self,
        parts: &Parts,
        graph: &Graph,
        index: usize,
        results: &[Option<Arc<NodeRecord>>],
    ) -> bool {
        let node = &graph.nodes()[index];
        let inputs = node.links.iter().map(|link| {
            let outputs = &results[link.node].as_ref()?.outcome.outputs;
            outputs.get(link.output).map(|(_, hash)| *hash)
        });
        parts.recipe.identity == node.recipe.identity
            && inputs.eq(parts.inputs.iter().map(|hash| Some(*hash)))
            && self.has_files(parts, graph, index)
    }

    /// Returns true if the files of the node are known to be unchanged without reading them.
    fn has_files(&self, parts: &Parts, graph: &Graph, index: usize) -> bool {
        let files = graph.nodes()[index].files.iter();
        files
            .map(|file| self.files.cached_hash(&file.path))
            .eq(parts.files.iter().map(|hash| Some(*hash)))
    }

    /// Returns true if a result's values are available without computing them.
    fn has_values(&self, done: &NodeRecord) -> bool {
        done.outcome.has_values()
            || self.known_results().is_some_and(|disk| disk.has_entry(done.key))
    }

    /// Returns true if the cached result with this key must be computed again and compared.
    pub(super) fn verifies(&self, key: Hash) -> bool {
        let [a, b, ..] = key.0;
        self.is_verifying()
            && f64::from(u16::from_le_bytes([a, b])) < self.verified_fraction * 65536.0
            && !lock(&self.verified).contains(&key)
    }
}
