//! The parameters of a graph, and the evaluation of `Param` and `Expr`.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

use indexmap::IndexMap;
use maquette_syntax::error::{MAX_REPORTED, Span, code};
use maquette_syntax::{
    Body, ExternalOrigin, Field, Help, Kind, LocalDiagnostic, Origin, Quantity, SourceMap, Tree,
    Unit, nearest_or_all, parse, truncate,
};

use super::constants::{in_own_unit, resolve_in_unit};
use super::declaration::Declaration;
use super::draft_value::{has_draft, resolve_side};
use super::expression::{ExpressionError, Outcome, component_names, evaluate, named_parameters};

mod order;

use order::Order;
pub(crate) use order::names_in;

/// The values of a graph's parameters.
#[derive(Clone, Debug, Default)]
pub(crate) struct Parameters {
    values: IndexMap<String, Tree>,
    numbers: BTreeMap<String, Outcome>,
    /// True to use the draft value of each `Draft`.
    draft: bool,
    /// The known units of parameters, by parameter name, and the positions at which the units are declared.
    units: BTreeMap<String, (Unit, Span)>,
    /// The parameters whose defaults are computed. Each comes after the parameters from which it is computed.
    derived: Arc<[Declaration]>,
}

/// The value of a `Param` or an `Expr`, or a number with a unit.
pub(super) struct ResolvedValue {
    pub(super) value: Tree,
    pub(super) unit: Unit,
    /// The value as messages name it, such as `Param("near")`.
    pub words: String,
    /// The position of the declaration that states the unit, and a text for the message. `None` if the unit does not come from a
    /// declaration.
    pub(super) note: Option<(Span, String)>,
}

impl Parameters {
    /// Reads the declarations of a graph's parameters. Values of `--set` replace defaults.
    pub(crate) fn read(
        entries: &[(&Tree, &Tree)],
        set: &[(String, String)],
        draft: bool,
        source_map: &SourceMap,
        diagnostics: &mut Vec<LocalDiagnostic>,
    ) -> (Vec<Declaration>, Self) {
        let mut parameters = Self { draft, ..Self::default() };
        let mut declarations = Vec::with_capacity(entries.len());
        for (key, declaration) in entries {
            let Some(name) = key.text() else { continue };
            parameters.insert(name, Tree::new(declaration.span, Kind::Broken));
            let Some(mut declared) = Declaration::read(name, declaration, diagnostics) else {
                continue;
            };
            if let Some((_, text)) = set.iter().rev().find(|(target, _)| target == name) {
                let given = read_set(text, &format!("{name}={text}"), declaration.span);
                declared.default = in_own_unit(&given, name, declared.unit(), diagnostics);
            }
            let unit = declared.unit().and_then(Unit::read);
            let unit = unit.map(|unit| (name.to_owned(), (unit, declared.unit_span)));
            parameters.units.extend(unit);
            declarations.push(declared);
        }
        let order = Order::compute(&declarations, source_map, diagnostics);
        let derived = order.indices.iter().map(|&at| &declarations[at]);
        parameters.derived =
            derived.filter(|declared| is_parametric(&declared.default)).cloned().collect();
        let mut others = Self { draft: !draft, ..parameters.clone() };
        let has_sides = declarations.iter().any(|declared| has_draft(&declared.default));
        // Also report errors of the other side of each `Draft` (draft or final value), unless the current side has the same errors.
        let (mut known, mut other_findings) = (Vec::new(), Vec::new());
        for &at in &order.indices {
            let declared = &mut declarations[at];
            let own = parameters.value(declared, &mut known);
            if has_sides {
                let other = others.value(declared, &mut other_findings);
                others.insert(&declared.name, other.clone());
                let sides = if draft { [other, own.clone()] } else { [own.clone(), other] };
                declared.sides = Some(sides).filter(|_| has_draft(&declared.default));
            }
            parameters.insert(&declared.name, own.clone());
            declared.is_derived = is_parametric(&declared.default);
            declared.default = own;
        }
        other_findings.retain(|diagnostic| !known.contains(diagnostic));
        diagnostics.append(&mut known);
        diagnostics.append(&mut other_findings);
        (declarations, parameters)
    }

