//! Tests what nodes want of values, once for each value.

use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use maquette_graph::{Graph, GraphNode, Guard};
use maquette_syntax::error::{Error, Problem, Severity, code};
use maquette_value::{AnyValue, Hash, Offence};

use super::lock;

/// What tests have found, by the value's hash and the property.
type Found = HashMap<(Hash, &'static str), Option<Arc<Offence>>>;

/// What tests have found so far.
#[derive(Default)]
pub(super) struct Guards(Mutex<Found>);

/// So many are remembered; then all are forgotten, and found again when they are needed.
const KEPT: usize = 100_000;

/// So many offending elements are remembered of each value.
const TOLD: usize = 100;

/// A value that a node must not be run on.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{} wants {kind}[{}], but `{link}` {}", guard.by, guard.property, offence.what)]
pub(super) struct NotAsWanted {
    guard: Guard,
    kind: &'static str,
    link: String,
    offence: Arc<Offence>,
    /// What looks at the value.
    command: String,
}

impl NotAsWanted {
    /// The problem of a node that was not run: at the use of a graph if its input wants more, else at the node.
    pub(super) fn problem(&self, node: &GraphNode) -> Problem {
        let elements = self.offence.elements.iter();
        let elements = elements.map(|it| (it.name.clone(), it.place().coords.into())).collect();
        let look = (0 < self.offence.count)
            .then(|| format!("`{} --out look.png` lists and marks them", self.command));
        let look = look.unwrap_or_default();
        if let Some(input) = &self.guard.input {
            return Problem { elements, ..input.problem(self.to_string(), look) };
        }
        let message = format!("`{}` cannot be computed: {self}", node.name);
        Problem { elements, ..node.problem(Severity::Error, code::FAILED, message, &look) }
    }
}

impl Guards {
    /// What stands against a property of a value.
    fn offence(&self, value: &AnyValue, property: &'static str) -> Option<Arc<Offence>> {
        let key = (value.hash(), property);
        if let Some(known) = lock(&self.0).get(&key) {
            return known.clone();
        }
        let found = value.offence(property).map(|mut offence| {
            offence.elements.truncate(TOLD);
            Arc::new(offence)
        });
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
        for guard in &node.guards {
            let value = &inputs[guard.slot];
            if let Some(offence) = self.offence(value, guard.property) {
                let source = &node.links[guard.slot];
                let link = graph.link_name(source.node, source.output);
                let (guard, kind) = (guard.clone(), value.kind().name);
                let command = graph.command("inspect", &link);
                return Err(NotAsWanted { guard, kind, link, offence, command }.into());
            }
        }
        Ok(())
    }
}
