//! The last known results of a graph's nodes. Each has the parts from which it was computed.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use maquette_graph::Graph;
use maquette_value::Hash;

use super::State;
use super::cache::Outcome;
use super::disk::{Disk, MIN_SECONDS_TO_KEEP};
use super::key::Parts;
use super::run::NodeEvent;
use super::timing::{NOTE, Timings, bytes_of_files};

/// A result of a node with its key. The result never becomes invalid, because the key covers everything from which it was computed.
pub(super) struct NodeRecord {
    pub(super) parts: Parts,
    pub(super) key: Hash,
    pub(super) outcome: Arc<Outcome>,
}

/// The nodes that an evaluation has visited, by index. The result is `None` if the node failed or was not run.
pub(super) type VisitedNodes = Vec<(usize, Option<Arc<NodeRecord>>)>;

/// The last results of a graph's nodes, in the order of the graph.
pub(super) struct Snapshot {
    /// The path of the graph file.
    pub(super) graph: PathBuf,
    /// A hash of the names, recipes and links of all nodes of the graph.
    pub(super) shape: Hash,
    /// For each node, a hash of its name, recipe and links. Empty if these hashes are unknown.
    pub(super) identities: Arc<[Hash]>,
    /// The names of the nodes. After them come the names of loop elements that the graph does not list, because their `ForEach` over data
    /// is not expanded.
    pub(super) names: Arc<[String]>,
    pub(super) results: Vec<Option<Arc<NodeRecord>>>,
    /// For each node, true if the last evaluation requested the node and the node has a result.
    pub(super) is_current: Vec<bool>,
    /// The index of each name in `names`, computed when it is first needed.
    pub(super) positions: OnceLock<HashMap<String, usize>>,
}

impl Snapshot {
    /// Stores the times of the nodes that an evaluation has computed. Times below a millisecond say little and are left out.
    pub(super) fn keep_timings(&self, events: &[NodeEvent], graph: &Graph, disk: &Disk) {
        let slow = events
            .iter()
            .filter(|event| event.state == State::Computed && event.seconds > MIN_SECONDS_TO_KEEP);
        let timed: Vec<_> = slow
            .filter_map(|event| {
                let node = &graph.nodes()[event.index];
                let inputs: f64 = node
                    .links
                    .iter()
                    .filter_map(|link| self.current(link.node)?.outcome.sizes.get(link.output))
                    .map(|size| size.bytes)
                    .sum();
                let made = self.current(event.index)?.outcome.bytes as f64;
                Some((node.kind(), inputs + made + bytes_of_files(node), event.seconds))
            })
            .collect();
        if timed.is_empty() || disk.write_error().is_some() {
            return;
        }
        let note = Path::new(NOTE);
        let mut timings = Timings::read(disk.note(note));
        timed.into_iter().for_each(|(kind, work, seconds)| timings.insert(kind, work, seconds));
        disk.keep_note(note, serde_json::to_vec(&timings).unwrap_or_default(), Vec::new());
    }

    /// Returns the result that the node got in the last evaluation, or `None` if it was not requested or failed.
    pub(super) fn current(&self, index: usize) -> Option<&Arc<NodeRecord>> {
        self.results[index].as_ref().filter(|_| self.is_current[index])
    }

    /// Returns the result that the node got in the last evaluation. Returns `None` if there is no such result, or if the node's name,
    /// recipe or links have changed since.
    pub(super) fn current_if_unchanged(
        &self,
        graph: &Graph,
        index: usize,
    ) -> Option<&Arc<NodeRecord>> {
        let identity = self.identities.get(index)?;
        self.current(index).filter(|_| *identity == graph.topology().identities[index])
    }

    /// Writes results to disk that were computed while writing to disk was turned off.
    pub(super) fn save_unsaved(&self, disk: &Disk) {
        for done in self.results.iter().flatten().filter(|done| done.outcome.take_unsaved()) {
            if let Some(values) = done.outcome.values() {
                disk.keep(done.key, &done.parts.recipe.kind, &done.outcome, &values, true);
            }
        }
    }

    /// Returns the last result of the node with this name, or `None` if no result is known. `near` is a guess of the node's index, which
    /// makes the search faster.
    pub(super) fn last_result(&self, name: &str, near: usize) -> Option<&Arc<NodeRecord>> {
        let index = match self.names.get(near) {
            Some(there) if there == name => near,
            _ => *self.positions().get(name)?,
        };
        self.results[index].as_ref()
    }

    /// Returns the results of loop elements that the graph does not list, because the `ForEach` loops that contain them are not expanded.
    /// The results of such elements stay valid.
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
