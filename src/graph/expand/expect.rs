//! What the uses of graphs want and expect of values, in the flat graph.

use std::ops::Range;
use std::sync::Arc;

use super::{Expansion, Scope, Values};
use crate::definition::{Definition, Expecting};
use crate::expected::{Expected, Expecter};
use crate::{Guard, Wanter};

impl Expansion<'_, '_> {
    /// What a graph wants of its inputs is tested before a node inside takes them, which stand behind the `first`.
    pub(super) fn guard(&mut self, graph: &Definition, scope: &Scope, first: usize) {
        for (input, wants) in graph.wants.iter().enumerate().filter(|(_, wants)| !wants.is_empty())
        {
            let name = &graph.drafts[input].name.text;
            let by: Arc<str> = match scope.prefix.strip_suffix('/') {
                Some(prefix) => format!("input `{name}` of `{prefix}`").into(),
                None => format!("input `{name}`").into(),
            };
            let by = &by;
            let wanters = wants.iter().map(|&(property, span)| {
                let (source, span) = graph.sheet.place(span);
                (property, Arc::new(Wanter { source, span, uses: scope.uses.clone() }))
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
                    node.recipe = Arc::new(node.recipe.guarded(&Vec::from_iter(tests)));
                }
                node.guards.extend(guards);
            }
        }
    }

    /// What a graph expects of its values in this use.
    pub(super) fn expect(
        &mut self,
        definition: &Definition,
        scope: &Scope,
        inside: Range<usize>,
        values: &Values,
    ) {
        if definition.expect.is_empty() {
            return;
        }
        let target = |&(draft, output): &(usize, usize)| values.only((draft, output));
        let of = scope.prefix.strip_suffix('/').map(|name| {
            let ports = definition.ports.iter().filter_map(|port| target(port.target.as_ref()?));
            let givers = ports.map(|(node, _)| node).collect();
            (name, Expecter { uses: scope.uses.clone(), inside, givers })
        });
        fn at_border(
            word: &str,
            definition_drafts: &[crate::definition::Draft],
            definition_inputs: usize,
            definition_ports: &[crate::definition::Port],
        ) -> bool {
            let inputs = definition_drafts[..definition_inputs].iter();
            definition_ports.iter().any(|port| port.name == word)
                || inputs.map(|input| &input.name.text).any(|name| name == word)
        }
        for Expecting { expectation, span, targets } in &definition.expect {
            // Of an input that is left out nothing is expected.
            if targets.iter().flatten().any(|it| target(it).is_none()) {
                continue;
            }
            let mut expectation = expectation.clone();
            if let Some((name, _)) = &of {
                for word in expectation.values_mut() {
                    let gap = if at_border(
                        word,
                        &definition.drafts,
                        definition.inputs,
                        &definition.ports,
                    ) {
                        '.'
                    } else {
                        '/'
                    };
                    *word = format!("{name}{gap}{word}");
                }
            }
            let values = targets.iter().map(|it| it.as_ref().and_then(target)).collect();
            let (source, span) = definition.sheet.place(*span);
            let of = of.as_ref().map(|(_, of)| of.clone());
            self.expect.push(Expected { expectation, values, source, span, of, is_example: false });
        }
    }
}
