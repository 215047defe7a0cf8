//! The properties that graph files require of inputs and promise of outputs.

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Help, Kind, Tree, nearest_or_all, with_article};
use maquette_value::ValueType;

use super::check::Check;
use super::definition::{Definition, Port};
use super::expectation::Expectation;
use super::header::Header;
use crate::definition::BoundExpectation;

impl Definition {
    /// Returns the promises of the graph, as pairs of an output and a property.
    pub(super) fn promises(&self) -> impl Iterator<Item = (&str, &str)> {
        self.expect.iter().filter_map(|expecting| {
            let property = expecting.expectation.promised_property()?;
            Some((expecting.expectation.values()[0], property))
        })
    }
}

impl Check<'_, '_> {
    /// Reads a list of properties, such as `[Closed, Triangles]`, with their positions. Returns an empty list if the type of the value is
    /// unknown.
    pub(super) fn properties(
        &mut self,
        list: &Tree,
        kind: Option<&ValueType>,
    ) -> Vec<(&'static str, Span)> {
        let Kind::List(words) = &list.kind else {
            if !list.is_broken() {
                let message = format!("properties are a list, not {}", list.describe());
                let help = "write [Closed, Triangles]";
                let help = match &list.kind {
                    Kind::Word(word) => Help::edit(help, list.span, format!("[{word}]")),
                    _ => help.into(),
                };
                self.report(code::WRONG_VALUE, list.span, message, help);
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
                        "" => format!("a property is a word, not {}", word.describe()),
                        name => format!("{what} has no property `{name}`"),
                    };
                    let help = match known.is_empty() {
                        true => format!("{what} has no properties").into(),
                        false => nearest_or_all(name, "its properties", &known),
                    };
                    self.report(code::WRONG_VALUE, word.span, message, help);
                }
            }
        }
        properties
    }

    /// Reads the section `promises` of a graph file: the properties that the graph promises of its outputs.
    pub(super) fn promises(
        &mut self,
        header: &Header<'_>,
        ports: &[Port],
    ) -> Vec<BoundExpectation> {
        let mut promises = Vec::new();
        for (key, list) in header.promises {
            let name = key.text().unwrap_or_default();
            let Some(port) = ports.iter().find(|port| port.name == name) else {
                let names: Vec<_> = ports.iter().map(|port| &port.name[..]).collect();
                let (message, help) = match names.is_empty() {
                    true => (
                        "a graph without `inputs` gives files, of which nothing is promised"
                            .to_owned(),
                        "use `expect` for conditions on its values".into(),
                    ),
                    false => (
                        format!("there is no output `{name}`"),
                        nearest_or_all(name, "its outputs", &names),
                    ),
                };
                self.report(code::UNKNOWN_LINK, key.span, message, help);
                continue;
            };
            for (property, span) in self.properties(list, port.kind) {
                let (of, property) = (name.to_owned(), property.to_owned());
                let expectation = Expectation::Promised { of, property };
                promises.push(BoundExpectation { expectation, span, targets: vec![port.target] });
            }
        }
        promises
    }
}
