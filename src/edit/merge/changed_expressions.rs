//! Finds expressions whose meaning would change in the merged graph. For example, the difference `a-b` becomes a single name if the other
//! side has added a parameter `a-b`.

use std::collections::{BTreeSet, HashSet};
use std::path::Path;
use std::sync::Arc;

use maquette_graph::expression::named_parameters;
use maquette_graph::tree::{entries, text_in_call};
use maquette_syntax::error::{Diagnostic, Severity, Source, Span, code};
use maquette_syntax::{Body, Kind, Token, Tree, tokens};

/// An expression in a graph, with its path and the names of the parameters in it.
struct Expression {
    path: Vec<String>,
    text: String,
    names: Vec<String>,
}

/// An expression that would have another meaning in the merged graph.
pub(super) struct ChangedExpression {
    /// The entry that contains the expression, such as `nodes.moved`.
    pub(super) entry: String,
    text: String,
}

/// Returns the expressions of a merged text that have another meaning there than in the text from which they come.
pub(super) fn changed_expressions(before: [&Tree; 3], merged: &Tree) -> Vec<ChangedExpression> {
    let [base, ours, theirs] = before.map(expressions_of);
    let mut changed = Vec::new();
    for found in expressions_of(merged) {
        let in_base = found.find_in(&base);
        let sides = [&ours, &theirs].map(|side| found.find_in(side));
        if sides.into_iter().flatten().any(|side| {
            // True if this side wrote the expression, or changed to which parameters the names in the expression refer.
            let is_edited = in_base.is_none_or(|in_base| in_base.names != side.names);
            is_edited && side.names != found.names
        }) {
            let entry = found.path[..found.path.len().min(2)].join(".");
            changed.push(ChangedExpression { entry, text: found.text });
        }
    }
    changed
}

impl ChangedExpression {
    /// Returns the error for the expression. In `text`, the entry that contains the expression is marked as a conflict.
    pub(super) fn diagnostic(&self, path: &Path, text: &str) -> Diagnostic {
        let message = format!(
            "`{}` would change its meaning with the parameters of the other side",
            self.text
        );
        Diagnostic {
            severity: Severity::Error,
            code: code::EXPRESSION,
            source: Arc::new(Source { name: path.to_owned(), text: text.to_owned() }),
            span: self.span_in(text).unwrap_or_default(),
            message,
            help: "put spaces around a minus sign".into(),
            fix: Vec::new(),
            elements: Vec::new(),
            note: None,
            uses: Vec::new(),
        }
    }

    /// Returns the first position of the expression between conflict markers. `None` if it does not occur there.
    fn span_in(&self, text: &str) -> Option<Span> {
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

impl Expression {
    /// Finds the expression in another text: at the same path or, if it was moved within a list, in the same entry.
    fn find_in<'r>(&self, all: &'r [Self]) -> Option<&'r Self> {
        let mut same = all.iter().filter(|it| it.text == self.text);
        let here = same.clone().find(|it| it.path == self.path);
        here.or_else(|| same.find(|it| it.path.iter().take(2).eq(self.path.iter().take(2))))
    }
}

/// Returns all expressions of a graph.
fn expressions_of(tree: &Tree) -> Vec<Expression> {
    let fields = tree.fields().unwrap_or_default();
    let known = HashSet::from_iter(entries(fields, "params").map(|(name, _)| name));
    let mut search = Search { known, path: Vec::new(), found: Vec::new() };
    search.value(tree);
    search.found
}

struct Search<'t> {
    known: HashSet<&'t str>,
    path: Vec<String>,
    found: Vec<Expression>,
}

impl Search<'_> {
    fn value(&mut self, tree: &Tree) {
        if let Some(text) = text_in_call(tree, "Expr") {
            let places = named_parameters(text, &|name| self.known.contains(name));
            let names = places.unwrap_or_default().into_iter().map(|at| text[at].to_owned());
            let (path, names) = (self.path.clone(), names.collect());
            self.found.push(Expression { path, text: text.to_owned(), names });
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

/// Returns the entries that contain the changed expressions, such as `nodes.moved`.
pub(super) fn entries_of(changed: &[ChangedExpression]) -> BTreeSet<String> {
    changed.iter().map(|it| it.entry.clone()).collect()
}
