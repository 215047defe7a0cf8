//! The fields of a graph file, and their validation.

use std::collections::{HashMap, HashSet};

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Field, Kind, Tree, nearest_or_all, with_article};

use super::check::Check;

/// The version of the file format that this program reads.
const FORMAT: f64 = 1.0;

/// The names of the fields that a graph file can have.
pub(super) const FIELDS: [&str; 11] = [
    "format", "version", "doc", "packs", "use", "inputs", "params", "nodes", "outputs", "promises",
    "expect",
];

/// The values of the fields of a graph.
pub(super) struct Header<'t> {
    pub(super) doc: String,
    /// The field `version` of the graph.
    pub(super) version: Option<&'t Tree>,
    /// The packs that the graph requires, with their versions.
    pub(super) packs: &'t [(Tree, Tree)],
    pub(super) uses: &'t [(Tree, Tree)],
    /// The declared inputs. `None` if the file has no field `inputs`; the outputs of the graph are then files, not ports.
    pub(super) inputs: Option<&'t [(Tree, Tree)]>,
    pub(super) params: &'t [(Tree, Tree)],
    pub(super) nodes: &'t [(Tree, Tree)],
    pub(super) outputs: &'t [(Tree, Tree)],
    /// The properties that the graph promises of its outputs.
    pub(super) promises: &'t [(Tree, Tree)],
    pub(super) expect: Option<&'t Tree>,
}

/// Returns true if a word can be the name of a node: `[a-z][a-z0-9-]*`.
pub fn is_name(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_lowercase())
        && word.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-')
}

/// Returns the field name for an input or a parameter: `eye_step` for `eye-step`.
pub fn field_of(name: &str) -> String {
    name.replace('-', "_")
}

/// Returns the name of the input or parameter for a field name: `eye-step` for `eye_step`.
pub fn name_of(field: &str) -> String {
    field.replace('_', "-")
}

impl Check<'_, '_> {
    /// Reports an unknown format version, and returns true. The rest of the file is then not checked.
    pub(super) fn is_other_format(&mut self, tree: &Tree) -> bool {
        let fields = tree.fields().unwrap_or_default();
        let Some(field) = fields.iter().find(|field| field.name.text == "format") else {
            return false;
        };
        match field.value.kind {
            Kind::Number { value, .. } if value != FORMAT => {
                let message =
                    format!("format {value} is unknown: this program reads format {FORMAT}");
                let help = "use a newer program, or an older version of the graph";
                self.report(code::FORMAT, field.value.span, message, help);
                true
            }
            _ => false,
        }
    }

    pub(super) fn read_header<'t>(&mut self, tree: &'t Tree) -> Option<Header<'t>> {
        let is_graph = tree.name().is_some_and(|name| name.text == "Graph");
        let Some(fields) = tree.fields().filter(|_| is_graph) else {
            let message = format!("expected Graph(..), found {}", tree.describe());
            let help = match tree.name().as_ref().map_or("", |name| &name.text) {
                "Test" => "this is a test: run it with `maquette test`",
                "Lock" => {
                    "this is a lock file, which `maquette lock` writes next to a graph: name the graph"
                }
                "Pins" => {
                    "these are pins, which `maquette pin` writes next to a graph: name the graph"
                }
                "Layout" => "this is the layout of a graph in an editor: name the graph",
                "Handles" => "these are handles, which nodes read",
                _ => "begin with `Graph(format: 1, nodes: {..}, outputs: {..})`",
            };
            self.report(code::SYNTAX, tree.span, message, help);
            return None;
        };
        let mut header = Header {
            doc: String::new(),
            version: None,
            packs: &[],
            uses: &[],
            inputs: None,
            params: &[],
            nodes: &[],
            outputs: &[],
            promises: &[],
            expect: None,
        };
        let mut given = HashSet::new();
        for Field { name, value } in fields {
            if !given.insert(&name.text) {
                let message = format!("field `{}` is given twice", name.text);
                self.report(code::BAD_NAME, name.span, message, "keep one of them");
                continue;
            }
            match (&name.text[..], &value.kind) {
                ("format", Kind::Number { .. }) => {}
                ("doc", Kind::Text(doc)) => header.doc.clone_from(doc),
                ("version", _) => header.version = Some(value),
                ("packs", Kind::Map(entries)) => header.packs = entries,
                ("use", Kind::Map(entries)) => header.uses = entries,
                ("inputs", Kind::Map(entries)) => header.inputs = Some(entries),
                ("params", Kind::Map(entries)) => header.params = entries,
                ("nodes", Kind::Map(entries)) => header.nodes = entries,
                ("outputs", Kind::Map(entries)) => header.outputs = entries,
                ("promises", Kind::Map(entries)) => header.promises = entries,
                ("expect", _) => header.expect = Some(value),
                (known, _) if FIELDS.contains(&known) => self.wrong_field(known, value),
                (unknown, _) => {
                    let message = format!("Graph has no field `{unknown}`");
                    let help = self.guess(|| nearest_or_all(unknown, "its fields", &FIELDS));
                    self.report(code::UNKNOWN_FIELD, name.span, message, help);
                }
            }
        }
        for needed in ["format", "nodes", "outputs"] {
            if !fields.iter().any(|field| field.name.text == needed) {
                let span = tree.name().map_or(tree.span, |name| name.span);
                let message = format!("Graph needs a field `{needed}`");
                let help = if needed == "format" {
                    "write `format: 1`"
                } else {
                    "write a map: {\"name\": .., ..}"
                };
                self.report(code::MISSING_FIELD, span, message, help);
            }
        }
        Some(header)
    }

    fn wrong_field(&mut self, field: &str, value: &Tree) {
        let wanted = match field {
            "format" => "the number 1",
            "doc" => "a text",
            _ => "a map: {\"name\": .., ..}",
        };
        let message =
            format!("field `{field}` of Graph: expected {wanted}, found {}", value.describe());
        self.report(code::WRONG_VALUE, value.span, message, "");
    }

    /// Returns the entries of a map whose names are valid and unique, and reports the other entries.
    pub(super) fn named_entries<'t>(
        &mut self,
        entries: &'t [(Tree, Tree)],
        what: &str,
        taken: &[(Tree, Tree)],
    ) -> Vec<(&'t Tree, &'t Tree)> {
        let mut kept = Vec::with_capacity(entries.len());
        let taken = taken.iter().filter_map(|(key, _)| Some((key.text()?, (key.span, "input"))));
        let mut seen: HashMap<&str, (Span, &str)> = taken.collect();
        for (key, value) in entries {
            let Some(name) = key.text() else {
                let message = format!(
                    "the name of {} is a text in double quotes, not {}",
                    with_article(what),
                    key.describe()
                );
                self.report(code::BAD_NAME, key.span, message, "");
                continue;
            };
            if !is_name(name) {
                let message = format!("`{name}` cannot name {}", with_article(what));
                let help =
                    "use a lower-case letter followed by lower-case letters, digits and hyphens";
                self.report(code::BAD_NAME, key.span, message, help);
                self.misnamed.insert(name.to_owned());
            } else if let Some((first, kind)) = seen.insert(name, (key.span, what)) {
                let message = format!("there is already {} `{name}`", with_article(kind));
                self.report(code::BAD_NAME, key.span, message, "give one of them another name");
                if let Some(diagnostic) = self.diagnostics.last_mut() {
                    diagnostic.note = Some((first, "the first one".into()));
                }
            } else {
                kept.push((key, value));
            }
        }
        kept
    }
}