    /// Evaluates the default of a parameter. The default may be computed from other parameters.
    fn value(&self, declared: &Declaration, diagnostics: &mut Vec<LocalDiagnostic>) -> Tree {
        let default = &declared.default;
        let mut value = of_side(resolve_side(default, self.draft, diagnostics), default);
        if is_parametric(&value) {
            let (name, unit, origin) = (&declared.name, declared.unit(), value.origin.clone());
            value = resolve_in_unit(&value, Some(self), name, unit, diagnostics);
            value.origin = origin;
        }
        declared.with_default(value).value(diagnostics)
    }

    /// Replaces the values of some parameters by the values that a node gives when it uses this graph.
    pub(crate) fn with_values(
        &self,
        given: impl IntoIterator<Item = (String, Tree)>,
        diagnostics: &mut Vec<LocalDiagnostic>,
    ) -> Self {
        let mut parameters = self.clone();
        let mut names = BTreeSet::new();
        for (name, value) in given {
            parameters.insert(&name, value);
            names.insert(name);
        }
        for declared in self.derived.iter().filter(|declared| !names.contains(&declared.name)) {
            let value = parameters.value(declared, diagnostics);
            parameters.insert(&declared.name, value);
        }
        parameters
    }

    /// Returns the parameters with computed defaults, each with the parameter names that occur in its default. Each comes after the
    /// parameters from which it is computed.
    pub(crate) fn derived_parameters(
        &self,
    ) -> impl DoubleEndedIterator<Item = (&str, Vec<String>)> {
        self.derived.iter().map(|declared| {
            let names = names_in(&declared.default, &|name| self.values.contains_key(name));
            (&declared.name[..], names)
        })
    }

    fn insert(&mut self, name: &str, value: Tree) {
        match &value.kind {
            Kind::Bool(truth) => {
                self.numbers.insert(name.to_owned(), Outcome::Truth(*truth));
            }
            Kind::Call { name: None, body: Body::Items(items) } => {
                for (component, item) in component_names(name).zip(items) {
                    self.insert_number(component, item, self.unit(name));
                }
            }
            _ => self.insert_number(name.to_owned(), &value, self.unit(name)),
        }
        self.values.insert(name.to_owned(), value);
    }

    /// Makes a number known to expressions.
    fn insert_number(&mut self, name: String, value: &Tree, unit: Unit) {
        if let Kind::Number { value, .. } = value.kind {
            self.numbers.insert(name, Outcome::Number(Quantity { value, unit }));
        }
    }

    /// Returns the parameters with `draft` negated: for drafts instead of final results, or vice versa.
    pub(super) fn for_other_side(&self) -> Self {
        Self { draft: !self.draft, ..self.clone() }
    }

