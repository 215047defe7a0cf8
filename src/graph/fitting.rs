//! What fields and parameters say once `Param`, `Expr` and `cm(1.2)` are worked out: plain numbers in the unit of each.

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Body, Expected, Field, Finding, Help, Kind, Origin, Quantity, Tree, Unit};
use serde_json::{Value as Json, json};

use super::parameters::{Parameters, Worked, is_computed};
use super::quality::{each_side, is_draft};

/// Works out the values in a call.
struct Fitting<'a> {
    /// None leaves `Param` and `Expr` as they are.
    parameters: Option<&'a Parameters>,
    /// The type of node whose fields they are; none for a parameter.
    owner: Option<&'a str>,
    findings: &'a mut Vec<Finding>,
}

impl Parameters {
    /// The call of a node with every `Param`, `Expr` and unit in it replaced by its value; what has none becomes broken.
    pub(super) fn fitted(
        &self,
        tree: &Tree,
        owner: &str,
        schema: &Json,
        findings: &mut Vec<Finding>,
    ) -> Tree {
        let mut fitting = Fitting { parameters: Some(self), owner: Some(owner), findings };
        fitting.value(tree, Some(Expected::of_node(owner, schema)))
    }

    /// A value of which nothing is known, with every `Param` and `Expr` in it replaced.
    pub(super) fn substitute(&self, tree: &Tree, findings: &mut Vec<Finding>) -> Tree {
        Fitting { parameters: Some(self), owner: None, findings }.value(tree, None)
    }
}

/// The call of a node with plain numbers in place of those with units, as far as these fit.
pub fn in_plain_numbers(tree: &Tree, schema: &Json) -> Tree {
    let mut fitting = Fitting { parameters: None, owner: None, findings: &mut Vec::new() };
    fitting.value(tree, Some(Expected::of_node("", schema)))
}

/// A list of calls, each one of a schema's choices, with plain numbers in place of those with units; what does not fit is broken.
pub(super) fn calls_in_plain_numbers(
    list: &Tree,
    schema: &Json,
    findings: &mut Vec<Finding>,
) -> Tree {
    let Kind::List(items) = &list.kind else { return list.clone() };
    Tree {
        kind: Kind::List(
            items
                .iter()
                .map(|item| {
                    let Some(name) = item.name() else { return item.clone() };
                    let mut fitting =
                        Fitting { parameters: None, owner: Some(&name.text), findings };
                    fitting.value(item, Some(Expected::of_node(&name.text, schema)))
                })
                .collect(),
        ),
        ..list.clone()
    }
}

/// A value for the parameter `name`, in plain numbers of its unit.
pub fn in_own_unit(
    tree: &Tree,
    name: &str,
    unit: Option<&str>,
    findings: &mut Vec<Finding>,
) -> Tree {
    if is_draft(tree) {
        return each_side(tree, |side| in_own_unit(side, name, unit, findings));
    }
    own_value(tree, None, name, unit, findings)
}

/// The same, with every `Param` and `Expr` in it replaced by its value if there are parameters.
pub(super) fn own_value(
    tree: &Tree,
    parameters: Option<&Parameters>,
    name: &str,
    unit: Option<&str>,
    findings: &mut Vec<Finding>,
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
    let expected = Expected { unit, ..Expected::of_node(name, &schema) };
    Fitting { parameters, owner: None, findings }.value(tree, Some(expected))
}

/// The declaration of a parameter with all of its numbers in its unit.
pub fn declaration_in_own_unit(tree: &Tree, name: &str, findings: &mut Vec<Finding>) -> Tree {
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
                    let value = in_own_unit(&field.value, name, unit, findings);
                    Field { name: field.name.clone(), value }
                }
                _ => field.clone(),
            })
            .collect(),
    );
    Tree { kind: Kind::Call { name: kind.clone(), body }, ..tree.clone() }
}

