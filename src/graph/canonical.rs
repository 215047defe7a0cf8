//! The canonical form of a graph: two texts with the same meaning have equal canonical forms. The form does not contain spaces, comments,
//! the order of entries, or fields that equal their defaults.
//!
//! The canonical form is a [`Tree`] without positions. Fields and entries are sorted by name, `1` and `1.0` are equal, and a list that
//! could be a tuple is a tuple. A link is stored as a bare word that includes quotes, which no bare word of a file contains. A link to the
//! first output of a node omits `.output`.

use std::collections::HashMap;

use maquette_syntax::error::Span;
use maquette_syntax::{
    Body, Field, Kind, Name, Quantity, Tree, as_tree, option_inner, resolve, variants,
};
use serde_json::Value as Json;

use super::constants::{declaration_in_own_unit, in_plain_numbers};
use super::describe::Subgraph;
use super::draft_value::{is_draft, make_draft};
use super::expectation::Expectation;
use super::expression::named_parameters;
use super::parameters::is_computed;
use super::repeat::DEFAULT_MAX_ELEMENTS;
use crate::catalog::{Catalog, Entry};
use crate::tree::{entries, show};

/// Fields at the top level of a graph file that the canonical form omits if they are empty.
pub const OMITTABLE_FIELDS: [&str; 5] = ["doc", "packs", "use", "params", "expect"];

/// The sections of a graph whose entries have names. Each is a pair of the field name of the section, such as `params`, and the word for
/// one of its entries, such as `parameter`.
pub(super) const SECTIONS: [(&str, &str); 5] = [
    ("use", "use"),
    ("inputs", "input"),
    ("params", "parameter"),
    ("nodes", "node"),
    ("outputs", "output"),
];

/// The canonical form of a graph.
pub(super) struct CanonicalGraph {
    /// The top-level fields of the graph file that are not sections. If the file does not begin with `Graph`, its type is one more item.
    pub(super) rest: Vec<Item>,
    /// The entries of each section, in the order of [`SECTIONS`].
    pub(super) sections: [Vec<Item>; SECTIONS.len()],
}

/// An entry of a section of the graph file, or another top-level field.
#[derive(Clone)]
pub(super) struct Item {
    pub(super) name: String,
    pub(super) value: Tree,
    /// The value as the file contains it: its numbers keep the units in which they are written.
    written: Tree,
}

impl Item {
    /// Returns the name of the entry's type; empty if the value is not a call.
    pub(super) fn kind(&self) -> &str {
        match &self.value.kind {
            Kind::Call { name: Some(name), .. } => &name.text,
            _ => "",
        }
    }

    /// Returns `part`, the part of the value at the dotted path `path`, as text. If `part` contains a number with a unit, the text shows
    /// the number as it is written in the file.
    pub(super) fn show(&self, path: &str, part: &Tree) -> String {
        let steps = path.split('.').filter(|step| !step.is_empty()).map(str::to_owned);
        let written = self.written.descend(&Vec::from_iter(steps));
        show(if has_units(written, part) { written } else { part })
    }
}

/// Returns true if a number in `written`, the value as the file contains it, has a unit.
fn has_units(written: &Tree, value: &Tree) -> bool {
    fn any_has_units(a: &[Tree], b: &[Tree]) -> bool {
        a.len() == b.len() && a.iter().zip(b).any(|(a, b)| has_units(a, b))
    }
    match (&written.kind, &value.kind) {
        (_, Kind::Number { .. }) => Quantity::read(written).is_some(),
        (Kind::List(a), Kind::List(b)) => any_has_units(a, b),
        (
            Kind::Call { name: a_name, body: Body::Items(a) },
            Kind::Call { name: b_name, body: Body::Items(b) },
        ) => {
            a_name.as_ref().map(|it| &it.text) == b_name.as_ref().map(|it| &it.text)
                && any_has_units(a, b)
        }
        (Kind::Call { body: Body::Fields(a), .. }, Kind::Call { body: Body::Fields(b), .. }) => {
            b.iter().any(|field| {
                let mut same = a.iter().filter(|other| other.name.text == field.name.text);
                same.any(|other| has_units(&other.value, &field.value))
            })
        }
        _ => false,
    }
}

