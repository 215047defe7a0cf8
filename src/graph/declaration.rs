//! Declarations of a graph's parameters: type, default and range.

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Body, Help, Kind, LocalDiagnostic, Origin, Tree, nearest, nearest_or_all};
use maquette_value::Color;
use serde_json::{Value as Json, json};

use super::constants::declaration_in_own_unit;

/// The types that a parameter can have.
pub(super) const TYPES: [&str; 7] =
    ["Number", "Integer", "Toggle", "Color", "Text", "Choice", "Vector"];

/// Returns the names of the fields that the declaration of a parameter of this type can have.
pub(super) fn fields_of(kind: &str) -> &'static [&'static str] {
    match kind {
        "Number" | "Integer" | "Vector" => &["default", "doc", "min", "max", "unit"],
        "Choice" => &["default", "doc", "of"],
        _ => &["default", "doc"],
    }
}

/// The declaration of a parameter, such as `"growth": Number(default: 12.0, min: 0.0, max: 40.0)`.
#[derive(Clone, Debug)]
pub struct Declaration {
    pub name: String,
    kind: String,
    pub(crate) default: Tree,
    /// If the default is a `Draft`: its value for final results, then its value for drafts. `None` for any other default.
    pub(super) sides: Option<[Tree; 2]>,
    /// True if the default is an expression of other parameters.
    pub(super) is_derived: bool,
    min: Option<f64>,
    max: Option<f64>,
    choices: Vec<String>,
    unit: Option<String>,
    /// The position, in the graph file, of the parameter's unit.
    pub(super) unit_span: Span,
    doc: String,
}

impl Declaration {
    /// Reads the declaration of a parameter. Returns `None` if the declaration has no type or no default.
    pub(crate) fn read(
        name: &str,
        tree: &Tree,
        diagnostics: &mut Vec<LocalDiagnostic>,
    ) -> Option<Self> {
        let tree = &declaration_in_own_unit(tree, name, diagnostics);
        let kind = match tree.name() {
            Some(kind) if TYPES.contains(&&kind.text[..]) => kind.text,
            Some(kind) => {
                let message = format!("unknown parameter type `{}`", kind.text);
                diagnostics.push(LocalDiagnostic::new(
                    code::WRONG_VALUE,
                    kind.span,
                    message,
                    nearest_or_all(&kind.text, "types", &TYPES),
                ));
                return None;
            }
            None if tree.is_broken() => return None,
            None => {
                let message = format!("parameter `{name}` has no type");
                diagnostics.push(LocalDiagnostic::new(
                    code::WRONG_VALUE,
                    tree.span,
                    message,
                    "write Number(default: 1.0)",
                ));
                return None;
            }
        };
        let known = fields_of(&kind);
        let mut declaration = Self {
            name: name.to_owned(),
            kind,
            default: Tree::new(tree.span, Kind::Broken),
            sides: None,
            is_derived: false,
            min: None,
            max: None,
            choices: Vec::new(),
            unit: None,
            unit_span: Span::default(),
            doc: String::new(),
        };
        // False after an error in the declaration: then the default value is not checked against the other fields.
        let mut is_whole = true;
        let (mut has_default, mut has_choices) = (false, declaration.kind != "Choice");
        for field in tree.fields().unwrap_or_default() {
            let (word, value) = (&field.name.text[..], &field.value);
            has_choices |= word == "of";
            has_default |= word == "default";
            if !known.contains(&word) {
                let message = format!("{} has no field `{word}`", declaration.kind);
                diagnostics.push(LocalDiagnostic::new(
                    code::UNKNOWN_FIELD,
                    field.name.span,
                    message,
                    nearest_or_all(word, "its fields", known),
                ));
                continue;
            }
            let fits = match (word, &value.kind) {
                (_, Kind::Broken) => true,
                ("default", _) => {
                    declaration.default =
                        Tree { origin: Some(Origin::Default(value.span)), ..value.clone() };
                    true
                }
                ("min", Kind::Number { value, .. }) => declaration.min.replace(*value).is_none(),
                ("max", Kind::Number { value, .. }) => declaration.max.replace(*value).is_none(),
                ("of", Kind::List(items)) if !items.is_empty() => {
                    for item in items {
                        match &item.kind {
                            Kind::Word(word) => declaration.choices.push(word.clone()),
                            Kind::Broken => is_whole = false,
                            _ => {
                                is_whole = false;
                                let message =
                                    format!("a choice is a bare word, not {}", item.describe());
                                let help = match item.text().filter(|text| is_word(text)) {
                                    Some(text) => {
                                        let help = format!("write {text} without quotes");
                                        Help::edit(help, item.span, text)
                                    }
                                    None => "as in `of: [Left, Right]`".into(),
                                };
                                diagnostics.push(LocalDiagnostic::new(
                                    code::WRONG_VALUE,
                                    item.span,
                                    message,
                                    help,
                                ));
                            }
                        }
                    }
                    true
                }
                ("doc", Kind::Text(text)) => {
                    declaration.doc.clone_from(text);
                    true
                }
                ("unit", Kind::Text(text)) => {
                    declaration.unit_span = value.span;
                    declaration.unit.replace(text.clone()).is_none()
                }
                _ => false,
            };
            if !fits {
                is_whole = false;
                let message = match (word, &value.kind) {
                    ("of", Kind::List(_)) => "there is nothing to choose from".to_owned(),
                    _ => format!(
                        "field `{word}` of {} cannot be {}",
                        declaration.kind,
                        value.describe()
                    ),
                };
                diagnostics.push(LocalDiagnostic::new(
                    code::WRONG_VALUE,
                    value.span,
                    message,
                    Help::default(),
                ));
            }
        }
        if !has_choices {
            let message = format!("parameter `{name}` has no choices");
            diagnostics.push(LocalDiagnostic::new(
                code::MISSING_FIELD,
                tree.span,
                message,
                "write `of: [Left, Right]`",
            ));
            return None;
        }
        if let (Some(min), Some(max)) = (declaration.min, declaration.max)
            && max < min
        {
            let message = format!("parameter `{name}` has a `min`, {min}, above its `max`, {max}");
            diagnostics.push(LocalDiagnostic::new(
                code::WRONG_VALUE,
                tree.span,
                message,
                "swap them",
            ));
            return None;
        }
        if !has_default {
            let message = format!("parameter `{name}` has no default");
            diagnostics.push(LocalDiagnostic::new(
                code::MISSING_FIELD,
                tree.span,
                message,
                "write `default: ..`",
            ));
            return None;
        }
        is_whole.then_some(declaration)
    }

