//! Resolves `Param`, `Expr` and numbers with units, such as `cm(1.2)`, to plain numbers in the unit of each field.

use maquette_syntax::error::{Span, code};
use maquette_syntax::{
    Body, ExpectedValue, Field, Help, Kind, LocalDiagnostic, Origin, Quantity, Tree, Unit,
};
use serde_json::{Value as Json, json};

use super::draft_value::{is_draft, map_sides};
use super::parameters::{Parameters, ResolvedValue, is_computed};

/// Resolves the values in the fields of a call.
struct Resolver<'a> {
    /// The parameters of the graph. If `None`, `Param` and `Expr` are not replaced.
    parameters: Option<&'a Parameters>,
    /// The node type whose fields are resolved. `None` if a parameter is resolved.
    owner: Option<&'a str>,
    diagnostics: &'a mut Vec<LocalDiagnostic>,
}

impl Parameters {
    /// Replaces every `Param`, `Expr` and number with a unit in the call of a node by its value. A part without a value becomes broken.
    pub(super) fn resolve_call(
        &self,
        tree: &Tree,
        owner: &str,
        schema: &Json,
        diagnostics: &mut Vec<LocalDiagnostic>,
    ) -> Tree {
        let mut fitting = Resolver { parameters: Some(self), owner: Some(owner), diagnostics };
        fitting.value(tree, Some(ExpectedValue::for_node(owner, schema)))
    }

    /// Replaces every `Param` and `Expr` in a value whose schema is unknown.
    pub(super) fn substitute(&self, tree: &Tree, diagnostics: &mut Vec<LocalDiagnostic>) -> Tree {
        Resolver { parameters: Some(self), owner: None, diagnostics }.value(tree, None)
    }
}

/// Converts the numbers with units in the call of a node to plain numbers in the units of the node's fields. A number with an unsuitable
/// unit becomes broken.
pub fn in_plain_numbers(tree: &Tree, schema: &Json) -> Tree {
    let mut fitting = Resolver { parameters: None, owner: None, diagnostics: &mut Vec::new() };
    fitting.value(tree, Some(ExpectedValue::for_node("", schema)))
}

/// Converts the numbers with units in a list of calls to plain numbers. The schema lists the possible calls. A number with a wrong unit
/// becomes broken.
pub(super) fn calls_in_plain_numbers(
    list: &Tree,
    schema: &Json,
    diagnostics: &mut Vec<LocalDiagnostic>,
) -> Tree {
    let Kind::List(items) = &list.kind else { return list.clone() };
    Tree {
        kind: Kind::List(
            items
                .iter()
                .map(|item| {
                    let Some(name) = item.name() else { return item.clone() };
                    let mut fitting =
                        Resolver { parameters: None, owner: Some(&name.text), diagnostics };
                    fitting.value(item, Some(ExpectedValue::for_node(&name.text, schema)))
                })
                .collect(),
        ),
        ..list.clone()
    }
}

/// Converts a value of the parameter `name` to plain numbers in the parameter's unit.
pub fn in_own_unit(
    tree: &Tree,
    name: &str,
    unit: Option<&str>,
    diagnostics: &mut Vec<LocalDiagnostic>,
) -> Tree {
    if is_draft(tree) {
        return map_sides(tree, |side| in_own_unit(side, name, unit, diagnostics));
    }
    resolve_in_unit(tree, None, name, unit, diagnostics)
}

/// Converts a value to plain numbers in the parameter's unit. If `parameters` are given, also replaces every `Param` and `Expr` in the
/// value.
pub(super) fn resolve_in_unit(
    tree: &Tree,
    parameters: Option<&Parameters>,
    name: &str,
    unit: Option<&str>,
    diagnostics: &mut Vec<LocalDiagnostic>,
) -> Tree {
    let number = json!({ "type": "number" });
    let schema = match &tree.kind {
        Kind::Call { name, body: Body::Items(items) } if name.is_none() || 1 < items.len() => {
            let count = items.len();
            json!({ "type": "array", "items": number, "minItems": count, "maxItems": count })
        }
        _ => number,
    };
    let unit = unit.map(str::to_owned);
    let expected = ExpectedValue { unit, ..ExpectedValue::for_node(name, &schema) };
    Resolver { parameters, owner: None, diagnostics }.value(tree, Some(expected))
}

