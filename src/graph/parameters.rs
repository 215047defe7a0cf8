//! A graph's own parameters, and how their values stand in for `Param` and `Expr`.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

use indexmap::IndexMap;
use maquette_syntax::error::{MOST_TOLD, Span, code};
use maquette_syntax::{
    Body, Field, Finding, Given, Help, Kind, Origin, Quantity, Sheet, Tree, Unit, cut,
    nearest_or_all, parse,
};

use super::declaration::Declaration;
use super::expression::{ExpressionError, Outcome, evaluate, named_parameters};
use super::fitting::{in_own_unit, own_value};
use super::quality::{chosen, has_draft};

mod order;

use order::Order;
pub(crate) use order::names_in;

/// The values of a graph's parameters.
#[derive(Clone, Debug, Default)]
pub(crate) struct Parameters {
    values: IndexMap<String, Tree>,
    numbers: BTreeMap<String, Outcome>,
    /// Whether a `Draft` stands for its draft.
    draft: bool,
    /// The known units of those that have one, and where these are declared.
    units: BTreeMap<String, (Unit, Span)>,
    /// Those whose defaults are computed from others, each behind all that it is computed from.
    derived: Arc<[Declaration]>,
}

/// What a `Param` or `Expr` gives, or a number that is written with its unit.
pub(super) struct Worked {
    pub(super) value: Tree,
    pub(super) unit: Unit,
    /// What it is, for messages: `Param("near")`.
    pub words: String,
    /// Where its unit comes from, if that is another place.
    pub(super) note: Option<(Span, String)>,
}

impl Parameters {
    /// Reads the declarations, with `--set` values in place of defaults, for a draft or for final results.
    pub(crate) fn read(
        entries: &[(&Tree, &Tree)],
        set: &[(String, String)],
        draft: bool,
        sheet: &Sheet,
        findings: &mut Vec<Finding>,
    ) -> (Vec<Declaration>, Self) {
        let mut parameters = Self { draft, ..Self::default() };
        let mut declarations = Vec::with_capacity(entries.len());
        for (key, declaration) in entries {
            let Some(name) = key.text() else { continue };
            parameters.put(name, Tree::new(declaration.span, Kind::Broken));
            let Some(mut declared) = Declaration::read(name, declaration, findings) else {
                continue;
            };
            if let Some((_, text)) = set.iter().rev().find(|(target, _)| target == name) {
                let given = read_set(text, &format!("{name}={text}"), declaration.span);
                declared.default = in_own_unit(&given, name, declared.unit(), findings);
            }
            let unit = declared.unit().and_then(Unit::read);
            let unit = unit.map(|unit| (name.to_owned(), (unit, declared.unit_span)));
            parameters.units.extend(unit);
            declarations.push(declared);
        }
        let order = Order::of(&declarations, sheet, findings);
        let derived = order.all.iter().map(|&at| &declarations[at]);
        parameters.derived =
            derived.filter(|declared| is_parametric(&declared.default)).cloned().collect();
        let mut others = Self { draft: !draft, ..parameters.clone() };
        let has_sides = declarations.iter().any(|declared| has_draft(&declared.default));
        // What is wrong with the other side is reported if it is not wrong with this one.
        let (mut known, mut other_findings) = (Vec::new(), Vec::new());
        for &at in &order.all {
            let declared = &mut declarations[at];
            let own = parameters.value(declared, &mut known);
            if has_sides {
                let other = others.value(declared, &mut other_findings);
                others.put(&declared.name, other.clone());
                let sides = if draft { [other, own.clone()] } else { [own.clone(), other] };
                declared.sides = Some(sides).filter(|_| has_draft(&declared.default));
            }
            parameters.put(&declared.name, own.clone());
            declared.derives = is_parametric(&declared.default);
            declared.default = own;
        }
        other_findings.retain(|finding| !known.contains(finding));
        findings.append(&mut known);
        findings.append(&mut other_findings);
        (declarations, parameters)
    }

    /// The value that a parameter has by its default, which may be computed from others.
    fn value(&self, declared: &Declaration, findings: &mut Vec<Finding>) -> Tree {
        let default = &declared.default;
        let mut value = of_side(chosen(default, self.draft, findings), default);
        if is_parametric(&value) {
            let (name, unit, origin) = (&declared.name, declared.unit(), value.origin.clone());
            value = own_value(&value, Some(self), name, unit, findings);
            value.origin = origin;
        }
        declared.with_default(value).value(findings)
    }

