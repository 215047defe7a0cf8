//! Completion: proposals for fields, nodes, links, parameters, enum variants, units and files.

use std::collections::BTreeSet;

use maquette_syntax::error::Span;
use maquette_syntax::{Cursor, TypedKind, WalkEvent, cursor, for_each_word};

use super::expected_syntax::{BracketContent, ExpectedSyntax, FieldInfo, Keys, SyntaxResolver};
use super::library::Library;
use super::scope::{Declaration, Scope};
use super::symbols::has_letters;

mod values;

/// A proposal for completing the typed text.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Proposal {
    /// The label that the editor shows and compares with the typed text.
    pub(super) label: String,
    /// The text to insert; `$0` marks the position of the cursor after the insertion.
    pub(super) insert: String,
    pub(super) kind: ProposalKind,
    /// The type of the proposed node, field or value, on one line.
    pub(super) detail: String,
    pub(super) doc: String,
    /// The rank for sorting. The most likely proposal has the lowest rank.
    rank: usize,
}

/// The kind of a proposal, which determines its icon in the editor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ProposalKind {
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

/// The proposals for a position, the most likely first, and the span of text that each of them replaces.
pub(super) struct Proposals {
    pub(super) span: Span,
    pub(super) list: Vec<Proposal>,
}

/// The maximum number of proposals in one answer.
const MAX_PROPOSALS: usize = 200;

pub(super) fn proposals(library: &Library<'_>, text: &str, at: usize) -> Proposals {
    let scope = Scope::parse(text);
    let cursor = cursor(text, at);
    let slots = SyntaxResolver { library, scope: &scope };
    let (inside, slot) = slots.resolve(&cursor.frames);
    let Some(span) = replacement_span(text, &cursor, &slot, at) else {
        return Proposals { span: Span { start: at, end: at }, list: Vec::new() };
    };
    let search = Search { library, scope: &scope, text, cursor: &cursor, at };
    let is_named = cursor.frames.last().is_some_and(|frame| frame.field.is_some());
    let mut list = match inside {
        BracketContent::Fields(_, fields) if !is_named => search.fields(&fields),
        BracketContent::Entries(keys) if !is_named => search.keys(keys),
        _ if cursor.frames.is_empty() => search.beginnings(),
        _ => search.values(&slot),
    };
    rank(&mut list, &text[span.start..at]);
    list.truncate(MAX_PROPOSALS);
    Proposals { span, list }
}

fn is_text(cursor: &Cursor) -> bool {
    cursor.typed.kind == TypedKind::Text
}