    /// Returns the current side of a `Draft`. Reports an invalid side, and returns `None`.
    pub(super) fn side<'t>(
        &self,
        tree: &'t Tree,
        diagnostics: &mut Vec<LocalDiagnostic>,
    ) -> Option<&'t Tree> {
        resolve_side(tree, self.draft, diagnostics)
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

    /// Returns a note that states the unit of a parameter, at the position of its declaration. `None` if the unit is unknown.
    fn note(&self, name: &str) -> Option<(Span, String)> {
        let (unit, span) = self.units.get(name)?;
        Some((*span, format!("`{name}` is in {unit}")))
    }

    /// Evaluates a `Param` or an `Expr`. If there are errors, reports them and returns a broken value.
    pub(super) fn resolve(
        &self,
        tree: &Tree,
        diagnostics: &mut Vec<LocalDiagnostic>,
    ) -> ResolvedValue {
        let guesses = diagnostics.len() < MAX_REPORTED;
        let resolved = match (tree.call_of("Param"), tree.call_of("Expr")) {
            (Some(argument), _) => self.parameter(argument, guesses),
            (None, argument) => self.expression(tree, argument.unwrap_or(tree), guesses),
        };
        match resolved {
            Ok(ResolvedValue { value, unit, words, note }) => {
                let value = match value.origin {
                    Some(Origin::External(_)) => at_span(value, tree.span),
                    _ => Tree { span: tree.span, ..value },
                };
                ResolvedValue { value, unit, words, note }
            }
            Err(diagnostic) => {
                diagnostics.push(*diagnostic);
                let (value, unit) = (Tree::new(tree.span, Kind::Broken), Unit::default());
                ResolvedValue { value, unit, words: String::new(), note: None }
            }
        }
    }

    fn parameter(
        &self,
        argument: &Tree,
        guesses: bool,
    ) -> Result<ResolvedValue, Box<LocalDiagnostic>> {
        let name = text_argument(argument)?;
        let Some(value) = self.values.get(name).cloned() else {
            let help = match self.values.is_empty() {
                true => "declare it under `params`".into(),
                false if !guesses => Help::default(),
                false => nearest_or_all(name, "its parameters", &self.names()),
            };
            return Err(parameter_error(
                argument.span,
                format!("the graph has no parameter `{name}`"),
                help,
            ));
        };
        let words = format!("`Param(\"{name}\")`");
        Ok(ResolvedValue { value, unit: self.unit(name), words, note: self.note(name) })
    }

    fn expression(
        &self,
        call: &Tree,
        argument: &Tree,
        guesses: bool,
    ) -> Result<ResolvedValue, Box<LocalDiagnostic>> {
        let text = text_argument(argument)?;
        let (kind, unit) = match evaluate(text, &self.numbers) {
            Ok(Outcome::Number(Quantity { value, unit })) => {
                (Kind::Number { value, whole: value.fract() == 0.0 }, unit)
            }
            Ok(Outcome::Truth(truth)) => (Kind::Bool(truth), Unit::default()),
            // A parameter without a value has been reported at its declaration.
            Err(error) if error.unknown().is_some_and(|name| self.is_broken(name)) => {
                (Kind::Broken, Unit::default())
            }
            Err(error) if error.unknown().is_some_and(|name| self.values.contains_key(name)) => {
                return Err(self.not_a_number(
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
                return Err(Box::new(LocalDiagnostic {
                    note,
                    ..*parameter_error(span, message, help)
                }));
            }
        };
        let named = named_parameters(text, &|name| self.values.contains_key(name));
        let note = named.into_iter().flatten().find_map(|at| self.note(&text[at]));
        let words = format!("`Expr(\"{}\")`", truncate(text));
        Ok(ResolvedValue { value: Tree::new(Span::default(), kind), unit, words, note })
    }
}

impl Parameters {
    /// Returns the error for an expression that uses a parameter that is neither a number nor a toggle.
    fn not_a_number(
        &self,
        call: &Tree,
        argument: &Tree,
        text: &str,
        name: &str,
    ) -> Box<LocalDiagnostic> {
        let named = named_parameters(text, &|known| known == name).into_iter().flatten().next();
        let at = named.and_then(|at| place_in(call, argument, text, at));
        let unchanged = format!("pass it to a field unchanged: Param(\"{name}\")");
        let (kind, help) = match self.values.get(name).map(|value| &value.kind) {
            Some(Kind::Text(_)) => ("a text", unchanged),
            Some(Kind::Word(_)) => ("a choice", unchanged),
            _ => ("a vector", format!("use one of its numbers, as `{name}.x`, or {unchanged}")),
        };
        let message = format!("`{name}` is {kind}, but Expr accepts only numbers and toggles");
        parameter_error(at.unwrap_or(argument.span), message, help.into())
    }
}

/// Adds the origin of a parameter's default, which is a `Draft`, to `side`, one of its two values. Returns a broken value if `side` is
/// `None`.
fn of_side(side: Option<&Tree>, default: &Tree) -> Tree {
    match (side, &default.origin) {
        (None, _) => Tree::new(default.span, Kind::Broken),
        (Some(side), Some(Origin::Default(_))) => {
            Tree { origin: Some(Origin::Default(side.span)), ..side.clone() }
        }
        (Some(side), origin) => Tree { origin: origin.clone(), ..side.clone() },
    }
}

/// Returns the text argument of `Param(..)` or `Expr(..)`.
fn text_argument(argument: &Tree) -> Result<&str, Box<LocalDiagnostic>> {
    fn argument_message(argument: &Tree) -> String {
        format!("expected a text, found {}", argument.describe())
    }
    let help = "write Param(\"name\") or Expr(\"a + b\")";
    argument
        .text()
        .ok_or_else(|| parameter_error(argument.span, argument_message(argument), help.into()))
}

fn parameter_error(span: Span, message: String, help: Help) -> Box<LocalDiagnostic> {
    Box::new(LocalDiagnostic { code: code::EXPRESSION, span, message, help, note: None })
}

/// Returns the position in the file of a part of an expression. `None` if the expression contains escapes or comes from another file.
fn place_in(call: &Tree, argument: &Tree, text: &str, part: Range<usize>) -> Option<Span> {
    let Span { start, end } = argument.span;
    // All parts of a value from another file have the same position.
    let is_there = argument.span != call.span && end - start == text.len() + 2;
    is_there.then(|| Span { start: start + 1 + part.start, end: start + 1 + part.end })
}

/// Parses a value of `--set`: as RON, or else as text. If text remains after a single word, the whole is a text. For example,
/// `data//mug.obj` is a path, not a word before a comment.
pub(crate) fn read_set(text: &str, set: &str, span: Span) -> Tree {
    let (tree, errors) = parse(text);
    let is_cut = matches!(&tree.kind, Kind::Word(word) if *word != text.trim());
    let kind = match errors.is_empty() && !is_cut {
        true => at_span(tree, span).kind,
        false => Kind::Text(text.to_owned()),
    };
    Tree { span, kind, origin: Some(Origin::Set(set.to_owned())) }
}

/// Prepares a value for use in another file: stores its position in the current file as its origin.
pub(crate) fn for_other_file(tree: Tree, source_map: &Arc<SourceMap>) -> Tree {
    fn given_origin(
        span: Span,
        set: Option<String>,
        source_map: &Arc<SourceMap>,
    ) -> Option<Origin> {
        Some(Origin::External(ExternalOrigin { source_map: source_map.clone(), span, set }))
    }
    fn all_for_other_file(items: Vec<Tree>, source_map: &Arc<SourceMap>) -> Vec<Tree> {
        items.into_iter().map(|item| for_other_file(item, source_map)).collect()
    }
    let origin = match tree.origin {
        Some(Origin::Default(span)) => given_origin(span, None, source_map),
        Some(Origin::Set(text)) => given_origin(tree.span, Some(text), source_map),
        None => given_origin(tree.span, None, source_map),
        // Keep the origin of a value that several files have passed on: the position in the first file.
        given => given,
    };
    let kind = match tree.kind {
        Kind::List(items) => Kind::List(all_for_other_file(items, source_map)),
        Kind::Call { name, body: Body::Items(items) } => {
            Kind::Call { name, body: Body::Items(all_for_other_file(items, source_map)) }
        }
        plain => plain,
    };
    Tree { span: tree.span, kind, origin }
}

/// Returns true for a `Param` or an `Expr`.
pub fn is_computed(tree: &Tree) -> bool {
    tree.call_of("Param").is_some() || tree.call_of("Expr").is_some()
}

/// Returns true if the value is or contains a value that is computed from parameters.
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

/// Sets all positions in a tree to one span. For trees that were not parsed from the file.
fn at_span(tree: Tree, span: Span) -> Tree {
    fn all_at_span(trees: Vec<Tree>, span: &Span) -> Vec<Tree> {
        trees.into_iter().map(|tree| at_span(tree, *span)).collect()
    }
    let kind = match tree.kind {
        Kind::List(items) => Kind::List(all_at_span(items, &span)),
        Kind::Call { name, body: Body::Items(items) } => {
            Kind::Call { name, body: Body::Items(all_at_span(items, &span)) }
        }
        Kind::Call { name, body: Body::Fields(fields) } => Kind::Call {
            name,
            body: Body::Fields(
                fields
                    .into_iter()
                    .map(|field: Field| Field { value: at_span(field.value, span), ..field })
                    .collect(),
            ),
        },
        plain => plain,
    };
    Tree { span, kind, origin: tree.origin }
}
