//! What may be written at a place: fields, nodes, links that fit, parameters, choices, units and files.

use std::collections::BTreeSet;

use maquette_syntax::error::Span;
use maquette_syntax::{Cursor, Passed, TypedKind, cursor, each_word};

use super::library::Library;
use super::scope::{Declared, Scope};
use super::slot::{FieldOf, Inside, Keys, Slot, Slots};
use super::symbols::has_letters;

mod values;

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
    let slots = Slots { library, scope: &scope };
    let (inside, slot) = slots.at(&cursor.frames);
    let Some(span) = replaced(text, &cursor, &slot, at) else {
        return Proposals { span: Span { start: at, end: at }, list: Vec::new() };
    };
    let search = Search { library, scope: &scope, text, cursor: &cursor, at };
    let is_named = cursor.frames.last().is_some_and(|frame| frame.field.is_some());
    let mut list = match inside {
        Inside::Fields(_, fields) if !is_named => search.fields(&fields),
        Inside::Entries(keys) if !is_named => search.keys(keys),
        _ if cursor.frames.is_empty() => search.beginnings(),
        _ => search.values(&slot),
    };
    rank(&mut list, &text[span.start..at]);
    list.truncate(MOST);
    Proposals { span, list }
}

fn is_text(cursor: &Cursor) -> bool {
    cursor.typed.kind == TypedKind::Text
}

/// The part of the cursor's line that a proposal replaces: the word or text there, and in an expression the word of it; of a text that does not
/// end on the line only what is before the cursor. `None` in comments, and where a name would begin on an earlier line.
fn replaced(text: &str, cursor: &Cursor, slot: &Slot, at: usize) -> Option<Span> {
    let Span { start, end } = cursor.typed.span;
    match cursor.typed.kind {
        TypedKind::Comment => None,
        TypedKind::Nothing | TypedKind::Word => Some(Span { start, end }),
        TypedKind::Text => {
            let (before, behind) = (&text[start..at], &text[at..end]);
            if matches!(slot, Slot::Expression) {
                fn is_part(c: char) -> bool {
                    c.is_ascii_alphanumeric() || c == '_' || c == '-'
                }
                let start = start + before.trim_end_matches(is_part).len();
                let end = end - behind.trim_start_matches(is_part).len();
                return Some(Span { start, end });
            }
            let is_closed = text[end..].starts_with('"') && !behind.contains(['\n', '\r']);
            let is_of_line = !before.contains(['\n', '\r']);
            is_of_line.then_some(Span { start, end: if is_closed { end } else { at } })
        }
    }
}

/// Leaves what may be meant by what has been typed, the likeliest first: what begins so, then what has it in it, then its letters in order.
fn rank(list: &mut Vec<Proposal>, typed: &str) {
    let typed = typed.to_lowercase();
    fn distance(it: &Proposal, typed: &str) -> Option<i32> {
        let label = it.label.to_lowercase();
        match label.find(typed) {
            Some(0) => Some(0),
            Some(_) => Some(1),
            None if has_letters(&label, typed) => Some(2),
            None => is_described_with(it, typed).then_some(3),
        }
    }
    // A name over several lines is a string without an end.
    list.retain(|it| distance(it, &typed).is_some() && !it.label.contains(['\n', '\r']));
    list.sort_by_cached_key(|proposal| (distance(proposal, &typed), proposal.rank));
    let mut seen = BTreeSet::new();
    list.retain(|proposal| seen.insert((proposal.label.clone(), proposal.insert.clone())));
}

