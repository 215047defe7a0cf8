//! Replaces the parameters of nodes by values when the nodes are moved to another graph.

use std::collections::{BTreeMap, BTreeSet};

use maquette_graph::constants::in_own_unit;
use maquette_graph::draft_value::{is_draft, side};
use maquette_graph::expression::named_parameters;
use maquette_graph::migrate::kind_of;
use maquette_graph::parameters::is_computed;
use maquette_graph::tree::{show, text_in_call};
use maquette_graph::{EditError, Splice, apply};
use maquette_syntax::error::{Span, code};
use maquette_syntax::{Body, ExpectedValue, Kind, Quantity, Tree, Unit, parse, quote, truncate};

use super::{ParsedGraph, edit_error};

/// The replacement of a parameter. The *target graph* is the graph to which the nodes are moved.
#[derive(Clone)]
pub(crate) enum ParameterValue {
    /// A parameter of the target graph, by name.
    Parameter(String),
    /// An expression of parameters of the target graph.
    Expression(String),
    /// A value in RON, and the unit that the replaced parameter declares.
    Value { text: String, unit: Option<String> },
}

/// Returns the edits of a moved node that replace parameters by their values. `parameters` are the names of the target graph's parameters.
///
/// # Errors
/// A value cannot be written in place of the parameter.
pub(crate) fn substitution_splices(
    known: &ParsedGraph,
    (key, entry): &(Tree, Tree),
    values: &BTreeMap<String, ParameterValue>,
    parameters: &BTreeSet<String>,
) -> Result<Vec<Splice>, EditError> {
    let mut substitution = Substitution { values, parameters, splices: Vec::new() };
    let (name, kind) = (key.text().unwrap_or_default(), kind_of(entry));
    let schema = known.parsed_node(name).and_then(|parsed| parsed.what.schema());
    let kind = kind.map_or_else(String::new, |kind| kind.text);
    let of_node = schema.map(|schema| ExpectedValue::for_node(&kind, schema));
    if entry.name().is_none_or(|name| name.text != "ForEach") {
        substitution.replace_in_value(entry, of_node.as_ref())?;
        return Ok(substitution.splices);
    }
    for field in entry.fields().unwrap_or_default() {
        match (&field.name.text[..], &field.value.kind) {
            ("over", Kind::List(items)) => {
                items
                    .iter()
                    .try_for_each(|item| substitution.replace_in_value(item, of_node.as_ref()))?;
            }
            ("with", _) => substitution.replace_in_value(&field.value, of_node.as_ref())?,
            _ => substitution.replace_in_value(&field.value, None)?,
        }
    }
    Ok(substitution.splices)
}

/// Replaces parameters by their values in an expression.
///
/// # Errors
/// A value cannot be written in an expression.
pub(crate) fn expression(
    text: &str,
    values: &BTreeMap<String, ParameterValue>,
    parameters: &BTreeSet<String>,
) -> Result<String, EditError> {
    Substitution { values, parameters, splices: Vec::new() }.expression(text, Span::default())
}

struct Substitution<'a> {
    values: &'a BTreeMap<String, ParameterValue>,
    parameters: &'a BTreeSet<String>,
    splices: Vec<Splice>,
}

