//! Values in place of parameters, in nodes that go to another graph.

use std::collections::{BTreeMap, BTreeSet};

use maquette_graph::expression::named_parameters;
use maquette_graph::fitting::in_own_unit;
use maquette_graph::migrate::kind_of;
use maquette_graph::parameters::is_computed;
use maquette_graph::quality::{is_draft, side};
use maquette_graph::tree::show;
use maquette_graph::{Refusal, Splice, apply};
use maquette_syntax::error::{Span, code};
use maquette_syntax::{Body, Expected, Kind, Quantity, Tree, Unit, cut, parse, quoted};

use super::{Known, refusal};

/// What a parameter stands for in the other graph.
#[derive(Clone)]
pub(crate) enum Given {
    /// A parameter there.
    Parameter(String),
    /// An expression of parameters there.
    Expression(String),
    /// A value, as RON, and the unit that the parameter is declared with.
    Value { text: String, unit: Option<String> },
}

/// The edits of a node that put what they stand for in the place of parameters. `there` are the parameters of the other graph.
///
/// # Errors
/// A value that cannot be said in this place.
pub(crate) fn put_values(
    known: &Known,
    (key, entry): &(Tree, Tree),
    values: &BTreeMap<String, Given>,
    there: &BTreeSet<String>,
) -> Result<Vec<Splice>, Refusal> {
    let mut putting = Putting { values, there, splices: Vec::new() };
    let (name, kind) = (key.text().unwrap_or_default(), kind_of(entry));
    let schema = known.draft(name).and_then(|draft| draft.what.schema());
    let kind = kind.map_or_else(String::new, |kind| kind.text);
    let of_node = schema.map(|schema| Expected::of_node(&kind, schema));
    if entry.name().is_none_or(|name| name.text != "ForEach") {
        putting.value(entry, of_node.as_ref())?;
        return Ok(putting.splices);
    }
    for field in entry.fields().unwrap_or_default() {
        match (&field.name.text[..], &field.value.kind) {
            ("over", Kind::List(items)) => {
                items.iter().try_for_each(|item| putting.value(item, of_node.as_ref()))?;
            }
            ("with", _) => putting.value(&field.value, of_node.as_ref())?,
            _ => putting.value(&field.value, None)?,
        }
    }
    Ok(putting.splices)
}

/// An expression with what they stand for in the place of parameters.
///
/// # Errors
/// What they stand for cannot be said in an expression.
pub(crate) fn expression(
    text: &str,
    values: &BTreeMap<String, Given>,
    there: &BTreeSet<String>,
) -> Result<String, Refusal> {
    Putting { values, there, splices: Vec::new() }.expression(text, Span::default())
}

struct Putting<'a> {
    values: &'a BTreeMap<String, Given>,
    there: &'a BTreeSet<String>,
    splices: Vec<Splice>,
}

