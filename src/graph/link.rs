//! Where the links of a graph lead, in which order its nodes come, and what flows on the links.

use std::collections::HashMap;

use maquette_syntax::error::{Span, code};
use maquette_syntax::{FoundLink, Help, any_of, nearest_or_all, with_article};
use maquette_value::ValueType;

use super::check::Check;
use super::needs::Needs;
use super::top::name_of;
use crate::definition::{Draft, Each, What};

/// More links than this one after the other through `ForEach`es without elements are a circle.
const MOST_LINKS: usize = 64;

/// The names that links may begin with.
pub struct Names<'e> {
    places: HashMap<String, Named>,
    pub(super) eaches: &'e [Each],
}

/// What a name means, by its place among the drafts or the `ForEach`es.
#[derive(Clone, Copy)]
pub(super) enum Named {
    Draft(usize),
    Each(usize),
}

impl<'e> Names<'e> {
    pub fn new(drafts: &[Draft], eaches: &'e [Each]) -> Self {
        let nodes = drafts.iter().enumerate();
        let nodes = nodes.map(|(index, draft)| (draft.name.text.clone(), Named::Draft(index)));
        let all = eaches.iter().enumerate();
        let all = all.map(|(index, each)| (each.name.clone(), Named::Each(index)));
        Self { places: nodes.chain(all).collect(), eaches }
    }

    pub(super) fn find(&self, name: &str) -> Option<Named> {
        self.places.get(name).copied()
    }
}

