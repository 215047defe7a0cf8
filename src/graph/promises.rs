//! Properties in graph files: what a graph wants of its inputs, and promises of its outputs.

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Help, Kind, Tree, nearest_or_all, with_article};
use maquette_value::ValueType;

use super::check::Check;
use super::definition::{Definition, Port};
use super::expectation::Expectation;
use super::top::TopLevel;
use crate::definition::Expecting;

impl Definition {
    /// Its outputs and the properties that it promises of them.
    pub(super) fn promises(&self) -> impl Iterator<Item = (&str, &str)> {
        self.expect.iter().filter_map(|expecting| {
            let property = expecting.expectation.promised()?;
            Some((expecting.expectation.values()[0], property))
        })
    }
}

impl Check<'_, '_> {
    /// The properties in a list of words, `[Closed, Triangles]`, and where each stands; none where the type is not known.
    pub(super) fn properties(
        &mut self,
        list: &Tree,
        kind: Option<&ValueType>,
    ) -> Vec<(&'static str, Span)> {
        let Kind::List(words) = &list.kind else {
            if !list.is_broken() {
                let message = format!("properties are a list, not {}", list.in_words());
                let help = "write [Closed, Triangles]";
                let help = match &list.kind {
                    Kind::Word(word) => Help::edit(help, list.span, format!("[{word}]")),
                    _ => help.into(),
                };
                self.find(code::WRONG_VALUE, list.span, message, help);
            }
            return Vec::new();
        };
        let Some(kind) = kind else { return Vec::new() };
        let known: Vec<_> = kind.properties().into_iter().map(|(name, _)| name).collect();
        let mut properties = Vec::new();
        for word in words {
            let name = match &word.kind {
                Kind::Word(name) => &name[..],
                _ => "",
            };
            match kind.property(name) {
                Some(property) => properties.push((property, word.span)),
                None => {
                    let what = with_article(kind.name);
                    let message = match name {
                        "" => format!("a property is a word, not {}", word.in_words()),
                        name => format!("{what} has no property `{name}`"),
                    };
                    let help = match known.is_empty() {
                        true => format!("nothing can be wanted or promised of {what}").into(),
                        false => nearest_or_all(name, "its properties", &known),
                    };
                    self.find(code::WRONG_VALUE, word.span, message, help);
                }
            }
        }
        properties
    }

    /// What a graph promises of its outputs.
    pub(super) fn promises(&mut self, top: &TopLevel<'_>, ports: &[Port]) -> Vec<Expecting> {
        let mut promises = Vec::new();
        for (key, list) in top.promises {
            let name = key.text().unwrap_or_default();
            let Some(port) = ports.iter().find(|port| port.name == name) else {
                let names: Vec<_> = ports.iter().map(|port| &port.name[..]).collect();
                let (message, help) = match names.is_empty() {
                    true => (
                        "a graph without `inputs` gives files, of which nothing is promised"
                            .to_owned(),
                        "say what must hold of its values in `expect`".into(),
                    ),
                    false => (
                        format!("there is no output `{name}`"),
                        nearest_or_all(name, "its outputs", &names),
                    ),
                };
                self.find(code::UNKNOWN_LINK, key.span, message, help);
                continue;
            };
            for (property, span) in self.properties(list, port.kind) {
                let (of, property) = (name.to_owned(), property.to_owned());
                let expectation = Expectation::Promised { of, property };
                promises.push(Expecting { expectation, span, targets: vec![port.target] });
            }
        }
        promises
    }
}
