//! What may be written at a place: fields, nodes, links that fit, parameters, choices, units and files.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::Value as Json;

use super::library::{Library, NodeKind};
use super::scope::{Declared, Scope};
use super::slot::{FieldOf, Inside, Keys, Slot, Slots, takes};
use crate::error::Span;
use crate::text::{Cursor, Passed, TypedKind, cursor, each_word, ron, unit_names, variants};

/// Something that may be written.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Proposal {
    /// What is shown and compared with what has been typed.
    pub(super) label: String,
    /// What is written; `$0` is where the cursor is afterwards.
    pub(super) insert: String,
    pub(super) sort: Sort,
    /// What it takes or gives, on a line.
    pub(super) detail: String,
    pub(super) doc: String,
    /// The lower, the likelier.
    rank: usize,
}

/// What a proposal is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sort {
    Field,
    Node,
    Link,
    Parameter,
    Choice,
    Value,
    Unit,
    File,
    Keyword,
}

/// The proposals at a place, the likeliest first, and the part of the text in whose place they are written.
pub(super) struct Proposals {
    pub(super) span: Span,
    pub(super) list: Vec<Proposal>,
}

/// More are not told at once; what is typed next leaves fewer.
const MOST: usize = 200;

pub(super) fn proposals(library: &Library<'_>, text: &str, at: usize) -> Proposals {
    let scope = Scope::of(text);
    let cursor = cursor(text, at);
    let span = replaced(text, &cursor, at);
    if cursor.typed.kind == TypedKind::Comment {
        return Proposals { span, list: Vec::new() };
    }
    let slots = Slots { library, scope: &scope };
    let (inside, slot) = slots.at(&cursor.frames);
    let search = Search { library, scope: &scope, text, cursor: &cursor, at };
    let is_named = cursor.frames.last().is_some_and(|frame| frame.field.is_some());
    let mut list = match inside {
        Inside::Fields(_, fields) if !is_named => search.fields(&fields),
        Inside::Entries(keys) if !is_named => search.keys(keys),
        _ if cursor.frames.is_empty() => search.beginnings(),
        _ => search.values(&slot),
    };
    let (start, typed) = match slot {
        Slot::Expression if is_text(&cursor) => {
            let start = expression_word(text, &cursor, at);
            (start, &text[start..at])
        }
        _ => (span.start, &text[span.start.min(at)..at]),
    };
    rank(&mut list, typed);
    list.truncate(MOST);
    Proposals { span: Span { start, ..span }, list }
}

fn is_text(cursor: &Cursor) -> bool {
    cursor.typed.kind == TypedKind::Text
}

/// What a proposal replaces: the word or text at the place; of a text without an end only what stands before the place.
fn replaced(text: &str, cursor: &Cursor, at: usize) -> Span {
    let span = cursor.typed.span;
    let is_closed = !is_text(cursor) || text[span.end..].starts_with('"');
    Span {
        start: span.start,
        end: if is_closed { span.end } else { at.clamp(span.start, span.end) },
    }
}

/// Where the word begins that stands before a place in an expression.
fn expression_word(text: &str, cursor: &Cursor, at: usize) -> usize {
    let before = &text[cursor.typed.span.start..at];
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    cursor.typed.span.start + before.trim_end_matches(is_part).len()
}

/// Leaves what may be meant by what has been typed, the likeliest first: what begins so, then what has it in it, then its letters in order.
fn rank(list: &mut Vec<Proposal>, typed: &str) {
    let typed = typed.to_lowercase();
    let distance = |label: &str| {
        let label = label.to_lowercase();
        let mut rest = label.chars();
        match label.find(&typed) {
            Some(0) => Some(0),
            Some(_) => Some(1),
            None => typed.chars().all(|c| rest.any(|other| other == c)).then_some(2),
        }
    };
    list.retain(|proposal| distance(&proposal.label).is_some());
    list.sort_by_key(|proposal| (distance(&proposal.label), proposal.rank));
    let mut seen = BTreeSet::new();
    list.retain(|proposal| seen.insert((proposal.label.clone(), proposal.insert.clone())));
}

struct Search<'a> {
    library: &'a Library<'a>,
    scope: &'a Scope,
    text: &'a str,
    cursor: &'a Cursor,
    at: usize,
}