/// Converts all numbers in the declaration of a parameter to the parameter's unit.
pub fn declaration_in_own_unit(
    tree: &Tree,
    name: &str,
    diagnostics: &mut Vec<LocalDiagnostic>,
) -> Tree {
    let Kind::Call { name: kind, body: Body::Fields(fields) } = &tree.kind else {
        return tree.clone();
    };
    let unit = fields.iter().find(|field| field.name.text == "unit");
    let unit = unit.and_then(|field| field.value.text());
    let body = Body::Fields(
        fields
            .iter()
            .map(|field| match &field.name.text[..] {
                "default" | "min" | "max" => {
                    let value = in_own_unit(&field.value, name, unit, diagnostics);
                    Field { name: field.name.clone(), value }
                }
                _ => field.clone(),
            })
            .collect(),
    );
    Tree { kind: Kind::Call { name: kind.clone(), body }, ..tree.clone() }
}

impl Resolver<'_> {
    /// Converts a value to plain numbers. In an integer, `-0.0` becomes 0, because expressions may yield `-0.0`.
    fn value(&mut self, tree: &Tree, expected: Option<ExpectedValue<'_>>) -> Tree {
        let is_whole = expected.as_ref().is_some_and(ExpectedValue::is_whole_number);
        let tree = self.resolve(tree, expected);
        match tree.kind {
            Kind::Number { value: 0.0, .. } if is_whole => {
                Tree { kind: Kind::Number { value: 0.0, whole: true }, ..tree }
            }
            _ => tree,
        }
    }

    fn resolve(&mut self, tree: &Tree, expected: Option<ExpectedValue<'_>>) -> Tree {
        if is_plain(tree) {
            return tree.clone();
        }
        if is_draft(tree) {
            return match self.parameters {
                Some(parameters) => match parameters.side(tree, self.diagnostics) {
                    Some(side) => self.value(side, expected),
                    None => Tree::new(tree.span, Kind::Broken),
                },
                None => map_sides(tree, |side| self.value(side, expected.clone())),
            };
        }
        if is_computed(tree) {
            let Some(parameters) = self.parameters else { return tree.clone() };
            let resolved = parameters.resolve(tree, self.diagnostics);
            return match expected {
                Some(expected) => self.fit(resolved, &expected),
                None => resolved.value,
            };
        }
        if let Some(expected) = expected.as_ref().filter(|expected| expected.is_number())
            && let Some(name) = tree.name()
            && let Some(unit) = Unit::from_name(&name.text)
        {
            let Some(Quantity { value, .. }) = Quantity::read(tree) else {
                let message = format!("`{}(..)` holds one number", name.text);
                let help = format!("write {0}(1.5), or Expr(\"{0}(a)\")", name.text);
                return self.report_invalid(tree, message, help.into());
            };
            let whole = value.fract() == 0.0;
            let number = Tree { kind: Kind::Number { value, whole }, ..tree.clone() };
            // Without an exponent, the text of a large number may have hundreds of digits.
            let number_in_words =
                if value.abs() < 1e16 { value.to_string() } else { format!("{value:e}") };
            let words = format!("`{}({number_in_words})`", name.text);
            return self.literal(
                ResolvedValue { value: number, unit, words, note: origin_note(tree) },
                expected,
            );
        }
        if let Some(expected) = expected.as_ref().filter(|expected| expected.is_tuple())
            && let Kind::Call { name: Some(name), body: Body::Items(items) } = &tree.kind
            && let Some(unit) = Unit::from_name(&name.text)
        {
            return self.tuple(tree, &name.text, unit, items, expected);
        }
        let expected = expected.as_ref();
        let kind = match &tree.kind {
            Kind::List(items) => Kind::List(self.items(items, |k| expected?.item(k))),
            Kind::Map(entries) => Kind::Map(
                entries
                    .iter()
                    .map(|(key, value)| {
                        let value = self.value(value, expected.and_then(ExpectedValue::entry));
                        (key.clone(), value)
                    })
                    .collect(),
            ),
            Kind::Call { name, body } => {
                let behind = name.as_ref().and_then(|name| expected?.variant_content(&name.text));
                let inside = if name.is_some() { behind.as_ref() } else { expected };
                let body = match body {
                    Body::Empty => Body::Empty,
                    Body::Items(items) if name.is_some() => {
                        Body::Items(self.items(items, |k| inside?.argument(k)))
                    }
                    Body::Items(items) => Body::Items(self.items(items, |k| inside?.item(k))),
                    Body::Fields(fields) => {
                        let fields = fields.iter().map(|field| {
                            let expected = inside.and_then(|inside| inside.field(&field.name.text));
                            let value = self.value(&field.value, expected);
                            Field { name: field.name.clone(), value }
                        });
                        Body::Fields(fields.collect())
                    }
                };
                Kind::Call { name: name.clone(), body }
            }
            plain => plain.clone(),
        };
        Tree { kind, ..tree.clone() }
    }

    /// Resolves `cm(1, 2, 3)` to `(cm(1), cm(2), cm(3))`. An error that applies to all numbers is reported once.
    fn tuple(
        &mut self,
        tree: &Tree,
        name: &str,
        unit: Unit,
        items: &[Tree],
        expected: &ExpectedValue<'_>,
    ) -> Tree {
        if items.iter().any(|item| !matches!(item.kind, Kind::Number { .. } | Kind::Broken)) {
            let message = format!("`{name}(..)` holds numbers");
            let help =
                format!("give each its own: ({name}(1.5), Param(\"a\"), Expr(\"{name}(a)\"))");
            return self.report_invalid(tree, message, help.into());
        }
        let mut fitted = Vec::with_capacity(items.len());
        for (index, item) in items.iter().enumerate() {
            // Superfluous numbers are reported by the check of the whole value.
            let Some(expected) = expected.item(index) else { break };
            let value = Tree { span: tree.span, ..item.clone() };
            let words = format!("`{name}(..)`");
            let value = self
                .literal(ResolvedValue { value, unit, words, note: origin_note(tree) }, &expected);
            if value.is_broken() {
                return value;
            }
            fitted.push(Tree { span: item.span, ..value });
        }
        fitted.extend_from_slice(&items[fitted.len()..]);
        Tree { kind: Kind::Call { name: None, body: Body::Items(fitted) }, ..tree.clone() }
    }

    fn items<'e>(
        &mut self,
        items: &[Tree],
        expected: impl Fn(usize) -> Option<ExpectedValue<'e>>,
    ) -> Vec<Tree> {
        let items = items.iter().enumerate();
        items.map(|(index, item)| self.value(item, expected(index))).collect()
    }

    /// Converts a number that is written with a unit to the unit of its field.
    fn literal(&mut self, resolved: ResolvedValue, expected: &ExpectedValue<'_>) -> Tree {
        let known = expected.unit.as_deref().and_then(Unit::read);
        if known.is_some() {
            return self.fit(resolved, expected);
        }
        let (subject, ResolvedValue { words, unit, .. }) = (self.subject(expected), &resolved);
        let (message, help) = match &expected.unit {
            Some(own) => (
                format!("{subject} is in {own}, but {words} is in {unit}"),
                format!("write a plain number, which is in {own}").into(),
            ),
            None => {
                let message = format!("{subject} has no unit, but {words} is in {unit}");
                let help = "write a plain number";
                let help = match &resolved.value.kind {
                    Kind::Number { value, .. } if !words.ends_with("(..)`") => {
                        Help::edit(help, resolved.value.span, value.to_string())
                    }
                    _ => help.into(),
                };
                (message, help)
            }
        };
        self.wrong_unit(&resolved, message, help)
    }

    /// Converts a value to the unit of its field. If the field has no known unit, or the value has no unit, the numbers are unchanged.
    fn fit(&mut self, resolved: ResolvedValue, expected: &ExpectedValue<'_>) -> Tree {
        let ResolvedValue { value, unit, words, .. } = &resolved;
        let (Some(wanted), false) = (expected.unit.as_deref().and_then(Unit::read), unit.is_pure())
        else {
            return resolved.value;
        };
        if !unit.is_compatible(wanted) {
            let subject = self.subject(expected);
            let message = format!("{subject} is in {wanted}, but {words} is in {unit}");
            let help = format!(
                "a plain number is in {wanted}; other units of the same kind are converted"
            );
            return self.wrong_unit(&resolved, message, help.into());
        }
        let mut is_finite = true;
        let fitted = scale_numbers(value, &mut |value| {
            let value = Quantity { value, unit: *unit }.to_unit(wanted);
            is_finite &= value.is_finite();
            value
        });
        if !is_finite {
            return self.wrong_unit(
                &resolved,
                format!("{words} is too large for a number of {wanted}"),
                Help::default(),
            );
        }
        fitted
    }

    fn subject(&self, expected: &ExpectedValue<'_>) -> String {
        match self.owner {
            Some(owner) => format!("field `{}` of {owner}", expected.field),
            None => format!("parameter `{}`", expected.field),
        }
    }

    fn wrong_unit(&mut self, resolved: &ResolvedValue, message: String, help: Help) -> Tree {
        let broken = self.report_invalid(&resolved.value, message, help);
        if let Some(diagnostic) = self.diagnostics.last_mut() {
            diagnostic.note.clone_from(&resolved.note);
        }
        broken
    }

    fn report_invalid(&mut self, tree: &Tree, message: String, help: Help) -> Tree {
        let (code, span) = (code::WRONG_VALUE, tree.span);
        self.diagnostics.push(LocalDiagnostic { code, span, message, help, note: None });
        Tree::new(span, Kind::Broken)
    }
}

