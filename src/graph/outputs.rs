//! The outputs of a graph: either files, in a format for the type of the value, or values for other graphs that use this graph.

use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;

use maquette_syntax::error::{Span, code};
use maquette_syntax::paths::is_inside_output_folder;
use maquette_syntax::spelling::{file_key, same_file_message};
use maquette_syntax::{Tree, with_article};
use maquette_value::ValueType;
use maquette_value::fs::extension;

use super::check::Check;
use super::definition::Port;
use super::link::Names;
use super::{GraphOutput, is_name};
use crate::definition::ParsedNode;

impl Check<'_, '_> {
    /// Returns the output files, and in a second list those whose type of value is unknown.
    pub(super) fn outputs(
        &mut self,
        entries: &[(Tree, Tree)],
        parsed_nodes: &[ParsedNode],
        names: &Names<'_>,
    ) -> (Vec<GraphOutput>, Vec<GraphOutput>) {
        let mut outputs: Vec<GraphOutput> = Vec::with_capacity(entries.len());
        let mut undecided = Vec::new();
        // Compare the names as paths: `a/./b.ply` equals `a//b.ply`.
        let mut taken: HashMap<String, (&str, Span)> = HashMap::new();
        for (key, value) in entries {
            let Some(name) = key.text() else {
                let message = format!("the name of an output is a text, not {}", key.describe());
                self.report(code::BAD_NAME, key.span, message, "write \"name.ply\": \"node\"");
                continue;
            };
            if !is_inside_output_folder(name) {
                let message = format!("output `{name}` is outside the output folder");
                self.report(
                    code::OUTSIDE,
                    key.span,
                    message,
                    "name a file, such as \"model.ply\"; --out chooses the folder",
                );
                continue;
            }
            if name.contains(char::is_control) {
                let message = format!("output `{name}` has a control character in its name");
                self.report(code::BAD_NAME, key.span, message, "use a name of one line");
                continue;
            }
            if let Some(&(first, at)) = taken.get(&file_key(name)) {
                if Path::new(first) == Path::new(name) {
                    let message = format!("there is already an output `{name}`");
                    self.report(code::BAD_NAME, key.span, message, "");
                } else {
                    let message = same_file_message("outputs", first, name);
                    let help = "give one of them another name";
                    self.report_with_note(
                        key.span,
                        message,
                        help,
                        (at, "the first one".to_owned()),
                    );
                }
                continue;
            }
            let Some(targets) = self.output_link(name, value, parsed_nodes, names) else {
                continue;
            };
            let Some((node, output)) = self.single_target(name, value, &targets, parsed_nodes)
            else {
                continue;
            };
            let kind = parsed_nodes[node].types.get(output).copied().flatten();
            let ending = extension(Path::new(name));
            let format = match kind {
                Some(kind) => self.world.catalog.format(kind, &ending),
                None => self.world.catalog.any_format(&ending),
            };
            let Some(format) = format.copied() else {
                self.no_format(name, &ending, kind, key.span);
                continue;
            };
            taken.insert(file_key(name), (name, key.span));
            let (source, span) = self.source_map.locate(key.span);
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
        parsed_nodes: &[ParsedNode],
        names: &Names<'_>,
    ) -> Option<Vec<(usize, usize)>> {
        let Some(link) = value.text() else {
            let message = format!("output `{name}`: expected a link, found {}", value.describe());
            let help = "write \"node\" or \"node.output\"";
            self.report(code::WRONG_VALUE, value.span, message, help);
            return None;
        };
        self.target(link, value.span, parsed_nodes, names)
    }

    /// Returns the value to which a link leads. Reports an error and returns `None` if the link leads to a list.
    fn single_target(
        &mut self,
        name: &str,
        value: &Tree,
        targets: &[(usize, usize)],
        parsed_nodes: &[ParsedNode],
    ) -> Option<(usize, usize)> {
        let list = match *targets {
            [(node, output)] if parsed_nodes[node].is_list(output) => "a list".to_owned(),
            [target] => return Some(target),
            _ => format!("a list of {}", targets.len()),
        };
        let message = format!("output `{name}` is one value, but this is {list}");
        let help = "join them first, or add an output for each";
        self.report(code::WRONG_TYPE, value.span, message, help);
        None
    }

    /// Returns the outputs of a graph with inputs: ports to which other graphs can link, instead of files.
    pub fn ports(
        &mut self,
        entries: &[(Tree, Tree)],
        parsed_nodes: &[ParsedNode],
        names: &Names<'_>,
    ) -> Vec<Port> {
        let mut ports: Vec<Port> = Vec::with_capacity(entries.len());
        let mut taken = HashSet::new();
        for (key, value) in entries {
            let Some(name) = key.text() else {
                let message = format!("the name of an output is a text, not {}", key.describe());
                self.report(code::BAD_NAME, key.span, message, "write \"name\": \"node\"");
                continue;
            };
            if !is_name(&name.replace('_', "-")) {
                let message = format!("`{name}` cannot name an output of a graph that others use");
                let help =
                    "its outputs are ports, not files: use lower-case letters, digits and hyphens";
                self.report(code::BAD_NAME, key.span, message, help);
                continue;
            }
            if !taken.insert(name) {
                let message = format!("there is already an output `{name}`");
                self.report(code::BAD_NAME, key.span, message, "");
                continue;
            }
            let targets = self.output_link(name, value, parsed_nodes, names);
            // Keep an output with an invalid link, so that links to it in other graphs do not cause further errors.
            let target =
                targets.and_then(|targets| self.single_target(name, value, &targets, parsed_nodes));
            if let Some(input) =
                target.map(|(node, _)| &parsed_nodes[node]).filter(|it| it.is_optional)
            {
                let input = &input.name.text;
                let message =
                    format!("output `{name}` needs a value, but input `{input}` may be left out");
                let help = format!("declare `{input}` without Optional(..)");
                self.report(code::MISSING_FIELD, value.span, message, help);
            }
            let kind = target.and_then(|(node, output)| parsed_nodes[node].types.get(output));
            let (name, kind) = (name.to_owned(), kind.copied().flatten());
            let lineage = Arc::default();
            ports.push(Port { name, target, kind, lineage, span: key.span });
        }
        ports
    }

    fn no_format(&mut self, name: &str, ending: &str, kind: Option<&ValueType>, span: Span) {
        let known = self.world.catalog.extensions(kind);
        let what = kind.map_or_else(|| "a value".to_owned(), |kind| with_article(kind.name));
        let message = match ending {
            "" => format!("output `{name}` has no extension that determines how to write {what}"),
            _ => format!("{what} cannot be written to a `.{ending}` file"),
        };
        let help = match (known.is_empty(), kind) {
            (true, _) => format!("{what} has no file format"),
            (false, _) => format!("{what} can be written to: {}", known.join(", ")),
        };
        self.report(code::OUTPUT_FORMAT, span, message, help);
    }
}
