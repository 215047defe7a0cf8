//! What evaluations found of a graph: for each node what it was last computed from, and what came out.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use super::cache::Outcome;
use super::disk::Disk;
use super::key::Parts;
use crate::value::Hash;

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
    /// The nodes' names.
    pub(super) names: Arc<[String]>,
    pub(super) results: Vec<Option<Arc<Done>>>,
    /// The nodes that the last evaluation wanted and has the results of.
    pub(super) found: Vec<bool>,
    places: OnceLock<HashMap<String, usize>>,
}

impl Snapshot {
    pub(super) fn new(
        graph: PathBuf,
        (shape, names): (Hash, Arc<[String]>),
        results: Vec<Option<Arc<Done>>>,
        found: Vec<bool>,
    ) -> Self {
        Self { graph, shape, names, results, found, places: OnceLock::new() }
    }

    /// What the last evaluation found of a node.
    pub(super) fn current(&self, index: usize) -> Option<&Arc<Done>> {
        self.results[index].as_ref().filter(|_| self.found[index])
    }

    /// Puts results on disk that were made while nothing was to be put there.
    pub(super) fn settle(&self, disk: &Disk) {
        for done in self.results.iter().flatten().filter(|done| done.outcome.settle()) {
            if let Some(values) = done.outcome.values() {
                disk.keep(done.key, &done.outcome, &values, true);
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

    fn places(&self) -> &HashMap<String, usize> {
        let names = self.names.iter().enumerate();
        self.places.get_or_init(|| names.map(|(index, name)| (name.clone(), index)).collect())
    }
}
