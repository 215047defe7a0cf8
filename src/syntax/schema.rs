//! Checks values against the JSON schemas of their fields, and collects links and files.
//!
//! All errors are reported, each at its own position, before serde deserializes the value.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use maquette_value::Color;
use maquette_value::fs::extension;
use serde_json::{Map, Value as Json};

use super::help::Help;
use super::local_diagnostic::LocalDiagnostic;
use super::parser::parse;
use super::ron::to_ron;
use super::schema_path::{option_inner, resolve, variants};
use super::source_map::SourceMap;
use super::suggest::nearest_or_all;
use super::tree::{Body, ExternalOrigin, Field, Kind, Name, Origin, Tree};
use super::{any_of, with_article};
use crate::error::{MAX_REPORTED, Span, code};

mod rules;

/// A link in the fields of a node.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundLink {
    pub span: Span,
    /// The target of the link, in the form `node` or `node.output`.
    pub text: String,
    /// The name of the field that contains the link.
    pub port: String,
    /// The name of the type that the port takes, or of a union of types.
    pub wants: String,
    /// The types of values that the port takes.
    pub types: Vec<String>,
    /// True if the port takes a list of links.
    pub is_list: bool,
    /// True if the port may be left without a link.
    pub is_optional: bool,
}

/// A file to which a field of a node refers.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundFile {
    pub span: Span,
    /// The span of the path in the graph file. It differs from `span` if the path is the default of a parameter.
    pub at: Span,
    pub given: String,
    pub resolved: PathBuf,
    /// The file and position in which the path is written. `None` if the path is written in the file of the node.
    pub from: Option<ExternalOrigin>,
    /// The error message and the help, if the node does not read files with this extension. Otherwise `None`.
    pub extension_error: Option<(String, String)>,
}

/// A check of one node against its schema. Collects the links and files in the node's fields.
pub struct Walk<'a> {
    /// The name of the node, for messages.
    pub node: &'a str,
    /// The schema of the node. Contains the definitions to which references in the schema refer.
    pub root: &'a Json,
    /// The source map, which determines the folders to which paths are relative. `None` if the node has no paths.
    pub source_map: Option<&'a SourceMap>,
    /// The diagnostics that have been found so far.
    pub diagnostics: Vec<LocalDiagnostic>,
    pub links: Vec<FoundLink>,
    pub files: Vec<FoundFile>,
}

