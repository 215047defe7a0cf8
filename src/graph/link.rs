//! Where the links of a graph lead, in which order its nodes come, and what flows on the links.

use std::collections::HashMap;

use super::check::Check;
use super::draft::{Draft, What};
use super::each::Each;
use super::needs::Needs;
use crate::error::{Span, code};
use crate::node::Output;
use crate::text::{FoundLink, any_of, nearest_or_all, with_article};
use crate::value::ValueType;

/// More links than this one after the other through `ForEach`es without elements are a circle.
const MOST_LINKS: usize = 64;

/// The names that links may begin with.
pub(super) struct Names<'e> {
    places: HashMap<String, Named>,
    eaches: &'e [Each],
}

#[derive(Clone, Copy)]
enum Named {
    Draft(usize),
    Each(usize),
}

impl<'e> Names<'e> {
    pub(super) fn new(drafts: &[Draft<'_>], eaches: &'e [Each]) -> Self {
        let nodes = drafts.iter().enumerate();
        let nodes = nodes.map(|(index, draft)| (draft.name.text.clone(), Named::Draft(index)));
        let all = eaches.iter().enumerate();
        let all = all.map(|(index, each)| (each.name.clone(), Named::Each(index)));
        Self { places: nodes.chain(all).collect(), eaches }
    }
}

impl<'a> Check<'_, 'a> {
    /// Finds what each link names.
    pub(super) fn link(&mut self, drafts: &mut [Draft<'a>], names: &Names<'_>) {
        for index in 0..drafts.len() {
            let targets = (0..drafts[index].links.len()).map(|link| {
                let link = &drafts[index].links[link];
                self.target(&link.text, link.span, drafts, names)
            });
            drafts[index].targets = targets.collect();
        }
    }

    /// The nodes and outputs that a link names, by the drafts' places: several if it names the output of a `ForEach`.
    pub(super) fn target(
        &mut self,
        text: &str,
        span: Span,
        drafts: &[Draft<'_>],
        names: &Names<'_>,
    ) -> Option<Vec<(usize, usize)>> {
        let (node, output) = match text.split_once('.') {
            Some((node, output)) => (node, Some(output)),
            None => (text, None),
        };
        match names.places.get(node) {
            Some(&Named::Draft(index)) => {
                let what = &drafts[index].what;
                let output = match output {
                    Some(output) if !matches!(what, What::Unknown) => {
                        self.output(node, what.kind(), &what.outputs(), output, span)
                    }
                    _ => Some(0),
                };
                output.map(|output| vec![(index, output)])
            }
            Some(&Named::Each(index)) => {
                self.target_in_each(&names.eaches[index], output, span, drafts, names)
            }
            None => {
                let help = self.guess(|| {
                    let all = drafts.iter().map(|draft| &draft.name.text[..]);
                    let mut known = Vec::from_iter(all.filter(|name| !name.contains('/')));
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
            let help = self.guess(|| nearest_or_all(output, "its outputs", names));
            self.find(code::UNKNOWN_LINK, span, message, help);
        }
        found
    }

    fn target_in_each(
        &mut self,
        each: &Each,
        output: Option<&str>,
        span: Span,
        drafts: &[Draft<'_>],
        names: &Names<'_>,
    ) -> Option<Vec<(usize, usize)>> {
        let element = each.elements.first().map(|&element| &drafts[element].what);
        let outputs = match (element, &each.outputs) {
            (None, None) => return None,
            (Some(What::Unknown), _) => {
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
    pub(super) fn needs(drafts: &[Draft<'_>]) -> Needs {
        let links = drafts.iter().enumerate().flat_map(|(user, draft)| {
            let targets = draft.targets.iter().flatten().flatten();
            targets.map(move |(source, _)| (user, *source))
        });
        Needs::new(drafts.len(), links)
    }

    /// The nodes, each after those that it hangs on as far as there is no cycle; cycles are reported.
    pub(super) fn order(&mut self, drafts: &[Draft<'_>], needs: &Needs) -> Vec<usize> {
        let (order, cycles) = needs.order();
        cycles.iter().for_each(|cycle| self.cycle(cycle, drafts));
        order
    }

    fn cycle(&mut self, cycle: &[usize], drafts: &[Draft<'_>]) {
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
    pub(super) fn types(&mut self, drafts: &mut [Draft<'a>], order: &[usize], eaches: &[Each]) {
        for &index in order {
            let draft = &drafts[index];
            let mut came_in: Vec<(&str, &'static ValueType)> = Vec::new();
            let mut misfits = Vec::new();
            for (link, targets) in draft.links.iter().zip(&draft.targets) {
                let Some(targets) = targets else { continue };
                if targets.len() != 1 && !link.many {
                    let place = match targets.first() {
                        Some(&(node, _)) => Some(drafts[node].name.span),
                        None => eaches
                            .iter()
                            .find(|each| each.is_named(&link.text))
                            .map(|each| each.span),
                    };
                    self.not_one(draft.what.kind(), link, targets.len());
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
                What::Node(entry) => {
                    let kind = |output: &Output| match output.types[..] {
                        [kind] => Some(kind),
                        _ => came_in.iter().find(|(wants, _)| *wants == output.kind).map(|x| x.1),
                    };
                    entry.outputs().iter().map(kind).collect()
                }
                What::Switch(_) => vec![first],
                _ => draft.types.clone(),
            };
            let is_switch = matches!(draft.what, What::Switch(_));
            let owner = draft.what.kind().to_owned();
            drafts[index].types = types;
            for (link, kind, place) in misfits {
                match first.filter(|_| is_switch) {
                    Some(first) => self.unlike(&link, first, kind),
                    None => self.misfit(&owner, &link, kind),
                }
                self.note(Some(place), || format!("this gives {}", with_article(kind.name)));
            }
        }
    }

    /// Gives the last finding its other end.
    fn note(&mut self, place: Option<Span>, words: impl FnOnce() -> String) {
        if let Some(finding) = self.findings.last_mut() {
            finding.note = place.map(|place| (place, words()));
        }
    }

    /// A list of values comes to a port for one.
    fn not_one(&mut self, owner: &str, link: &FoundLink, count: usize) {
        let (port, text) = (&link.port, &link.text);
        let message =
            format!("port `{port}` of {owner} takes one link, but `{text}` is a list of {count}");
        let help = match count {
            0 => "a port that takes many links takes it".to_owned(),
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

    fn misfit(&mut self, owner: &str, link: &FoundLink, kind: &ValueType) {
        let wanted = any_of(link.types.iter().map(String::as_str));
        let message = format!(
            "port `{}` of {owner} wants {}, but `{}` is {}",
            link.port,
            with_article(&wanted),
            link.text,
            with_article(kind.name)
        );
        let makers = link
            .types
            .iter()
            .map(|wanted| (wanted, self.world.catalog.converters(kind.name, wanted)));
        let help = makers.filter_map(|(wanted, makers)| {
            let maker = makers.first()?;
            Some(format!("{} makes {} of it", with_article(maker), with_article(wanted)))
        });
        let help = Vec::from_iter(help).join("; ");
        self.find(code::WRONG_TYPE, link.span, message, help);
    }
}
