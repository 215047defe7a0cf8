//! Which values are tested for what before nodes run on them: what is wanted and nobody promises.

use std::collections::HashSet;
use std::sync::Arc;

use maquette_node::Source as Origin;
use maquette_syntax::error::{Problem, Severity, code};

use super::expected::Expected;
use super::{ELEMENTS, Graph, GraphNode, Link};
use crate::flat::Guard;

/// A node and one of its outputs.
type Target = (usize, usize);

/// Outputs and properties.
type Facts<'p> = HashSet<(Target, &'p str)>;

/// What is known of the values of a flat graph before it runs.
#[derive(Default)]
pub(super) struct Known {
    always: Facts<'static>,
    never: Facts<'static>,
}

impl Known {
    /// Finds out what is known, adds what nodes themselves want to their guards, and takes away what need not be tested. Warns of what is
    /// wanted and never given.
    pub(super) fn settle(nodes: &mut [GraphNode]) -> (Self, Vec<Problem>) {
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
            fn target(slot: usize, node_links: &[Link]) -> (usize, usize) {
                (node_links[slot].node, node_links[slot].output)
            }
            for guard in guards
                .iter()
                .filter(|it| known.never.contains(&(target(it.slot, &node.links), it.property)))
            {
                warnings.push(never(nodes, node, guard));
            }
            // On what it is run has been tested by then.
            fn holds(
                slot: usize,
                property: &'static str,
                guards: &[Guard],
                known_always: &HashSet<((usize, usize), &'static str)>,
                node_links: &[Link],
            ) -> bool {
                known_always.contains(&(target(slot, node_links), property))
                    || guards.iter().any(|it| (it.slot, it.property) == (slot, property))
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
                        // Of nothing anything holds, but not of what is made of it.
                        links.peek().is_some()
                            && links.all(|(slot, _)| {
                                holds(slot, property, &guards, &known.always, &node.links)
                            })
                    }
                    Origin::Never => {
                        known.never.insert(((index, output), property));
                        false
                    }
                };
                found.extend(is_kept.then_some(((index, output), property)));
            }
            guards
                .retain(|it| !known.always.contains(&(target(it.slot, &node.links), it.property)));
            nodes[index].guards = guards;
            known.always.extend(found);
        }
        (known, warnings)
    }

    /// Leaves out those promises of graphs that follow from what is inside, as those of graphs that only hand one on, and warns of those
    /// that cannot be kept: once for all elements of a `ForEach`.
    pub(super) fn judge(&self, expected: &mut Vec<Expected>, warnings: &mut Vec<Problem>) {
        let (always, never): (&Facts<'_>, &Facts<'_>) = (&self.always, &self.never);
        let (mut promised, mut told) = (HashSet::new(), HashSet::new());
        expected.retain(|it| {
            let (Some(property), Some(target)) = (it.expectation.promised(), it.values[0]) else {
                return true;
            };
            let is_first = promised.insert((target, property.to_owned())) || it.of.is_none();
            if is_first && never.contains(&(target, property)) {
                let name = it.expectation.values()[0];
                let message =
                    format!("`{name}` is promised to be {property}, but what gives it never is so");
                let problem = Problem { severity: Severity::Warning, ..it.problem(message) };
                if told.insert((it.source.name.clone(), it.span, problem.span)) {
                    warnings.push(problem);
                }
            }
            is_first && !always.contains(&(target, property))
        });
    }
}

/// Whether values at a link can have the property; what has the type of what comes in somewhere may.
fn has_property(nodes: &[GraphNode], link: &Link, property: &str) -> bool {
    let kind = nodes[link.node].types.get(link.output).copied().flatten();
    kind.is_some_and(|kind| kind.property(property).is_some())
}

fn never(nodes: &[GraphNode], node: &GraphNode, guard: &Guard) -> Problem {
    let link = &node.links[guard.slot];
    let source = &nodes[link.node];
    let (kind, property) = (source.types[link.output].map_or("", |kind| kind.name), guard.property);
    let message = format!(
        "{} of `{}` wants {kind}[{property}], but `{}` never is so",
        guard.by, node.name, source.name
    );
    let help = format!(
        "the command `nodes {}` says what it promises with which parameters",
        source.kind()
    );
    node.problem(Severity::Warning, code::WRONG_TYPE, message, &help)
}

impl Graph {
    /// What a link to this output of a node would say.
    pub fn link_name(&self, node: usize, output: usize) -> String {
        let GraphNode { name, outputs, .. } = &self.nodes[node];
        match (name.rsplit_once('/'), outputs.len()) {
            // The data of one element.
            (Some((each, port)), _) if self.nodes[node].kind() == ELEMENTS => {
                format!("{each}/{}/{port}", output + 1)
            }
            (_, 1) => name.clone(),
            _ => format!("{name}.{}", outputs[output]),
        }
    }
}
