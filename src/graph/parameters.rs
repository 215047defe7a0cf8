//! A graph's own parameters, and how their values stand in for `Param` and `Expr`.

use std::collections::BTreeMap;

use indexmap::IndexMap;

use super::expression::{Outcome, evaluate};
use super::file::{Body, Field, Kind, Origin, Tree, parse};
use super::schema::Finding;
use super::suggest::{nearest, nearest_or_all};
use crate::error::{Span, code};
use crate::value::Color;

/// The values of a graph's parameters.
#[derive(Debug, Default)]
pub(crate) struct Parameters {
    values: IndexMap<String, Tree>,
    numbers: BTreeMap<String, Outcome>,
}

/// The types that a parameter can have.
const TYPES: [&str; 7] = ["Number", "Integer", "Toggle", "Color", "Text", "Choice", "Vector"];

impl Parameters {
    /// Reads the declarations, with `--set` values in place of defaults.
    pub(crate) fn read(
        declarations: &[(Tree, Tree)],
        set: &[(String, String)],
        findings: &mut Vec<Finding>,
    ) -> Self {
        let mut parameters = Self::default();
        for (key, declaration) in declarations {
            let Some(name) = key.text() else { continue };
            let declared = Declaration::read(name, declaration, findings);
            let Some(mut declared) = declared else {
                let broken = Tree::new(declaration.span, Kind::Broken);
                parameters.values.insert(name.to_owned(), broken);
                continue;
            };
            if let Some((_, text)) = set.iter().rev().find(|(target, _)| target == name) {
                declared.default = read_set(text, &format!("{name}={text}"), declaration.span);
            }
            let value = declared.value(findings);
            match value.kind {
                Kind::Number { value, .. } => {
                    parameters.numbers.insert(name.to_owned(), Outcome::Number(value));
                }
                Kind::Bool(truth) => {
                    parameters.numbers.insert(name.to_owned(), Outcome::Truth(truth));
                }
                _ => {}
            }
            parameters.values.insert(name.to_owned(), value);
        }
        parameters
    }

    pub(crate) fn names(&self) -> Vec<&str> {
        self.values.keys().map(String::as_str).collect()
    }