    pub(super) fn with_default(&self, default: Tree) -> Self {
        Self { default, ..self.clone() }
    }

    pub(super) fn unit(&self) -> Option<&str> {
        self.unit.as_deref()
    }

    fn is_in_range(&self, x: f64) -> bool {
        self.min.is_none_or(|min| min <= x) && self.max.is_none_or(|max| x <= max)
    }

    /// Returns the default value, if it has the declared type and is in the declared range. Otherwise returns a broken value.
    pub(crate) fn value(&self, diagnostics: &mut Vec<LocalDiagnostic>) -> Tree {
        let tree = &self.default;
        if !tree.is_complete() {
            return Tree::new(tree.span, Kind::Broken);
        }
        let is_set = matches!(tree.origin, Some(Origin::Set(_)));
        fn number(tree: &Tree) -> Option<f64> {
            match tree.kind {
                Kind::Number { value, .. } => Some(value),
                _ => None,
            }
        }
        let mut out_of_range = None;
        let mut limited = |x: f64| {
            if !self.is_in_range(x) {
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
        let mut find = |code, message: String, help: Help| {
            diagnostics.push(LocalDiagnostic { code, span: at, message, help, note: note.clone() });
        };
        if let Some(x) = out_of_range {
            let unit = self.unit.as_ref().map_or_else(String::new, |unit| format!(" {unit}"));
            let limits = [
                self.min.map(|min| format!("at least {min}")),
                self.max.map(|max| format!("at most {max}")),
            ];
            let limits = limits.into_iter().flatten().collect::<Vec<_>>().join(" and ");
            find(
                code::OUT_OF_RANGE,
                format!("parameter `{}` is {x}{unit}, but must be {limits}{unit}", self.name),
                Help::default(),
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
            Kind::Text(text) if self.choices.contains(text) => {
                Help::edit(format!("write {text} without quotes"), tree.span, text)
            }
            Kind::Word(word) => nearest(word, self.choices.iter().map(String::as_str)),
            _ => Help::default(),
        };
        let message =
            format!("parameter `{}`: expected {wanted}, found {}", self.name, tree.describe());
        find(code::WRONG_VALUE, message, help);
        Tree::new(tree.span, Kind::Broken)
    }
}

/// Schema of a parameter. It has the form of the schema of a built-in node's field, so that the same code checks and documents both.
impl Declaration {
    fn number_schema(&self, kind: &str) -> Json {
        let mut schema = json!({ "type": kind });
        for (name, limit) in [("minimum", self.min), ("maximum", self.max)] {
            if let Some(limit) = limit {
                schema[name] = limit.into();
            }
        }
        schema
    }

    pub(crate) fn schema(&self) -> Json {
        let mut schema = match &self.kind[..] {
            "Number" => self.number_schema("number"),
            "Integer" => self.number_schema("integer"),
            "Toggle" => json!({ "type": "boolean" }),
            "Color" => json!({ "type": "string", "format": "color" }),
            "Choice" => json!({ "type": "string", "enum": self.choices }),
            "Vector" => {
                let count = match &self.default.kind {
                    Kind::Call { body: Body::Items(items), .. } => items.len(),
                    _ => 0,
                };
                let items = self.number_schema("number");
                json!({ "type": "array", "items": items, "minItems": count, "maxItems": count })
            }
            _ => json!({ "type": "string" }),
        };
        schema["description"] = self.doc.clone().into();
        if let Some(unit) = &self.unit {
            schema["unit"] = unit.clone().into();
        }
        if let Some(default) = as_json(&self.default) {
            schema["default"] = default;
        }
        if self.is_derived {
            schema["derives"] = true.into();
        }
        if let Some([last, first]) = &self.sides {
            schema["draft"] = json!({ "final": as_json(last), "draft": as_json(first) });
        }
        schema
    }
}

/// Returns true if the text is a valid bare word, which needs no quotes.
fn is_word(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

fn as_json(tree: &Tree) -> Option<Json> {
    Some(match &tree.kind {
        Kind::Number { value, whole: true } => (*value as i64).into(),
        Kind::Number { value, .. } => (*value).into(),
        Kind::Bool(truth) => (*truth).into(),
        Kind::Text(text) | Kind::Word(text) => text.clone().into(),
        Kind::Call { body: Body::Items(items), .. } => {
            items.iter().map(as_json).collect::<Option<Vec<_>>>()?.into()
        }
        _ => return None,
    })
}
