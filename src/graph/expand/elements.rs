//! Expands each `ForEach` whose number of elements is unknown when the file is read.

use std::collections::HashSet;

use maquette_syntax::error::code;

use super::{
    Expansion, Instance, MAX_NODES, NewNode, RepeatedValues, Scope, Target, Values, link_targets,
};
use crate::dangling_names::{element_count_text, missing_element};
use crate::definition::{Definition, ElementCount, Elements, ParsedNode, Pick, Repeat};
use crate::flat::{Count, Loop};
use crate::for_each::{element_name, number_field};
use crate::header::{field_of, name_of};
use crate::stage::{elements_node, failing_node};
use crate::{GraphUse, Link};

impl Expansion<'_, '_> {
    /// Adds the node that splits data into elements. It has one output per element, or one output for an example.
    pub(super) fn expand_elements(
        &mut self,
        definition: &Definition,
        parsed: &ParsedNode,
        elements: &Elements,
        scope: &Scope,
        values: &Values,
    ) -> Vec<Target> {
        let name = format!("{}{}", scope.prefix, elements.each);
        let most = self.with_check(definition, scope, |check| {
            check.max_elements(elements.max_elements.as_ref(), scope.values(definition))
        });
        let (Some(most), Some(link)) = (most, parsed.links.first()) else { return Vec::new() };
        let count = self.counts.get(&name);
        let built = elements_node(elements, most, count, &link.text, &parsed.tree);
        let targets = link_targets(parsed, 0, values).into_iter();
        let links = targets.map(|(node, output)| Link { port: "over".into(), node, output });
        let is_open = !matches!(count, Some(Count::Of(_)));
        let count = if let Some(Count::Of(count)) = count { *count } else { 1 };
        let (links, outputs) = (links.collect(), vec!["value"; count]);
        let new_node =
            NewNode { name: Instance::default().name(parsed, scope), built, links, outputs };
        let node = self.push_node(definition, parsed, new_node, scope);
        self.loops.push(Loop { name, node, is_open });
        (0..count).map(|output| (node, output)).collect()
    }

    /// Adds the elements of a repeated node. If their number is unknown, adds one example element.
    pub(super) fn expand_repeated(
        &mut self,
        definition: &Definition,
        parsed: &ParsedNode,
        repeat: &Repeat,
        scope: &Scope,
        values: &Values,
    ) -> RepeatedValues {
        let name = format!("{}{}", scope.prefix, parsed.name.text);
        let (count, data) = match &repeat.count {
            ElementCount::Data(elements, port) => {
                let is_known = matches!(self.counts.get(&name), Some(Count::Of(_)));
                let data = &values.first_targets[*elements];
                (is_known.then_some(data.len()), Some((port, data)))
            }
            ElementCount::Number(_) => {
                let own = scope.values(definition);
                let count =
                    self.with_check(definition, scope, |check| check.element_count(repeat, own));
                (Some(count.unwrap_or(0)), None)
            }
        };
        let outputs: Vec<_> = parsed.what.outputs().into_iter().map(str::to_owned).collect();
        let carried = repeat.carry.iter().filter_map(|(port, _)| {
            Some((port, outputs.iter().position(|output| output == port)?))
        });
        let carried = Vec::from_iter(carried);
        let is_data = data.is_some() && count.is_some();
        let mut elements: Vec<Vec<Target>> = Vec::new();
        let (expected, known) = (self.expect.len(), self.world.diagnostics.len());
        for index in 0..count.unwrap_or(1) {
            if !is_data && self.count_and_check(definition, parsed, scope) {
                break;
            }
            let text = match count {
                Some(_) => element_name(&parsed.name.text, index),
                None => format!("{}/*", parsed.name.text),
            };
            let element = data
                .as_ref()
                .and_then(|(port, data)| Some(((*port).clone(), data.get(index).copied()?)));
            let mut links = Vec::from_iter(element);
            if let Some(before) = elements.last() {
                links.extend(carried.iter().filter_map(|(port, output)| {
                    Some((field_of(port), before.get(*output).copied()?))
                }));
            }
            let number = repeat.number.as_ref().map(|name| number_field(name, index + 1));
            let one = Instance { name: Some(text), links, number };
            elements.push(match is_data {
                true => self.expand_data_element(definition, parsed, &one, scope, values),
                false => self.expand_instance(definition, parsed, &one, scope, values),
            });
        }
        // The elements differ only in their numbers. If several have an error at the same position, report it once.
        let found = self.world.diagnostics.split_off(known);
        let mut seen = HashSet::new();
        self.world.diagnostics.extend(
            found.into_iter().filter(|it| seen.insert((it.source.name.clone(), it.span, it.code))),
        );
        let expected = self.expect[expected..].iter_mut();
        expected.for_each(|it| it.is_example |= count.is_none());
        fn first_value(
            port: &String,
            parsed: &ParsedNode,
            values: &Values,
        ) -> Option<(usize, usize)> {
            let link = parsed.links.iter().position(|link| name_of(&link.port) == *port)?;
            link_targets(parsed, link, values).first().copied()
        }
        let given = (0..outputs.len()).map(|output| {
            let mut all = elements.iter().filter_map(|element| element.get(output).copied());
            match carried.iter().find(|(_, carried)| *carried == output) {
                // Without elements, an output that is passed from element to element has the value of the corresponding input.
                Some((port, _)) => all
                    .next_back()
                    .or_else(|| first_value(port, parsed, values))
                    .into_iter()
                    .collect(),
                None => all.collect(),
            }
        });
        let given = Vec::from_iter(given);
        let inputs = (0..parsed.links.len()).filter_map(|link| {
            let target = link_targets(parsed, link, values).first().copied()?;
            Some((parsed.links[link].port.clone(), target))
        });
        let inputs = inputs.collect();
        let (kind, is_open) = (format!("ForEach({})", parsed.what.kind()), count.is_none());
        let named = outputs.into_iter().zip(given.iter().cloned()).collect();
        self.uses.push(GraphUse { name, kind, inputs, outputs: named, is_open });
        RepeatedValues { elements, outputs: given, is_open }
    }

