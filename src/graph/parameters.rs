//! A graph's own parameters, and how their values stand in for `Param` and `Expr`.

use std::collections::BTreeMap;
use std::sync::Arc;

use indexmap::IndexMap;

use super::declaration::Declaration;
use super::expression::{Outcome, evaluate};
use super::quality::{chosen, is_draft};
use crate::error::{MOST_TOLD, Span, code};
use crate::text::{Body, Field, Finding, Given, Kind, Origin, Sheet, Tree, nearest_or_all, parse};

/// The values of a graph's parameters.
#[derive(Clone, Debug, Default)]
pub(crate) struct Parameters {
    values: IndexMap<String, Tree>,
    numbers: BTreeMap<String, Outcome>,
    /// Whether a `Draft` stands for its draft.
    draft: bool,
}

impl Parameters {
    /// Reads the declarations, with `--set` values in place of defaults, for a draft or for final results.
    pub(crate) fn read(
        entries: &[(&Tree, &Tree)],
        set: &[(String, String)],
        draft: bool,
        findings: &mut Vec<Finding>,
    ) -> (Vec<Declaration>, Self) {
        let mut parameters = Self { draft, ..Self::default() };
        let mut declarations = Vec::with_capacity(entries.len());
        for (key, declaration) in entries {
            let Some(name) = key.text() else { continue };
            let declared = Declaration::read(name, declaration, findings);
            let Some(mut declared) = declared else {
                parameters.put(name, Tree::new(declaration.span, Kind::Broken));
                continue;
            };
            if let Some((_, text)) = set.iter().rev().find(|(target, _)| target == name) {
                declared.default = read_set(text, &format!("{name}={text}"), declaration.span);
            }
            let default = declared.default.clone();
            if is_draft(&default) {
                // The other value must fit, too; what is wrong with both is told below.
                let other = chosen(&default, !draft, &mut Vec::new());
                declared.default = of_side(other, &default);
                declared.value(findings);
            }
            declared.default = of_side(chosen(&default, draft, findings), &default);
            declared.default = declared.value(findings);
            parameters.put(name, declared.default.clone());
            declarations.push(declared);
        }
        (declarations, parameters)
    }

    /// The same parameters with the values that a use gives to some of them.
    pub(crate) fn with(&self, given: impl IntoIterator<Item = (String, Tree)>) -> Self {
        let mut parameters = self.clone();
        for (name, value) in given {
            parameters.put(&name, value);
        }
        parameters
    }

    fn put(&mut self, name: &str, value: Tree) {
        match value.kind {
            Kind::Number { value, .. } => {
                self.numbers.insert(name.to_owned(), Outcome::Number(value));
            }
            Kind::Bool(truth) => {
                self.numbers.insert(name.to_owned(), Outcome::Truth(truth));
            }
            _ => {}
        }
        self.values.insert(name.to_owned(), value);
    }

    /// The same for what a `Draft` does not stand for now.
    pub(super) fn of_other_side(&self) -> Self {
        Self { draft: !self.draft, ..self.clone() }
    }

    pub(crate) fn names(&self) -> Vec<&str> {
        self.values.keys().map(String::as_str).collect()
    }

    /// The tree with every `Param` and `Expr` in it replaced by its value; one that has no value becomes broken.
    pub(crate) fn substitute(&self, tree: &Tree, findings: &mut Vec<Finding>) -> Tree {
        if is_draft(tree) {
            return match chosen(tree, self.draft, findings) {
                Some(value) => self.substitute(value, findings),
                None => Tree::new(tree.span, Kind::Broken),
            };
        }
        if let Some(argument) = tree.call_of("Param").or_else(|| tree.call_of("Expr")) {
            let is_param = tree.call_of("Param").is_some();
            let found = match argument.text() {
                Some(name) if is_param => self.parameter(name, findings.len() < MOST_TOLD),
                Some(text) => self.expression(text, findings.len() < MOST_TOLD),
                None => Err((
                    format!("this wants a text, not {}", argument.in_words()),
                    "write Param(\"name\") or Expr(\"a + b\")".into(),
                )),
            };
            return match found {
                Ok(value) if matches!(value.origin, Some(Origin::Given(_))) => {
                    moved(value, tree.span)
                }
                Ok(value) => Tree { span: tree.span, ..value },
                Err((message, help)) => {
                    let span = argument.span;
                    findings.push(Finding {
                        code: code::EXPRESSION,
                        span,
                        message,
                        help,
                        note: None,
                    });
                    Tree::new(tree.span, Kind::Broken)
                }
            };
        }
        let all = |trees: &[Tree], findings: &mut _| -> Vec<Tree> {
            trees.iter().map(|tree| self.substitute(tree, findings)).collect()
        };
        let kind = match &tree.kind {
            Kind::List(items) => Kind::List(all(items, findings)),
            Kind::Map(entries) => {
                let mut entry =
                    |(key, value): &(Tree, Tree)| (key.clone(), self.substitute(value, findings));
                Kind::Map(entries.iter().map(&mut entry).collect())
            }
            Kind::Call { name, body } => {
                let body = match body {
                    Body::Empty => Body::Empty,
                    Body::Items(items) => Body::Items(all(items, findings)),
                    Body::Fields(fields) => {
                        let mut field = |field: &Field| Field {
                            name: field.name.clone(),
                            value: self.substitute(&field.value, findings),
                        };
                        Body::Fields(fields.iter().map(&mut field).collect())
                    }
                };
                Kind::Call { name: name.clone(), body }
            }
            plain => plain.clone(),
        };
        Tree { kind, ..tree.clone() }
    }