impl CanonicalGraph {
    pub(super) fn new(tree: &Tree, catalog: &Catalog, graphs: &[Subgraph]) -> Self {
        let fields = tree.fields().unwrap_or_default();
        let kinds = kinds(fields);
        let reader = Canonicalizer { catalog, graphs, kinds: &kinds };
        let mut rest = Vec::new();
        if let Some(name) = tree.name().filter(|name| name.text != "Graph") {
            let value = bare(Kind::Word(name.text));
            rest.push(Item { name: "type".to_owned(), written: value.clone(), value });
        }
        fn is_section(name: &str) -> bool {
            SECTIONS.iter().any(|(section, _)| *section == name)
        }
        for field in fields.iter().filter(|field| {
            let name = &field.name.text[..];
            let is_nothing = OMITTABLE_FIELDS.contains(&name) && is_empty(&field.value);
            !is_section(name) && !is_nothing
        }) {
            let value = match &field.name.text[..] {
                "expect" => canonical_value(&Expectation::in_plain_numbers(&field.value).0),
                _ => canonical_value(&field.value),
            };
            let (name, written) = (field.name.text.clone(), canonical_value(&field.value));
            rest.push(Item { name, value, written });
        }
        let sections = SECTIONS.map(|(section, _)| {
            let entries = entries(fields, section);
            let mut seen: HashMap<&str, usize> = HashMap::new();
            let items = entries.map(|(name, value)| {
                let written = canonical_value(value);
                let value = match section {
                    "nodes" => reader.node(value),
                    "outputs" => reader.links(value),
                    "params" => canonical_declaration(&declaration_in_own_unit(
                        value,
                        name,
                        &mut Vec::new(),
                    )),
                    "inputs" => canonical_declaration(value),
                    _ => canonical_value(value),
                };
                let count = seen.entry(name).or_default();
                *count += 1;
                // Duplicate names are reported elsewhere. Number them here, so that both entries take part in comparisons.
                let name = if *count == 1 { name.to_owned() } else { format!("{name} ({count})") };
                Item { name, value, written }
            });
            items.collect()
        });
        Self { rest, sections }
    }
}

/// Returns the canonical form of a declaration, which omits an empty description.
fn canonical_declaration(tree: &Tree) -> Tree {
    let mut said = canonical_value(tree);
    if let Kind::Call { body, .. } = &mut said.kind
        && let Body::Fields(fields) = body
    {
        fields.retain(|field| field.name.text != "doc" || !is_empty(&field.value));
        *body = sorted_body(std::mem::take(fields));
    }
    said
}

/// Returns the type of each node of a graph, by the node's name. Inputs are included, with an empty text as their type.
fn kinds(fields: &[Field]) -> HashMap<String, String> {
    let inputs = entries(fields, "inputs").map(|(name, _)| (name.to_owned(), String::new()));
    let nodes = entries(fields, "nodes").map(|(name, node)| {
        let kind = node.name().map_or_else(String::new, |kind| kind.text);
        (name.to_owned(), kind)
    });
    inputs.chain(nodes).collect()
}

pub(super) fn bare(kind: Kind) -> Tree {
    Tree::new(Span::default(), kind)
}

fn bare_name(name: &Name) -> Name {
    Name { text: name.text.clone(), span: Span::default() }
}

/// Returns the canonical form of a value whose schema is unknown. No text in the value is treated as a link.
pub fn canonical_value(tree: &Tree) -> Tree {
    canonical_with(tree, &|text| Kind::Text(text.to_owned()))
}