impl Fitting<'_> {
    /// A value in plain numbers. Of whole ones `-0.0`, as expressions may give it, is none but 0.
    fn value(&mut self, tree: &Tree, expected: Option<Expected<'_>>) -> Tree {
        let is_whole = expected.as_ref().is_some_and(Expected::is_whole_number);
        let tree = self.worked_out(tree, expected);
        match tree.kind {
            Kind::Number { value: 0.0, .. } if is_whole => {
                Tree { kind: Kind::Number { value: 0.0, whole: true }, ..tree }
            }
            _ => tree,
        }
    }

    fn worked_out(&mut self, tree: &Tree, expected: Option<Expected<'_>>) -> Tree {
        if is_plain(tree) {
            return tree.clone();
        }
        if is_draft(tree) {
            return match self.parameters {
                Some(parameters) => match parameters.side(tree, self.findings) {
                    Some(side) => self.value(side, expected),
                    None => Tree::new(tree.span, Kind::Broken),
                },
                None => each_side(tree, |side| self.value(side, expected.clone())),
            };
        }
        if is_computed(tree) {
            let Some(parameters) = self.parameters else { return tree.clone() };
            let worked = parameters.worked_out(tree, self.findings);
            return match expected {
                Some(expected) => self.fit(worked, &expected),
                None => worked.value,
            };
        }
        if let Some(expected) = expected.as_ref().filter(|expected| expected.is_number())
            && let Some(name) = tree.name()
            && let Some(unit) = Unit::named(&name.text)
        {
            let Some(Quantity { value, .. }) = Quantity::read(tree) else {
                let message = format!("`{}(..)` holds one number", name.text);
                let help = format!("write {0}(1.5), or Expr(\"{0}(a)\")", name.text);
                return self.wrong(tree, message, help.into());
            };
            let whole = value.fract() == 0.0;
            let number = Tree { kind: Kind::Number { value, whole }, ..tree.clone() };
            // Written out, a number may have hundreds of digits.
            let number_in_words =
                if value.abs() < 1e16 { value.to_string() } else { format!("{value:e}") };
            let words = format!("`{}({number_in_words})`", name.text);
            return self.literal(Worked { value: number, unit, words, note: note(tree) }, expected);
        }
        if let Some(expected) = expected.as_ref().filter(|expected| expected.is_tuple())
            && let Kind::Call { name: Some(name), body: Body::Items(items) } = &tree.kind
            && let Some(unit) = Unit::named(&name.text)
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
                        let value = self.value(value, expected.and_then(Expected::entry));
                        (key.clone(), value)
                    })
                    .collect(),
            ),
            Kind::Call { name, body } => {
                let behind = name.as_ref().and_then(|name| expected?.behind(&name.text));
                let inside = if name.is_some() { behind.as_ref() } else { expected };
                let body = match body {
                    Body::Empty => Body::Empty,
                    Body::Items(items) if name.is_some() => {
                        Body::Items(self.items(items, |k| inside?.argument(k)))
                    }
                    Body::Items(items) => Body::Items(self.items(items, |k| inside?.item(k))),
                    Body::Fields(fields) => {
                        let mut field = |field: &Field| {
                            let expected = inside.and_then(|inside| inside.field(&field.name.text));
                            let value = self.value(&field.value, expected);
                            Field { name: field.name.clone(), value }
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

    /// What `cm(1, 2, 3)` says: `(cm(1), cm(2), cm(3))`. What is wrong with one of them is told of all.
    fn tuple(
        &mut self,
        tree: &Tree,
        name: &str,
        unit: Unit,
        items: &[Tree],
        expected: &Expected<'_>,
    ) -> Tree {
        if items.iter().any(|item| !matches!(item.kind, Kind::Number { .. } | Kind::Broken)) {
            let message = format!("`{name}(..)` holds numbers");
            let help =
                format!("give each its own: ({name}(1.5), Param(\"a\"), Expr(\"{name}(a)\"))");
            return self.wrong(tree, message, help.into());
        }
        let mut fitted = Vec::with_capacity(items.len());
        for (index, item) in items.iter().enumerate() {
            // That there are too many is told when all of them are checked.
            let Some(expected) = expected.item(index) else { break };
            let value = Tree { span: tree.span, ..item.clone() };
            let words = format!("`{name}(..)`");
            let value = self.literal(Worked { value, unit, words, note: note(tree) }, &expected);
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
        expected: impl Fn(usize) -> Option<Expected<'e>>,
    ) -> Vec<Tree> {
        let items = items.iter().enumerate();
        items.map(|(index, item)| self.value(item, expected(index))).collect()
    }

    /// What was written with a unit, in the unit of its place.
    fn literal(&mut self, worked: Worked, expected: &Expected<'_>) -> Tree {
        let known = expected.unit.as_deref().and_then(Unit::read);
        if known.is_some() {
            return self.fit(worked, expected);
        }
        let (subject, Worked { words, unit, .. }) = (self.subject(expected), &worked);
        let (message, help) = match &expected.unit {
            Some(own) => (
                format!("{subject} is in {own}, but {words} is in {unit}"),
                format!("write a plain number, which is in {own}").into(),
            ),
            None => {
                let message = format!("{subject} has no unit, but {words} is in {unit}");
                let help = "write a plain number";
                let help = match &worked.value.kind {
                    Kind::Number { value, .. } if !words.ends_with("(..)`") => {
                        Help::edit(help, worked.value.span, value.to_string())
                    }
                    _ => help.into(),
                };
                (message, help)
            }
        };
        self.misfit(&worked, message, help)
    }

    /// A value in the unit of its place, if that is known; else the plain numbers as they are.
    fn fit(&mut self, worked: Worked, expected: &Expected<'_>) -> Tree {
        let Worked { value, unit, words, .. } = &worked;
        let (Some(wanted), false) = (expected.unit.as_deref().and_then(Unit::read), unit.is_pure())
        else {
            return worked.value;
        };
        if !unit.is_like(wanted) {
            let subject = self.subject(expected);
            let message = format!("{subject} is in {wanted}, but {words} is in {unit}");
            let help = format!(
                "a plain number is in {wanted}; other units of the same kind are converted"
            );
            return self.misfit(&worked, message, help.into());
        }
        let mut is_finite = true;
        let fitted = scaled(value, &mut |value| {
            let value = Quantity { value, unit: *unit }.in_unit(wanted);
            is_finite &= value.is_finite();
            value
        });
        if !is_finite {
            return self.misfit(
                &worked,
                format!("{words} is too large for a number of {wanted}"),
                Help::default(),
            );
        }
        fitted
    }

    fn subject(&self, expected: &Expected<'_>) -> String {
        match self.owner {
            Some(owner) => format!("field `{}` of {owner}", expected.field),
            None => format!("parameter `{}`", expected.field),
        }
    }

    fn misfit(&mut self, worked: &Worked, message: String, help: Help) -> Tree {
        let broken = self.wrong(&worked.value, message, help);
        if let Some(finding) = self.findings.last_mut() {
            finding.note.clone_from(&worked.note);
        }
        broken
    }

    fn wrong(&mut self, tree: &Tree, message: String, help: Help) -> Tree {
        let (code, span) = (code::WRONG_VALUE, tree.span);
        self.findings.push(Finding { code, span, message, help, note: None });
        Tree::new(span, Kind::Broken)
    }
}

/// What a value was set by, if it was.
fn note(tree: &Tree) -> Option<(Span, String)> {
    match &tree.origin {
        Some(Origin::Set(text)) => Some((tree.span, format!("set by `--set {text}`"))),
        _ => None,
    }
}

/// The value with other numbers; a whole number stays one, if it can.
fn scaled(tree: &Tree, scale: &mut impl FnMut(f64) -> f64) -> Tree {
    let mut all = |items: &[Tree]| items.iter().map(|item| scaled(item, scale)).collect();
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

/// Whether nothing in a value is to be worked out.
fn is_plain(tree: &Tree) -> bool {
    match &tree.kind {
        Kind::Call { name: Some(name), body } => {
            let is_word = matches!(&name.text[..], "Param" | "Expr" | "Draft")
                || Unit::named(&name.text).is_some();
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