    /// The tree with every `Param` and `Expr` in it replaced by its value; one that has no value becomes broken.
    pub(crate) fn substitute(&self, tree: &Tree, findings: &mut Vec<Finding>) -> Tree {
        if let Some(argument) = tree.call_of("Param").or_else(|| tree.call_of("Expr")) {
            let is_param = tree.call_of("Param").is_some();
            let found = match argument.text() {
                Some(name) if is_param => self.parameter(name),
                Some(text) => self.expression(text),
                None => Err((
                    format!("this wants a text, not {}", argument.in_words()),
                    "write Param(\"name\") or Expr(\"a + b\")".into(),
                )),
            };
            return match found {
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

    fn parameter(&self, name: &str) -> Result<Tree, (String, String)> {
        self.values.get(name).cloned().ok_or_else(|| {
            let help = match self.values.is_empty() {
                true => "declare it under `params`".into(),
                false => nearest_or_all(name, "its parameters", &self.names()),
            };
            (format!("the graph has no parameter `{name}`"), help)
        })
    }

    fn expression(&self, text: &str) -> Result<Tree, (String, String)> {
        let outcome = match evaluate(text, &self.numbers) {
            Ok(outcome) => outcome,
            // A parameter without a value has been reported where it is declared.
            Err(_) if self.values.values().any(Tree::is_broken) => {
                return Ok(Tree::new(Span::default(), Kind::Broken));
            }
            Err(error) => return Err((error.message, error.help)),
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

/// A value from `--set`: RON, or else text.
pub(crate) fn read_set(text: &str, set: &str, span: Span) -> Tree {
    let (tree, mistakes) = parse(text);
    let kind =
        if mistakes.is_empty() { moved(tree, span).kind } else { Kind::Text(text.to_owned()) };
    Tree { span, kind, origin: Some(Origin::Set(set.to_owned())) }
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

/// `"growth": Number(default: 12.0, min: 0.0, max: 40.0)`.
struct Declaration<'a> {
    name: &'a str,
    kind: String,
    default: Tree,
    min: Option<f64>,
    max: Option<f64>,
    choices: Vec<String>,
}

impl<'a> Declaration<'a> {
    fn read(name: &'a str, tree: &Tree, findings: &mut Vec<Finding>) -> Option<Self> {
        let mut find = |code, span, message: String, help: String| {
            findings.push(Finding { code, span, message, help, note: None });
        };
        let kind = match tree.name() {
            Some(kind) if TYPES.contains(&&kind.text[..]) => kind.text,
            Some(kind) => {
                let message = format!("there is no type of parameters `{}`", kind.text);
                find(
                    code::WRONG_VALUE,
                    kind.span,
                    message,
                    nearest_or_all(&kind.text, "types", &TYPES),
                );
                return None;
            }
            None if tree.is_broken() => return None,
            None => {
                let message = format!("parameter `{name}` has no type");
                find(code::WRONG_VALUE, tree.span, message, "write Number(default: 1.0)".into());
                return None;
            }
        };
        let known: &[&str] = match &kind[..] {
            "Number" | "Integer" | "Vector" => &["default", "doc", "min", "max", "unit"],
            "Choice" => &["default", "doc", "of"],
            _ => &["default", "doc"],
        };
        let mut declaration = Self {
            name,
            kind,
            default: Tree::new(tree.span, Kind::Broken),
            min: None,
            max: None,
            choices: Vec::new(),
        };
        let mut has_default = false;
        for field in tree.fields().unwrap_or_default() {
            let (word, value) = (&field.name.text[..], &field.value);
            if !known.contains(&word) {
                let message = format!("{} has no field `{word}`", declaration.kind);
                find(
                    code::UNKNOWN_FIELD,
                    field.name.span,
                    message,
                    nearest_or_all(word, "its fields", known),
                );
                continue;
            }
            let fits = match (word, &value.kind) {
                (_, Kind::Broken) => true,
                ("default", _) => {
                    has_default = true;
                    declaration.default =
                        Tree { origin: Some(Origin::Default(value.span)), ..value.clone() };
                    true
                }
                ("min", Kind::Number { value, .. }) => declaration.min.replace(*value).is_none(),
                ("max", Kind::Number { value, .. }) => declaration.max.replace(*value).is_none(),
                ("of", Kind::List(items)) => {
                    declaration.choices =
                        items.iter().filter_map(|item| item.name()).map(|name| name.text).collect();
                    declaration.choices.len() == items.len() && !items.is_empty()
                }
                ("doc" | "unit", Kind::Text(_)) => true,
                _ => false,
            };
            if !fits {
                let message = format!(
                    "field `{word}` of {} cannot be {}",
                    declaration.kind,
                    value.in_words()
                );
                find(code::WRONG_VALUE, value.span, message, String::new());
            }
        }
        if !has_default {
            let message = format!("parameter `{name}` has no default");
            find(code::MISSING_FIELD, tree.span, message, "write `default: ..`".into());
            return None;
        }
        Some(declaration)
    }

    /// The value, if it is one of the declared type and in range.
    fn value(&self, findings: &mut Vec<Finding>) -> Tree {
        let tree = &self.default;
        let is_set = matches!(tree.origin, Some(Origin::Set(_)));
        let in_range =
            |x: f64| self.min.is_none_or(|min| min <= x) && self.max.is_none_or(|max| x <= max);
        let number = |tree: &Tree| match tree.kind {
            Kind::Number { value, .. } => Some(value),
            _ => None,
        };
        let mut out_of_range = None;
        let mut limited = |x: f64| {
            if !in_range(x) {
                out_of_range = Some(x);
            }
            true
        };
        let (fits, kind) = match (&self.kind[..], &tree.kind) {
            ("Number", Kind::Number { value, .. }) => (limited(*value), tree.kind.clone()),
            ("Integer", Kind::Number { value, .. }) => {
                (value.fract() == 0.0 && limited(*value), tree.kind.clone())
            }
            ("Toggle", Kind::Bool(_)) => (true, tree.kind.clone()),
            ("Color", Kind::Text(text)) => (text.parse::<Color>().is_ok(), tree.kind.clone()),
            ("Text", Kind::Text(_)) => (true, tree.kind.clone()),
            ("Text", Kind::Word(word)) if is_set => (true, Kind::Text(word.clone())),
            ("Choice", Kind::Word(word)) => (self.choices.contains(word), tree.kind.clone()),
            ("Vector", Kind::Call { name: None, body: Body::Items(items) }) => {
                let fits = items.iter().all(|item| number(item).is_some_and(&mut limited));
                (fits, tree.kind.clone())
            }
            (_, Kind::Broken) => return tree.clone(),
            _ => (false, Kind::Broken),
        };
        let (at, note) = match &tree.origin {
            Some(Origin::Set(text)) => {
                (tree.span, Some((tree.span, format!("set by `--set {text}`"))))
            }
            _ => (tree.span, None),
        };
        let mut find = |code, message: String, help: String| {
            findings.push(Finding { code, span: at, message, help, note: note.clone() });
        };
        if let Some(x) = out_of_range {
            let limits = [
                self.min.map(|min| format!("at least {min}")),
                self.max.map(|max| format!("at most {max}")),
            ];
            let limits = Vec::from_iter(limits.into_iter().flatten()).join(" and ");
            find(
                code::OUT_OF_RANGE,
                format!("parameter `{}` is {x}, but must be {limits}", self.name),
                String::new(),
            );
            return Tree::new(tree.span, Kind::Broken);
        }
        if fits {
            return Tree { kind, ..tree.clone() };
        }
        let wanted = match &self.kind[..] {
            "Number" => "a number".to_owned(),
            "Integer" => "a number without fraction".to_owned(),
            "Toggle" => "true or false".to_owned(),
            "Color" => "a color as in \"#c33923\"".to_owned(),
            "Text" => "a text in double quotes".to_owned(),
            "Choice" => format!("one of {}", self.choices.join(", ")),
            _ => "numbers in parentheses: (0, 0, 1)".to_owned(),
        };
        let help = match &tree.kind {
            Kind::Word(word) => nearest(word, self.choices.iter().map(String::as_str)),
            _ => String::new(),
        };
        let message = format!("parameter `{}` wants {wanted}, not {}", self.name, tree.in_words());
        find(code::WRONG_VALUE, message, help);
        Tree::new(tree.span, Kind::Broken)
    }
}
