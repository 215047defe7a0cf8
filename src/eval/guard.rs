//! Tests what nodes want of values, once for each value.

use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use super::lock;
use crate::error::Error;
use crate::graph::{Graph, GraphNode, Guard};
use crate::value::{AnyValue, Hash, Offence};

/// What tests have found, by the value's hash and the property.
type Found = HashMap<(Hash, &'static str), Option<Arc<Offence>>>;

/// What tests have found so far.
#[derive(Default)]
pub(super) struct Guards(Mutex<Found>);

/// So many are remembered; then all are forgotten, and found again when they are needed.
const KEPT: usize = 100_000;

/// A value that a node must not be run on.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{wanted_by} wants {kind}[{property}], but `{link}` {what}")]
struct NotAsWanted {
    wanted_by: Arc<str>,
    kind: &'static str,
    property: &'static str,
    link: String,
    what: String,
}

impl Guards {
    /// What stands against a property of a value.
    fn offence(&self, value: &AnyValue, property: &'static str) -> Option<Arc<Offence>> {
        let key = (value.hash(), property);
        if let Some(known) = lock(&self.0).get(&key) {
            return known.clone();
        }
        let found = value.offence(property).map(Arc::new);
        let mut known = lock(&self.0);
        if KEPT <= known.len() {
            known.clear();
        }
        known.insert(key, found.clone());
        found
    }

    /// Whether a node may be run on these values.
    ///
    /// # Errors
    /// If a value is not what the node wants; the text says which elements offend.
    pub(super) fn check(
        &self,
        graph: &Graph,
        node: &GraphNode,
        inputs: &[AnyValue],
    ) -> Result<(), Error> {
        for Guard { slot, property, by } in &node.guards {
            let value = &inputs[*slot];
            if let Some(offence) = self.offence(value, property) {
                let source = &node.links[*slot];
                let link = graph.link_name(source.node, source.output);
                let (wanted_by, kind, what) = (by.clone(), value.kind().name, offence.what.clone());
                return Err(NotAsWanted { wanted_by, kind, property, link, what }.into());
            }
        }
        Ok(())
    }
}
