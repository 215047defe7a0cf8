//! The last known results of a graph's nodes, each with the parts from which it was computed.

use std::collections::{HashMap, HashSet};
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use maquette_graph::Graph;
use maquette_value::Hash;

use super::cache::Outcome;
use super::disk::Disk;
use super::key::Parts;

/// A result with its key. A result never becomes invalid, because the key covers everything from which it was computed.
pub(super) struct NodeRecord {
    pub(super) parts: Parts,
    pub(super) key: Hash,
    pub(super) outcome: Arc<Outcome>,
}

/// The nodes that an evaluation has visited, each with its result, or `None` if it has no result.
pub(super) type VisitedNodes = Vec<(usize, Option<Arc<NodeRecord>>)>;

/// The last results of a graph's nodes, in the order of the graph.
pub(super) struct Snapshot {
    /// The path of the graph file.
    pub(super) graph: PathBuf,
    /// The identity of the graph's topology.
    pub(super) shape: Hash,
    /// The identities of the graph's nodes; empty if they are unknown.
    pub(super) identities: Arc<[Hash]>,
    /// The names of the nodes. They are followed by the names of elements that this version of the graph does not list: elements of a
    /// `ForEach` over data.
    pub(super) names: Arc<[String]>,
    pub(super) results: Vec<Option<Arc<NodeRecord>>>,
    /// For each node, true if the last evaluation requested the node and the node has a result.
    pub(super) is_current: Vec<bool>,
    /// The index of each name. Computed when it is first needed.
    pub(super) positions: OnceLock<HashMap<String, usize>>,
}

impl Snapshot {
    /// Returns the result of a node in the last evaluation.
    pub(super) fn current(&self, index: usize) -> Option<&Arc<NodeRecord>> {
        self.results[index].as_ref().filter(|_| self.is_current[index])
    }

    /// Returns the result of a node in the last evaluation, if the graph still has a node with the same recipe and links at this index.
    pub(super) fn current_if_unchanged(
        &self,
        graph: &Graph,
        index: usize,
    ) -> Option<&Arc<NodeRecord>> {
        let identity = self.identities.get(index)?;
        self.current(index).filter(|_| *identity == graph.topology().identities[index])
    }

    /// Writes those results to disk that were computed while writing to disk was turned off.
    pub(super) fn save_unsaved(&self, disk: &Disk) {
        for done in self.results.iter().flatten().filter(|done| done.outcome.take_unsaved()) {
            if let Some(values) = done.outcome.values() {
                disk.keep(done.key, &done.parts.recipe.kind, &done.outcome, &values, true);
            }
        }
    }

    /// Returns the last result of the node with this name. `near` is the probable index of the node.
    pub(super) fn last_result(&self, name: &str, near: usize) -> Option<&Arc<NodeRecord>> {
        let index = match self.names.get(near) {
            Some(there) if there == name => near,
            _ => *self.positions().get(name)?,
        };
        self.results[index].as_ref()
    }

    /// Returns the results of elements that the graph does not list at present, because their `ForEach` has not been expanded. These
    /// results stay valid.
    pub(super) fn elements(
        &self,
        graph: &Graph,
    ) -> impl Iterator<Item = (String, Arc<NodeRecord>)> {
        let is_open = graph.loops().iter().any(|it| it.is_open);
        let names = is_open.then(|| HashSet::<&String>::from_iter(graph.topology().names.iter()));
        let known = self.names.iter().zip(&self.results).filter(move |(name, _)| {
            names.as_ref().is_some_and(|names| !names.contains(name))
                && graph.open_loop(name).is_some()
        });
        known.filter_map(|(name, done)| Some((name.clone(), done.clone()?)))
    }

    fn positions(&self) -> &HashMap<String, usize> {
        let names = self.names.iter().enumerate();
        self.positions.get_or_init(|| names.map(|(index, name)| (name.clone(), index)).collect())
    }
}