    /// The same parameters with the values that a use gives to some of them.
    pub(crate) fn with(
        &self,
        given: impl IntoIterator<Item = (String, Tree)>,
        findings: &mut Vec<Finding>,
    ) -> Self {
        let mut parameters = self.clone();
        let mut names = BTreeSet::new();
        for (name, value) in given {
            parameters.put(&name, value);
            names.insert(name);
        }
        for declared in self.derived.iter().filter(|declared| !names.contains(&declared.name)) {
            let value = parameters.value(declared, findings);
            parameters.put(&declared.name, value);
        }
        parameters
    }

    /// The parameters whose defaults are computed, each behind all that it is computed from, with the names in its default.
    pub(crate) fn derived(&self) -> impl DoubleEndedIterator<Item = (&str, Vec<String>)> {
        let is_known = |name: &str| self.values.contains_key(name);
        self.derived
            .iter()
            .map(move |declared| (&declared.name[..], names_in(&declared.default, &is_known)))
    }

    fn put(&mut self, name: &str, value: Tree) {
        match value.kind {
            Kind::Number { value, .. } => {
                let unit = self.unit(name);
                self.numbers.insert(name.to_owned(), Outcome::Number(Quantity { value, unit }));
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

    /// What a `Draft` stands for now; none if something is wrong with it, which is reported.
    pub(super) fn side<'t>(&self, tree: &'t Tree, findings: &mut Vec<Finding>) -> Option<&'t Tree> {
        chosen(tree, self.draft, findings)
    }

    pub(crate) fn names(&self) -> Vec<&str> {
        self.values.keys().map(String::as_str).collect()
    }

    fn is_broken(&self, name: &str) -> bool {
        self.values.get(name).is_some_and(Tree::is_broken)
    }

    fn unit(&self, name: &str) -> Unit {
        self.units.get(name).map(|(unit, _)| *unit).unwrap_or_default()
    }

    /// Where the unit of a parameter is declared.
    fn note(&self, name: &str) -> Option<(Span, String)> {
        let (unit, span) = self.units.get(name)?;
        Some((*span, format!("`{name}` is in {unit}")))
    }

    /// What a `Param` or `Expr` gives: something broken if that cannot be said, which is reported.
    pub(super) fn worked_out(&self, tree: &Tree, findings: &mut Vec<Finding>) -> Worked {
        let guesses = findings.len() < MOST_TOLD;
        let worked = match (tree.call_of("Param"), tree.call_of("Expr")) {
            (Some(argument), _) => self.parameter(argument, guesses),
            (None, argument) => self.expression(tree, argument.unwrap_or(tree), guesses),
        };
        match worked {
            Ok(Worked { value, unit, words, note }) => {
                let value = match value.origin {
                    Some(Origin::Given(_)) => moved(value, tree.span),
                    _ => Tree { span: tree.span, ..value },
                };
                Worked { value, unit, words, note }
            }
            Err(finding) => {
                findings.push(*finding);
                let (value, unit) = (Tree::new(tree.span, Kind::Broken), Unit::default());
                Worked { value, unit, words: String::new(), note: None }
            }
        }
    }

    fn parameter(&self, argument: &Tree, guesses: bool) -> Result<Worked, Box<Finding>> {
        let name = written(argument)?;
        let Some(value) = self.values.get(name).cloned() else {
            let help = match self.values.is_empty() {
                true => "declare it under `params`".into(),
                false if !guesses => Help::default(),
                false => nearest_or_all(name, "its parameters", &self.names()),
            };
            return Err(wrong(argument.span, format!("the graph has no parameter `{name}`"), help));
        };
        let words = format!("`Param(\"{name}\")`");
        Ok(Worked { value, unit: self.unit(name), words, note: self.note(name) })
    }

    fn expression(
        &self,
        call: &Tree,
        argument: &Tree,
        guesses: bool,
    ) -> Result<Worked, Box<Finding>> {
        let text = written(argument)?;
        let (kind, unit) = match evaluate(text, &self.numbers) {
            Ok(Outcome::Number(Quantity { value, unit })) => {
                (Kind::Number { value, whole: value.fract() == 0.0 }, unit)
            }
            Ok(Outcome::Truth(truth)) => (Kind::Bool(truth), Unit::default()),
            // A parameter without a value has been reported where it is declared.
            Err(error) if error.unknown().is_some_and(|name| self.is_broken(name)) => {
                (Kind::Broken, Unit::default())
            }
            Err(error) if error.unknown().is_some_and(|name| self.values.contains_key(name)) => {
                return Err(self.no_number(
                    call,
                    argument,
                    text,
                    error.unknown().unwrap_or_default(),
                ));
            }
            Err(error) => {
                let help = if guesses { error.help(&self.numbers) } else { Help::default() };
                let ExpressionError { message, at, note, .. } = error;
                let place = |at: Range<usize>| place_in(call, argument, text, at);
                let span = at.and_then(place).unwrap_or(argument.span);
                let note = note.and_then(|note| Some((place(note.0)?, note.1)));
                return Err(Box::new(Finding { note, ..*wrong(span, message, help) }));
            }
        };
        let named = named_parameters(text, &|name| self.values.contains_key(name));
        let note = named.into_iter().flatten().find_map(|at| self.note(&text[at]));
        let words = format!("`Expr(\"{}\")`", cut(text));
        Ok(Worked { value: Tree::new(Span::default(), kind), unit, words, note })
    }
}

impl Parameters {
    /// Says that an expression names a parameter with which nothing can be computed.
    fn no_number(&self, call: &Tree, argument: &Tree, text: &str, name: &str) -> Box<Finding> {
        let named = named_parameters(text, &|known| known == name).into_iter().flatten().next();
        let at = named.and_then(|at| place_in(call, argument, text, at));
        let kind = match self.values.get(name).map(|value| &value.kind) {
            Some(Kind::Text(_)) => "a text",
            Some(Kind::Word(_)) => "a choice",
            _ => "a vector",
        };
        let message = format!("`{name}` is {kind}, and Expr computes with numbers and toggles");
        let help = format!("it is given to a field as it is: Param(\"{name}\")");
        wrong(at.unwrap_or(argument.span), message, help.into())
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

/// The text in a `Param` or `Expr`.
fn written(argument: &Tree) -> Result<&str, Box<Finding>> {
    fn found(argument: &Tree) -> String {
        format!("this wants a text, not {}", argument.in_words())
    }
    let help = "write Param(\"name\") or Expr(\"a + b\")";
    argument.text().ok_or_else(|| wrong(argument.span, found(argument), help.into()))
}

fn wrong(span: Span, message: String, help: Help) -> Box<Finding> {
    Box::new(Finding { code: code::EXPRESSION, span, message, help, note: None })
}

/// The place of a part of an expression's text, if the text stands in the file as it is, without escapes.
fn place_in(call: &Tree, argument: &Tree, text: &str, part: Range<usize>) -> Option<Span> {
    let Span { start, end } = argument.span;
    // What was given elsewhere has one place for all of it.
    let is_there = argument.span != call.span && end - start == text.len() + 2;
    is_there.then(|| Span { start: start + 1 + part.start, end: start + 1 + part.end })
}

/// A value from `--set`: RON, or else text. A word with more behind it is text: `data//mug.obj` is a path, and no word before a comment.
pub(crate) fn read_set(text: &str, set: &str, span: Span) -> Tree {
    let (tree, mistakes) = parse(text);
    let is_cut = matches!(&tree.kind, Kind::Word(word) if *word != text.trim());
    let kind = match mistakes.is_empty() && !is_cut {
        true => moved(tree, span).kind,
        false => Kind::Text(text.to_owned()),
    };
    Tree { span, kind, origin: Some(Origin::Set(set.to_owned())) }
}

/// The value as another file gets it: with the place in this file that it comes from.
pub(crate) fn handed_over(tree: Tree, sheet: &Arc<Sheet>) -> Tree {
    fn given(span: Span, set: Option<String>, sheet: &Arc<Sheet>) -> Option<Origin> {
        Some(Origin::Given(Given { sheet: sheet.clone(), span, set }))
    }
    let again = |tree: Tree| handed_over(tree, sheet);
    let origin = match tree.origin {
        Some(Origin::Default(span)) => given(span, None, sheet),
        Some(Origin::Set(text)) => given(tree.span, Some(text), sheet),
        None => given(tree.span, None, sheet),
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

/// Whether the value is a parameter's, or computed from such.
pub fn is_computed(tree: &Tree) -> bool {
    tree.call_of("Param").is_some() || tree.call_of("Expr").is_some()
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
    fn all(trees: Vec<Tree>, span: &Span) -> Vec<Tree> {
        trees.into_iter().map(|tree| moved(tree, *span)).collect()
    }
    let kind = match tree.kind {
        Kind::List(items) => Kind::List(all(items, &span)),
        Kind::Call { name, body: Body::Items(items) } => {
            Kind::Call { name, body: Body::Items(all(items, &span)) }
        }
        Kind::Call { name, body: Body::Fields(fields) } => Kind::Call {
            name,
            body: Body::Fields(
                fields
                    .into_iter()
                    .map(|field: Field| Field { value: moved(field.value, span), ..field })
                    .collect(),
            ),
        },
        plain => plain,
    };
    Tree { span, kind, origin: tree.origin }
}
