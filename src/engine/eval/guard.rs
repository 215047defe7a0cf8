//! Checks that input values have the properties that nodes require. Each pair of value and property is checked once.

use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use maquette_graph::{Graph, GraphNode, Guard};
use maquette_syntax::error::{Diagnostic, Error, Severity, code};
use maquette_value::{AnyValue, Hash, Violation};

use super::lock;

/// The result of each check, by the hash of the value and the name of the property. `None` means that the value has the property.
type CheckResults = HashMap<(Hash, &'static str), Option<Arc<Violation>>>;

/// The results of the checks that an evaluator has made.
#[derive(Default)]
pub(super) struct Guards(Mutex<CheckResults>);

/// The maximum number of stored check results. When it is reached, all are dropped; the checks are repeated when needed.
const MAX_RESULTS: usize = 100_000;

/// The maximum number of violating elements that are kept per value.
const MAX_ELEMENTS: usize = 100;

/// The error that an input value lacks a property that the node requires.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{} wants {kind}[{}], but `{link}` {}", guard.by, guard.property, violation.what)]
pub(super) struct UnmetRequirement {
    guard: Guard,
    kind: &'static str,
    link: String,
    violation: Arc<Violation>,
    /// The command line that shows the violating elements to the user.
    command: String,
}

impl UnmetRequirement {
    /// Returns the error for `node`, which was not run. If an input of a used graph requires the property, the error is reported where that
    /// graph is used. Otherwise it is reported at the node.
    pub(super) fn diagnostic(&self, node: &GraphNode) -> Diagnostic {
        let elements = self.violation.elements.iter();
        let elements = elements.map(|it| (it.name.clone(), it.center().coords.into())).collect();
        let look = (0 < self.violation.count)
            .then(|| format!("`{} --out look.png` lists and marks them", self.command));
        let look = look.unwrap_or_default();
        if let Some(input) = &self.guard.input {
            return Diagnostic { elements, ..input.diagnostic(self.to_string(), look) };
        }
        let message = format!("`{}` cannot be computed: {self}", node.name);
        Diagnostic { elements, ..node.diagnostic(Severity::Error, code::FAILED, message, &look) }
    }
}

impl Guards {
    /// Checks if a value has a property. Returns its violation, or `None` if it has the property.
    fn violation(&self, value: &AnyValue, property: &'static str) -> Option<Arc<Violation>> {
        let key = (value.hash(), property);
        if let Some(known) = lock(&self.0).get(&key) {
            return known.clone();
        }
        let found = value.violation(property).map(|mut violation| {
            violation.elements.truncate(MAX_ELEMENTS);
            Arc::new(violation)
        });
        let mut known = lock(&self.0);
        if MAX_RESULTS <= known.len() {
            known.clear();
        }
        known.insert(key, found.clone());
        found
    }

    /// Checks that the inputs of a node have the properties that the node requires.
    ///
    /// # Errors
    /// If a value lacks a property; the message lists the violating elements.
    pub(super) fn check(
        &self,
        graph: &Graph,
        node: &GraphNode,
        inputs: &[AnyValue],
    ) -> Result<(), Error> {
        for guard in &node.guards {
            let value = &inputs[guard.slot];
            if let Some(violation) = self.violation(value, guard.property) {
                let source = &node.links[guard.slot];
                let link = graph.link_name(source.node, source.output);
                let (guard, kind) = (guard.clone(), value.kind().name);
                let command = graph.command("inspect", &link);
                return Err(UnmetRequirement { guard, kind, link, violation, command }.into());
            }
        }
        Ok(())
    }
}