    /// Adds one element of a `ForEach` over data. Its number may cause an error that was unknown when the graph was read. The node of this
    /// element then fails during evaluation.
    fn expand_data_element(
        &mut self,
        definition: &Definition,
        parsed: &ParsedNode,
        one: &Instance,
        scope: &Scope,
        values: &Values,
    ) -> Vec<Target> {
        let (diagnostics, uses, loops) =
            (self.world.diagnostics.len(), self.uses.len(), self.loops.len());
        let (nodes, expect) = (self.nodes.len(), self.expect.len());
        let given = match self.count_and_check(definition, parsed, scope) {
            true => Vec::new(),
            false => self.expand_instance(definition, parsed, one, scope, values),
        };
        let too_many =
            (self.count > MAX_NODES).then(|| format!("the graph has more than {MAX_NODES} nodes"));
        let found =
            self.world.diagnostics.drain(diagnostics..).next().map(|diagnostic| diagnostic.message);
        let Some(why) = too_many.or(found) else { return given };
        self.nodes.truncate(nodes);
        self.uses.truncate(uses);
        self.loops.truncate(loops);
        self.expect.truncate(expect);
        self.push_failing_node(definition, parsed, one.name(parsed, scope), why, scope)
    }

    /// Adds a node that fails, instead of the parsed node.
    fn push_failing_node(
        &mut self,
        definition: &Definition,
        parsed: &ParsedNode,
        name: String,
        why: String,
        scope: &Scope,
    ) -> Vec<Target> {
        let outputs = vec!["value"; parsed.types.len()];
        let built = failing_node(why, &parsed.tree);
        let new_node = NewNode { name, built, links: Vec::new(), outputs };
        let node = self.push_node(definition, parsed, new_node, scope);
        (0..parsed.types.len()).map(|output| (node, output)).collect()
    }

    /// Returns the outputs of one element, to which a link such as `spots/2` refers by number.
    pub(super) fn expand_pick(
        &mut self,
        definition: &Definition,
        parsed: &ParsedNode,
        pick: &Pick,
        scope: &Scope,
        values: &Values,
    ) -> Vec<Target> {
        let Some(of) = values.repeated.get(&pick.of) else { return Vec::new() };
        let place = if of.is_open { Some(0) } else { pick.number.checked_sub(1) };
        if let Some(found) = place.and_then(|place| of.elements.get(place)) {
            return found.clone();
        }
        let repeated = &definition.parsed_nodes[pick.of];
        let (each, count) = (&repeated.name.text, of.elements.len());
        if let Some(Repeat { count: ElementCount::Number(_), .. }) = &repeated.repeat {
            self.with_check(definition, scope, |check| {
                let (message, help) = missing_element(&parsed.name.text, each, count);
                check.report(code::UNKNOWN_LINK, parsed.name.span, message, help);
            });
            return Vec::new();
        }
        let name = Instance::default().name(parsed, scope);
        let why = format!("there is no such element: {}", element_count_text(each, count));
        self.push_failing_node(definition, parsed, name, why, scope)
    }
}
