//! Guards: tests of properties that a node requires of its input and that the node computing this input does not promise.

use std::collections::HashSet;
use std::sync::Arc;

use maquette_node::Source as Origin;
use maquette_syntax::error::{Diagnostic, Severity, code};

use super::expected::GraphExpectation;
use super::{ELEMENTS, Graph, GraphNode, Link};
use crate::flat::Guard;

/// The index of a node, and the index of the node's output.
type Target = (usize, usize);

/// Pairs of an output and a property. All outputs of one set are known to have their property, or all are known to lack it.
type Facts<'p> = HashSet<(Target, &'p str)>;

/// The properties that the values of a flat graph are known to have or to lack before the graph is evaluated.
#[derive(Default)]
pub(super) struct KnownProperties {
    always: Facts<'static>,
    never: Facts<'static>,
}

impl KnownProperties {
    /// Determines the known properties. Adds the nodes' own requirements to their guards, and removes guards that known properties satisfy.
    /// Returns warnings about required properties that a value never has.
    pub(super) fn resolve_guards(nodes: &mut [GraphNode]) -> (Self, Vec<Diagnostic>) {
        let (mut known, mut warnings) = (Self::default(), Vec::new());
        for index in 0..nodes.len() {
            let mut guards = std::mem::take(&mut nodes[index].guards);
            for (port, property) in nodes[index].node.wants() {
                let by: Arc<str> = format!("port `{port}`").into();
                let links = nodes[index].links.iter().enumerate();
                for (slot, link) in links.filter(|(_, link)| link.port == port) {
                    if has_property(nodes, link, property) {
                        guards.push(Guard { slot, property, by: by.clone(), input: None });
                    }
                }
            }
            let node = &nodes[index];
            for guard in guards.iter().filter(|it| known.never.contains(&it.tested_property(node)))
            {
                warnings.push(never_holds_warning(nodes, node, guard));
            }
            let mut found = Vec::new();
            for (output, property, source) in node.node.promises() {
                let Some(output) = node.outputs.iter().position(|name| *name == output) else {
                    continue;
                };
                let is_kept = match source {
                    Origin::Always => true,
                    Origin::From(port) => {
                        let links = node.links.iter().enumerate();
                        let mut links = links.filter(|(_, link)| link.port == port).peekable();
                        // Without links at this port, `all` would be trivially true. A guard of this node also makes a property certain,
                        // because guards are tested before the node runs.
                        links.peek().is_some()
                            && links.all(|(slot, link)| {
                                known.always.contains(&((link.node, link.output), property))
                                    || guards
                                        .iter()
                                        .any(|it| (it.slot, it.property) == (slot, property))
                            })
                    }
                    Origin::Never => {
                        known.never.insert(((index, output), property));
                        false
                    }
                };
                found.extend(is_kept.then_some(((index, output), property)));
            }
            guards.retain(|it| !known.always.contains(&it.tested_property(node)));
            nodes[index].guards = guards;
            known.always.extend(found);
        }
        (known, warnings)
    }

    /// Removes those promises of graphs that are known to hold, because they follow from promises of the graphs' nodes. Warns about
    /// promises that cannot be kept, once for all elements of a `ForEach`.
    pub(super) fn retain_open_promises(
        &self,
        expected: &mut Vec<GraphExpectation>,
        warnings: &mut Vec<Diagnostic>,
    ) {
        let (always, never): (&Facts<'_>, &Facts<'_>) = (&self.always, &self.never);
        let (mut promised, mut reported) = (HashSet::new(), HashSet::new());
        expected.retain(|it| {
            let (Some(property), Some(target)) = (it.expectation.promised_property(), it.values[0]) else {
                return true;
            };
            let is_first = promised.insert((target, property.to_owned())) || it.of.is_none();
            if is_first && never.contains(&(target, property)) {
                let name = it.expectation.values()[0];
                let message =
                    format!("`{name}` is promised to be {property}, but the node that computes it never guarantees that");
                let diagnostic = Diagnostic { severity: Severity::Warning, ..it.diagnostic(message) };
                if reported.insert((it.source.name.clone(), it.span, diagnostic.span)) {
                    warnings.push(diagnostic);
                }
            }
            is_first && !always.contains(&(target, property))
        });
    }
}

impl Guard {
    /// Returns the output whose value the guard tests, and the tested property.
    fn tested_property(&self, node: &GraphNode) -> (Target, &'static str) {
        let Link { node, output, .. } = node.links[self.slot];
        ((node, output), self.property)
    }
}

/// Returns true if the type of the linked value defines this property.
fn has_property(nodes: &[GraphNode], link: &Link, property: &str) -> bool {
    let kind = nodes[link.node].types.get(link.output).copied().flatten();
    kind.is_some_and(|kind| kind.property(property).is_some())
}

fn never_holds_warning(nodes: &[GraphNode], node: &GraphNode, guard: &Guard) -> Diagnostic {
    let link = &node.links[guard.slot];
    let source = &nodes[link.node];
    let (kind, property) = (source.types[link.output].map_or("", |kind| kind.name), guard.property);
    let message = format!(
        "{} of `{}` wants {kind}[{property}], but `{}` never guarantees that",
        guard.by, node.name, source.name
    );
    let help = format!(
        "the command `nodes {}` shows what it promises for which parameters",
        source.kind()
    );
    node.diagnostic(Severity::Warning, code::WRONG_TYPE, message, &help)
}

impl Graph {
    /// Returns the link that refers to an output of a node.
    pub fn link_name(&self, node: usize, output: usize) -> String {
        let GraphNode { name, outputs, .. } = &self.nodes[node];
        match (name.rsplit_once('/'), outputs.len()) {
            // The node splits data into the elements of a `ForEach`. Its outputs have names such as `spots/3/spot`.
            (Some((each, port)), _) if self.nodes[node].kind() == ELEMENTS => {
                format!("{each}/{}/{port}", output + 1)
            }
            (_, 1) => name.clone(),
            _ => format!("{name}.{}", outputs[output]),
        }
    }
}