/// Returns true if the description of a node has a word that begins so: one of another program, such as "decimate" for `Simplify`.
fn is_described_with(it: &Proposal, typed: &str) -> bool {
    // So short a word is in most of them.
    const MIN_LETTERS: usize = 4;
    let is_meant = it.sort == Sort::Node && MIN_LETTERS <= typed.chars().count();
    is_meant
        && it
            .doc
            .split(|c: char| !c.is_alphanumeric())
            .any(|word| word.to_lowercase().starts_with(typed))
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
            (
                "Sweep",
                "Sweep(\n    graph: \"$0\",\n    over: Values(\"\", []),\n)\n",
                "A graph over many scans and many values.",
            ),
        ];
        match is_text(self.cursor) || !self.behind().is_empty() {
            true => Vec::new(),
            false => files
                .into_iter()
                .enumerate()
                .map(|(index, (label, insert, detail)): (usize, (&str, &str, &str))| Proposal {
                    detail: detail.to_owned(),
                    ..self.proposal(label, insert.to_owned(), Sort::Keyword, index)
                })
                .collect(),
        }
    }

    fn fields(&self, fields: &[FieldOf]) -> Vec<Proposal> {
        if is_text(self.cursor) {
            return Vec::new();
        }
        let given = self.cursor.frames.last().map_or(&[][..], |frame| &frame.given);
        fn is_given(
            field: &FieldOf,
            given: &[maquette_syntax::Name],
            cursor_typed_span: &Span,
        ) -> bool {
            given.iter().any(|name| name.text == field.name && name.span != *cursor_typed_span)
        }
        let left = fields
            .iter()
            .enumerate()
            .filter(|(_, field)| !is_given(field, given, &self.cursor.typed.span));
        left.map(|(index, field)| {
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
        })
        .collect()
    }

    /// Names with what is told of each.
    fn named(&self, keys: Keys) -> Vec<(String, String)> {
        let about = || self.library.about(self.scope);
        fn named(all: &[Declared]) -> Vec<(String, String)> {
            all.iter().map(|it| (it.name.text.clone(), it.kind.clone())).collect::<Vec<_>>()
        }
        match keys {
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
                    known.extend(values.map(|field| {
                        (format!("{}.{}", node.name.text, field.name), field.takes.clone())
                    }));
                }
                known
            }),
        }
    }

    fn keys(&self, keys: Keys) -> Vec<Proposal> {
        let given = self.cursor.frames.last().map_or(&[][..], |frame| &frame.given);
        let left = self.named(keys).into_iter().filter(|(name, _)| {
            !given.iter().any(|it| it.text == *name && it.span != self.cursor.typed.span)
        });
        left.enumerate()
            .map(|(index, (name, detail)): (usize, (String, String))| {
                let quoted = self.quoted(&name);
                let insert = if self.behind().trim_start_matches('"').starts_with(':')
                    || is_text(self.cursor)
                {
                    quoted
                } else {
                    format!("{quoted}: $0")
                };
                Proposal { detail, ..self.proposal(&name, insert, Sort::Field, index) }
            })
            .collect()
    }

    fn names(&self, names: Keys) -> Vec<Proposal> {
        self.named(names)
            .into_iter()
            .enumerate()
            .map(|(index, (name, detail)): (usize, (String, String))| Proposal {
                detail,
                ..self.proposal(&name, self.quoted(&name), Sort::Parameter, index)
            })
            .collect()
    }

    fn values(&self, slot: &Slot) -> Vec<Proposal> {
        let is_text = is_text(self.cursor);
        let mut found = match slot {
            Slot::Link(types) => self.links(types),
            Slot::Expected => self.expected(),
            Slot::Name(names) => self.names(*names),
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
            Some(
                kind.outputs
                    .iter()
                    .map(|(name, types)| {
                        (name.clone(), types.iter().map(|&kind| kind.to_owned()).collect())
                    })
                    .collect(),
            )
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
        let mut found: Vec<_> = scope_outputs
            .iter()
            .enumerate()
            .map(|(index, output)| Proposal {
                detail: format!("output: {}", output.kind),
                ..self.proposal(
                    &output.name.text,
                    self.quoted(&output.name.text),
                    Sort::Link,
                    index,
                )
            })
            .collect();
        found.extend(self.links(&[]));
        found
    }
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