impl Substitution<'_> {
    fn replace_in_value(
        &mut self,
        tree: &Tree,
        expected: Option<&ExpectedValue<'_>>,
    ) -> Result<(), EditError> {
        if is_draft(tree) {
            let mut sides = [false, true].into_iter().filter_map(|draft| side(tree, draft));
            return sides.try_for_each(|side| self.replace_in_value(side, expected));
        }
        if is_computed(tree) {
            return self.replace_computed(tree, expected);
        }
        match &tree.kind {
            Kind::List(items) => self.replace_in_items(items, |at| expected?.item(at)),
            Kind::Map(entries) => {
                let inside = expected.and_then(ExpectedValue::entry);
                entries
                    .iter()
                    .try_for_each(|(_, value)| self.replace_in_value(value, inside.as_ref()))
            }
            Kind::Call { name, body } => {
                let inside = match name {
                    Some(name) => {
                        expected.and_then(|expected| expected.variant_content(&name.text))
                    }
                    None => expected.cloned(),
                };
                let inside = inside.as_ref();
                match body {
                    Body::Empty => Ok(()),
                    Body::Items(items) if name.is_some() => {
                        self.replace_in_items(items, |at| inside?.argument(at))
                    }
                    Body::Items(items) => self.replace_in_items(items, |at| inside?.item(at)),
                    Body::Fields(fields) => fields.iter().try_for_each(|field| {
                        let expected = inside.and_then(|inside| inside.field(&field.name.text));
                        self.replace_in_value(&field.value, expected.as_ref())
                    }),
                }
            }
            _ => Ok(()),
        }
    }

    fn replace_in_items<'e>(
        &mut self,
        items: &[Tree],
        expected: impl Fn(usize) -> Option<ExpectedValue<'e>>,
    ) -> Result<(), EditError> {
        let mut items = items.iter().enumerate();
        items.try_for_each(|(at, item)| self.replace_in_value(item, expected(at).as_ref()))
    }

    fn replace_computed(
        &mut self,
        tree: &Tree,
        expected: Option<&ExpectedValue<'_>>,
    ) -> Result<(), EditError> {
        let written = match (text_in_call(tree, "Param"), text_in_call(tree, "Expr")) {
            (Some(name), _) => match self.values.get(name) {
                Some(ParameterValue::Parameter(new)) if new == name => return Ok(()),
                Some(ParameterValue::Parameter(new)) => format!("Param({})", quote(new)),
                Some(ParameterValue::Expression(text)) => format!("Expr({})", quote(text)),
                Some(ParameterValue::Value { text, unit }) => {
                    let unit = unit.as_deref();
                    value_text(name, text, unit, expected)
                        .ok_or_else(|| unit_error(tree.span, name))?
                }
                None => return Ok(()),
            },
            (None, Some(text)) => match self.expression(text, tree.span)? {
                new if new == text => return Ok(()),
                new => format!("Expr({})", quote(&new)),
            },
            (None, None) => return Ok(()),
        };
        self.splices.push((tree.span, written));
        Ok(())
    }

    /// Replaces parameters by their values in an expression.
    fn expression(&self, text: &str, span: Span) -> Result<String, EditError> {
        let places = named_parameters(text, &|name| self.values.contains_key(name));
        let places = places.unwrap_or_default();
        let mut parts = Vec::new();
        for at in &places {
            let name = &text[at.clone()];
            parts.push(match self.values.get(name) {
                Some(ParameterValue::Parameter(new)) => (new.clone(), vec![new.clone()]),
                Some(ParameterValue::Expression(inner)) => {
                    let names = named_parameters(inner, &|name| self.parameters.contains(name));
                    let names = names.into_iter().flatten().map(|at| inner[at].to_owned());
                    (format!("({inner})"), names.collect())
                }
                Some(ParameterValue::Value { text: value, unit }) => {
                    let number = operand_text(value, unit.as_deref());
                    (number.ok_or_else(|| expression_error(name, value, span, text))?, Vec::new())
                }
                None => (name.to_owned(), Vec::new()),
            });
        }
        let names: Vec<_> = parts.iter().flat_map(|(_, names)| names.clone()).collect();
        // A name next to a hyphen may be read as part of a longer name. If so, the second pass adds parentheses.
        for apart in [false, true] {
            let mut new = text.to_owned();
            for (at, (part, _)) in places.iter().zip(&parts).rev() {
                let part = if apart { format!("({part})") } else { part.clone() };
                new.replace_range(at.clone(), &part);
            }
            let found = named_parameters(&new, &|name| self.parameters.contains(name));
            let found = found.unwrap_or_default().into_iter().map(|at| new[at].to_owned());
            let known = found.filter(|name| !matches!(&name[..], "true" | "false"));
            if known.eq(names.iter().cloned()) {
                return Ok(new);
            }
        }
        let name = places.first().map_or("", |at| &text[at.clone()]);
        Err(expression_error(name, "its names would be read as one", span, text))
    }
}

fn unit_error(span: Span, name: &str) -> EditError {
    let message = format!("the value of `{name}` cannot be written in the unit of this field");
    let help = format!("give `{name}` and this field the same unit");
    edit_error(code::WRONG_VALUE, span, message, help)
}

/// Returns the value of a parameter as text for a field. A value in another unit than that of the field is written with its unit. `None` if
/// the value cannot be written.
fn value_text(
    name: &str,
    text: &str,
    unit: Option<&str>,
    expected: Option<&ExpectedValue<'_>>,
) -> Option<String> {
    let own = unit.and_then(Unit::read);
    let wanted = expected.and_then(|expected| expected.unit.as_deref()).and_then(Unit::read);
    match (own, wanted) {
        (Some(own), Some(wanted)) if own != wanted => {
            let word = unit.filter(|word| Unit::from_name(word).is_some())?;
            let mut splices = Vec::new();
            add_unit(&parse(text).0, word, text, &mut splices);
            Some(apply(text, splices))
        }
        (Some(_), None) => {
            let tree = parse(text).0;
            let plain = in_own_unit(&tree, name, unit, &mut Vec::new());
            Some(if plain == tree { text.to_owned() } else { show(&plain) })
        }
        _ => Some(text.to_owned()),
    }
}

/// Returns the error for a value that cannot be written in an expression.
fn expression_error(name: &str, detail: &str, span: Span, text: &str) -> EditError {
    let message =
        format!("Expr(\"{}\") cannot contain the value of `{name}`: {detail}", truncate(text));
    let help = format!("give `{name}` a number, a Param or an Expr");
    edit_error(code::EXPRESSION, span, message, help)
}

/// Collects the edits that append the unit to each number without a unit.
fn add_unit(tree: &Tree, unit: &str, text: &str, splices: &mut Vec<Splice>) {
    match &tree.kind {
        Kind::Number { .. } => {
            let Span { start, end } = tree.span;
            splices.push((tree.span, format!("{unit}({})", &text[start..end])));
        }
        _ if Quantity::read(tree).is_some() || is_computed(tree) => {}
        Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
            items.iter().for_each(|item| add_unit(item, unit, text, splices));
        }
        Kind::Call { body: Body::Fields(fields), .. } => {
            fields.iter().for_each(|field| add_unit(&field.value, unit, text, splices));
        }
        _ => {}
    }
}

/// Returns a value as an operand for an expression. `None` if it is neither a number nor a truth value.
fn operand_text(text: &str, unit: Option<&str>) -> Option<String> {
    let tree = parse(text).0;
    if let Some(Quantity { value, .. }) = Quantity::read(&tree) {
        return Some(format!("{}({value})", tree.name()?.text));
    }
    let value = match tree.kind {
        Kind::Bool(truth) => return Some(truth.to_string()),
        Kind::Number { value, .. } => value,
        _ => return None,
    };
    match unit.filter(|unit| Unit::read(unit).is_some()) {
        Some(unit) => Unit::from_name(unit).map(|_| format!("{unit}({value})")),
        None if value < 0.0 => Some(format!("({value})")),
        None => Some(value.to_string()),
    }
}
