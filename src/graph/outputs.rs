//! What a graph gives: files, each in a format that its value has, or values for who uses it.

use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;

use maquette_syntax::error::{Span, code};
use maquette_syntax::paths::stays_inside;
use maquette_syntax::spelling::{file_key, one_file};
use maquette_syntax::{Tree, with_article};
use maquette_value::ValueType;
use maquette_value::plain::ending;

use super::check::Check;
use super::definition::Port;
use super::link::Names;
use super::{GraphOutput, is_name};
use crate::definition::Draft;

impl Check<'_, '_> {
    /// The files that a graph gives, and those of which it is not known what they hold.
    pub(super) fn outputs(
        &mut self,
        entries: &[(Tree, Tree)],
        drafts: &[Draft],
        names: &Names<'_>,
    ) -> (Vec<GraphOutput>, Vec<GraphOutput>) {
        let mut outputs: Vec<GraphOutput> = Vec::with_capacity(entries.len());
        let mut undecided = Vec::new();
        // As paths: `a/./b.ply` is `a//b.ply`.
        let mut taken: HashMap<String, (&str, Span)> = HashMap::new();
        for (key, value) in entries {
            let Some(name) = key.text() else {
                let message = format!("the name of an output is a text, not {}", key.in_words());
                self.find(code::BAD_NAME, key.span, message, "write \"name.ply\": \"node\"");
                continue;
            };
            if !stays_inside(name) {
                let message = format!("output `{name}` lies outside of the folder of outputs");
                self.find(
                    code::OUTSIDE,
                    key.span,
                    message,
                    "name a file, such as \"model.ply\"; --out chooses the folder",
                );
                continue;
            }
            if name.contains(char::is_control) {
                let message = format!("output `{name}` has a control character in its name");
                self.find(code::BAD_NAME, key.span, message, "write a name of one line");
                continue;
            }
            if let Some(&(first, at)) = taken.get(&file_key(name)) {
                if Path::new(first) == Path::new(name) {
                    let message = format!("there is already an output `{name}`");
                    self.find(code::BAD_NAME, key.span, message, "");
                } else {
                    let message = one_file("outputs", first, name);
                    let help = "give one of them another name";
                    self.find_beside(key.span, message, help, (at, "the first one".to_owned()));
                }
                continue;
            }
            let Some(targets) = self.output_link(name, value, drafts, names) else { continue };
            let Some((node, output)) = self.only(name, value, &targets, drafts) else { continue };
            let kind = drafts[node].types.get(output).copied().flatten();
            let ending = ending(Path::new(name));
            let format = match kind {
                Some(kind) => self.world.catalog.format(kind, &ending),
                None => self.world.catalog.any_format(&ending),
            };
            let Some(format) = format.copied() else {
                self.no_format(name, &ending, kind, key.span);
                continue;
            };
            taken.insert(file_key(name), (name, key.span));
            let (source, span) = self.sheet.place(key.span);
            let list = if kind.is_some() { &mut outputs } else { &mut undecided };
            let (name, lineage) = (name.to_owned(), Arc::default());
            list.push(GraphOutput { name, node, output, format, lineage, source, span });
        }
        (outputs, undecided)
    }

    fn output_link(
        &mut self,
        name: &str,
        value: &Tree,
        drafts: &[Draft],
        names: &Names<'_>,
    ) -> Option<Vec<(usize, usize)>> {
        let Some(link) = value.text() else {
            let message = format!("output `{name}` wants a link, not {}", value.in_words());
            let help = "write \"node\" or \"node.output\"";
            self.find(code::WRONG_VALUE, value.span, message, help);
            return None;
        };
        self.target(link, value.span, drafts, names)
    }

    /// The only value of a link.
    fn only(
        &mut self,
        name: &str,
        value: &Tree,
        targets: &[(usize, usize)],
        drafts: &[Draft],
    ) -> Option<(usize, usize)> {
        let list = match *targets {
            [(node, output)] if drafts[node].is_list(output) => "a list".to_owned(),
            [target] => return Some(target),
            _ => format!("a list of {}", targets.len()),
        };
        let message = format!("output `{name}` is one value, but this is {list}");
        let help = "join them first, or name an output for each";
        self.find(code::WRONG_TYPE, value.span, message, help);
        None
    }

    /// The outputs of a graph that others use: ports instead of files.
    pub fn ports(
        &mut self,
        entries: &[(Tree, Tree)],
        drafts: &[Draft],
        names: &Names<'_>,
    ) -> Vec<Port> {
        let mut ports: Vec<Port> = Vec::with_capacity(entries.len());
        let mut taken = HashSet::new();
        for (key, value) in entries {
            let Some(name) = key.text() else {
                let message = format!("the name of an output is a text, not {}", key.in_words());
                self.find(code::BAD_NAME, key.span, message, "write \"name\": \"node\"");
                continue;
            };
            if !is_name(&name.replace('_', "-")) {
                let message = format!("`{name}` cannot name an output of a graph that others use");
                let help = "its outputs are ports, not files: lower-case letters, digits, hyphens";
                self.find(code::BAD_NAME, key.span, message, help);
                continue;
            }
            if !taken.insert(name) {
                let message = format!("there is already an output `{name}`");
                self.find(code::BAD_NAME, key.span, message, "");
                continue;
            }
            let targets = self.output_link(name, value, drafts, names);
            // An output whose link is wrong is still there for those who use the graph.
            let target = targets.and_then(|targets| self.only(name, value, &targets, drafts));
            if let Some(input) = target.map(|(node, _)| &drafts[node]).filter(|it| it.is_optional) {
                let input = &input.name.text;
                let message =
                    format!("output `{name}` needs a value, but input `{input}` may be left out");
                let help = format!("declare `{input}` without Optional(..)");
                self.find(code::MISSING_FIELD, value.span, message, help);
            }
            let kind = target.and_then(|(node, output)| drafts[node].types.get(output));
            let (name, kind) = (name.to_owned(), kind.copied().flatten());
            let lineage = Arc::default();
            ports.push(Port { name, target, kind, lineage, span: key.span });
        }
        ports
    }

    fn no_format(&mut self, name: &str, ending: &str, kind: Option<&ValueType>, span: Span) {
        let known = self.world.catalog.endings(kind);
        let what = kind.map_or_else(|| "a value".to_owned(), |kind| with_article(kind.name));
        let message = match ending {
            "" => format!("output `{name}` has no ending that says how to write {what}"),
            _ => format!("{what} cannot be written to a `.{ending}` file"),
        };
        let help = match (known.is_empty(), kind) {
            (true, _) => format!("{what} has no file format"),
            (false, _) => format!("{what} can be written to: {}", known.join(", ")),
        };
        self.find(code::OUTPUT_FORMAT, span, message, help);
    }
}