fn canonical_with(tree: &Tree, text: &dyn Fn(&str) -> Kind) -> Tree {
    fn canonical_values(trees: &[Tree], text: &dyn Fn(&str) -> Kind) -> Vec<Tree> {
        trees.iter().map(|tree| canonical_with(tree, text)).collect()
    }
    bare(match &tree.kind {
        Kind::Number { value, .. } => Kind::Number { value: *value, whole: false },
        Kind::Text(content) => text(content),
        Kind::List(items) => Kind::List(canonical_values(items, text)),
        Kind::Map(entries) => {
            // Only the values of a map are links, not its keys.
            sorted_map(
                entries
                    .iter()
                    .map(|(key, value)| (canonical_value(key), canonical_with(value, text)))
                    .collect(),
            )
        }
        Kind::Call { name, body } => {
            let body = match body {
                Body::Empty => Body::Empty,
                Body::Items(items) if is_computed(tree) => {
                    Body::Items(items.iter().map(canonical_value).collect())
                }
                Body::Items(items) => Body::Items(canonical_values(items, text)),
                Body::Fields(fields) => sorted_body(
                    fields
                        .iter()
                        .map(|field| bare_field(&field.name, canonical_with(&field.value, text)))
                        .collect(),
                ),
            };
            Kind::Call { name: name.as_ref().map(bare_name), body }
        }
        other => other.clone(),
    })
}

fn bare_field(name: &Name, value: Tree) -> Field {
    Field { name: bare_name(name), value }
}

fn sorted_body(mut fields: Vec<Field>) -> Body {
    fields.sort_by(|a, b| a.name.text.cmp(&b.name.text));
    if fields.is_empty() { Body::Empty } else { Body::Fields(fields) }
}

fn sorted_map(mut entries: Vec<(Tree, Tree)>) -> Kind {
    entries.sort_by(|a, b| a.0.text().cmp(&b.0.text()));
    Kind::Map(entries)
}

/// Returns true if the value of a field equals the field's default. The value must not contain links.
pub fn is_default(tree: &Tree, schema: &Json, root: &Json, catalog: &Catalog) -> bool {
    let kinds = HashMap::new();
    let reader = Canonicalizer { catalog, graphs: &[], kinds: &kinds };
    reader.value(tree, schema, root) == reader.default(schema, root)
}

struct Canonicalizer<'a> {
    catalog: &'a Catalog,
    /// The graphs that this graph uses as nodes, except for those whose files could not be read.
    graphs: &'a [Subgraph],
    kinds: &'a HashMap<String, String>,
}

