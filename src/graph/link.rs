//! Resolves links: determines their targets, the order of the nodes, and the types of values.

use std::collections::HashMap;

use maquette_syntax::error::{Span, code};
use maquette_syntax::{FoundLink, Help, any_of, nearest_or_all, with_article};
use maquette_value::ValueType;

use super::check::Check;
use super::dependencies::Dependencies;
use super::header::name_of;
use crate::definition::{ForEachNode, NodeKind, ParsedNode};

/// Maximum number of links that are followed through `ForEach` nodes without elements. A longer chain must be a cycle.
const MAX_CHAINED_LINKS: usize = 64;

/// The names of nodes and `ForEach` nodes to which a link can lead.
pub struct Names<'e> {
    places: HashMap<String, NamedTarget>,
    pub(super) for_each_nodes: &'e [ForEachNode],
}

/// The node or `ForEach` that has a name, as an index in the list of nodes or of `ForEach` nodes.
#[derive(Clone, Copy)]
pub(super) enum NamedTarget {
    Node(usize),
    ForEach(usize),
}

impl<'e> Names<'e> {
    pub fn new(parsed_nodes: &[ParsedNode], for_each_nodes: &'e [ForEachNode]) -> Self {
        let nodes = parsed_nodes.iter().enumerate();
        let nodes =
            nodes.map(|(index, parsed)| (parsed.name.text.clone(), NamedTarget::Node(index)));
        let all = for_each_nodes.iter().enumerate();
        let all = all.map(|(index, each)| (each.name.clone(), NamedTarget::ForEach(index)));
        Self { places: nodes.chain(all).collect(), for_each_nodes }
    }

    pub(super) fn find(&self, name: &str) -> Option<NamedTarget> {
        self.places.get(name).copied()
    }
}