impl Putting<'_> {
    fn value(&mut self, tree: &Tree, expected: Option<&Expected<'_>>) -> Result<(), Refusal> {
        if is_draft(tree) {
            let mut sides = [false, true].into_iter().filter_map(|draft| side(tree, draft));
            return sides.try_for_each(|side| self.value(side, expected));
        }
        if is_computed(tree) {
            return self.computed(tree, expected);
        }
        match &tree.kind {
            Kind::List(items) => self.items(items, |at| expected?.item(at)),
            Kind::Map(entries) => {
                let inside = expected.and_then(Expected::entry);
                entries.iter().try_for_each(|(_, value)| self.value(value, inside.as_ref()))
            }
            Kind::Call { name, body } => {
                let inside = match name {
                    Some(name) => expected.and_then(|expected| expected.behind(&name.text)),
                    None => expected.cloned(),
                };
                let inside = inside.as_ref();
                match body {
                    Body::Empty => Ok(()),
                    Body::Items(items) if name.is_some() => {
                        self.items(items, |at| inside?.argument(at))
                    }
                    Body::Items(items) => self.items(items, |at| inside?.item(at)),
                    Body::Fields(fields) => fields.iter().try_for_each(|field| {
                        let expected = inside.and_then(|inside| inside.field(&field.name.text));
                        self.value(&field.value, expected.as_ref())
                    }),
                }
            }
            _ => Ok(()),
        }
    }

    fn items<'e>(
        &mut self,
        items: &[Tree],
        expected: impl Fn(usize) -> Option<Expected<'e>>,
    ) -> Result<(), Refusal> {
        let mut items = items.iter().enumerate();
        items.try_for_each(|(at, item)| self.value(item, expected(at).as_ref()))
    }

    fn computed(&mut self, tree: &Tree, expected: Option<&Expected<'_>>) -> Result<(), Refusal> {
        let text = |call: &str| tree.call_of(call).and_then(Tree::text);
        let written = match (text("Param"), text("Expr")) {
            (Some(name), _) => match self.values.get(name) {
                Some(Given::Parameter(new)) if new == name => return Ok(()),
                Some(Given::Parameter(new)) => format!("Param({})", quoted(new)),
                Some(Given::Expression(text)) => format!("Expr({})", quoted(text)),
                Some(Given::Value { text, unit }) => {
                    let unit = unit.as_deref();
                    literal(name, text, unit, expected)
                        .ok_or_else(|| unit_refused(tree.span, name))?
                }
                None => return Ok(()),
            },
            (None, Some(text)) => match self.expression(text, tree.span)? {
                new if new == text => return Ok(()),
                new => format!("Expr({})", quoted(&new)),
            },
            (None, None) => return Ok(()),
        };
        self.splices.push((tree.span, written));
        Ok(())
    }

    /// An expression with what they stand for in the place of parameters.
    fn expression(&self, text: &str, span: Span) -> Result<String, Refusal> {
        let places = named_parameters(text, &|name| self.values.contains_key(name));
        let places = places.unwrap_or_default();
        fn refused(name: &str, what: &str, span: &Span, text: &str) -> Refusal {
            let message =
                format!("Expr(\"{}\") cannot say what `{name}` is given: {what}", cut(text));
            let help = format!("give `{name}` a number, a Param or an Expr");
            refusal(code::EXPRESSION, *span, message, help)
        }
        let mut parts = Vec::new();
        for at in &places {
            let name = &text[at.clone()];
            parts.push(match self.values.get(name) {
                Some(Given::Parameter(new)) => (new.clone(), vec![new.clone()]),
                Some(Given::Expression(inner)) => {
                    let names = named_parameters(inner, &|name| self.there.contains(name));
                    let names = names.into_iter().flatten().map(|at| inner[at].to_owned());
                    (format!("({inner})"), names.collect())
                }
                Some(Given::Value { text: value, unit }) => {
                    let number = number(value, unit.as_deref());
                    (number.ok_or_else(|| refused(name, value, &span, text))?, Vec::new())
                }
                None => (name.to_owned(), Vec::new()),
            });
        }
        let names: Vec<_> = parts.iter().flat_map(|(_, names)| names.clone()).collect();
        // Beside a hyphen a name may be taken for a longer one, unless it stands by itself.
        for apart in [false, true] {
            let mut new = text.to_owned();
            for (at, (part, _)) in places.iter().zip(&parts).rev() {
                let part = if apart { format!("({part})") } else { part.clone() };
                new.replace_range(at.clone(), &part);
            }
            let found = named_parameters(&new, &|name| self.there.contains(name));
            let found = found.unwrap_or_default().into_iter().map(|at| new[at].to_owned());
            let known = found.filter(|name| !matches!(&name[..], "true" | "false"));
            if known.eq(names.iter().cloned()) {
                return Ok(new);
            }
        }
        let name = places.first().map_or("", |at| &text[at.clone()]);
        Err(refused(name, "names would run into each other", &span, text))
    }
}

fn unit_refused(span: Span, name: &str) -> Refusal {
    let message = format!("the value of `{name}` cannot be said in the unit of this place");
    let help = format!("make `{name}` and this field of one unit");
    refusal(code::WRONG_VALUE, span, message, help)
}

/// A value in the place of a parameter: with its unit if it is another one than that of the place; none if that cannot be written.
fn literal(
    name: &str,
    text: &str,
    unit: Option<&str>,
    expected: Option<&Expected<'_>>,
) -> Option<String> {
    let own = unit.and_then(Unit::read);
    let wanted = expected.and_then(|expected| expected.unit.as_deref()).and_then(Unit::read);
    match (own, wanted) {
        (Some(own), Some(wanted)) if own != wanted => {
            let word = unit.filter(|word| Unit::named(word).is_some())?;
            let mut splices = Vec::new();
            with_unit(&parse(text).0, word, text, &mut splices);
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

/// The edits that give each number without a unit this one.
fn with_unit(tree: &Tree, unit: &str, text: &str, splices: &mut Vec<Splice>) {
    fn all(trees: &[Tree], unit: &str, text: &str, splices: &mut Vec<(Span, String)>) {
        trees.iter().for_each(|it| with_unit(it, unit, text, splices))
    }
    match &tree.kind {
        Kind::Number { .. } => {
            let Span { start, end } = tree.span;
            splices.push((tree.span, format!("{unit}({})", &text[start..end])));
        }
        _ if Quantity::read(tree).is_some() || is_computed(tree) => {}
        Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
            all(items, unit, text, splices)
        }
        Kind::Call { body: Body::Fields(fields), .. } => {
            fields.iter().for_each(|field| with_unit(&field.value, unit, text, splices));
        }
        _ => {}
    }
}

/// A value as a part of an expression; none if it is no number and no condition.
fn number(text: &str, unit: Option<&str>) -> Option<String> {
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
        Some(unit) => Unit::named(unit).map(|_| format!("{unit}({value})")),
        None if value < 0.0 => Some(format!("({value})")),
        None => Some(value.to_string()),
    }
}
