//! Completion of values: nodes, keywords, schema values, parameters, expressions and files.

use std::path::Path;
use std::rc::Rc;

use maquette_syntax::{Unit, to_ron, unit_names, variants};
use serde_json::Value as Json;

use super::{Proposal, ProposalKind, Search, is_text};
use crate::expected_syntax::{ExpectedSyntax, FieldInfo, fields_of, takes};
use crate::library::{Library, NodeKind};

impl Search<'_> {
    /// Returns the text of a new node, with its required ports to be filled in.
    fn node_call(&self, name: &str, fields: &[FieldInfo]) -> String {
        let ports = fields.iter().filter(|field| field.required);
        let ports: Vec<_> = ports
            .filter_map(|field| match &field.slot {
                ExpectedSyntax::Link(_) => Some((&field.name, "\"", "\"")),
                ExpectedSyntax::List(item) if matches!(**item, ExpectedSyntax::Link(_)) => {
                    Some((&field.name, "[", "]"))
                }
                _ => None,
            })
            .collect();
        if ports.is_empty() || self.text_after().starts_with('(') {
            return self.call(name);
        }
        let fields = ports.iter().enumerate().map(|(index, (name, open, close))| {
            format!("{name}: {open}{}{close}", if index == 0 { "$0" } else { "" })
        });
        format!("{name}({})", fields.collect::<Vec<_>>().join(", "))
    }

    /// Proposes node types: first the used graphs, then nodes that accept the outputs of the nodes just before the cursor.
    pub(super) fn nodes(&self) -> Vec<Proposal> {
        let mut known = Vec::new();
        for used in &self.scope.uses {
            known.extend(
                self.library
                    .kind(self.scope, &used.name.text)
                    .map(|kind| (&used.name.text[..], kind)),
            );
        }
        for name in self.library.catalog.names() {
            known.extend(self.library.kind(self.scope, name).map(|kind| (name, kind)));
        }
        let newest = self.scope.nodes.iter().rev().filter(|node| node.name.span.end < self.at);
        let newest = newest.filter(|node| !node.kind.is_empty());
        let newest = newest.flat_map(|node| self.outputs(node)).flat_map(|(_, types)| types);
        let newest = newest.collect::<Vec<_>>();
        fn rank(fields: &[FieldInfo], newest: &[String]) -> usize {
            let mut wanted = fields.iter().filter(|field| field.required);
            let wanted = wanted.find_map(|field| match &field.slot {
                ExpectedSyntax::Link(types) => Some(types.clone()),
                ExpectedSyntax::List(item) => match &**item {
                    ExpectedSyntax::Link(types) => Some(types.clone()),
                    _ => None,
                },
                _ => None,
            });
            match wanted {
                None => {
                    if newest.is_empty() {
                        0
                    } else {
                        500
                    }
                }
                Some(types) => newest
                    .iter()
                    .position(|kind| types.contains(kind))
                    .map_or(900, |near| 10 * near.min(40)),
            }
        }
        let mut found: Vec<_> = known
            .into_iter()
            .enumerate()
            .map(|(index, (name, kind)): (usize, (&str, Rc<NodeKind>))| {
                let fields = fields_of(&kind.schema, &kind.schema);
                let rank = 1000 * rank(&fields, &newest) + index;
                Proposal {
                    detail: gives(&kind),
                    doc: kind.schema["description"].as_str().unwrap_or_default().to_owned(),
                    ..self.proposal(name, self.node_call(name, &fields), ProposalKind::Node, rank)
                }
            })
            .collect();
        for (index, name) in ["ForEach", "Switch"].into_iter().enumerate() {
            found.push(Proposal {
                doc: Library::word("nodes", name),
                ..self.proposal(name, self.call(name), ProposalKind::Keyword, 450_000 + index)
            });
        }
        found
    }

    pub(super) fn node_types(&self) -> Vec<Proposal> {
        let used = self.scope.uses.iter().map(|used| &used.name.text[..]);
        let all = used.chain(self.library.catalog.names()).enumerate();
        all.map(|(index, name)| self.proposal(name, self.quote(name), ProposalKind::Node, index))
            .collect()
    }

    pub(super) fn inputs(&self) -> Vec<Proposal> {
        let mut kinds: Vec<_> = self.library.catalog.value_types().into_keys().collect();
        kinds.sort_unstable();
        let all = kinds.into_iter().chain(["Optional"]).enumerate();
        all.map(|(index, name)| self.proposal(name, self.call(name), ProposalKind::Node, index))
            .collect()
    }

    pub(super) fn declarations(&self) -> Vec<Proposal> {
        let words = Library::words_in("params");
        let proposals = words.iter().enumerate().map(|(index, name)| {
            let insert = match self.text_after().starts_with('(') {
                true => name.clone(),
                false => format!("{name}(default: $0)"),
            };
            Proposal {
                doc: Library::word("params", name),
                ..self.proposal(name, insert, ProposalKind::Node, index)
            }
        });
        proposals.collect()
    }

    pub(super) fn properties(&self, kind: &str) -> Vec<Proposal> {
        let mut types = Vec::from_iter(self.library.catalog.value_types());
        types.sort_by_key(|(name, _)| *name);
        let mut found = Vec::new();
        for (name, value) in types {
            if kind.is_empty() || name == kind {
                for (property, doc) in value.properties() {
                    let proposal = self.proposal(
                        property,
                        property.to_owned(),
                        ProposalKind::Choice,
                        found.len(),
                    );
                    found.push(Proposal { doc: doc.to_owned(), ..proposal });
                }
            }
        }
        found.sort_by(|a, b| a.label.cmp(&b.label));
        found
    }

    pub(super) fn words(&self, words: &[(String, String)]) -> Vec<Proposal> {
        fn is_plain(word: &str) -> bool {
            word.parse::<f64>().is_ok() || word == "true" || word == "false"
        }
        words
            .iter()
            .enumerate()
            .map(|(index, (word, doc))| {
                let insert = if is_plain(word) { word.clone() } else { self.quote(word) };
                Proposal {
                    doc: doc.clone(),
                    ..self.proposal(word, insert, ProposalKind::Choice, index)
                }
            })
            .collect()
    }

    pub(super) fn parameter_names(&self) -> Vec<Proposal> {
        self.scope
            .params
            .iter()
            .enumerate()
            .map(|(index, it)| Proposal {
                detail: format!("{} {}", it.kind, it.of).trim_end().to_owned(),
                ..self.proposal(
                    &it.name.text,
                    self.quote(&it.name.text),
                    ProposalKind::Parameter,
                    index,
                )
            })
            .collect()
    }

    pub(super) fn expression(&self) -> Vec<Proposal> {
        let mut found = self.parameter_names();
        found.retain(|proposal| {
            !proposal.detail.starts_with("Text") && !proposal.detail.starts_with("Color")
        });
        // `rest` begins after the word at the cursor, which may be in the middle of an expression.
        let rest = self.text[self.at..]
            .trim_start_matches(|c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-')
            .trim_start();
        fn call(name: &str, rest: &str) -> String {
            match rest.starts_with('(') {
                true => name.to_owned(),
                false => format!("{name}($0)"),
            }
        }
        for name in Library::words_in("Expr") {
            found.push(Proposal {
                doc: Library::word("Expr", &name),
                ..self.proposal(&name, call(&name, rest), ProposalKind::Value, 100 + found.len())
            });
        }
        for name in ["pi", "true", "false"] {
            found.push(self.proposal(
                name,
                name.to_owned(),
                ProposalKind::Value,
                100 + found.len(),
            ));
        }
        for name in unit_names() {
            found.push(self.proposal(
                name,
                call(name, rest),
                ProposalKind::Unit,
                100 + found.len(),
            ));
        }
        match is_text(self.cursor) {
            true => found,
            false => Vec::new(),
        }
    }

    /// Proposes values that a schema allows: the default, enum variants, and units.
    pub(super) fn schema_proposals(&self, schema: &Json, root: &Json) -> Vec<Proposal> {
        let mut found = Vec::new();
        let default = schema.get("default").filter(|default| !default.is_null());
        let default = default.map(|default| to_ron(default, schema, root));
        let choices = variants(schema);
        let described = schema["oneOf"].as_array().into_iter().flatten();
        let described =
            described.map(|it| it["description"].as_str().unwrap_or_default()).collect::<Vec<_>>();
        if is_text(self.cursor) {
            let text = default.as_deref().and_then(|it| it.strip_prefix('"')?.strip_suffix('"'));
            found.extend(
                text.map(|text| self.proposal(text, text.to_owned(), ProposalKind::Value, 0)),
            );
            return found;
        }
        for (index, (name, content)) in choices.iter().enumerate() {
            let insert = if content.is_some() { self.call(name) } else { (*name).to_owned() };
            let doc = described.get(index).copied().unwrap_or_default().to_owned();
            let is_default =
                default.as_deref().is_some_and(|it| it.split('(').next() == Some(name));
            let rank = if is_default { 0 } else { index + 1 };
            let detail = content.map_or_else(String::new, |content| takes(content, root));
            found.push(Proposal {
                doc,
                detail,
                ..self.proposal(name, insert, ProposalKind::Choice, rank)
            });
        }
        if schema["type"] == "boolean" {
            for (rank, word) in ["true", "false"].into_iter().enumerate() {
                found.push(self.proposal(word, word.to_owned(), ProposalKind::Value, rank));
            }
        }
        if let Some(default) = default.filter(|_| choices.is_empty()) {
            let proposal = self.proposal(&default, default.clone(), ProposalKind::Value, 0);
            found.push(Proposal { detail: "default".into(), ..proposal });
        }
        if schema.get("properties").is_some() && !self.text_after().starts_with('(') {
            found.push(self.proposal("(..)", "($0)".into(), ProposalKind::Value, 1));
        }
        if let Some(own) = schema["unit"].as_str().and_then(Unit::read) {
            let fitting = unit_names()
                .filter(|name| Unit::from_name(name).is_some_and(|unit| unit.is_compatible(own)));
            for (index, unit) in fitting.enumerate() {
                found.push(self.proposal(unit, self.call(unit), ProposalKind::Unit, 30 + index));
            }
        }
        found
    }

    /// Proposes alternatives to a literal value: a parameter of the right type, an expression, or a draft value.
    pub(super) fn computed_proposals(&self, slot: &ExpectedSyntax) -> Vec<Proposal> {
        let schema = match slot {
            ExpectedSyntax::Value { schema, .. } => Some(&**schema),
            _ => None,
        };
        let is_number =
            schema.is_none_or(|it| matches!(it["type"].as_str(), Some("number" | "integer")));
        let unit = schema.and_then(|schema| schema["unit"].as_str()).unwrap_or_default();
        let mut found = Vec::new();
        for it in &self.scope.params {
            let fits = match &it.kind[..] {
                "Number" | "Integer" => is_number && schema.is_some(),
                "Text" => {
                    matches!(slot, ExpectedSyntax::Path(_))
                        || schema.is_some_and(|it| it["type"] == "string")
                }
                "Color" => schema.is_some_and(|it| it["format"] == "color"),
                "Toggle" => schema.is_some_and(|it| it["type"] == "boolean"),
                "Choice" => schema.is_some_and(|it| !variants(it).is_empty()),
                _ => schema.is_some_and(|it| it["type"] == "array"),
            };
            if !fits {
                continue;
            }
            let rank = 5 + found.len() + if it.of == unit { 0 } else { 10 };
            let label = format!("Param(\"{}\")", it.name.text);
            let proposal = self.proposal(&label, label.clone(), ProposalKind::Parameter, rank);
            found.push(Proposal { detail: format!("{} {}", it.kind, it.of), ..proposal });
        }
        if self.text_after().starts_with('(') {
            let words = ["Param", "Expr", "Draft"].into_iter().enumerate();
            found.extend(words.map(|(index, word)| {
                self.proposal(word, word.into(), ProposalKind::Keyword, 40 + index)
            }));
            return found;
        }
        if is_number && schema.is_some() {
            found.push(self.proposal("Expr", "Expr(\"$0\")".into(), ProposalKind::Keyword, 40));
        }
        let words = [("Param", "Param(\"$0\")"), ("Draft", "Draft(final: $0, draft: )")];
        found.extend(
            words.map(|(word, insert)| {
                self.proposal(word, insert.into(), ProposalKind::Keyword, 41)
            }),
        );
        found
    }

    /// Proposes folders, and files with one of the extensions `endings`.
    pub(super) fn files(&self, endings: &[String]) -> Vec<Proposal> {
        let typed = match is_text(self.cursor) {
            true => &self.text[self.cursor.typed.span.start..self.at],
            false => "",
        };
        let (folder, _) = typed.rsplit_once('/').unwrap_or(("", typed));
        let inside = self.library.path.with_file_name("").join(folder);
        fn fits(name: &str, endings: &[String]) -> bool {
            let ending = Path::new(name).extension().map(|it| it.to_string_lossy().to_lowercase());
            endings.is_empty() || ending.is_some_and(|ending| endings.contains(&ending))
        }
        let mut names = Vec::new();
        for entry in std::fs::read_dir(inside).into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let is_folder = entry.path().is_dir();
            let is_own = entry.path() == self.library.path;
            let is_plain = !name.contains(['"', '\\', '\n', '\r']);
            if name.starts_with('.') || is_own || !is_plain || !(is_folder || fits(&name, endings))
            {
                continue;
            }
            let slash = if is_folder { "/" } else { "" };
            let gap = if folder.is_empty() { "" } else { "/" };
            names.push((is_folder, format!("{folder}{gap}{name}{slash}")));
        }
        names.sort();
        names
            .into_iter()
            .enumerate()
            .map(|(index, (is_folder, name)): (usize, (bool, String))| {
                let rank = index + 1000 * usize::from(is_folder);
                self.proposal(&name, self.quote(&name), ProposalKind::File, rank)
            })
            .collect()
    }
}

/// Formats the types of a node's ports and outputs, such as `Mask -> Labels`.
fn gives(kind: &NodeKind) -> String {
    let fields = fields_of(&kind.schema, &kind.schema);
    let takes = fields.iter().filter(|field| field.required);
    let takes = takes.filter_map(|field| match &field.slot {
        ExpectedSyntax::Link(types) => Some(types.join(" or ")),
        ExpectedSyntax::List(_) => Some(field.takes.clone()),
        _ => None,
    });
    let takes = takes.collect::<Vec<_>>().join(", ");
    let gives = kind.outputs.iter().map(|(_, types)| types.join(" or "));
    let gives = gives.collect::<Vec<_>>().join(", ");
    if takes.is_empty() { gives } else { format!("{takes} -> {gives}") }
}