impl Canonicalizer<'_> {
    fn node(&self, tree: &Tree) -> Tree {
        let Some(name) = tree.name() else { return self.links(tree) };
        match (self.schema(&name.text), tree.fields()) {
            (None, Some(fields)) if name.text == "ForEach" => self.for_each(&name, fields),
            (Some(schema), Some(_)) => {
                let tree = in_plain_numbers(tree, schema);
                let fields = tree.fields().unwrap_or_default();
                let body = self.fields(fields, schema, schema);
                bare(Kind::Call { name: Some(bare_name(&name)), body })
            }
            // If the type of a node is unknown, each text that equals the name of a node is treated as a link.
            _ => self.links(tree),
        }
    }

    /// Returns the schema of a node type, if it is known.
    fn schema(&self, kind: &str) -> Option<&Json> {
        let built_in = self.catalog.find(kind).map(Entry::schema);
        built_in.or_else(|| Some(self.graph(kind)?.schema()))
    }

    /// Returns the canonical form of the fields in `tree`: those of one element of a `ForEach`, or those in `with`, which all elements
    /// share. A field with its default value is omitted, unless `kept` contains a field of the same name.
    fn fields_of_element(&self, tree: &Tree, schema: Option<&Json>, kept: &[Field]) -> Tree {
        let Some(schema) = schema.filter(|_| tree.fields().is_some()) else {
            return self.links(tree);
        };
        let tree = in_plain_numbers(tree, schema);
        let fields = tree.fields().unwrap_or_default().iter().filter_map(|field| {
            let one = self.fields(std::slice::from_ref(field), schema, schema);
            // An element must state a default explicitly if `with` sets the field to another value.
            let is_kept = kept.iter().any(|it| it.name.text == field.name.text);
            match one {
                Body::Fields(mut fields) => fields.pop(),
                _ => is_kept.then(|| bare_field(&field.name, canonical_value(&field.value))),
            }
        });
        bare(Kind::Call { name: None, body: sorted_body(fields.collect()) })
    }

    /// Returns the canonical form of a `ForEach`.
    fn for_each(&self, name: &Name, fields: &[Field]) -> Tree {
        let value = |name: &str| fields.iter().find(|it| it.name.text == name).map(|it| &it.value);
        let schema = value("graph").and_then(Tree::text).and_then(|kind| self.schema(kind));
        let with = value("with").map(|with| self.fields_of_element(with, schema, &[]));
        let kept = with.as_ref().and_then(Tree::fields).unwrap_or_default();
        let fields = fields.iter().filter_map(|field| {
            let value = match (&field.name.text[..], &field.value.kind) {
                ("with", _) => with.clone()?,
                ("over", Kind::List(elements)) => bare(Kind::List(
                    elements.iter().map(|it| self.fields_of_element(it, schema, kept)).collect(),
                )),
                // The texts in these fields are the names of a type, an input and a parameter, not links to nodes.
                ("graph" | "each" | "number", _) => canonical_value(&field.value),
                _ => self.links(&field.value),
            };
            let is_nothing = matches!(&field.name.text[..], "with" | "links" | "carry")
                && is_empty(&value)
                || is_default_most(field);
            (!is_nothing).then(|| bare_field(&field.name, value))
        });
        let body = sorted_body(fields.collect());
        bare(Kind::Call { name: Some(bare_name(name)), body })
    }

    fn graph(&self, kind: &str) -> Option<&Subgraph> {
        self.graphs.iter().find(|graph| graph.name == kind)
    }

    fn links(&self, tree: &Tree) -> Tree {
        canonical_with(tree, &|text| match self.kinds.contains_key(node_of_link(text)) {
            true => self.link(text),
            false => Kind::Text(text.to_owned()),
        })
    }

    fn link(&self, text: &str) -> Kind {
        let first = text.split_once('.').and_then(|(node, output)| {
            let kind = self.kinds.get(node)?;
            let first = match self.catalog.find(kind) {
                Some(entry) => entry.outputs().first()?.name,
                None => self.graph(kind)?.first_output()?,
            };
            (first == output).then_some(node)
        });
        Kind::Word(format!("\"{}\"", first.unwrap_or(text)))
    }

    /// Returns the fields that differ from their defaults.
    fn fields(&self, fields: &[Field], schema: &Json, root: &Json) -> Body {
        let properties = &schema["properties"];
        let kept = fields.iter().filter_map(|field| {
            let Some(schema) = properties.get(&field.name.text) else {
                return Some(bare_field(&field.name, self.links(&field.value)));
            };
            let value = self.value(&field.value, schema, root);
            let is_default = value == self.default(schema, root);
            (!is_default).then(|| bare_field(&field.name, value))
        });
        sorted_body(kept.collect())
    }

    /// Returns the default value of a field. A default that is computed from other fields is unknown, and is returned as broken.
    fn default(&self, schema: &Json, root: &Json) -> Tree {
        if schema.get("derives").is_some() {
            return bare(Kind::Broken);
        }
        fn default_tree(default: &Json, schema: &Json) -> Tree {
            match default {
                // The default of a choice is a word. `as_tree` would make it a text if it begins with a lower-case letter, as in parameters
                // of graphs.
                Json::String(word) if schema.get("enum").is_some() => {
                    bare(Kind::Word(word.clone()))
                }
                default => as_tree(default),
            }
        }
        let default = match schema.get("draft") {
            Some(sides) => make_draft(|side| default_tree(&sides[side], schema)),
            None => default_tree(schema.get("default").unwrap_or(&Json::Null), schema),
        };
        self.value(&default, schema, root)
    }

    fn value(&self, tree: &Tree, schema: &Json, root: &Json) -> Tree {
        if is_computed(tree) {
            return canonical_value(tree);
        }
        if is_draft(tree) {
            let body = sorted_body(
                tree.fields()
                    .unwrap_or_default()
                    .iter()
                    .map(|field| bare_field(&field.name, self.value(&field.value, schema, root)))
                    .collect(),
            );
            return bare(Kind::Call { name: tree.name().as_ref().map(bare_name), body });
        }
        let schema = resolve(root, schema);
        if schema.get("port").is_some() {
            return match &tree.kind {
                Kind::Text(text) => bare(self.link(text)),
                _ => canonical_value(tree),
            };
        }
        if let Some(inner) = option_inner(&schema) {
            return match &tree.kind {
                Kind::Word(word) if word == "None" => canonical_value(tree),
                _ => self.value(tree.call_of("Some").unwrap_or(tree), &inner, root),
            };
        }
        if let Some(name) = tree.name()
            && let Some((_, content)) =
                variants(&schema).into_iter().find(|(known, _)| *known == name.text)
        {
            return bare(match content {
                Some(content) => self.choice(tree, &name, content, root),
                None => Kind::Word(name.text),
            });
        }
        let takes_links = schema.get("items").is_some_and(|items| items.get("port").is_some());
        bare(match &tree.kind {
            // A single link is allowed at a port that takes a list of links.
            Kind::Text(text) if takes_links => self.link(text),
            Kind::Call { name: None, body: Body::Fields(fields) } => {
                Kind::Call { name: None, body: self.fields(fields, &schema, root) }
            }
            Kind::Map(entries) => {
                let content = schema.get("additionalProperties").cloned().unwrap_or_default();
                let entries = entries
                    .iter()
                    .map(|(key, value)| (canonical_value(key), self.value(value, &content, root)));
                sorted_map(entries.collect())
            }
            Kind::List(list) if is_tuple(&schema) => {
                Kind::Call { name: None, body: Body::Items(self.items(list, &schema, root)) }
            }
            Kind::List(list) => Kind::List(self.items(list, &schema, root)),
            Kind::Call { name: None, body: Body::Items(tuple) } => {
                Kind::Call { name: None, body: Body::Items(self.items(tuple, &schema, root)) }
            }
            Kind::Text(text) if schema.get("format").and_then(Json::as_str) == Some("color") => {
                Kind::Text(text.to_ascii_lowercase())
            }
            _ => return canonical_value(tree),
        })
    }

    /// Returns the canonical form of the content of a choice, such as the fields after `Near` in `Near(distance: 2.0)`.
    fn choice(&self, tree: &Tree, name: &Name, content: &Json, root: &Json) -> Kind {
        let content = resolve(root, content);
        let body = match &tree.kind {
            Kind::Call { body: Body::Fields(fields), .. } => self.fields(fields, &content, root),
            Kind::Call { body: Body::Items(items), .. } => Body::Items(match &items[..] {
                [item] if !is_tuple(&content) => vec![self.value(item, &content, root)],
                items => self.items(items, &content, root),
            }),
            _ => Body::Empty,
        };
        Kind::Call { name: Some(bare_name(name)), body }
    }

    fn items(&self, items: &[Tree], schema: &Json, root: &Json) -> Vec<Tree> {
        let fixed = schema.get("prefixItems").and_then(Json::as_array);
        items
            .iter()
            .enumerate()
            .map(|(index, item)| {
                let schema =
                    fixed.and_then(|fixed| fixed.get(index)).or_else(|| schema.get("items"));
                schema
                    .map_or_else(|| canonical_value(item), |schema| self.value(item, schema, root))
            })
            .collect()
    }
}

