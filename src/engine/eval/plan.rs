//! What must be looked at, found before anything runs.
//!
//! Data that a node was computed from are spread over memory: fetching them for 10 000 nodes took four of five milliseconds. So for a node
//! of unchanged name, recipe and links, whose dependencies are unchanged, only one hash is compared.

use std::sync::{Arc, OnceLock};

use maquette_graph::Graph;
use maquette_value::Hash;

use super::key::Parts;
use super::snapshot::{Done, Snapshot, Visited};
use super::{Evaluator, lock};

/// What an evaluation does with each node.
pub(super) struct Plan {
    pub(super) wanted: Arc<[bool]>,
    pub(super) tasks: Vec<Task>,
    /// The results that are known before anything runs.
    pub(super) known: Known,
    /// How many nodes have a task.
    active: usize,
}

/// What an evaluation does with a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Task {
    /// Nothing: its result is known, or nobody needs it.
    None,
    /// It is not what it was, or hangs on one that is not: it may have to be computed.
    Look,
    /// Its result is known, but its values are needed and gone.
    Restore,
    /// Its result is known, but it is computed to compare the result.
    Verify,
}

/// The results of nodes that are computed from the same as the last time.
pub(super) enum Known {
    /// Nothing changed: what the last evaluation found.
    All(Arc<Snapshot>),
    /// The result of each node, if it is known.
    Some(Vec<Option<Arc<Done>>>),
}

impl Known {
    pub(super) fn get(&self, index: usize) -> Option<&Arc<Done>> {
        match self {
            Self::All(snapshot) => snapshot.current(index),
            Self::Some(results) => results[index].as_ref(),
        }
    }

    /// What is known after the nodes that have a task were visited: each node's last result, of this evaluation or of an earlier
    /// one of the graph.
    pub(super) fn after(
        self,
        visited: Visited,
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
        // Where one gave another result than was known, others may have been computed from the old one.
        let mut agree = true;
        for (index, done) in visited {
            if let (Some(before), Some(done)) = (&results[index], &done) {
                agree &= done.outcome.equals(&before.outcome);
            }
            results[index] = done;
        }
        let mut found: Vec<_> = results.iter().map(Option::is_some).collect();
        let (name, shape) = (&graph.source().name, graph.shape());
        if let Some(last) = last.filter(|last| last.graph == *name) {
            for (index, result) in results.iter_mut().enumerate().filter(|(_, it)| it.is_none()) {
                *result = last.before(&shape.names[index], index).cloned();
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
            found,
            places: OnceLock::new(),
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
        let wanted: Arc<[bool]> = graph.shape().needed_by(roots).into();
        let known = evaluator.known(graph, &wanted);
        let mut tasks = vec![Task::None; wanted.len()];
        for index in (0..wanted.len()).filter(|&index| wanted[index]) {
            tasks[index] = match known.get(index) {
                None => Task::Look,
                Some(done) if evaluator.verifies(done.key) => Task::Verify,
                Some(_) => Task::None,
            };
        }
        // Backwards, so that what a restored node needs is met after it.
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
                graph.shape().sources(index).for_each(|node| needed[node] = true);
            }
        }
        let active = tasks.iter().filter(|task| **task != Task::None).count();
        Self { wanted, tasks, known, active }
    }

    pub(super) fn has_work(&self) -> bool {
        0 < self.active
    }

    /// How many of the wanted nodes have no task.
    pub(super) fn unchanged(&self) -> usize {
        self.wanted.iter().filter(|wanted| **wanted).count() - self.active
    }
}

impl Evaluator {
    /// The results of the wanted nodes that are computed from the same as the last time: a result is true for ever, so only
    /// what it was computed from is compared.
    fn known(&self, graph: &Graph, wanted: &[bool]) -> Known {
        let Some(last) = &self.last else { return Known::Some(vec![None; wanted.len()]) };
        if self.nothing_changed(last, graph, wanted) {
            return Known::All(last.clone());
        }
        let shape = graph.shape();
        let mut results: Vec<Option<Arc<Done>>> = vec![None; wanted.len()];
        // The nodes that are as they were in the last evaluation, and hang on such alone: there each was computed from what the others gave.
        let mut same = vec![false; wanted.len()];
        for index in (0..wanted.len()).filter(|&index| wanted[index]) {
            let known = match last
                .same(graph, index)
                .filter(|_| shape.sources(index).all(|source| same[source]))
            {
                Some(done)
                    if !shape.reads_files(index) || self.has_files(&done.parts, graph, index) =>
                {
                    same[index] = true;
                    Some(done)
                }
                _ => last
                    .before(&shape.names[index], index)
                    .filter(|done| self.is_computed_from(&done.parts, graph, index, &results)),
            };
            results[index] = known.cloned();
        }
        Known::Some(results)
    }

    /// The same graph, nothing wanted that the last evaluation did not find, and no other file: then everything is as it was.
    fn nothing_changed(&self, last: &Snapshot, graph: &Graph, wanted: &[bool]) -> bool {
        let same = last.shape == graph.shape().identity;
        let mut readers = graph.shape().readers.iter().filter(|&&index| wanted[index]);
        same && wanted.iter().zip(&last.found).all(|(wanted, found)| found | !wanted)
            && readers.all(|&index| {
                last.current(index).is_some_and(|done| self.has_files(&done.parts, graph, index))
            })
    }

    /// Whether a node would be computed from these parts, as far as the results before it are known.
    fn is_computed_from(
        &self,
        parts: &Parts,
        graph: &Graph,
        index: usize,
        results: &[Option<Arc<Done>>],
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

    /// Whether a node's files are known, without reading them, to be these.
    fn has_files(&self, parts: &Parts, graph: &Graph, index: usize) -> bool {
        let files = graph.nodes()[index].files.iter();
        files.map(|file| self.files.look(&file.path)).eq(parts.files.iter().map(|hash| Some(*hash)))
    }

    /// Whether a result's values can be had without computing them.
    fn has_values(&self, done: &Done) -> bool {
        done.outcome.has_values() || self.known_results().is_some_and(|disk| disk.has(done.key))
    }

    /// Returns true if the cached result of this key is to be computed and compared.
    pub(super) fn verifies(&self, key: Hash) -> bool {
        let [a, b, ..] = key.0;
        self.is_verifying()
            && f64::from(u16::from_le_bytes([a, b])) < self.verify * 65536.0
            && !lock(&self.verified).contains(&key)
    }
}