impl Walk<'_> {
    /// Checks the call of the node.
    pub fn node(&mut self, tree: &Tree) {
        let (root, node) = (self.root, self.node);
        match &tree.kind {
            Kind::Word(_) => {
                let help = format!("write `{node}()` for a node without fields");
                self.report(code::WRONG_VALUE, tree, format!("{node} has no parentheses"), help);
            }
            Kind::Call { body: Body::Items(_), .. } => {
                let help = format!("write `{node}(field: value, ..)`");
                self.report(code::WRONG_VALUE, tree, format!("{node} needs named fields"), help);
            }
            _ => self.fields(tree, root, node),
        }
    }

    fn report(&mut self, code: &'static str, tree: &Tree, message: String, help: impl Into<Help>) {
        let mut help: Help = help.into();
        let note = match &tree.origin {
            Some(Origin::Default(span)) => Some((*span, "the value comes from here".to_owned())),
            Some(Origin::Set(text)) => Some((tree.span, format!("set by `--set {text}`"))),
            Some(Origin::External(given)) => {
                // A note must be in the same file as its diagnostic, so describe an origin in another file in the help text.
                let gap = if help.is_empty() { "" } else { "; " };
                help = self.suggest(|| {
                    format!("the value comes from {}{gap}{help}", given.location()).into()
                });
                None
            }
            None => None,
        };
        self.diagnostics.push(LocalDiagnostic { code, span: tree.span, message, help, note });
    }

    /// Returns the suggestion that `make` computes. Skips the work if there are already more diagnostics than will be shown.
    fn suggest(&self, make: impl FnOnce() -> Help) -> Help {
        if self.diagnostics.len() < MAX_REPORTED { make() } else { Help::default() }
    }

    /// Checks the value of the field `field`.
    pub fn value(&mut self, tree: &Tree, schema: &Json, field: &str) {
        if tree.is_broken() {
            return;
        }
        let schema = resolve(self.root, schema);
        if schema.get("port").is_some() {
            return self.link(tree, &schema, field);
        }
        if let Some(inner) = option_inner(&schema) {
            return match &tree.kind {
                Kind::Word(word) if word == "None" => {}
                _ => self.value(tree.call_of("Some").unwrap_or(tree), &inner, field),
            };
        }
        let variants = variants(&schema);
        if !variants.is_empty() {
            return self.variant(tree, &variants, field);
        }
        match schema.get("type").and_then(Json::as_str) {
            Some("object") if schema.get("properties").is_some() => match tree.kind {
                Kind::Call { name: None, .. } => self.fields(tree, &schema, field),
                _ => {
                    self.report_wrong_value(tree, field, "a group of fields: `(field: value, ..)`");
                }
            },
            Some("object") => self.map(tree, &schema, field),
            Some("array") => self.array(tree, &schema, field),
            Some("number" | "integer") => self.number(tree, &schema, field),
            Some("boolean") if !matches!(tree.kind, Kind::Bool(_)) => {
                self.report_wrong_value(tree, field, "true or false");
            }
            Some("string") => self.text(tree, &schema, field),
            _ => {}
        }
    }

    fn report_wrong_value(&mut self, tree: &Tree, field: &str, wanted: &str) {
        let message = format!(
            "field `{field}` of {}: expected {wanted}, found {}",
            self.node,
            tree.describe()
        );
        let help = match (&tree.kind, wanted) {
            // Suggest `Param(..)` only if the field itself contains the text, not if the text is the default of a parameter.
            (Kind::Text(text), _) if wanted.starts_with("a number") && tree.origin.is_none() => {
                format!(
                    "parameters take values; for a parameter of the graph write Param(\"{text}\")"
                )
            }
            _ => String::new(),
        };
        self.report(code::WRONG_VALUE, tree, message, help);
    }

    fn fields(&mut self, tree: &Tree, schema: &Json, owner: &str) {
        let empty = Map::new();
        let properties = schema.get("properties").and_then(Json::as_object).unwrap_or(&empty);
        let Some(fields) = tree.fields() else {
            let message = format!(
                "field `{owner}` of {}: expected named fields: `(field: value, ..)`, found {}",
                self.node,
                tree.describe()
            );
            let required = schema["required"].as_array().map_or(&[][..], |required| required);
            let help = match (&tree.kind, required) {
                (Kind::Call { body: Body::Items(items), .. }, [name]) if items.len() == 1 => {
                    let name = name.as_str().unwrap_or_default();
                    items[0].text().map(|text| format!("write `{owner}({name}: \"{text}\")`"))
                }
                _ => None,
            };
            return self.report(code::WRONG_VALUE, tree, message, help.unwrap_or_default());
        };
        let required = schema.get("required").and_then(Json::as_array).into_iter().flatten();
        let required: Vec<_> = required.filter_map(Json::as_str).collect();
        let (mut given, mut meant) = (HashSet::new(), HashSet::<String>::new());
        for Field { name, value } in fields {
            let at_name = Tree::new(name.span, Kind::Broken);
            if !given.insert(&name.text[..]) {
                let message = format!("field `{}` is given twice", name.text);
                self.report(code::BAD_NAME, &at_name, message, "keep one of them");
            } else if let Some(schema) = properties.get(&name.text) {
                let first = self.links.len();
                self.value(value, schema, &name.text);
                if let [link] = &mut self.links[first..]
                    && link.span == value.call_of("Some").unwrap_or(value).span
                {
                    link.is_optional = !required.contains(&&name.text[..]);
                }
            } else {
                let message = format!("{owner} has no field `{}`", name.text);
                fn names(properties: &Map<String, Json>) -> Vec<&str> {
                    properties.keys().map(String::as_str).collect::<Vec<_>>()
                }
                let port = self.port_for(&name.text, schema);
                let help = port.unwrap_or_else(|| {
                    self.suggest(|| nearest_or_all(&name.text, "its fields", &names(properties)))
                });
                meant.extend(help.suggested_name().map(str::to_owned));
                self.report(code::UNKNOWN_FIELD, &at_name, message, help);
            }
        }
        self.check_order(fields, schema, owner);
        for name in required {
            // Do not report a field as missing if its name is only misspelled.
            if given.contains(name) || meant.contains(name) {
                continue;
            }
            let schema = properties.get(name);
            let (message, help) = match schema.and_then(|schema| schema.get("port")) {
                Some(Json::String(wants)) => {
                    let words = format!(
                        "write `{name}: \"node\"` with a node that gives {}",
                        accepted_types(schema.unwrap_or(&Json::Null), wants)
                    );
                    let types = schema.and_then(|schema| schema["types"].as_array());
                    let types = types.into_iter().flatten().filter_map(Json::as_str);
                    let types = types.map(str::to_owned).collect();
                    let help = Help::link(words, name, types);
                    (format!("{owner} needs a link at its port `{name}`"), help)
                }
                _ => {
                    let schema = schema.map(|schema| resolve(self.root, schema));
                    let choices = schema.as_deref().map(variants).unwrap_or_default();
                    let choices: Vec<_> = choices.into_iter().map(|(choice, _)| choice).collect();
                    let help = match choices.is_empty() {
                        true => format!("write `{name}: ..`"),
                        false => format!("write `{name}: ..` with one of {}", choices.join(", ")),
                    };
                    (format!("{owner} needs a field `{name}`"), help.into())
                }
            };
            self.report(code::MISSING_FIELD, tree, message, help);
        }
    }

    fn link(&mut self, tree: &Tree, schema: &Json, field: &str) {
        let wants = schema["port"].as_str().unwrap_or_default().to_owned();
        // Links define the structure of the graph, so a link must not come from a parameter.
        let is_parameter = matches!(tree.origin, Some(Origin::Default(_) | Origin::External(_)));
        let Some(text) = tree.text().filter(|_| !is_parameter) else {
            let found =
                if is_parameter { "the value of a parameter".into() } else { tree.describe() };
            let message =
                format!("port `{field}` of {}: expected a link, found {found}", self.node);
            let help = format!(
                "write the name of a node that gives {}: \"node\"",
                accepted_types(schema, &wants)
            );
            return self.report(code::WRONG_VALUE, tree, message, help);
        };
        let types = schema["types"].as_array().into_iter().flatten();
        self.links.push(FoundLink {
            span: tree.span,
            text: text.to_owned(),
            port: field.to_owned(),
            wants,
            types: types.filter_map(Json::as_str).map(str::to_owned).collect(),
            is_list: false,
            is_optional: false,
        });
    }

    /// Checks the value of a port that takes a list: either a list of links, or a single link that may lead to several values.
    fn links(&mut self, tree: &Tree, schema: &Json, field: &str) {
        let first = self.links.len();
        match &tree.kind {
            Kind::List(items) => items.iter().for_each(|item| self.value(item, schema, field)),
            Kind::Text(_) => self.value(tree, schema, field),
            _ => self.report_wrong_value(tree, field, "a list of links: `[\"node\", ..]`"),
        }
        self.links[first..].iter_mut().for_each(|link| link.is_list = true);
    }

    fn variant(&mut self, tree: &Tree, variants: &[(&str, Option<&Json>)], field: &str) {
        let names: Vec<&str> = variants.iter().map(|(name, _)| *name).collect();
        let Some(name) = tree.name() else {
            return self.report_wrong_value(tree, field, &format!("one of {}", names.join(", ")));
        };
        let Some((_, content)) = variants.iter().find(|(known, _)| *known == name.text) else {
            let message = format!("field `{field}` of {} has no choice `{}`", self.node, name.text);
            let help = self.suggest(|| nearest_or_all(&name.text, "its choices", &names));
            let at_name = Tree { span: name.span, ..tree.clone() };
            return self.report(code::WRONG_VALUE, &at_name, message, help);
        };
        let Some(content) = content else {
            if !matches!(tree.kind, Kind::Word(_)) {
                self.report_wrong_value(
                    tree,
                    field,
                    &format!("`{}` without parentheses", name.text),
                );
            }
            return;
        };
        let content = resolve(self.root, content);
        let is_struct = content.get("properties").is_some();
        let is_tuple = content.get("prefixItems").is_some();
        match &tree.kind {
            Kind::Word(_) if is_struct => {
                let call = Kind::Call { name: None, body: Body::Empty };
                self.fields(&Tree { kind: call, ..tree.clone() }, &content, &name.text);
            }
            _ if is_struct => self.fields(tree, &content, &name.text),
            Kind::Call { body, .. } if is_tuple => {
                let kind = Kind::Call { name: None, body: body.clone() };
                self.array(&Tree { kind, ..tree.clone() }, &content, field);
            }
            _ if is_tuple => self.array(tree, &content, field),
            Kind::Call { body: Body::Items(items), .. } if items.len() == 1 => {
                self.value(&items[0], &content, field);
            }
            Kind::Call { body: Body::Items(items), .. } => {
                let message = format!("`{}(..)` holds one value, not {}", name.text, items.len());
                self.report(code::WRONG_VALUE, tree, message, "");
            }
            Kind::Call { body: Body::Fields(fields), .. } if fields.len() == 1 => {
                let (name, field_name) = (&name.text, &fields[0].name.text);
                let message =
                    format!("`{name}(..)` holds one value without a name, not `{field_name}: ..`");
                let help = fields[0].value.text().map(|text| format!("write `{name}(\"{text}\")`"));
                self.report(code::WRONG_VALUE, tree, message, help.unwrap_or_default());
            }
            _ => self.report_wrong_value(tree, field, &format!("one value: `{}(..)`", name.text)),
        }
    }

    fn map(&mut self, tree: &Tree, schema: &Json, field: &str) {
        let Kind::Map(entries) = &tree.kind else {
            return self.report_wrong_value(tree, field, "a map: `{\"key\": value, ..}`");
        };
        if let Some(content) = schema.get("additionalProperties") {
            entries.iter().for_each(|(_, value)| self.value(value, content, field));
        }
    }

    fn array(&mut self, tree: &Tree, schema: &Json, field: &str) {
        let items = schema.get("items").filter(|items| items.get("port").is_some());
        if let Some(items) = items.filter(|_| schema.get("minItems").is_none()) {
            let is_empty = matches!(&tree.kind, Kind::List(items) if items.is_empty());
            if is_empty && schema.get("least").is_some() {
                let message = format!("port `{field}` of {} needs at least one link", self.node);
                return self.report(code::MISSING_FIELD, tree, message, "write `[\"node\"]`");
            }
            return self.links(tree, items, field);
        }
        let fixed = schema.get("prefixItems").and_then(Json::as_array);
        let least = schema.get("minItems").and_then(Json::as_u64);
        let most = schema.get("maxItems").and_then(Json::as_u64);
        let is_tuple = fixed.is_some() || (least.is_some() && least == most);
        let items: &[Tree] = match &tree.kind {
            Kind::List(items) => items,
            Kind::Call { name: None, body: Body::Items(items) } if is_tuple => items,
            _ if is_tuple => {
                let count = least.unwrap_or_default();
                return self.report_wrong_value(
                    tree,
                    field,
                    &format!("{count} values in parentheses"),
                );
            }
            _ => return self.report_wrong_value(tree, field, "a list: `[.., ..]`"),
        };
        let count = items.len() as u64;
        if least.is_some_and(|least| count < least) || most.is_some_and(|most| most < count) {
            let wanted = match (least, most) {
                (Some(least), Some(most)) if least == most => format!("{least} values"),
                (Some(least), _) if count < least => format!("at least {least} values"),
                (_, most) => format!("at most {} values", most.unwrap_or_default()),
            };
            let message =
                format!("field `{field}` of {}: expected {wanted}, found {count}", self.node);
            return self.report(code::WRONG_VALUE, tree, message, "");
        }
        self.check_vector(tree, items, schema, field);
        for (index, item) in items.iter().enumerate() {
            let schema = fixed.and_then(|fixed| fixed.get(index)).or_else(|| schema.get("items"));
            if let Some(schema) = schema {
                self.value(item, schema, field);
            }
        }
    }

    fn number(&mut self, tree: &Tree, schema: &Json, field: &str) {
        let whole = schema.get("type").and_then(Json::as_str) == Some("integer");
        let Kind::Number { value, .. } = tree.kind else {
            let wanted = if whole { "a number without fraction" } else { "a number" };
            return self.report_wrong_value(tree, field, wanted);
        };
        if whole && value.fract() != 0.0 {
            return self.report_wrong_value(tree, field, "a number without fraction");
        }
        fn limit(name: &str, schema: &Json) -> Option<f64> {
            schema.get(name).and_then(Json::as_f64)
        }
        let (min, max) = (limit("minimum", schema), limit("maximum", schema));
        let (above, below) = (limit("exclusiveMinimum", schema), limit("exclusiveMaximum", schema));
        let fits = min.is_none_or(|min| min <= value)
            && max.is_none_or(|max| value <= max)
            && above.is_none_or(|above| above < value)
            && below.is_none_or(|below| value < below);
        if !fits {
            // Report only the narrower of two limits: "at least 0" is redundant beside "more than 0".
            let above = above.filter(|above| min.is_none_or(|min| min <= *above));
            let below = below.filter(|below| max.is_none_or(|max| *below <= max));
            let lowest = above.map(|above| format!("more than {above}"));
            let lowest = lowest.or_else(|| min.map(|min| format!("at least {min}")));
            let highest = below.map(|below| format!("less than {below}"));
            let highest = highest.or_else(|| max.map(|max| format!("at most {max}")));
            let range: Vec<String> = lowest.into_iter().chain(highest).collect();
            let unit = schema.get("unit").and_then(Json::as_str);
            let unit = unit.map_or_else(String::new, |unit| format!(" {unit}"));
            let message = format!(
                "field `{field}` of {} is {value}{unit}, but must be {}{unit}",
                self.node,
                range.join(" and ")
            );
            let help = schema.get("limit").and_then(Json::as_str).unwrap_or_default();
            self.report(code::OUT_OF_RANGE, tree, message, help);
        } else if let Some(wanted) = Self::violated_number_rule(value, schema) {
            let message =
                format!("field `{field}` of {} is {value}, but must be {wanted}", self.node);
            self.report(code::OUT_OF_RANGE, tree, message, "");
        }
    }

    fn text(&mut self, tree: &Tree, schema: &Json, field: &str) {
        let Some(text) = tree.text() else {
            return self.report_wrong_value(tree, field, "a text in double quotes");
        };
        match schema.get("format").and_then(Json::as_str) {
            Some("color") => {
                if let Err(error) = text.parse::<Color>() {
                    let message = format!("field `{field}` of {}: {error}", self.node);
                    self.report(code::WRONG_VALUE, tree, message, "");
                }
            }
            Some("file") if text.is_empty() && schema.get("default").is_some() => {}
            Some("file") if text.is_empty() => {
                let message = format!("field `{field}` of {} names no file", self.node);
                self.report(code::MISSING_FILE, tree, message, "write the path of a file");
            }
            Some("file") => {
                let span = tree.span;
                let (at, from) = match &tree.origin {
                    Some(Origin::External(given)) => (span, Some(given.clone())),
                    Some(Origin::Default(at)) => (*at, None),
                    _ => (span, None),
                };
                let folder = self.source_map.map_or(Path::new("."), |map| map.folder_for(tree));
                let (given, resolved) = (text.to_owned(), folder.join(text));
                let extension_error = self.extension_error(schema, text);
                self.files.push(FoundFile { span, at, given, resolved, from, extension_error });
            }
            _ => {}
        }
    }
}