fn is_tuple(schema: &Json) -> bool {
    fn count(name: &str, schema: &Json) -> Option<u64> {
        schema.get(name).and_then(Json::as_u64)
    }
    schema.get("prefixItems").is_some()
        || (count("minItems", schema).is_some()
            && count("minItems", schema) == count("maxItems", schema))
}

/// Returns true if the value is or contains a link.
pub(super) fn has_link(tree: &Tree) -> bool {
    match &tree.kind {
        Kind::Word(word) => word.starts_with('"'),
        Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
            items.iter().any(has_link)
        }
        Kind::Call { body: Body::Fields(fields), .. } => {
            fields.iter().any(|field| has_link(&field.value))
        }
        Kind::Map(entries) => entries.iter().any(|(_, value)| has_link(value)),
        _ => false,
    }
}

/// Renames nodes in links, and parameters in `Param` and `Expr`. The functions return the new name, or `None` to keep the old one.
pub(super) fn rename(
    tree: &Tree,
    node: &dyn Fn(&str) -> Option<String>,
    parameter: &dyn Fn(&str) -> Option<String>,
) -> Tree {
    let again = |tree: &Tree| rename(tree, node, parameter);
    bare(match &tree.kind {
        Kind::Word(word) if word.starts_with('"') => {
            let link = word.trim_matches('"');
            let (name, output) = link.split_at(node_of_link(link).len());
            match node(name) {
                Some(name) => Kind::Word(format!("\"{name}{output}\"")),
                None => tree.kind.clone(),
            }
        }
        Kind::Call { name, body: Body::Items(items) } if is_computed(tree) => {
            let text = items.first().and_then(Tree::text).unwrap_or_default();
            let text = rename_in_expression(text, parameter);
            Kind::Call { name: name.clone(), body: Body::Items(vec![bare(Kind::Text(text))]) }
        }
        Kind::List(items) => Kind::List(items.iter().map(again).collect()),
        Kind::Map(entries) => {
            Kind::Map(entries.iter().map(|(key, value)| (key.clone(), again(value))).collect())
        }
        Kind::Call { name, body } => {
            let body = match body {
                Body::Empty => Body::Empty,
                Body::Items(items) => Body::Items(items.iter().map(again).collect()),
                Body::Fields(fields) => Body::Fields(
                    fields
                        .iter()
                        .map(|field| bare_field(&field.name, again(&field.value)))
                        .collect(),
                ),
            };
            Kind::Call { name: name.clone(), body }
        }
        other => other.clone(),
    })
}

