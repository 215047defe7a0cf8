//! What evaluations found of a graph: for each node what it was last computed from, and what came out.

use std::collections::{HashMap, HashSet};
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use maquette_graph::Graph;
use maquette_value::Hash;

use super::cache::Outcome;
use super::disk::Disk;
use super::key::Parts;

/// A result, and what it was computed from: true whatever becomes of the graph and its files.
pub(super) struct Done {
    pub(super) parts: Parts,
    pub(super) key: Hash,
    pub(super) outcome: Arc<Outcome>,
}

/// Nodes that an evaluation visited, each with its result; none if it has none.
pub(super) type Visited = Vec<(usize, Option<Arc<Done>>)>;

/// The last results of a graph's nodes, in its order.
pub(super) struct Snapshot {
    /// The graph's file.
    pub(super) graph: PathBuf,
    /// The identity of its shape.
    pub(super) shape: Hash,
    /// The identities of its nodes; empty if they are not known.
    pub(super) identities: Arc<[Hash]>,
    /// The nodes' names, and behind them those of elements that the graph had when its data were taken apart.
    pub(super) names: Arc<[String]>,
    pub(super) results: Vec<Option<Arc<Done>>>,
    /// The nodes that the last evaluation wanted and has the results of.
    pub(super) found: Vec<bool>,
    /// The places of the names, once somebody asked for one.
    pub(super) places: OnceLock<HashMap<String, usize>>,
}

impl Snapshot {
    /// What the last evaluation found of a node.
    pub(super) fn current(&self, index: usize) -> Option<&Arc<Done>> {
        self.results[index].as_ref().filter(|_| self.found[index])
    }

    /// The same, if the graph has the node at the same place, of the same recipe and links.
    pub(super) fn same(&self, graph: &Graph, index: usize) -> Option<&Arc<Done>> {
        let identity = self.identities.get(index)?;
        self.current(index).filter(|_| *identity == graph.shape().identities[index])
    }

    /// Puts results on disk that were made while nothing was to be put there.
    pub(super) fn settle(&self, disk: &Disk) {
        for done in self.results.iter().flatten().filter(|done| done.outcome.settle()) {
            if let Some(values) = done.outcome.values() {
                disk.keep(done.key, &done.parts.recipe.kind, &done.outcome, &values, true);
            }
        }
    }

    /// The last result of the node of that name, which most likely stands at the place `near`.
    pub(super) fn before(&self, name: &str, near: usize) -> Option<&Arc<Done>> {
        let index = match self.names.get(near) {
            Some(there) if there == name => near,
            _ => *self.places().get(name)?,
        };
        self.results[index].as_ref()
    }

    /// The results of elements of data that a graph does not go over for now: who looks at another node of it, or has not taken the data
    /// apart yet, knows no less of them.
    pub(super) fn elements(&self, graph: &Graph) -> impl Iterator<Item = (String, Arc<Done>)> {
        let is_open = graph.loops().iter().any(|it| it.is_open);
        let names = is_open.then(|| HashSet::<&String>::from_iter(graph.shape().names.iter()));
        let known = self.names.iter().zip(&self.results).filter(move |(name, _)| {
            names.as_ref().is_some_and(|names| !names.contains(name))
                && graph.open_loop(name).is_some()
        });
        known.filter_map(|(name, done)| Some((name.clone(), done.clone()?)))
    }

    fn places(&self) -> &HashMap<String, usize> {
        let names = self.names.iter().enumerate();
        self.places.get_or_init(|| names.map(|(index, name)| (name.clone(), index)).collect())
    }
}