impl Walk<'_> {
    /// Returns the message and the help if the field lists the extensions that it accepts, and this file has another one. Otherwise `None`.
    fn extension_error(&self, schema: &Json, name: &str) -> Option<(String, String)> {
        let known = schema.get("endings").and_then(Json::as_array)?;
        let known: Vec<_> = known.iter().filter_map(Json::as_str).collect();
        Path::new(name).file_name()?;
        let ending = extension(Path::new(name));
        if known.contains(&&ending[..]) {
            return None;
        }
        let message = match &ending[..] {
            "" => format!("`{name}` has no extension that tells {} how to read it", self.node),
            _ => format!("{} cannot read `.{ending}` files", self.node),
        };
        Some((message, format!("supported extensions: {}", known.join(", "))))
    }
}

/// Describes the types that a port takes. A union is described by its member types, because users do not know the union's name.
fn accepted_types(port: &Json, wants: &str) -> String {
    let types = port["types"].as_array().into_iter().flatten();
    let types: Vec<_> = types.filter_map(Json::as_str).map(with_article).collect();
    if types.is_empty() { with_article(wants) } else { any_of(types.iter().map(String::as_str)) }
}

/// Checks a default against the schema of its field. Returns the messages of the errors.
pub fn check_default(default: &Json, field: &Json, root: &Json) -> Vec<String> {
    let mut walk = Walk {
        node: "the node",
        root,
        source_map: None,
        diagnostics: Vec::new(),
        links: Vec::new(),
        files: Vec::new(),
    };
    if !default.is_null() {
        walk.value(&as_tree(default), field, "default");
        // Also check the default in the form in which the manual prints it.
        let (printed, errors) = parse(&to_ron(default, field, root));
        walk.value(&printed, field, "default");
        let errors = errors.into_iter().map(|error| error.message);
        return errors.chain(walk.diagnostics.into_iter().map(|found| found.message)).collect();
    }
    Vec::new()
}

