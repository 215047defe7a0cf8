//! The elements of a `ForEach` whose number is known late, in the flat graph.

use std::collections::HashSet;

use maquette_syntax::error::code;

use super::{Elemental, Expansion, MOST, One, Put, Scope, Target, Values, linked};
use crate::definition::{Counted, Definition, Draft, Elements, Pick, Repeat};
use crate::each::{element_name, numbered};
use crate::flat::{Count, Loop};
use crate::stage::{cut_node, refused_node};
use crate::top::{field_of, name_of};
use crate::unfound::{beyond, elements};
use crate::{GraphUse, Link};

impl Expansion<'_, '_> {
    /// The node that takes data apart: an output for each element, or one for an example.
    pub(super) fn elements(
        &mut self,
        definition: &Definition,
        draft: &Draft,
        elements: &Elements,
        scope: &Scope,
        values: &Values,
    ) -> Vec<Target> {
        let name = format!("{}{}", scope.prefix, elements.each);
        let most = self.checked(definition, scope, |check| {
            check.most(elements.most.as_ref(), scope.values(definition))
        });
        let (Some(most), Some(link)) = (most, draft.links.first()) else { return Vec::new() };
        let count = self.counts.get(&name);
        let built = cut_node(elements, most, count, &link.text, &draft.tree);
        let targets = linked(draft, 0, values).into_iter();
        let links = targets.map(|(node, output)| Link { port: "over".into(), node, output });
        let is_open = !matches!(count, Some(Count::Of(_)));
        let count = if let Some(Count::Of(count)) = count { *count } else { 1 };
        let (links, outputs) = (links.collect(), vec!["value"; count]);
        let put = Put { name: One::default().name(draft, scope), built, links, outputs };
        let node = self.put(definition, draft, put, scope);
        self.loops.push(Loop { name, node, is_open });
        (0..count).map(|output| (node, output)).collect()
    }

