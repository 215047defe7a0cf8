//! Adds the requirements and expectations in the files of used graphs to the flat graph.

use std::ops::Range;
use std::sync::Arc;

use super::{Expansion, Scope, Values};
use crate::definition::{BoundExpectation, Definition};
use crate::expected::{ExpectingUse, GraphExpectation};
use crate::{Guard, RequiringInput};

impl Expansion<'_, '_> {
    /// Adds tests of the properties that a graph requires of its inputs. The tests are made by the nodes that take these inputs, among
    /// those with index `first` or greater.
    pub(super) fn add_guards(&mut self, graph: &Definition, scope: &Scope, first: usize) {
        for (input, wants) in graph.wants.iter().enumerate().filter(|(_, wants)| !wants.is_empty())
        {
            let name = &graph.parsed_nodes[input].name.text;
            let by: Arc<str> = match scope.prefix.strip_suffix('/') {
                Some(prefix) => format!("input `{name}` of `{prefix}`").into(),
                None => format!("input `{name}`").into(),
            };
            let by = &by;
            let wanters = wants.iter().map(|&(property, span)| {
                let (source, span) = graph.source_map.locate(span);
                (property, Arc::new(RequiringInput { source, span, uses: scope.uses.clone() }))
            });
            let wanters = &Vec::from_iter(wanters);
            for node in &mut self.nodes[first..] {
                let slots = node.links.iter().enumerate();
                let slots =
                    slots.filter(|(_, it)| Some((it.node, it.output)) == scope.inputs[input]);
                let guards = slots.flat_map(|(slot, _)| {
                    wanters.iter().map(move |(property, wanter)| {
                        let (by, input) = (by.clone(), Some(wanter.clone()));
                        Guard { slot, property, by, input }
                    })
                });
                let guards = Vec::from_iter(guards);
                if !guards.is_empty() {
                    let tests = guards.iter().map(|guard| (guard.slot, guard.property));
                    node.recipe = Arc::new(node.recipe.with_guards(&Vec::from_iter(tests)));
                }
                node.guards.extend(guards);
            }
        }
    }

    /// Adds the expectations in the file of a graph for one node that uses the graph.
    pub(super) fn add_expectations(
        &mut self,
        definition: &Definition,
        scope: &Scope,
        inside: Range<usize>,
        values: &Values,
    ) {
        if definition.expect.is_empty() {
            return;
        }
        let of = scope.prefix.strip_suffix('/').map(|name| {
            let ports =
                definition.ports.iter().filter_map(|port| values.first_target(port.target?));
            let givers = ports.map(|(node, _)| node).collect();
            (name, ExpectingUse { uses: scope.uses.clone(), inside, givers })
        });
        for BoundExpectation { expectation, span, targets } in &definition.expect {
            // An expectation about the value of an omitted input does not apply.
            if targets.iter().flatten().any(|target| values.first_target(*target).is_none()) {
                continue;
            }
            let mut expectation = expectation.clone();
            if let Some((name, _)) = &of {
                for word in expectation.values_mut() {
                    let gap = if definition.has_port_or_input(word) { '.' } else { '/' };
                    *word = format!("{name}{gap}{word}");
                }
            }
            let values = targets
                .iter()
                .map(|it| it.and_then(|target| values.first_target(target)))
                .collect();
            let (source, span) = definition.source_map.locate(*span);
            let of = of.as_ref().map(|(_, of)| of.clone());
            self.expect.push(GraphExpectation {
                expectation,
                values,
                source,
                span,
                of,
                is_example: false,
            });
        }
    }
}