/// Converts a JSON value to a tree. An object with a single key that is capitalized becomes an enum variant, whose content is the value of
/// the key.
pub fn as_tree(value: &Json) -> Tree {
    fn fields(fields: &Map<String, Json>) -> Body {
        Body::Fields(
            fields
                .iter()
                .map(|(name, value): (&String, &Json)| Field {
                    name: Name { text: name.clone(), span: Span::default() },
                    value: as_tree(value),
                })
                .collect(),
        )
    }
    fn is_choice(name: &str) -> bool {
        name.starts_with(|c: char| c.is_ascii_uppercase())
    }
    let choice = |entries: &'_ Map<String, Json>| match entries.iter().next() {
        Some((name, _)) if entries.len() == 1 && is_choice(name) => Some(name.clone()),
        _ => None,
    };
    let kind = match value {
        Json::Null => Kind::Word("None".into()),
        Json::Bool(value) => Kind::Bool(*value),
        Json::Number(number) => {
            Kind::Number { value: number.as_f64().unwrap_or(f64::NAN), whole: !number.is_f64() }
        }
        Json::String(word) if is_choice(word) => Kind::Word(word.clone()),
        Json::String(text) => Kind::Text(text.clone()),
        Json::Array(items) => Kind::List(items.iter().map(as_tree).collect()),
        Json::Object(entries) => match choice(entries) {
            Some(name) => {
                let body = match &entries[&name] {
                    Json::Object(content) if choice(content).is_none() => fields(content),
                    Json::Array(items) => Body::Items(items.iter().map(as_tree).collect()),
                    other => Body::Items(vec![as_tree(other)]),
                };
                Kind::Call { name: Some(Name { text: name, span: Span::default() }), body }
            }
            None => Kind::Call { name: None, body: fields(entries) },
        },
    };
    Tree::new(Span::default(), kind)
}