    /// Puts the elements of a repeated draft in: as many as are known, or an example.
    pub(super) fn repeated(
        &mut self,
        definition: &Definition,
        draft: &Draft,
        repeat: &Repeat,
        scope: &Scope,
        values: &Values,
    ) -> Elemental {
        let name = format!("{}{}", scope.prefix, draft.name.text);
        let (count, data) = match &repeat.count {
            Counted::Data(elements, port) => {
                let is_known = matches!(self.counts.get(&name), Some(Count::Of(_)));
                let data = &values.single[*elements];
                (is_known.then_some(data.len()), Some((port, data)))
            }
            Counted::Number(_) => {
                let own = scope.values(definition);
                let count = self.checked(definition, scope, |check| check.how_many(repeat, own));
                (Some(count.unwrap_or(0)), None)
            }
        };
        let outputs: Vec<_> = draft.what.outputs().into_iter().map(str::to_owned).collect();
        let carried = repeat.carry.iter().filter_map(|(port, _)| {
            Some((port, outputs.iter().position(|output| output == port)?))
        });
        let carried = Vec::from_iter(carried);
        let is_data = data.is_some() && count.is_some();
        let mut elements: Vec<Vec<Target>> = Vec::new();
        let (expected, known) = (self.expect.len(), self.world.problems.len());
        for index in 0..count.unwrap_or(1) {
            if !is_data && self.is_full(definition, draft, scope) {
                break;
            }
            let text = match count {
                Some(_) => element_name(&draft.name.text, index),
                None => format!("{}/*", draft.name.text),
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
            let number = repeat.number.as_ref().map(|name| numbered(name, index + 1));
            let one = One { name: Some(text), links, number };
            elements.push(match is_data {
                true => self.one_of_data(definition, draft, &one, scope, values),
                false => self.one(definition, draft, &one, scope, values),
            });
        }
        // What is wrong at one place is so for each element, whose numbers alone differ.
        let found = self.world.problems.split_off(known);
        let mut seen = HashSet::new();
        self.world.problems.extend(
            found.into_iter().filter(|it| seen.insert((it.source.name.clone(), it.span, it.code))),
        );
        let expected = self.expect[expected..].iter_mut();
        expected.for_each(|it| it.is_example |= count.is_none());
        fn first(port: &String, draft: &Draft, values: &Values) -> Option<(usize, usize)> {
            let link = draft.links.iter().position(|link| name_of(&link.port) == *port)?;
            linked(draft, link, values).first().copied()
        }
        let given = (0..outputs.len()).map(|output| {
            let all = || elements.iter().filter_map(|element| element.get(output).copied());
            match carried.iter().find(|(_, carried)| *carried == output) {
                // Nothing is done to what is carried through no element.
                Some((port, _)) => {
                    all().next_back().or_else(|| first(port, draft, values)).into_iter().collect()
                }
                None => all().collect(),
            }
        });
        let given = Vec::from_iter(given);
        let inputs = (0..draft.links.len()).filter_map(|link| {
            let target = linked(draft, link, values).first().copied()?;
            Some((draft.links[link].port.clone(), target))
        });
        let inputs = inputs.collect();
        let (kind, is_open) = (format!("ForEach({})", draft.what.kind()), count.is_none());
        let named = outputs.into_iter().zip(given.iter().cloned()).collect();
        self.uses.push(GraphUse { name, kind, inputs, outputs: named, is_open });
        Elemental { elements, outputs: given, is_open }
    }

    /// An element of data. What is wrong with it alone, as with its number, lets it fail when it is evaluated: nobody could know when
    /// the graph was read.
    fn one_of_data(
        &mut self,
        definition: &Definition,
        draft: &Draft,
        one: &One,
        scope: &Scope,
        values: &Values,
    ) -> Vec<Target> {
        let (problems, uses, loops) =
            (self.world.problems.len(), self.uses.len(), self.loops.len());
        let (nodes, expect) = (self.nodes.len(), self.expect.len());
        let given = match self.is_full(definition, draft, scope) {
            true => Vec::new(),
            false => self.one(definition, draft, one, scope, values),
        };
        let too_many = (self.count > MOST).then(|| format!("the graph has more than {MOST} nodes"));
        let found = self.world.problems.drain(problems..).next().map(|problem| problem.message);
        let Some(why) = too_many.or(found) else { return given };
        self.nodes.truncate(nodes);
        self.uses.truncate(uses);
        self.loops.truncate(loops);
        self.expect.truncate(expect);
        self.refused(definition, draft, one.name(draft, scope), why, scope)
    }

    /// A node that fails in place of the draft.
    fn refused(
        &mut self,
        definition: &Definition,
        draft: &Draft,
        name: String,
        why: String,
        scope: &Scope,
    ) -> Vec<Target> {
        let outputs = vec!["value"; draft.types.len()];
        let built = refused_node(why, &draft.tree);
        let put = Put { name, built, links: Vec::new(), outputs };
        let node = self.put(definition, draft, put, scope);
        (0..draft.types.len()).map(|output| (node, output)).collect()
    }

    /// What the element gives that a link names by its number.
    pub(super) fn pick(
        &mut self,
        definition: &Definition,
        draft: &Draft,
        pick: &Pick,
        scope: &Scope,
        values: &Values,
    ) -> Vec<Target> {
        let Some(of) = values.repeated.get(&pick.of) else { return Vec::new() };
        let place = if of.is_open { Some(0) } else { pick.number.checked_sub(1) };
        if let Some(found) = place.and_then(|place| of.elements.get(place)) {
            return found.clone();
        }
        let repeated = &definition.drafts[pick.of];
        let (each, count) = (&repeated.name.text, of.elements.len());
        if let Some(Repeat { count: Counted::Number(_), .. }) = &repeated.repeat {
            self.checked(definition, scope, |check| {
                let (message, help) = beyond(&draft.name.text, each, count);
                check.find(code::UNKNOWN_LINK, draft.name.span, message, help);
            });
            return Vec::new();
        }
        let name = One::default().name(draft, scope);
        let why = format!("there is no such element: {}", elements(each, count));
        self.refused(definition, draft, name, why, scope)
    }
}