/// Renames parameters in the text of an expression.
fn rename_in_expression(text: &str, new: &dyn Fn(&str) -> Option<String>) -> String {
    let names = named_parameters(text, &|name| new(name).is_some()).unwrap_or_default();
    let mut result = text.to_owned();
    for at in names.into_iter().rev() {
        if let Some(new) = new(&text[at.clone()]) {
            result.replace_range(at, &new);
        }
    }
    result
}

/// Returns the node name at the start of a link: `eyes` for `eyes.range` and `eyes/1.range`.
pub fn node_of_link(link: &str) -> &str {
    link.split(['.', '/']).next().unwrap_or_default()
}

/// Returns true if a value is an empty text, list, map or group of fields. Returns false for numbers, words and calls with a name.
pub fn is_empty(value: &Tree) -> bool {
    match &value.kind {
        Kind::Text(text) => text.is_empty(),
        Kind::List(items) => items.is_empty(),
        Kind::Map(entries) => entries.is_empty(),
        Kind::Call { name: None, body } => *body == Body::Empty,
        _ => false,
    }
}

/// Returns true if a field of a `ForEach` sets `most`, the maximum number of elements, to its default.
pub fn is_default_most(field: &Field) -> bool {
    let is_usual = matches!(&field.value.kind, Kind::Number { value, .. } if *value == DEFAULT_MAX_ELEMENTS as f64);
    field.name.text == "most" && is_usual
}