impl<'a> Check<'_, 'a> {
    /// Resolves the targets of all links.
    pub(super) fn resolve_links(&mut self, parsed_nodes: &mut [ParsedNode], names: &Names<'_>) {
        for index in 0..parsed_nodes.len() {
            let targets = (0..parsed_nodes[index].links.len()).map(|link| {
                let link = &parsed_nodes[index].links[link];
                self.target(&link.text, link.span, parsed_nodes, names)
            });
            parsed_nodes[index].targets = targets.collect();
        }
    }

    /// Returns the nodes and outputs to which a link leads, as pairs of indices. Only a link to an output of a `ForEach` leads to several.
    pub fn target(
        &mut self,
        text: &str,
        span: Span,
        parsed_nodes: &[ParsedNode],
        names: &Names<'_>,
    ) -> Option<Vec<(usize, usize)>> {
        let (node, output) = match text.split_once('.') {
            Some((node, output)) => (node, Some(output)),
            None => (text, None),
        };
        match names.find(node) {
            Some(NamedTarget::Node(index)) => {
                let what = &parsed_nodes[index].what;
                let output = match output {
                    Some(output) if !matches!(what, NodeKind::Unknown(_)) => {
                        self.output(node, what.kind(), &what.outputs(), output, span)
                    }
                    _ => Some(0),
                };
                output.map(|output| vec![(index, output)])
            }
            Some(NamedTarget::ForEach(index)) => self.target_in_for_each(
                &names.for_each_nodes[index],
                output,
                span,
                parsed_nodes,
                names,
            ),
            None if self.misnamed.contains(node) => None,
            // The errors of the `ForEach` have already been reported.
            None if is_element_of_unknown(node, parsed_nodes) => None,
            None => {
                if let Some((message, help)) = self.dangling_link(text, parsed_nodes, names) {
                    self.report(code::UNKNOWN_LINK, span, message, help);
                    return None;
                }
                let help = self.guess(|| {
                    let all = parsed_nodes.iter().map(|parsed| &parsed.name.text[..]);
                    let mut known: Vec<_> = all.filter(|name| !name.contains('/')).collect();
                    known.extend(names.for_each_nodes.iter().map(|each| &each.name[..]));
                    nearest_or_all(node, "the graph's nodes", &known)
                });
                self.report(code::UNKNOWN_LINK, span, format!("there is no node `{node}`"), help);
                None
            }
        }
    }

    /// Returns the index of an output of a node, by its name. Reports an unknown output, and returns `None`.
    fn output(
        &mut self,
        node: &str,
        kind: &str,
        names: &[&str],
        output: &str,
        span: Span,
    ) -> Option<usize> {
        let found = names.iter().position(|name| *name == output);
        if found.is_none() {
            let kind = with_article(kind);
            let message = format!("`{node}` is {kind}, which has no output `{output}`");
            let help = self.guess(|| match (nearest_or_all(output, "its outputs", names), names) {
                (help, [only]) if help.suggested_name().is_none() => {
                    Help::rename(help.into(), output, only)
                }
                (help, _) => help,
            });
            self.report(code::UNKNOWN_LINK, span, message, help);
        }
        found
    }

    fn target_in_for_each(
        &mut self,
        each: &ForEachNode,
        output: Option<&str>,
        span: Span,
        parsed_nodes: &[ParsedNode],
        names: &Names<'_>,
    ) -> Option<Vec<(usize, usize)>> {
        let element = each.elements.first().map(|&element| &parsed_nodes[element].what);
        let outputs = match (element, &each.outputs) {
            (None, None) => return None,
            (Some(NodeKind::Unknown(_)), _) => {
                let is_carried = each.carry.iter().any(|(name, _)| Some(&name[..]) == output);
                let last = each.elements.len() - 1;
                let elements = if is_carried { &each.elements[last..] } else { &each.elements };
                return Some(elements.iter().map(|&element| (element, 0)).collect());
            }
            (Some(what), _) => what.outputs(),
            (None, Some(outputs)) => outputs.iter().map(String::as_str).collect(),
        };
        let output = match output {
            Some(output) => self.output(&each.name, &each.kind, &outputs, output, span)?,
            None => 0,
        };
        let name = outputs.get(output)?;
        let Some((_, first)) = each.carry.iter().find(|(carried, _)| carried == name) else {
            return Some(each.elements.iter().map(|&element| (element, output)).collect());
        };
        match each.elements.last() {
            Some(&last) => Some(vec![(last, output)]),
            // Without elements, an output that is passed from element to element has the value of the corresponding input. Limit the depth,
            // because such links may form a cycle.
            None if self.depth < MAX_CHAINED_LINKS => {
                self.depth += 1;
                let found =
                    self.target(first.text().unwrap_or_default(), first.span, parsed_nodes, names);
                self.depth -= 1;
                found
            }
            None => None,
        }
    }

    /// Returns the dependencies between nodes, by the indices of the nodes.
    pub(super) fn dependencies(parsed_nodes: &[ParsedNode]) -> Dependencies {
        let links = parsed_nodes.iter().enumerate().flat_map(|(user, parsed)| {
            let targets = parsed.targets.iter().flatten().flatten();
            targets.map(move |(source, _)| (user, *source))
        });
        Dependencies::new(parsed_nodes.len(), links)
    }

    /// Returns the nodes in topological order, each after those on which it depends. Reports cycles.
    pub(super) fn order(
        &mut self,
        parsed_nodes: &[ParsedNode],
        needs: &Dependencies,
    ) -> Vec<usize> {
        let (order, cycles) = needs.order();
        cycles.iter().for_each(|cycle| self.report_cycle(cycle, parsed_nodes));
        order
    }

    fn report_cycle(&mut self, cycle: &[usize], parsed_nodes: &[ParsedNode]) {
        let lowest =
            (0..cycle.len()).min_by_key(|&k| parsed_nodes[cycle[k]].name.span).unwrap_or_default();
        let around = (0..=cycle.len())
            .map(|k| &parsed_nodes[cycle[(lowest + k) % cycle.len()]].name.text[..]);
        let path = Vec::from_iter(around).join(" <- ");
        let span = parsed_nodes[cycle[lowest]].name.span;
        let message = format!("cycle: {path}");
        self.report(
            code::CYCLE,
            span,
            message,
            "a node cannot need its own result: break one of these links",
        );
    }

    /// Determines the type of every output, and checks the types of all links.
    pub(super) fn types(
        &mut self,
        parsed_nodes: &mut [ParsedNode],
        order: &[usize],
        for_each_nodes: &[ForEachNode],
    ) {
        for &index in order {
            let parsed = &parsed_nodes[index];
            if let NodeKind::Elements(elements) = &parsed.what {
                parsed_nodes[index].types =
                    vec![self.element_type(parsed, &elements.word, parsed_nodes)];
                continue;
            }
            if let NodeKind::Pick(pick) = &parsed.what {
                parsed_nodes[index].types = parsed_nodes[pick.of].types.clone();
                continue;
            }
            let mut accepted: Vec<(&str, &'static ValueType)> = Vec::new();
            let mut rejected = Vec::new();
            for (link, targets) in parsed.links.iter().zip(&parsed.targets) {
                let Some(targets) = targets else { continue };
                let is_list =
                    targets.iter().any(|&(node, output)| parsed_nodes[node].is_list(output));
                if (is_list || targets.len() != 1) && !link.is_list {
                    let place = match targets.first() {
                        Some(&(node, _)) => Some(parsed_nodes[node].name.span),
                        None => for_each_nodes
                            .iter()
                            .find(|each| each.is_named(&link.text))
                            .map(|each| each.span),
                    };
                    let count = (!is_list).then_some(targets.len());
                    self.report_list(parsed.what.kind(), link, count);
                    self.add_note(place, || "this gives the list".into());
                    continue;
                }
                for &(node, output) in targets {
                    let Some(kind) = parsed_nodes[node].types.get(output).copied().flatten() else {
                        continue;
                    };
                    let fits = match parsed.what {
                        NodeKind::Switch(_) => {
                            accepted.first().is_none_or(|(_, first)| *first == kind)
                        }
                        _ => link.types.iter().any(|fits| fits == kind.name || fits.is_empty()),
                    };
                    if fits {
                        accepted.push((&link.wants, kind));
                    } else {
                        rejected.push((link.clone(), kind, parsed_nodes[node].name.span));
                        break;
                    }
                }
            }
            let first = accepted.first().map(|(_, kind)| *kind);
            let types = match &parsed.what {
                NodeKind::Node(entry) => entry
                    .outputs()
                    .iter()
                    .map(|output| match output.types[..] {
                        [kind] => Some(kind),
                        _ => accepted.iter().find(|(wants, _)| *wants == output.kind).map(|x| x.1),
                    })
                    .collect(),
                NodeKind::Switch(_) => vec![first],
                _ => parsed.types.clone(),
            };
            let is_switch = matches!(parsed.what, NodeKind::Switch(_));
            let owner = parsed.what.kind().to_owned();
            parsed_nodes[index].types = types;
            for (link, kind, place) in rejected {
                match first.filter(|_| is_switch) {
                    Some(first) => self.report_case_type(&link, first, kind),
                    None => self.report_type(&owner, &link, kind, parsed_nodes, Some(index)),
                }
                self.add_note(Some(place), || format!("this gives {}", with_article(kind.name)));
            }
            self.check_carried(&parsed_nodes[index]);
        }
    }

    /// Checks that each element of a repeated node accepts the outputs that the previous element passes on.
    fn check_carried(&mut self, parsed: &ParsedNode) {
        let Some(repeat) = &parsed.repeat else { return };
        let (name, kind, outputs) = (&parsed.name.text, parsed.what.kind(), parsed.what.outputs());
        for (port, first) in &repeat.carry {
            let Some(output) = self.output(name, kind, &outputs, port, first.span) else {
                continue;
            };
            let link = parsed.links.iter().find(|link| name_of(&link.port) == *port);
            let (Some(link), Some(kind)) = (link, parsed.types.get(output).copied().flatten())
            else {
                continue;
            };
            if link.types.iter().all(|fits| fits != kind.name && !fits.is_empty()) {
                let link = FoundLink { text: format!("{name}.{port}"), ..link.clone() };
                self.report_type(parsed.what.kind(), &link, kind, &[], None);
            }
        }
    }

    /// Adds a note to the diagnostic that was reported last.
    fn add_note(&mut self, place: Option<Span>, words: impl FnOnce() -> String) {
        if let Some(diagnostic) = self.diagnostics.last_mut() {
            diagnostic.note = place.map(|place| (place, words()));
        }
    }

    /// Returns the type of the elements into which a `ForEach` splits the linked value. `word` selects the kind of elements.
    fn element_type(
        &mut self,
        parsed: &ParsedNode,
        word: &str,
        parsed_nodes: &[ParsedNode],
    ) -> Option<&'static ValueType> {
        let (link, targets) = (parsed.links.first()?, parsed.targets.first()?.as_ref()?);
        let [(node, output)] = targets[..] else {
            self.report_list("ForEach", link, Some(targets.len()));
            return None;
        };
        if parsed_nodes[node].is_list(output) {
            self.report_list("ForEach", link, None);
            return None;
        }
        let kind = parsed_nodes[node].types.get(output).copied().flatten()?;
        let known = kind.elements();
        if let Some(found) = known.iter().find(|known| known.word == word) {
            return Some(found.kind);
        }
        let (text, what) = (&link.text, with_article(kind.name));
        let words: Vec<_> = known.iter().map(|known| known.word).collect();
        let message = match word {
            "" => format!("ForEach cannot iterate over `{text}`, which is {what}"),
            _ => format!("{what} such as `{text}` has no {word}"),
        };
        let help = match words[..] {
            [] => self.iterable_types(),
            [""] => format!("write `over: \"{text}\"` for its {}", known[0].name),
            _ => {
                let ways = words.iter().map(|word| format!("{word}(\"{text}\")"));
                format!("write {}", any_of(Vec::from_iter(ways).iter().map(String::as_str)))
            }
        };
        self.report(code::WRONG_TYPE, link.span, message, help);
        None
    }

    /// Returns a sentence that lists the types over which a `ForEach` can iterate.
    fn iterable_types(&self) -> String {
        let ways: Vec<_> = self
            .world
            .values
            .values()
            .flat_map(|kind| {
                let words = kind.elements().into_iter().map(|way| match way.word {
                    "" => kind.name.to_owned(),
                    word => format!("{word} of {}", with_article(kind.name)),
                });
                words.collect::<Vec<_>>()
            })
            .collect();
        format!("it can iterate over {}", any_of(ways.iter().map(String::as_str)))
    }

    /// Reports a link to a list at a port that takes one value.
    fn report_list(&mut self, owner: &str, link: &FoundLink, count: Option<usize>) {
        let (port, text) = (&link.port, &link.text);
        let list = count.map_or_else(|| "a list".to_owned(), |count| format!("a list of {count}"));
        let message = format!("port `{port}` of {owner} takes one link, but `{text}` is {list}");
        let help = match count {
            Some(0) => "link it to a port that takes many links".to_owned(),
            _ => {
                let (node, output) = match text.split_once('.') {
                    Some((node, output)) => (node, format!(".{output}")),
                    None => (&text[..], String::new()),
                };
                format!("link it to a port that takes many links; `{node}/1{output}` is the first")
            }
        };
        self.report(code::WRONG_TYPE, link.span, message, help);
    }

    /// Reports a case of a `Switch` whose type differs from that of the first case. The type of a `Switch` must not depend on the choice.
    fn report_case_type(&mut self, link: &FoundLink, first: &ValueType, kind: &ValueType) {
        let (case, other, kind) = (&link.port, with_article(first.name), with_article(kind.name));
        let message = format!("case `{case}` of Switch is {kind}, but the first one is {other}");
        self.report(code::WRONG_TYPE, link.span, message, "use cases of one type");
    }

    fn report_type(
        &mut self,
        owner: &str,
        link: &FoundLink,
        kind: &ValueType,
        parsed_nodes: &[ParsedNode],
        user: Option<usize>,
    ) {
        let wanted = any_of(link.types.iter().map(String::as_str));
        let data = parsed_nodes.iter().find(|parsed| parsed.name.text == link.text);
        let data = data.filter(|parsed| matches!(parsed.what, NodeKind::Elements(_)));
        let given = match data.and_then(|parsed| parsed.links.first()) {
            Some(over) => format!("an element of `{}`", over.text),
            None => format!("`{}`", link.text),
        };
        let message = format!(
            "port `{}` of {owner} wants {}, but {given} is {}",
            link.port,
            with_article(&wanted),
            with_article(kind.name)
        );
        let makers = link
            .types
            .iter()
            .map(|wanted| (wanted, self.world.catalog.converters(kind.name, wanted)));
        let words = makers.filter_map(|(wanted, makers)| {
            let maker = makers.first()?;
            Some(format!("{} makes {} of it", with_article(maker), with_article(wanted)))
        });
        let words = Vec::from_iter(words).join("; ");
        let mut help = Help::from(words);
        let edits =
            user.and_then(|user| self.type_fix(link, kind, parsed_nodes, &parsed_nodes[user]));
        if let Some(edits) = edits {
            help.set_edits(edits);
        }
        self.report(code::WRONG_TYPE, link.span, message, help);
    }
}

/// Returns true if `name` is the name of an element, such as `eyes/1`, of a node that could not be checked.
fn is_element_of_unknown(name: &str, parsed_nodes: &[ParsedNode]) -> bool {
    let outer = name.split_once('/').map(|(outer, _)| outer);
    parsed_nodes.iter().any(|parsed| {
        outer == Some(&parsed.name.text) && matches!(parsed.what, NodeKind::Unknown(_))
    })
}