/// Returns the span of text that a proposal replaces. This is the word or string at the cursor, but only the word at the cursor if the
/// string is an expression. If the string does not end on the line of the cursor, this is only its part before the cursor. Returns `None`
/// in a comment, and in a string that begins on an earlier line.
fn replacement_span(text: &str, cursor: &Cursor, slot: &ExpectedSyntax, at: usize) -> Option<Span> {
    let Span { start, end } = cursor.typed.span;
    match cursor.typed.kind {
        TypedKind::Comment => None,
        TypedKind::Nothing | TypedKind::Word => Some(Span { start, end }),
        TypedKind::Text => {
            let (before, behind) = (&text[start..at], &text[at..end]);
            if matches!(slot, ExpectedSyntax::Expression) {
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

/// Filters proposals by the typed text, and sorts them by how well they match. First come labels that begin with the text, then labels that
/// contain it, then labels that contain its letters in order. Last come nodes whose description matches.
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
    // Drop labels with a line break: they are parts of a string whose closing quote is missing.
    list.retain(|it| distance(it, &typed).is_some() && !it.label.contains(['\n', '\r']));
    list.sort_by_cached_key(|proposal| (distance(proposal, &typed), proposal.rank));
    let mut seen = BTreeSet::new();
    list.retain(|proposal| seen.insert((proposal.label.clone(), proposal.insert.clone())));
}

/// Returns true if the description of a node contains a word that begins with the typed text. So users find a node by the term of another
/// program: for example, "decimate" finds `Simplify`.
fn is_described_with(it: &Proposal, typed: &str) -> bool {
    // Minimum length of the typed text. Shorter texts would match most descriptions.
    const MIN_LETTERS: usize = 4;
    let is_meant = it.kind == ProposalKind::Node && MIN_LETTERS <= typed.chars().count();
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
    fn proposal(&self, label: &str, insert: String, sort: ProposalKind, rank: usize) -> Proposal {
        let (label, detail, doc) = (label.to_owned(), String::new(), String::new());
        Proposal { label, insert, kind: sort, detail, doc, rank }
    }

    /// Returns the text that follows the word at the cursor.
    fn text_after(&self) -> &str {
        self.text[self.cursor.typed.span.end.max(self.at)..].trim_start()
    }

    /// Returns the text to insert for a call of `name`. Parentheses are added unless they already follow the word at the cursor.
    fn call(&self, name: &str) -> String {
        if self.text_after().starts_with('(') { name.to_owned() } else { format!("{name}($0)") }
    }

    /// Puts a text in quotes, unless the cursor is already inside of quotes.
    fn quote(&self, text: &str) -> String {
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
        match is_text(self.cursor) || !self.text_after().is_empty() {
            true => Vec::new(),
            false => files
                .into_iter()
                .enumerate()
                .map(|(index, (label, insert, detail)): (usize, (&str, &str, &str))| Proposal {
                    detail: detail.to_owned(),
                    ..self.proposal(label, insert.to_owned(), ProposalKind::Keyword, index)
                })
                .collect(),
        }
    }

    fn fields(&self, fields: &[FieldInfo]) -> Vec<Proposal> {
        if is_text(self.cursor) {
            return Vec::new();
        }
        let given = self.cursor.frames.last().map_or(&[][..], |frame| &frame.names);
        let other_names: Vec<_> =
            given.iter().filter(|name| name.span != self.cursor.typed.span).collect();
        let missing = fields
            .iter()
            .enumerate()
            .filter(|(_, field)| other_names.iter().all(|name| name.text != field.name));
        missing
            .map(|(index, field)| {
                let insert = match self.text_after().starts_with(':') {
                    true => field.name.clone(),
                    false => format!("{}: {}", field.name, opening(&field.slot)),
                };
                let rank = if field.required { index } else { 100 + index };
                Proposal {
                    detail: field.takes.clone(),
                    doc: field.doc.clone(),
                    ..self.proposal(&field.name, insert, ProposalKind::Field, rank)
                }
            })
            .collect()
    }

    /// Returns the keys that a map of this kind can have, each with a description.
    fn named_entries(&self, keys: Keys) -> Vec<(String, String)> {
        let about = || self.library.target(self.scope);
        fn entries(all: &[Declaration]) -> Vec<(String, String)> {
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
            Keys::Outputs => entries(&self.scope.outputs),
            Keys::TargetParams => about().map_or_else(Vec::new, |it| entries(&it.scope.params)),
            Keys::TargetNodes => about().map_or_else(Vec::new, |it| entries(&it.scope.nodes)),
            Keys::TargetInputs => about().map_or_else(Vec::new, |it| entries(&it.scope.inputs)),
            Keys::TargetOutputs => about().map_or_else(Vec::new, |it| entries(&it.scope.outputs)),
            Keys::TargetValues => about().map_or_else(Vec::new, |about| {
                let mut known = entries(&about.scope.params);
                for node in &about.scope.nodes {
                    let Some(ExpectedSyntax::Group(fields)) =
                        about.node(self.library, &node.name.text)
                    else {
                        continue;
                    };
                    let values = fields
                        .iter()
                        .filter(|field| !matches!(field.slot, ExpectedSyntax::Link(_)));
                    known.extend(values.map(|field| {
                        (format!("{}.{}", node.name.text, field.name), field.takes.clone())
                    }));
                }
                known
            }),
        }
    }

    fn keys(&self, keys: Keys) -> Vec<Proposal> {
        let given = self.cursor.frames.last().map_or(&[][..], |frame| &frame.names);
        let left = self.named_entries(keys).into_iter().filter(|(name, _)| {
            !given.iter().any(|it| it.text == *name && it.span != self.cursor.typed.span)
        });
        left.enumerate()
            .map(|(index, (name, detail)): (usize, (String, String))| {
                let quoted = self.quote(&name);
                let insert = if self.text_after().trim_start_matches('"').starts_with(':')
                    || is_text(self.cursor)
                {
                    quoted
                } else {
                    format!("{quoted}: $0")
                };
                Proposal { detail, ..self.proposal(&name, insert, ProposalKind::Field, index) }
            })
            .collect()
    }

    fn names(&self, names: Keys) -> Vec<Proposal> {
        self.named_entries(names)
            .into_iter()
            .enumerate()
            .map(|(index, (name, detail)): (usize, (String, String))| Proposal {
                detail,
                ..self.proposal(&name, self.quote(&name), ProposalKind::Parameter, index)
            })
            .collect()
    }

    fn values(&self, slot: &ExpectedSyntax) -> Vec<Proposal> {
        let is_text = is_text(self.cursor);
        let mut found = match slot {
            ExpectedSyntax::Link(types) => self.links(types),
            ExpectedSyntax::Expected => self.expectation_proposals(),
            ExpectedSyntax::Name(names) => self.names(*names),
            ExpectedSyntax::Node if !is_text => self.nodes(),
            ExpectedSyntax::NodeType => self.node_types(),
            ExpectedSyntax::Input if !is_text => self.inputs(),
            ExpectedSyntax::Parameter if !is_text => self.declarations(),
            ExpectedSyntax::Use => self.files(&["ron".to_owned()]),
            ExpectedSyntax::Path(endings) => self.files(endings),
            ExpectedSyntax::ParameterName => self.parameter_names(),
            ExpectedSyntax::Expression => self.expression(),
            ExpectedSyntax::Property(kind) if !is_text => self.properties(kind),
            ExpectedSyntax::Words(words) => self.words(words),
            ExpectedSyntax::List(item) if !is_text => {
                let mut inner = self.values(item);
                inner.retain(|proposal| matches!(proposal.kind, ProposalKind::Link));
                inner
            }
            ExpectedSyntax::Value { schema, root } => self.schema_proposals(schema, root),
            _ => Vec::new(),
        };
        let takes_parameters = matches!(
            slot,
            ExpectedSyntax::Value { .. } | ExpectedSyntax::Path(_) | ExpectedSyntax::Words(_)
        );
        if takes_parameters && !is_text && !matches!(slot, ExpectedSyntax::Words(_)) {
            found.extend(self.computed_proposals(slot));
        }
        found
    }

    /// Proposes links to values of the given types. First come nodes that no other node uses, then the nodes nearest to the cursor.
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
                let quoted = self.quote(&label);
                let kinds = if gives.is_empty() { node.kind.clone() } else { gives.join(" or ") };
                let proposal = self.proposal(&label, quoted, ProposalKind::Link, rank);
                found.push(Proposal { detail: format!("{kinds} of {}", node.kind), ..proposal });
            }
        }
        found
    }

    /// Returns all strings in the text except keys and the string at the cursor.
    fn texts(&self) -> BTreeSet<String> {
        let mut texts = BTreeSet::new();
        for_each_word(self.text, |_, passed| match passed {
            WalkEvent::Word(word, TypedKind::Text) if word.span != self.cursor.typed.span => {
                texts.insert(word.text.clone());
            }
            _ => {}
        });
        texts
    }

    /// Returns the outputs of a node or input, each with the possible types of its value. The list of types is empty if they are unknown.
    fn outputs(&self, node: &Declaration) -> Vec<(String, Vec<String>)> {
        if self.scope.inputs.iter().any(|input| std::ptr::eq(input, node)) {
            return vec![(String::new(), vec![node.kind.clone()])];
        }
        let name = if node.kind == "ForEach" { &node.of } else { &node.kind };
        let Some(kind) = self.library.kind(self.scope, name) else {
            return vec![(String::new(), Vec::new())];
        };
        let outputs = kind.outputs.iter().map(|(name, types)| {
            (name.clone(), types.iter().map(|&kind| kind.to_owned()).collect())
        });
        outputs.collect()
    }

    /// Proposes values that an expectation can be about: first the outputs of the graph, then links to nodes.
    fn expectation_proposals(&self) -> Vec<Proposal> {
        let scope_outputs = match &self.scope.file[..] {
            "Test" => self
                .library
                .target(self.scope)
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
                    self.quote(&output.name.text),
                    ProposalKind::Link,
                    index,
                )
            })
            .collect();
        found.extend(self.links(&[]));
        found
    }
}

/// Returns the text to insert after the name of a field, such as quotes or brackets. `$0` marks the cursor.
fn opening(slot: &ExpectedSyntax) -> &'static str {
    match slot {
        ExpectedSyntax::Link(_)
        | ExpectedSyntax::Path(_)
        | ExpectedSyntax::NodeType
        | ExpectedSyntax::Expected => "\"$0\"",
        ExpectedSyntax::List(_) => "[$0]",
        ExpectedSyntax::Map(..) => "{$0}",
        _ => "$0",
    }
}