    fn parameter(&self, name: &str, guesses: bool) -> Result<Tree, (String, String)> {
        self.values.get(name).cloned().ok_or_else(|| {
            let help = match self.values.is_empty() {
                true => "declare it under `params`".into(),
                false if !guesses => String::new(),
                false => nearest_or_all(name, "its parameters", &self.names()),
            };
            (format!("the graph has no parameter `{name}`"), help)
        })
    }

    fn expression(&self, text: &str, guesses: bool) -> Result<Tree, (String, String)> {
        let outcome = match evaluate(text, &self.numbers) {
            Ok(outcome) => outcome,
            // A parameter without a value has been reported where it is declared.
            Err(_) if self.values.values().any(Tree::is_broken) => {
                return Ok(Tree::new(Span::default(), Kind::Broken));
            }
            Err(error) => {
                let help = if guesses { error.help(&self.numbers) } else { String::new() };
                return Err((error.message, help));
            }
        };
        Ok(Tree::new(
            Span::default(),
            match outcome {
                Outcome::Number(value) => Kind::Number { value, whole: value.fract() == 0.0 },
                Outcome::Truth(truth) => Kind::Bool(truth),
            },
        ))
    }
}

/// What a default has for this side of a `Draft`, with what is known of the default; broken if it has nothing.
fn of_side(side: Option<&Tree>, default: &Tree) -> Tree {
    match (side, &default.origin) {
        (None, _) => Tree::new(default.span, Kind::Broken),
        (Some(side), Some(Origin::Default(_))) => {
            Tree { origin: Some(Origin::Default(side.span)), ..side.clone() }
        }
        (Some(side), origin) => Tree { origin: origin.clone(), ..side.clone() },
    }
}

/// A value from `--set`: RON, or else text.
pub(crate) fn read_set(text: &str, set: &str, span: Span) -> Tree {
    let (tree, mistakes) = parse(text);
    let kind =
        if mistakes.is_empty() { moved(tree, span).kind } else { Kind::Text(text.to_owned()) };
    Tree { span, kind, origin: Some(Origin::Set(set.to_owned())) }
}

/// The value as another file gets it: with the place in this file that it comes from.
pub(crate) fn handed_over(tree: Tree, sheet: &Arc<Sheet>) -> Tree {
    let given = |span, set| Some(Origin::Given(Given { sheet: sheet.clone(), span, set }));
    let again = |tree: Tree| handed_over(tree, sheet);
    let origin = match tree.origin {
        Some(Origin::Default(span)) => given(span, None),
        Some(Origin::Set(text)) => given(tree.span, Some(text)),
        None => given(tree.span, None),
        // It was handed over before; where it was first is what counts.
        given => given,
    };
    let kind = match tree.kind {
        Kind::List(items) => Kind::List(items.into_iter().map(again).collect()),
        Kind::Call { name, body: Body::Items(items) } => {
            Kind::Call { name, body: Body::Items(items.into_iter().map(again).collect()) }
        }
        plain => plain,
    };
    Tree { span: tree.span, kind, origin }
}

/// Whether a part of the value is computed from parameters.
pub(crate) fn is_parametric(tree: &Tree) -> bool {
    match &tree.kind {
        Kind::Call { name: Some(name), .. } if matches!(&name.text[..], "Param" | "Expr") => true,
        Kind::Call { body: Body::Fields(fields), .. } => {
            fields.iter().any(|field| is_parametric(&field.value))
        }
        Kind::Call { body: Body::Items(items), .. } | Kind::List(items) => {
            items.iter().any(is_parametric)
        }
        Kind::Map(entries) => entries.iter().any(|(_, value)| is_parametric(value)),
        _ => false,
    }
}

/// The tree with all its places set to one, because its own are not in the file.
fn moved(tree: Tree, span: Span) -> Tree {
    let all = |trees: Vec<Tree>| trees.into_iter().map(|tree| moved(tree, span)).collect();
    let kind = match tree.kind {
        Kind::List(items) => Kind::List(all(items)),
        Kind::Call { name, body: Body::Items(items) } => {
            Kind::Call { name, body: Body::Items(all(items)) }
        }
        Kind::Call { name, body: Body::Fields(fields) } => {
            let field = |field: Field| Field { value: moved(field.value, span), ..field };
            Kind::Call { name, body: Body::Fields(fields.into_iter().map(field).collect()) }
        }
        plain => plain,
    };
    Tree { span, kind, origin: tree.origin }
}
