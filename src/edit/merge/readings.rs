//! Expressions that say something else in the merged graph than where they were written: `a-b` is one name where the other side has
//! added a parameter `a-b`.

use std::collections::{BTreeSet, HashSet};
use std::path::Path;
use std::sync::Arc;

use maquette_graph::expression::named_parameters;
use maquette_graph::tree::entries;
use maquette_syntax::error::{Problem, Severity, Source, Span, code};
use maquette_syntax::{Body, Kind, Token, Tree, tokens};

/// An expression, and what it names.
struct Reading {
    path: Vec<String>,
    text: String,
    names: Vec<String>,
}

/// An expression that both together would make say something else than it was written for.
pub(super) struct Turned {
    /// The entry that it stands in: `nodes.moved`.
    pub(super) entry: String,
    text: String,
}

/// Those in a merged text, which was made of three others.
pub(super) fn turned(before: [&Tree; 3], merged: &Tree) -> Vec<Turned> {
    let [base, ours, theirs] = before.map(readings);
    let mut turned = Vec::new();
    for found in readings(merged) {
        let was = found.in_other(&base);
        let sides = [&ours, &theirs].map(|side| found.in_other(side));
        if sides.into_iter().flatten().any(|side| {
            // It was written so there, or the parameters that it names were.
            let is_edit = was.is_none_or(|was| was.names != side.names);
            is_edit && side.names != found.names
        }) {
            let entry = found.path[..found.path.len().min(2)].join(".");
            turned.push(Turned { entry, text: found.text });
        }
    }
    turned
}

impl Turned {
    /// What to say of it, in a text in which its entry is marked.
    pub(super) fn problem(&self, path: &Path, text: &str) -> Problem {
        let message = format!(
            "`{}` would say something else with the parameters that the other side has",
            self.text
        );
        Problem {
            severity: Severity::Error,
            code: code::EXPRESSION,
            source: Arc::new(Source { name: path.to_owned(), text: text.to_owned() }),
            span: self.place(text).unwrap_or_default(),
            message,
            help: "a hyphen with spaces around it is always a sign".into(),
            fix: Vec::new(),
            elements: Vec::new(),
            note: None,
            uses: Vec::new(),
        }
    }

    /// Its first place within marks.
    fn place(&self, text: &str) -> Option<Span> {
        let marks = text.find("<<<<<<< ours").unwrap_or_default();
        let mut behind_call = false;
        tokens(text).into_iter().find_map(|(token, span)| {
            let word = &text[span.start..span.end];
            let is_here = behind_call && marks < span.start && word.contains(&self.text);
            behind_call = token == Token::Open && text[..span.start].ends_with("Expr")
                || token == Token::Space && behind_call;
            is_here.then_some(span)
        })
    }
}

impl Reading {
    /// The same in another text: at its place, or where a list has moved it to.
    fn in_other<'r>(&self, all: &'r [Self]) -> Option<&'r Self> {
        let entry = |reading: &Self| reading.path.iter().take(2).cloned().collect::<Vec<_>>();
        let mut same = all.iter().filter(|it| it.text == self.text);
        let here = same.clone().find(|it| it.path == self.path);
        here.or_else(|| same.find(|it| entry(it) == entry(self)))
    }
}

/// All expressions of a graph.
fn readings(tree: &Tree) -> Vec<Reading> {
    let fields = tree.fields().unwrap_or_default();
    let known = HashSet::from_iter(entries(fields, "params").map(|(name, _)| name));
    let mut search = Search { known, path: Vec::new(), found: Vec::new() };
    search.value(tree);
    search.found
}

struct Search<'t> {
    known: HashSet<&'t str>,
    path: Vec<String>,
    found: Vec<Reading>,
}

impl Search<'_> {
    fn value(&mut self, tree: &Tree) {
        if let Some(text) = tree.call_of("Expr").and_then(Tree::text) {
            let places = named_parameters(text, &|name| self.known.contains(name));
            let names = places.unwrap_or_default().into_iter().map(|at| text[at].to_owned());
            let (path, names) = (self.path.clone(), names.collect());
            self.found.push(Reading { path, text: text.to_owned(), names });
            return;
        }
        match &tree.kind {
            Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
                for (index, item) in items.iter().enumerate() {
                    self.step(&index.to_string(), item);
                }
            }
            Kind::Call { body: Body::Fields(fields), .. } => {
                fields.iter().for_each(|field| self.step(&field.name.text, &field.value));
            }
            Kind::Map(entries) => {
                for (key, value) in entries {
                    self.step(key.text().unwrap_or_default(), value);
                }
            }
            _ => {}
        }
    }

    fn step(&mut self, step: &str, tree: &Tree) {
        self.path.push(step.to_owned());
        self.value(tree);
        self.path.pop();
    }
}

/// The entries that they stand in.
pub(super) fn entries_of(turned: &[Turned]) -> BTreeSet<String> {
    turned.iter().map(|it| it.entry.clone()).collect()
}