impl<'a> Check<'_, 'a> {
    /// Finds what each link names.
    pub(super) fn link(&mut self, drafts: &mut [Draft], names: &Names<'_>) {
        for index in 0..drafts.len() {
            let targets = (0..drafts[index].links.len()).map(|link| {
                let link = &drafts[index].links[link];
                self.target(&link.text, link.span, drafts, names)
            });
            drafts[index].targets = targets.collect();
        }
    }

    /// The nodes and outputs that a link names, by the drafts' places: several if it names the output of a `ForEach`.
    pub fn target(
        &mut self,
        text: &str,
        span: Span,
        drafts: &[Draft],
        names: &Names<'_>,
    ) -> Option<Vec<(usize, usize)>> {
        let (node, output) = match text.split_once('.') {
            Some((node, output)) => (node, Some(output)),
            None => (text, None),
        };
        match names.find(node) {
            Some(Named::Draft(index)) => {
                let what = &drafts[index].what;
                let output = match output {
                    Some(output) if !matches!(what, What::Unknown(_)) => {
                        self.output(node, what.kind(), &what.outputs(), output, span)
                    }
                    _ => Some(0),
                };
                output.map(|output| vec![(index, output)])
            }
            Some(Named::Each(index)) => {
                self.target_in_each(&names.eaches[index], output, span, drafts, names)
            }
            None if self.misnamed.contains(node) => None,
            // What is wrong with a `ForEach` says nothing of its elements.
            None if is_element_of_unknown(node, drafts) => None,
            None => {
                if let Some((message, help)) = self.unfound(text, drafts, names) {
                    self.find(code::UNKNOWN_LINK, span, message, help);
                    return None;
                }
                let help = self.guess(|| {
                    let all = drafts.iter().map(|draft| &draft.name.text[..]);
                    let mut known: Vec<_> = all.filter(|name| !name.contains('/')).collect();
                    known.extend(names.eaches.iter().map(|each| &each.name[..]));
                    nearest_or_all(node, "the graph's nodes", &known)
                });
                self.find(code::UNKNOWN_LINK, span, format!("there is no node `{node}`"), help);
                None
            }
        }
    }

    /// The place of the output of this name.
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
                (help, [only]) if help.meant().is_none() => Help::rename(help.into(), output, only),
                (help, _) => help,
            });
            self.find(code::UNKNOWN_LINK, span, message, help);
        }
        found
    }

    fn target_in_each(
        &mut self,
        each: &Each,
        output: Option<&str>,
        span: Span,
        drafts: &[Draft],
        names: &Names<'_>,
    ) -> Option<Vec<(usize, usize)>> {
        let element = each.elements.first().map(|&element| &drafts[element].what);
        let outputs = match (element, &each.outputs) {
            (None, None) => return None,
            (Some(What::Unknown(_)), _) => {
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
            // Nothing is done to what is carried through no element. A circle of links through such has no end.
            None if self.depth < MOST_LINKS => {
                self.depth += 1;
                let found =
                    self.target(first.text().unwrap_or_default(), first.span, drafts, names);
                self.depth -= 1;
                found
            }
            None => None,
        }
    }

    /// What hangs on what, by the drafts' places.
    pub(super) fn needs(drafts: &[Draft]) -> Needs {
        let links = drafts.iter().enumerate().flat_map(|(user, draft)| {
            let targets = draft.targets.iter().flatten().flatten();
            targets.map(move |(source, _)| (user, *source))
        });
        Needs::new(drafts.len(), links)
    }

    /// The nodes, each after those that it hangs on as far as there is no cycle; cycles are reported.
    pub(super) fn order(&mut self, drafts: &[Draft], needs: &Needs) -> Vec<usize> {
        let (order, cycles) = needs.order();
        cycles.iter().for_each(|cycle| self.cycle(cycle, drafts));
        order
    }

    fn cycle(&mut self, cycle: &[usize], drafts: &[Draft]) {
        let lowest =
            (0..cycle.len()).min_by_key(|&k| drafts[cycle[k]].name.span).unwrap_or_default();
        let around =
            (0..=cycle.len()).map(|k| &drafts[cycle[(lowest + k) % cycle.len()]].name.text[..]);
        let path = Vec::from_iter(around).join(" <- ");
        let span = drafts[cycle[lowest]].name.span;
        let message = format!("nodes hang on each other in a circle: {path}");
        self.find(
            code::CYCLE,
            span,
            message,
            "a node cannot need its own result: break one of these links",
        );
    }

    /// Finds the type of every output and checks that every link fits.
    pub(super) fn types(&mut self, drafts: &mut [Draft], order: &[usize], eaches: &[Each]) {
        for &index in order {
            let draft = &drafts[index];
            if let What::Elements(elements) = &draft.what {
                drafts[index].types = vec![self.element_type(draft, &elements.word, drafts)];
                continue;
            }
            if let What::Pick(pick) = &draft.what {
                drafts[index].types = drafts[pick.of].types.clone();
                continue;
            }
            let mut came_in: Vec<(&str, &'static ValueType)> = Vec::new();
            let mut misfits = Vec::new();
            for (link, targets) in draft.links.iter().zip(&draft.targets) {
                let Some(targets) = targets else { continue };
                let is_list = targets.iter().any(|&(node, output)| drafts[node].is_list(output));
                if (is_list || targets.len() != 1) && !link.many {
                    let place = match targets.first() {
                        Some(&(node, _)) => Some(drafts[node].name.span),
                        None => eaches
                            .iter()
                            .find(|each| each.is_named(&link.text))
                            .map(|each| each.span),
                    };
                    let count = (!is_list).then_some(targets.len());
                    self.not_one(draft.what.kind(), link, count);
                    self.note(place, || "this gives the list".into());
                    continue;
                }
                for &(node, output) in targets {
                    let Some(kind) = drafts[node].types.get(output).copied().flatten() else {
                        continue;
                    };
                    let fits = match draft.what {
                        What::Switch(_) => came_in.first().is_none_or(|(_, first)| *first == kind),
                        _ => link.types.iter().any(|fits| fits == kind.name || fits.is_empty()),
                    };
                    if fits {
                        came_in.push((&link.wants, kind));
                    } else {
                        misfits.push((link.clone(), kind, drafts[node].name.span));
                        break;
                    }
                }
            }
            let first = came_in.first().map(|(_, kind)| *kind);
            let types = match &draft.what {
                What::Node(entry) => entry
                    .outputs()
                    .iter()
                    .map(|output| match output.types[..] {
                        [kind] => Some(kind),
                        _ => came_in.iter().find(|(wants, _)| *wants == output.kind).map(|x| x.1),
                    })
                    .collect(),
                What::Switch(_) => vec![first],
                _ => draft.types.clone(),
            };
            let is_switch = matches!(draft.what, What::Switch(_));
            let owner = draft.what.kind().to_owned();
            drafts[index].types = types;
            for (link, kind, place) in misfits {
                match first.filter(|_| is_switch) {
                    Some(first) => self.unlike(&link, first, kind),
                    None => self.misfit(&owner, &link, kind, drafts, Some(index)),
                }
                self.note(Some(place), || format!("this gives {}", with_article(kind.name)));
            }
            self.carried(&drafts[index]);
        }
    }

    /// Whether each element of a repeated draft can take what the one before gives.
    fn carried(&mut self, draft: &Draft) {
        let Some(repeat) = &draft.repeat else { return };
        let (name, kind, outputs) = (&draft.name.text, draft.what.kind(), draft.what.outputs());
        for (port, first) in &repeat.carry {
            let Some(output) = self.output(name, kind, &outputs, port, first.span) else {
                continue;
            };
            let link = draft.links.iter().find(|link| name_of(&link.port) == *port);
            let (Some(link), Some(kind)) = (link, draft.types.get(output).copied().flatten())
            else {
                continue;
            };
            if link.types.iter().all(|fits| fits != kind.name && !fits.is_empty()) {
                let link = FoundLink { text: format!("{name}.{port}"), ..link.clone() };
                self.misfit(draft.what.kind(), &link, kind, &[], None);
            }
        }
    }

    /// Gives the last finding its other end.
    fn note(&mut self, place: Option<Span>, words: impl FnOnce() -> String) {
        if let Some(finding) = self.findings.last_mut() {
            finding.note = place.map(|place| (place, words()));
        }
    }

    /// The type of the elements that a word means in what comes in.
    fn element_type(
        &mut self,
        draft: &Draft,
        word: &str,
        drafts: &[Draft],
    ) -> Option<&'static ValueType> {
        let (link, targets) = (draft.links.first()?, draft.targets.first()?.as_ref()?);
        let [(node, output)] = targets[..] else {
            self.not_one("ForEach", link, Some(targets.len()));
            return None;
        };
        if drafts[node].is_list(output) {
            self.not_one("ForEach", link, None);
            return None;
        }
        let kind = drafts[node].types.get(output).copied().flatten()?;
        let known = kind.elements();
        if let Some(found) = known.iter().find(|known| known.word == word) {
            return Some(found.kind);
        }
        let (text, what) = (&link.text, with_article(kind.name));
        let words: Vec<_> = known.iter().map(|known| known.word).collect();
        let message = match word {
            "" => format!("ForEach cannot go over `{text}`, which is {what}"),
            _ => format!("{what} such as `{text}` has no {word}"),
        };
        let help = match words[..] {
            [] => self.gone_over(),
            [""] => format!("write `over: \"{text}\"` for its {}", known[0].name),
            _ => {
                let ways = words.iter().map(|word| format!("{word}(\"{text}\")"));
                format!("write {}", any_of(Vec::from_iter(ways).iter().map(String::as_str)))
            }
        };
        self.find(code::WRONG_TYPE, link.span, message, help);
        None
    }

    /// What a `ForEach` can go over.
    fn gone_over(&self) -> String {
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
        format!("it goes over {}", any_of(ways.iter().map(String::as_str)))
    }

    /// A list of values comes to a port for one.
    fn not_one(&mut self, owner: &str, link: &FoundLink, count: Option<usize>) {
        let (port, text) = (&link.port, &link.text);
        let list = count.map_or_else(|| "a list".to_owned(), |count| format!("a list of {count}"));
        let message = format!("port `{port}` of {owner} takes one link, but `{text}` is {list}");
        let help = match count {
            Some(0) => "a port that takes many links takes it".to_owned(),
            _ => {
                let (node, output) = match text.split_once('.') {
                    Some((node, output)) => (node, format!(".{output}")),
                    None => (&text[..], String::new()),
                };
                format!("a port that takes many links takes it; `{node}/1{output}` is the first")
            }
        };
        self.find(code::WRONG_TYPE, link.span, message, help);
    }

    /// What a `Switch` gives must not hang on what it chooses.
    fn unlike(&mut self, link: &FoundLink, first: &ValueType, kind: &ValueType) {
        let (case, other, kind) = (&link.port, with_article(first.name), with_article(kind.name));
        let message = format!("case `{case}` of Switch is {kind}, but the first one is {other}");
        self.find(code::WRONG_TYPE, link.span, message, "all cases give one type");
    }

    fn misfit(
        &mut self,
        owner: &str,
        link: &FoundLink,
        kind: &ValueType,
        drafts: &[Draft],
        user: Option<usize>,
    ) {
        let wanted = any_of(link.types.iter().map(String::as_str));
        let data = drafts.iter().find(|draft| draft.name.text == link.text);
        let data = data.filter(|draft| matches!(draft.what, What::Elements(_)));
        let given = match data.and_then(|draft| draft.links.first()) {
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
        let edits = user.and_then(|user| self.fitted(link, kind, drafts, &drafts[user]));
        if let Some(edits) = edits {
            help.with_edits(edits);
        }
        self.find(code::WRONG_TYPE, link.span, message, help);
    }
}

/// Whether a name is that of an element of what could not be understood.
fn is_element_of_unknown(name: &str, drafts: &[Draft]) -> bool {
    let outer = name.split_once('/').map(|(outer, _)| outer);
    let is_it =
        |draft: &Draft| outer == Some(&draft.name.text) && matches!(draft.what, What::Unknown(_));
    drafts.iter().any(is_it)
}
