//! The fields of a graph file: which there are, and whether each is what it should be.

use std::collections::{HashMap, HashSet};

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Field, Kind, Tree, nearest_or_all, with_article};

use super::check::Check;

/// The version of the file format that this program reads.
const FORMAT: f64 = 1.0;

/// The fields of a graph.
pub(super) const FIELDS: [&str; 11] = [
    "format", "version", "doc", "packs", "use", "inputs", "params", "nodes", "outputs", "promises",
    "expect",
];

/// What stands in the fields of a graph.
pub(super) struct TopLevel<'t> {
    pub(super) doc: String,
    /// Its own version.
    pub(super) version: Option<&'t Tree>,
    /// The packs that it needs, and their versions.
    pub(super) packs: &'t [(Tree, Tree)],
    pub(super) uses: &'t [(Tree, Tree)],
    /// None if the field is left out: then the outputs are files, not ports.
    pub(super) inputs: Option<&'t [(Tree, Tree)]>,
    pub(super) params: &'t [(Tree, Tree)],
    pub(super) nodes: &'t [(Tree, Tree)],
    pub(super) outputs: &'t [(Tree, Tree)],
    /// Properties of the outputs.
    pub(super) promises: &'t [(Tree, Tree)],
    pub(super) expect: Option<&'t Tree>,
}

/// Whether a word can name a node: `[a-z][a-z0-9-]*`.
pub fn is_name(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_lowercase())
        && word.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-')
}

/// How the name of an input or a parameter is written as a field of a use, where an underscore stands for a hyphen: `eye_step`.
pub fn field_of(name: &str) -> String {
    name.replace('-', "_")
}

/// The name that a field stands for: `eye-step`.
pub fn name_of(field: &str) -> String {
    field.replace('_', "-")
}

impl Check<'_, '_> {
    /// Whether the file is of another format version; then nothing else in it is judged.
    pub(super) fn is_newer(&mut self, tree: &Tree) -> bool {
        let fields = tree.fields().unwrap_or_default();
        let Some(field) = fields.iter().find(|field| field.name.text == "format") else {
            return false;
        };
        match field.value.kind {
            Kind::Number { value, .. } if value != FORMAT => {
                let message =
                    format!("format {value} is unknown: this program reads format {FORMAT}");
                let help = "use a newer program, or the graph's older version";
                self.find(code::FORMAT, field.value.span, message, help);
                true
            }
            _ => false,
        }
    }

    pub(super) fn top_level<'t>(&mut self, tree: &'t Tree) -> Option<TopLevel<'t>> {
        let is_graph = tree.name().is_some_and(|name| name.text == "Graph");
        let Some(fields) = tree.fields().filter(|_| is_graph) else {
            let message = format!("a graph file holds Graph(..), not {}", tree.in_words());
            let help = match tree.name().as_ref().map_or("", |name| &name.text) {
                "Test" => "it is a test: `maquette test` runs it",
                "Lock" => {
                    "it is a lock file, which `maquette lock` writes beside a graph: name the graph"
                }
                "Pins" => {
                    "these are pins, which `maquette pin` writes beside a graph: name the graph"
                }
                "Layout" => "it is where an editor puts the nodes of a graph: name the graph",
                "Handles" => "these are handles, which nodes read",
                _ => "begin with `Graph(format: 1, nodes: {..}, outputs: {..})`",
            };
            self.find(code::SYNTAX, tree.span, message, help);
            return None;
        };
        let mut top = TopLevel {
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
                self.find(code::BAD_NAME, name.span, message, "keep one of them");
                continue;
            }
            match (&name.text[..], &value.kind) {
                ("format", Kind::Number { .. }) => {}
                ("doc", Kind::Text(doc)) => top.doc.clone_from(doc),
                ("version", _) => top.version = Some(value),
                ("packs", Kind::Map(entries)) => top.packs = entries,
                ("use", Kind::Map(entries)) => top.uses = entries,
                ("inputs", Kind::Map(entries)) => top.inputs = Some(entries),
                ("params", Kind::Map(entries)) => top.params = entries,
                ("nodes", Kind::Map(entries)) => top.nodes = entries,
                ("outputs", Kind::Map(entries)) => top.outputs = entries,
                ("promises", Kind::Map(entries)) => top.promises = entries,
                ("expect", _) => top.expect = Some(value),
                (known, _) if FIELDS.contains(&known) => self.wrong_field(known, value),
                (unknown, _) => {
                    let message = format!("Graph has no field `{unknown}`");
                    let help = self.guess(|| nearest_or_all(unknown, "its fields", &FIELDS));
                    self.find(code::UNKNOWN_FIELD, name.span, message, help);
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
                self.find(code::MISSING_FIELD, span, message, help);
            }
        }
        Some(top)
    }

    fn wrong_field(&mut self, field: &str, value: &Tree) {
        let wanted = match field {
            "format" => "the number 1",
            "doc" => "a text",
            _ => "a map: {\"name\": .., ..}",
        };
        let message = format!("field `{field}` of Graph wants {wanted}, not {}", value.in_words());
        self.find(code::WRONG_VALUE, value.span, message, "");
    }

    /// The entries of a map whose keys are names, each once, and none of those that are taken already.
    pub(super) fn named<'t>(
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
                    key.in_words()
                );
                self.find(code::BAD_NAME, key.span, message, "");
                continue;
            };
            if !is_name(name) {
                let message = format!("`{name}` cannot name {}", with_article(what));
                let help = "names begin with a lower-case letter; lower-case letters, digits and hyphens follow";
                self.find(code::BAD_NAME, key.span, message, help);
                self.misnamed.insert(name.to_owned());
            } else if let Some((first, kind)) = seen.insert(name, (key.span, what)) {
                let message = format!("there is already {} `{name}`", with_article(kind));
                self.find(code::BAD_NAME, key.span, message, "give one of them another name");
                if let Some(finding) = self.findings.last_mut() {
                    finding.note = Some((first, "the first one".into()));
                }
            } else {
                kept.push((key, value));
            }
        }
        kept
    }
}