impl Search<'_> {
    fn proposal(&self, label: &str, insert: String, sort: Sort, rank: usize) -> Proposal {
        let (label, detail, doc) = (label.to_owned(), String::new(), String::new());
        Proposal { label, insert, sort, detail, doc, rank }
    }

    /// What follows the word at the place.
    fn behind(&self) -> &str {
        self.text[self.cursor.typed.span.end.max(self.at)..].trim_start()
    }

    /// A word before parentheses.
    fn call(&self, name: &str) -> String {
        if self.behind().starts_with('(') { name.to_owned() } else { format!("{name}($0)") }
    }

    /// A text: without quotes inside of some.
    fn quoted(&self, text: &str) -> String {
        if is_text(self.cursor) { text.to_owned() } else { format!("\"{text}\"") }
    }

    fn beginnings(&self) -> Vec<Proposal> {
        let graph =
            "Graph(\n    format: 1,\n    nodes: {\n        $0\n    },\n    outputs: {},\n)\n";
        let files = [
            ("Graph", graph, "A graph."),
            (
                "Patch",
                "Patch(of: \"$0\", params: {})\n",
                "A graph that is another one with other values.",
            ),
            ("Test", "Test(graph: \"$0\")\n", "What a graph must give."),
        ];
        let file = |(index, (label, insert, detail)): (usize, (&str, &str, &str))| Proposal {
            detail: detail.to_owned(),
            ..self.proposal(label, insert.to_owned(), Sort::Keyword, index)
        };
        match is_text(self.cursor) || !self.behind().is_empty() {
            true => Vec::new(),
            false => files.into_iter().enumerate().map(file).collect(),
        }
    }

    fn fields(&self, fields: &[FieldOf]) -> Vec<Proposal> {
        if is_text(self.cursor) {
            return Vec::new();
        }
        let given = self.cursor.frames.last().map_or(&[][..], |frame| &frame.given);
        let is_given = |field: &FieldOf| {
            given.iter().any(|name| name.text == field.name && name.span != self.cursor.typed.span)
        };
        let field = |(index, field): (usize, &FieldOf)| {
            let insert = match self.behind().starts_with(':') {
                true => field.name.clone(),
                false => format!("{}: {}", field.name, opening(&field.slot)),
            };
            let rank = if field.required { index } else { 100 + index };
            Proposal {
                detail: field.takes.clone(),
                doc: field.doc.clone(),
                ..self.proposal(&field.name, insert, Sort::Field, rank)
            }
        };
        let left = fields.iter().enumerate().filter(|(_, field)| !is_given(field));
        left.map(field).collect()
    }

    fn keys(&self, keys: Keys) -> Vec<Proposal> {
        let about = || self.library.about(self.scope);
        let named = |all: &[Declared]| {
            Vec::from_iter(all.iter().map(|it| (it.name.text.clone(), it.kind.clone())))
        };
        let known = match keys {
            Keys::Own => Vec::new(),
            Keys::Packs => {
                let packs = self
                    .library
                    .catalog
                    .entries()
                    .map(|entry| (entry.pack.to_owned(), String::new()));
                Vec::from_iter(BTreeSet::from_iter(packs))
            }
            Keys::Outputs => named(&self.scope.outputs),
            Keys::AboutParams => about().map_or_else(Vec::new, |it| named(&it.scope.params)),
            Keys::AboutNodes => about().map_or_else(Vec::new, |it| named(&it.scope.nodes)),
            Keys::AboutInputs => about().map_or_else(Vec::new, |it| named(&it.scope.inputs)),
            Keys::AboutOutputs => about().map_or_else(Vec::new, |it| named(&it.scope.outputs)),
            Keys::AboutValues => about().map_or_else(Vec::new, |about| {
                let mut known = named(&about.scope.params);
                for node in &about.scope.nodes {
                    let Some(Slot::Group(fields)) = about.node(self.library, &node.name.text)
                    else {
                        continue;
                    };
                    let values = fields.iter().filter(|field| !matches!(field.slot, Slot::Link(_)));
                    let name = |field: &FieldOf| format!("{}.{}", node.name.text, field.name);
                    known.extend(values.map(|field| (name(field), field.takes.clone())));
                }
                known
            }),
        };
        let given = self.cursor.frames.last().map_or(&[][..], |frame| &frame.given);
        let key = |(index, (name, detail)): (usize, (String, String))| {
            let quoted = self.quoted(&name);
            let insert =
                if self.behind().trim_start_matches('"').starts_with(':') || is_text(self.cursor) {
                    quoted
                } else {
                    format!("{quoted}: $0")
                };
            Proposal { detail, ..self.proposal(&name, insert, Sort::Field, index) }
        };
        let left = known.into_iter().filter(|(name, _)| {
            !given.iter().any(|it| it.text == *name && it.span != self.cursor.typed.span)
        });
        left.enumerate().map(key).collect()
    }

    fn values(&self, slot: &Slot) -> Vec<Proposal> {
        let is_text = is_text(self.cursor);
        let mut found = match slot {
            Slot::Link(types) => self.links(types),
            Slot::Expected => self.expected(),
            Slot::Node if !is_text => self.nodes(),
            Slot::NodeType => self.node_types(),
            Slot::Input if !is_text => self.inputs(),
            Slot::Parameter if !is_text => self.declarations(),
            Slot::Use => self.files(&["ron".to_owned()]),
            Slot::Path(endings) => self.files(endings),
            Slot::ParameterName => self.parameter_names(),
            Slot::Expression => self.expression(),
            Slot::Property(kind) if !is_text => self.properties(kind),
            Slot::Words(words) => self.words(words),
            Slot::List(item) if !is_text => {
                let mut inner = self.values(item);
                inner.retain(|proposal| matches!(proposal.sort, Sort::Link));
                inner
            }
            Slot::Value { schema, root } => self.described(schema, root),
            _ => Vec::new(),
        };
        let takes_parameters = matches!(slot, Slot::Value { .. } | Slot::Path(_) | Slot::Words(_));
        if takes_parameters && !is_text && !matches!(slot, Slot::Words(_)) {
            found.extend(self.computed(slot));
        }
        found
    }

    /// Links to values of some types: what nobody needs yet first, then what stands near.
    fn links(&self, types: &[String]) -> Vec<Proposal> {
        let own = self.cursor.frames.get(1).and_then(|section| section.field.as_ref());
        let own = own.filter(|_| self.cursor.frames.len() > 2).map(|name| &name.text[..]);
        let used = self.texts();
        let mut found = Vec::new();
        let nodes = self.scope.inputs.iter().chain(&self.scope.nodes);
        for (index, node) in nodes.enumerate().filter(|(_, node)| own != Some(&node.name.text[..]))
        {
            let outputs = self.outputs(node);
            let is_only = outputs.len() < 2;
            for (output, gives) in outputs {
                let fits = types.is_empty()
                    || gives.is_empty()
                    || gives.iter().any(|kind| types.iter().any(|wanted| wanted == kind));
                if !fits {
                    continue;
                }
                let label = match is_only || output.is_empty() {
                    true => node.name.text.clone(),
                    false => format!("{}.{output}", node.name.text),
                };
                let is_used = used.contains(&label);
                let is_below = self.at < node.name.span.start;
                let near = 1000 - index.min(999);
                let rank = near + 1000 * usize::from(is_used) + 2000 * usize::from(is_below);
                let quoted = self.quoted(&label);
                let kinds = if gives.is_empty() { node.kind.clone() } else { gives.join(" or ") };
                let proposal = self.proposal(&label, quoted, Sort::Link, rank);
                found.push(Proposal { detail: format!("{kinds} of {}", node.kind), ..proposal });
            }
        }
        found
    }

    /// All that stands in quotes, except for keys and what is being written.
    fn texts(&self) -> BTreeSet<String> {
        let mut texts = BTreeSet::new();
        each_word(self.text, |_, passed| match passed {
            Passed::Word(word, TypedKind::Text) if word.span != self.cursor.typed.span => {
                texts.insert(word.text.clone());
            }
            _ => {}
        });
        texts
    }

    /// The outputs of a node or an input, and the types of values that each gives; no types where nothing is known.
    fn outputs(&self, node: &Declared) -> Vec<(String, Vec<String>)> {
        let of = |kind: &str| {
            let kind = self.library.kind(self.scope, kind)?;
            let output = |(name, types): &(String, Vec<&str>)| {
                (name.clone(), types.iter().map(|&kind| kind.to_owned()).collect())
            };
            Some(kind.outputs.iter().map(output).collect())
        };
        let is_input = self.scope.inputs.iter().any(|input| std::ptr::eq(input, node));
        let found = match &node.kind[..] {
            kind if is_input => Some(vec![(String::new(), vec![kind.to_owned()])]),
            "ForEach" => of(&node.of),
            kind => of(kind),
        };
        found.unwrap_or_else(|| vec![(String::new(), Vec::new())])
    }

    /// What an expectation may speak of: outputs, then links.
    fn expected(&self) -> Vec<Proposal> {
        let scope_outputs = match &self.scope.file[..] {
            "Test" => self
                .library
                .about(self.scope)
                .map_or_else(Vec::new, |about| about.scope.outputs.clone()),
            _ => self.scope.outputs.clone(),
        };
        let output = |(index, output): (usize, &Declared)| Proposal {
            detail: format!("output: {}", output.kind),
            ..self.proposal(&output.name.text, self.quoted(&output.name.text), Sort::Link, index)
        };
        let mut found = Vec::from_iter(scope_outputs.iter().enumerate().map(output));
        found.extend(self.links(&[]));
        found
    }

    /// Types of nodes: graphs that are used, then what takes the newest values.
    fn nodes(&self) -> Vec<Proposal> {
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
        let newest = Vec::from_iter(newest);
        let rank = |kind: &NodeKind| {
            let wanted = super::slot::fields_of(&kind.schema, &kind.schema);
            let mut wanted = wanted.iter().filter(|field| field.required);
            let wanted = wanted.find_map(|field| match &field.slot {
                Slot::Link(types) => Some(types.clone()),
                Slot::List(item) => match &**item {
                    Slot::Link(types) => Some(types.clone()),
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
        };
        let node = |(index, (name, kind)): (usize, (&str, std::rc::Rc<NodeKind>))| Proposal {
            detail: gives(&kind),
            doc: kind.schema["description"].as_str().unwrap_or_default().to_owned(),
            ..self.proposal(name, self.call(name), Sort::Node, 1000 * rank(&kind) + index)
        };
        let mut found = Vec::from_iter(known.into_iter().enumerate().map(node));
        for (index, name) in ["ForEach", "Switch"].into_iter().enumerate() {
            found.push(Proposal {
                doc: Library::word("nodes", name),
                ..self.proposal(name, self.call(name), Sort::Keyword, 450_000 + index)
            });
        }
        found
    }

    fn node_types(&self) -> Vec<Proposal> {
        let used = self.scope.uses.iter().map(|used| &used.name.text[..]);
        let all = used.chain(self.library.catalog.names()).enumerate();
        all.map(|(index, name)| self.proposal(name, self.quoted(name), Sort::Node, index)).collect()
    }

    fn inputs(&self) -> Vec<Proposal> {
        let mut kinds = Vec::from_iter(self.library.catalog.value_types().into_keys());
        kinds.sort_unstable();
        let all = kinds.into_iter().chain(["Optional"]).enumerate();
        let of =
            |(index, name): (usize, &str)| self.proposal(name, self.call(name), Sort::Node, index);
        all.map(of).collect()
    }

    fn declarations(&self) -> Vec<Proposal> {
        let of = |(index, name): (usize, &String)| {
            let insert = match self.behind().starts_with('(') {
                true => name.clone(),
                false => format!("{name}(default: $0)"),
            };
            Proposal {
                doc: Library::word("params", name),
                ..self.proposal(name, insert, Sort::Node, index)
            }
        };
        Library::words_in("params").iter().enumerate().map(of).collect()
    }

    fn properties(&self, kind: &str) -> Vec<Proposal> {
        let mut types = Vec::from_iter(self.library.catalog.value_types());
        types.sort_by_key(|(name, _)| *name);
        let mut found = Vec::new();
        for (name, value) in types {
            if kind.is_empty() || name == kind {
                for (property, doc) in value.properties() {
                    let proposal =
                        self.proposal(property, property.to_owned(), Sort::Choice, found.len());
                    found.push(Proposal { doc: doc.to_owned(), ..proposal });
                }
            }
        }
        found.sort_by(|a, b| a.label.cmp(&b.label));
        found
    }

    fn words(&self, words: &[(String, String)]) -> Vec<Proposal> {
        let is_plain =
            |word: &str| word.parse::<f64>().is_ok() || word == "true" || word == "false";
        let of = |(index, (word, doc)): (usize, &(String, String))| {
            let insert = if is_plain(word) { word.clone() } else { self.quoted(word) };
            Proposal { doc: doc.clone(), ..self.proposal(word, insert, Sort::Choice, index) }
        };
        words.iter().enumerate().map(of).collect()
    }

    fn parameter_names(&self) -> Vec<Proposal> {
        let of = |(index, it): (usize, &Declared)| Proposal {
            detail: format!("{} {}", it.kind, it.of).trim_end().to_owned(),
            ..self.proposal(&it.name.text, self.quoted(&it.name.text), Sort::Parameter, index)
        };
        self.scope.params.iter().enumerate().map(of).collect()
    }

    fn expression(&self) -> Vec<Proposal> {
        let mut found = self.parameter_names();
        found.retain(|proposal| {
            !proposal.detail.starts_with("Text") && !proposal.detail.starts_with("Color")
        });
        for name in Library::words_in("Expr") {
            found.push(Proposal {
                doc: Library::word("Expr", &name),
                ..self.proposal(&name, format!("{name}($0)"), Sort::Value, 100 + found.len())
            });
        }
        match is_text(self.cursor) {
            true => found,
            false => Vec::new(),
        }
    }

    /// What a schema describes: its default, choices, units.
    fn described(&self, schema: &Json, root: &Json) -> Vec<Proposal> {
        let mut found = Vec::new();
        let default = schema.get("default").filter(|default| !default.is_null());
        let default = default.map(|default| ron(default, schema, root));
        let choices = variants(schema);
        let described = schema["oneOf"].as_array().into_iter().flatten();
        let described =
            Vec::from_iter(described.map(|it| it["description"].as_str().unwrap_or_default()));
        if is_text(self.cursor) {
            let text = default.as_deref().and_then(|it| it.strip_prefix('"')?.strip_suffix('"'));
            found.extend(text.map(|text| self.proposal(text, text.to_owned(), Sort::Value, 0)));
            return found;
        }
        for (index, (name, content)) in choices.iter().enumerate() {
            let insert = if content.is_some() { self.call(name) } else { name.clone() };
            let doc = described.get(index).copied().unwrap_or_default().to_owned();
            let is_default =
                default.as_deref().is_some_and(|it| it.split('(').next() == Some(&name[..]));
            let rank = if is_default { 0 } else { index + 1 };
            let detail = content.as_ref().map_or_else(String::new, |content| takes(content, root));
            found.push(Proposal { doc, detail, ..self.proposal(name, insert, Sort::Choice, rank) });
        }
        if schema["type"] == "boolean" {
            for (rank, word) in ["true", "false"].into_iter().enumerate() {
                found.push(self.proposal(word, word.to_owned(), Sort::Value, rank));
            }
        }
        if let Some(default) = default.filter(|_| choices.is_empty()) {
            let proposal = self.proposal(&default, default.clone(), Sort::Value, 0);
            found.push(Proposal { detail: "default".into(), ..proposal });
        }
        if schema.get("properties").is_some() && !self.behind().starts_with('(') {
            found.push(self.proposal("(..)", "($0)".into(), Sort::Value, 1));
        }
        if let Some(own) = schema["unit"].as_str().and_then(crate::text::Unit::read) {
            let fitting = unit_names().filter(|name| {
                crate::text::Unit::named(name).is_some_and(|unit| unit.is_like(own))
            });
            for (index, unit) in fitting.enumerate() {
                found.push(self.proposal(unit, self.call(unit), Sort::Unit, 30 + index));
            }
        }
        found
    }

    /// What stands for a value: parameters that fit, an expression, a draft.
    fn computed(&self, slot: &Slot) -> Vec<Proposal> {
        let schema = match slot {
            Slot::Value { schema, .. } => Some(&**schema),
            _ => None,
        };
        let is_number =
            schema.is_none_or(|it| matches!(it["type"].as_str(), Some("number" | "integer")));
        let kind = |it: &Declared| match &it.kind[..] {
            "Number" | "Integer" => is_number && schema.is_some(),
            "Text" => {
                matches!(slot, Slot::Path(_)) || schema.is_some_and(|it| it["type"] == "string")
            }
            "Color" => schema.is_some_and(|it| it["format"] == "color"),
            "Toggle" => schema.is_some_and(|it| it["type"] == "boolean"),
            "Choice" => schema.is_some_and(|it| !variants(it).is_empty()),
            _ => schema.is_some_and(|it| it["type"] == "array"),
        };
        let unit = schema.and_then(|schema| schema["unit"].as_str()).unwrap_or_default();
        let mut found = Vec::new();
        for it in self.scope.params.iter().filter(|it| kind(it)) {
            let rank = 5 + found.len() + if it.of == unit { 0 } else { 10 };
            let label = format!("Param(\"{}\")", it.name.text);
            let proposal = self.proposal(&label, label.clone(), Sort::Parameter, rank);
            found.push(Proposal { detail: format!("{} {}", it.kind, it.of), ..proposal });
        }
        if self.behind().starts_with('(') {
            let words = ["Param", "Expr", "Draft"].into_iter().enumerate();
            found.extend(
                words.map(|(index, word)| {
                    self.proposal(word, word.into(), Sort::Keyword, 40 + index)
                }),
            );
            return found;
        }
        if is_number && schema.is_some() {
            found.push(self.proposal("Expr", "Expr(\"$0\")".into(), Sort::Keyword, 40));
        }
        let words = [("Param", "Param(\"$0\")"), ("Draft", "Draft(final: $0, draft: )")];
        found.extend(
            words.map(|(word, insert)| self.proposal(word, insert.into(), Sort::Keyword, 41)),
        );
        found
    }

    /// Files beside the text with one of these endings, and folders.
    fn files(&self, endings: &[String]) -> Vec<Proposal> {
        let typed = match is_text(self.cursor) {
            true => &self.text[self.cursor.typed.span.start..self.at],
            false => "",
        };
        let (folder, _) = typed.rsplit_once('/').unwrap_or(("", typed));
        let inside = self.library.path.with_file_name("").join(folder);
        let fits = |name: &str| {
            let ending = Path::new(name).extension().map(|it| it.to_string_lossy().to_lowercase());
            endings.is_empty() || ending.is_some_and(|ending| endings.contains(&ending))
        };
        let mut names = Vec::new();
        for entry in std::fs::read_dir(inside).into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let is_folder = entry.path().is_dir();
            let is_own = entry.path() == self.library.path;
            if name.starts_with('.') || is_own || !(is_folder || fits(&name)) {
                continue;
            }
            let slash = if is_folder { "/" } else { "" };
            let gap = if folder.is_empty() { "" } else { "/" };
            names.push((is_folder, format!("{folder}{gap}{name}{slash}")));
        }
        names.sort();
        let file = |(index, (is_folder, name)): (usize, (bool, String))| {
            let rank = index + 1000 * usize::from(is_folder);
            self.proposal(&name, self.quoted(&name), Sort::File, rank)
        };
        names.into_iter().enumerate().map(file).collect()
    }
}

/// `Mask -> Labels`: what a node takes and gives.
fn gives(kind: &NodeKind) -> String {
    let fields = super::slot::fields_of(&kind.schema, &kind.schema);
    let takes = fields.iter().filter(|field| field.required);
    let takes = takes.filter_map(|field| match &field.slot {
        Slot::Link(types) => Some(types.join(" or ")),
        Slot::List(_) => Some(field.takes.clone()),
        _ => None,
    });
    let takes = Vec::from_iter(takes).join(", ");
    let gives = kind.outputs.iter().map(|(_, types)| types.join(" or "));
    let gives = Vec::from_iter(gives).join(", ");
    if takes.is_empty() { gives } else { format!("{takes} -> {gives}") }
}

/// What is written behind the name of a field before its value is known.
fn opening(slot: &Slot) -> &'static str {
    match slot {
        Slot::Link(_) | Slot::Path(_) | Slot::NodeType | Slot::Expected => "\"$0\"",
        Slot::List(_) => "[$0]",
        Slot::Map(..) => "{$0}",
        _ => "$0",
    }
}
