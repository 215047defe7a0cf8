//! What an evaluation found: for each node what it was computed from, and what came out.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use super::cache::Outcome;
use super::key::Parts;
use crate::graph::Shape;
use crate::value::Hash;

/// A node's result, and what it was computed from.
pub(super) struct Done {
    pub(super) parts: Parts,
    pub(super) key: Hash,
    pub(super) outcome: Arc<Outcome>,
}

/// What became of a node.
#[derive(Clone, Default)]
pub(super) enum Fate {
    /// It was never wanted, or never succeeded.
    #[default]
    Unknown,
    /// It failed or was not reached; this is from an earlier evaluation.
    Stale(Arc<Done>),
    Current(Arc<Done>),
}

/// The nodes of a graph, in its order, and what became of each.
pub(super) struct Snapshot {
    pub(super) shape: Arc<Shape>,
    pub(super) fates: Vec<Fate>,
    places: OnceLock<HashMap<String, usize>>,
}

impl Snapshot {
    pub(super) fn new(shape: Arc<Shape>, fates: Vec<Fate>) -> Self {
        Self { shape, fates, places: OnceLock::new() }
    }

    /// What is known after an evaluation of a graph of this shape that found this of some of its nodes; the others are as they
    /// were.
    pub(super) fn after(
        last: Option<Arc<Self>>,
        shape: &Arc<Shape>,
        found: Vec<(usize, Fate)>,
    ) -> Arc<Self> {
        if let Some(last) =
            last.as_ref().filter(|last| found.is_empty() && Arc::ptr_eq(&last.shape, shape))
        {
            return last.clone();
        }
        let fates = match last.map(Arc::try_unwrap) {
            None => Vec::new(),
            // Nobody else looks at it.
            Some(Ok(last)) => last.fates,
            Some(Err(last)) => last.fates.clone(),
        };
        let mut snapshot = Self::new(shape.clone(), fates);
        snapshot.fates.resize(shape.names.len(), Fate::Unknown);
        for (index, fate) in found {
            snapshot.fates[index] = fate;
        }
        Arc::new(snapshot)
    }

    /// The node's result of the last evaluation.
    pub(super) fn current(&self, index: usize) -> Option<&Arc<Done>> {
        match &self.fates[index] {
            Fate::Current(done) => Some(done),
            _ => None,
        }
    }

    /// The last result of the node of that name, which most likely stands at the place `near`.
    pub(super) fn before(&self, name: &str, near: usize) -> Option<&Arc<Done>> {
        let names = &self.shape.names;
        let index = match names.get(near) {
            Some(there) if there == name => near,
            _ => *self.places().get(name)?,
        };
        match &self.fates[index] {
            Fate::Unknown => None,
            Fate::Stale(done) | Fate::Current(done) => Some(done),
        }
    }

    fn places(&self) -> &HashMap<String, usize> {
        let names = self.shape.names.iter().enumerate();
        self.places.get_or_init(|| names.map(|(index, name)| (name.clone(), index)).collect())
    }
}