/// Returns a note that the value was set by the command-line option `--set`. `None` for all other values.
fn origin_note(tree: &Tree) -> Option<(Span, String)> {
    match &tree.origin {
        Some(Origin::Set(text)) => Some((tree.span, format!("set by `--set {text}`"))),
        _ => None,
    }
}

/// Applies `scale` to the numbers of a value. An integer remains an integer if its new value is whole.
fn scale_numbers(tree: &Tree, scale: &mut impl FnMut(f64) -> f64) -> Tree {
    let mut all = |items: &[Tree]| items.iter().map(|item| scale_numbers(item, scale)).collect();
    let kind = match &tree.kind {
        Kind::Number { value, whole } => {
            let value = scale(*value);
            Kind::Number { value, whole: *whole && value.fract() == 0.0 }
        }
        Kind::List(items) => Kind::List(all(items)),
        Kind::Call { name, body: Body::Items(items) } => {
            Kind::Call { name: name.clone(), body: Body::Items(all(items)) }
        }
        other => other.clone(),
    };
    Tree { kind, ..tree.clone() }
}

/// Returns true if a value contains no `Param`, `Expr`, `Draft`, number with a unit, or `-0.0`, all of which must be resolved.
fn is_plain(tree: &Tree) -> bool {
    match &tree.kind {
        Kind::Call { name: Some(name), body } => {
            let is_word = matches!(&name.text[..], "Param" | "Expr" | "Draft")
                || Unit::from_name(&name.text).is_some();
            !is_word && is_plain_inside(body)
        }
        Kind::Call { body, .. } => is_plain_inside(body),
        Kind::List(items) => items.iter().all(is_plain),
        Kind::Map(entries) => entries.iter().all(|(_, value)| is_plain(value)),
        Kind::Number { value, .. } => *value != 0.0 || value.is_sign_positive(),
        _ => true,
    }
}

fn is_plain_inside(body: &Body) -> bool {
    match body {
        Body::Empty => true,
        Body::Items(items) => items.iter().all(is_plain),
        Body::Fields(fields) => fields.iter().all(|field| is_plain(&field.value)),
    }
}
