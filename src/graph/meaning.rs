//! What the text of a graph says, without what it does not depend on: spaces, comments, order, and fields that are written
//! out with their defaults.
//!
//! A meaning is a [`Tree`] without places: fields and entries in the order of their names, numbers without the difference
//! between `1` and `1.0`, tuples that could be lists as tuples. A link is a word in quotes, which no file has, and has no
//! `.output` where that is the node's first one.

use std::collections::HashMap;

use maquette_syntax::error::Span;
use maquette_syntax::{
    Body, Field, Kind, Name, Quantity, Tree, as_tree, inside_option, resolve, variants,
};
use serde_json::Value as Json;

use super::describe::Subgraph;
use super::expectation::Expectation;
use super::expression::named_parameters;
use super::fitting::{declaration_in_own_unit, in_plain_numbers};
use super::parameters::is_computed;
use super::quality::{draft_of, is_draft};
use super::repeat::MOST;
use crate::catalog::{Catalog, Entry};
use crate::tree::{entries, show};

/// The fields of a graph that say nothing if there is nothing in them.
pub const EMPTY: [&str; 5] = ["doc", "packs", "use", "params", "expect"];

/// The parts of a graph whose entries have names.
pub(super) const SECTIONS: [(&str, &str); 5] = [
    ("use", "use"),
    ("inputs", "input"),
    ("params", "parameter"),
    ("nodes", "node"),
    ("outputs", "output"),
];

/// What a graph says.
pub(super) struct Meaning {
    /// The fields of the graph that are no sections, its own name among them.
    pub(super) rest: Vec<Item>,
    /// The entries of each section.
    pub(super) sections: [Vec<Item>; SECTIONS.len()],
}

/// An entry of a section, or a field of the graph.
#[derive(Clone)]
pub(super) struct Item {
    pub(super) name: String,
    pub(super) value: Tree,
    /// The same with numbers in the units that they are written in.
    written: Tree,
}

impl Item {
    /// The name of its type; empty if it is no call.
    pub(super) fn kind(&self) -> &str {
        match &self.value.kind {
            Kind::Call { name: Some(name), .. } => &name.text,
            _ => "",
        }
    }

    /// A part of the value, at this way with dots, as text: as it is written if a number in it has a unit.
    pub(super) fn show(&self, path: &str, part: &Tree) -> String {
        let steps = path.split('.').filter(|step| !step.is_empty()).map(str::to_owned);
        let written = self.written.at(&Vec::from_iter(steps));
        show(if has_units(written, part) { written } else { part })
    }
}

/// Whether something is written with a unit, of what has become this value.
fn has_units(written: &Tree, value: &Tree) -> bool {
    fn any(a: &[Tree], b: &[Tree]) -> bool {
        a.len() == b.len() && a.iter().zip(b).any(|(a, b)| has_units(a, b))
    }
    match (&written.kind, &value.kind) {
        (_, Kind::Number { .. }) => Quantity::read(written).is_some(),
        (Kind::List(a), Kind::List(b)) => any(a, b),
        (
            Kind::Call { name: a_name, body: Body::Items(a) },
            Kind::Call { name: b_name, body: Body::Items(b) },
        ) => a_name.as_ref().map(|it| &it.text) == b_name.as_ref().map(|it| &it.text) && any(a, b),
        (Kind::Call { body: Body::Fields(a), .. }, Kind::Call { body: Body::Fields(b), .. }) => {
            b.iter().any(|field| {
                let mut same = a.iter().filter(|other| other.name.text == field.name.text);
                same.any(|other| has_units(&other.value, &field.value))
            })
        }
        _ => false,
    }
}

impl Meaning {
    pub(super) fn of(tree: &Tree, catalog: &Catalog, graphs: &[Subgraph]) -> Self {
        let fields = tree.fields().unwrap_or_default();
        let kinds = kinds(fields);
        let reader = Reading { catalog, graphs, kinds: &kinds };
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
            let is_nothing = EMPTY.contains(&name) && is_empty(&field.value);
            !is_section(name) && !is_nothing
        }) {
            let value = match &field.name.text[..] {
                "expect" => plain(&Expectation::in_plain_numbers(&field.value).0),
                _ => plain(&field.value),
            };
            let (name, written) = (field.name.text.clone(), plain(&field.value));
            rest.push(Item { name, value, written });
        }
        let sections = SECTIONS.map(|(section, _)| {
            let entries = entries(fields, section);
            let mut seen: HashMap<&str, usize> = HashMap::new();
            let item = |(name, value)| {
                let written = plain(value);
                let value = match section {
                    "nodes" => reader.node(value),
                    "outputs" => reader.links(value),
                    "params" => declared(&declaration_in_own_unit(value, name, &mut Vec::new())),
                    "inputs" => declared(value),
                    _ => plain(value),
                };
                let count = seen.entry(name).or_default();
                *count += 1;
                // A name that is given twice is a mistake, but each has its own meaning.
                let name = if *count == 1 { name.to_owned() } else { format!("{name} ({count})") };
                Item { name, value, written }
            };
            entries.map(item).collect()
        });
        Self { rest, sections }
    }
}

/// What a declaration says; an empty description says nothing.
fn declared(tree: &Tree) -> Tree {
    let mut said = plain(tree);
    if let Kind::Call { body, .. } = &mut said.kind
        && let Body::Fields(fields) = body
    {
        fields.retain(|field| field.name.text != "doc" || !is_empty(&field.value));
        *body = sorted(std::mem::take(fields));
    }
    said
}

/// The type of each node; that of an input is empty.
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

/// A value of which nothing is known.
pub fn plain(tree: &Tree) -> Tree {
    plain_with(tree, &|text| Kind::Text(text.to_owned()))
}

fn plain_with(tree: &Tree, text: &dyn Fn(&str) -> Kind) -> Tree {
    fn all(trees: &[Tree], text: &dyn Fn(&str) -> Kind) -> Vec<Tree> {
        trees.iter().map(|tree| plain_with(tree, text)).collect()
    }
    bare(match &tree.kind {
        Kind::Number { value, .. } => Kind::Number { value: *value, whole: false },
        Kind::Text(content) => text(content),
        Kind::List(items) => Kind::List(all(items, text)),
        Kind::Map(entries) => {
            // Keys are not links.
            sorted_map(
                entries.iter().map(|(key, value)| (plain(key), plain_with(value, text))).collect(),
            )
        }
        Kind::Call { name, body } => {
            let body = match body {
                Body::Empty => Body::Empty,
                Body::Items(items) if is_computed(tree) => {
                    Body::Items(items.iter().map(plain).collect())
                }
                Body::Items(items) => Body::Items(all(items, text)),
                Body::Fields(fields) => sorted(
                    fields
                        .iter()
                        .map(|field| named(&field.name, plain_with(&field.value, text)))
                        .collect(),
                ),
            };
            Kind::Call { name: name.as_ref().map(bare_name), body }
        }
        other => other.clone(),
    })
}

fn named(name: &Name, value: Tree) -> Field {
    Field { name: bare_name(name), value }
}

fn sorted(mut fields: Vec<Field>) -> Body {
    fields.sort_by(|a, b| a.name.text.cmp(&b.name.text));
    if fields.is_empty() { Body::Empty } else { Body::Fields(fields) }
}

fn sorted_map(mut entries: Vec<(Tree, Tree)>) -> Kind {
    entries.sort_by(|a, b| a.0.text().cmp(&b.0.text()));
    Kind::Map(entries)
}

/// Whether a field, which has no links in it, says what it means if it is left out.
pub fn is_default(tree: &Tree, schema: &Json, root: &Json, catalog: &Catalog) -> bool {
    let kinds = HashMap::new();
    let reader = Reading { catalog, graphs: &[], kinds: &kinds };
    reader.value(tree, schema, root) == reader.default(schema, root)
}

struct Reading<'a> {
    catalog: &'a Catalog,
    /// The graphs that it uses, as far as they could be read.
    graphs: &'a [Subgraph],
    kinds: &'a HashMap<String, String>,
}

impl Reading<'_> {
    fn node(&self, tree: &Tree) -> Tree {
        let Some(name) = tree.name() else { return self.links(tree) };
        match (self.schema(&name.text), tree.fields()) {
            (None, Some(fields)) if name.text == "ForEach" => self.each(&name, fields),
            (Some(schema), Some(_)) => {
                let tree = in_plain_numbers(tree, schema);
                let fields = tree.fields().unwrap_or_default();
                let body = self.fields(fields, schema, schema);
                bare(Kind::Call { name: Some(bare_name(&name)), body })
            }
            // A text that names a node is taken for a link where the type is not known.
            _ => self.links(tree),
        }
    }

    /// Of the type of a node, as far as it is known.
    fn schema(&self, kind: &str) -> Option<&Json> {
        let built_in = self.catalog.find(kind).map(Entry::schema);
        built_in.or_else(|| Some(self.graph(kind)?.schema()))
    }

    /// A `ForEach`, whose elements are nodes of the type that it names.
    fn each(&self, name: &Name, fields: &[Field]) -> Tree {
        let value = |name: &str| fields.iter().find(|it| it.name.text == name).map(|it| &it.value);
        let schema = value("graph").and_then(Tree::text).and_then(|kind| self.schema(kind));
        let of_node = |tree: &Tree, kept: &[Field]| match (schema, tree.fields()) {
            (Some(schema), Some(_)) => {
                let tree = in_plain_numbers(tree, schema);
                let fields = tree.fields().unwrap_or_default().iter().filter_map(|field| {
                    let one = self.fields(std::slice::from_ref(field), schema, schema);
                    // An element says a default where all others have something else.
                    let is_kept = kept.iter().any(|it| it.name.text == field.name.text);
                    match one {
                        Body::Fields(mut fields) => fields.pop(),
                        _ => is_kept.then(|| named(&field.name, plain(&field.value))),
                    }
                });
                bare(Kind::Call { name: None, body: sorted(fields.collect()) })
            }
            _ => self.links(tree),
        };
        let with = value("with").map(|with| of_node(with, &[]));
        let kept = with.as_ref().and_then(Tree::fields).unwrap_or_default();
        let said = |field: &Field| {
            let said = match (&field.name.text[..], &field.value.kind) {
                ("with", _) => with.clone()?,
                ("over", Kind::List(elements)) => {
                    bare(Kind::List(elements.iter().map(|it| of_node(it, kept)).collect()))
                }
                // Names of a type, of an input and of a parameter, whatever nodes are called.
                ("graph" | "each" | "number", _) => plain(&field.value),
                _ => self.links(&field.value),
            };
            let is_nothing = matches!(&field.name.text[..], "with" | "links" | "carry")
                && is_empty(&said)
                || is_usual_most(field);
            (!is_nothing).then(|| named(&field.name, said))
        };
        let body = sorted(fields.iter().filter_map(said).collect());
        bare(Kind::Call { name: Some(bare_name(name)), body })
    }

    fn graph(&self, kind: &str) -> Option<&Subgraph> {
        self.graphs.iter().find(|graph| graph.name == kind)
    }

    fn links(&self, tree: &Tree) -> Tree {
        plain_with(tree, &|text| match self.kinds.contains_key(named_node(text)) {
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

    /// Fields without those that equal their defaults.
    fn fields(&self, fields: &[Field], schema: &Json, root: &Json) -> Body {
        let properties = &schema["properties"];
        let kept = fields.iter().filter_map(|field| {
            let Some(schema) = properties.get(&field.name.text) else {
                return Some(named(&field.name, self.links(&field.value)));
            };
            let value = self.value(&field.value, schema, root);
            let is_default = value == self.default(schema, root);
            (!is_default).then(|| named(&field.name, value))
        });
        sorted(kept.collect())
    }

    /// What a field means that is left out; broken if other fields decide it.
    fn default(&self, schema: &Json, root: &Json) -> Tree {
        if schema.get("derives").is_some() {
            return bare(Kind::Broken);
        }
        fn written(default: &Json, schema: &Json) -> Tree {
            match default {
                // A graph's own choices may be in lower case.
                Json::String(word) if schema.get("enum").is_some() => {
                    bare(Kind::Word(word.clone()))
                }
                default => as_tree(default),
            }
        }
        let default = match schema.get("draft") {
            Some(sides) => draft_of(|side| written(&sides[side], schema)),
            None => written(schema.get("default").unwrap_or(&Json::Null), schema),
        };
        self.value(&default, schema, root)
    }

    fn value(&self, tree: &Tree, schema: &Json, root: &Json) -> Tree {
        if is_computed(tree) {
            return plain(tree);
        }
        if is_draft(tree) {
            let body = sorted(
                tree.fields()
                    .unwrap_or_default()
                    .iter()
                    .map(|field| named(&field.name, self.value(&field.value, schema, root)))
                    .collect(),
            );
            return bare(Kind::Call { name: tree.name().as_ref().map(bare_name), body });
        }
        let schema = resolve(root, schema);
        if schema.get("port").is_some() {
            return match &tree.kind {
                Kind::Text(text) => bare(self.link(text)),
                _ => plain(tree),
            };
        }
        if let Some(inner) = inside_option(&schema) {
            return match &tree.kind {
                Kind::Word(word) if word == "None" => plain(tree),
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
        let items = |items: &[Tree]| self.items(items, &schema, root);
        let takes_links = schema.get("items").is_some_and(|items| items.get("port").is_some());
        bare(match &tree.kind {
            // One link to many values.
            Kind::Text(text) if takes_links => self.link(text),
            Kind::Call { name: None, body: Body::Fields(fields) } => {
                Kind::Call { name: None, body: self.fields(fields, &schema, root) }
            }
            Kind::Map(entries) => {
                let content = schema.get("additionalProperties").cloned().unwrap_or_default();
                let entry =
                    |(key, value): &(Tree, Tree)| (plain(key), self.value(value, &content, root));
                sorted_map(entries.iter().map(entry).collect())
            }
            Kind::List(list) if is_tuple(&schema) => {
                Kind::Call { name: None, body: Body::Items(items(list)) }
            }
            Kind::List(list) => Kind::List(items(list)),
            Kind::Call { name: None, body: Body::Items(tuple) } => {
                Kind::Call { name: None, body: Body::Items(items(tuple)) }
            }
            Kind::Text(text) if schema.get("format").and_then(Json::as_str) == Some("color") => {
                Kind::Text(text.to_ascii_lowercase())
            }
            _ => return plain(tree),
        })
    }

    /// What stands behind the name of a choice.
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
                schema.map_or_else(|| plain(item), |schema| self.value(item, schema, root))
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

/// Whether a part of the value is a link.
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

/// The value with other names for the nodes that links name, and for the parameters in `Param` and `Expr`.
pub(super) fn renamed(
    tree: &Tree,
    node: &dyn Fn(&str) -> Option<String>,
    parameter: &dyn Fn(&str) -> Option<String>,
) -> Tree {
    let again = |tree: &Tree| renamed(tree, node, parameter);
    bare(match &tree.kind {
        Kind::Word(word) if word.starts_with('"') => {
            let link = word.trim_matches('"');
            let (name, output) = link.split_at(named_node(link).len());
            match node(name) {
                Some(name) => Kind::Word(format!("\"{name}{output}\"")),
                None => tree.kind.clone(),
            }
        }
        Kind::Call { name, body: Body::Items(items) } if is_computed(tree) => {
            let text = items.first().and_then(Tree::text).unwrap_or_default();
            let text = renamed_words(text, parameter);
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
                    fields.iter().map(|field| named(&field.name, again(&field.value))).collect(),
                ),
            };
            Kind::Call { name: name.clone(), body }
        }
        other => other.clone(),
    })
}

/// The names in an expression, replaced.
fn renamed_words(text: &str, new: &dyn Fn(&str) -> Option<String>) -> String {
    let names = named_parameters(text, &|name| new(name).is_some()).unwrap_or_default();
    let mut result = text.to_owned();
    for at in names.into_iter().rev() {
        if let Some(new) = new(&text[at.clone()]) {
            result.replace_range(at, &new);
        }
    }
    result
}

/// The name that a link begins with: `eyes` of `eyes.range` and of `eyes/1.range`.
pub fn named_node(link: &str) -> &str {
    link.split(['.', '/']).next().unwrap_or_default()
}

/// Whether a value holds nothing.
pub fn is_empty(value: &Tree) -> bool {
    match &value.kind {
        Kind::Text(text) => text.is_empty(),
        Kind::List(items) => items.is_empty(),
        Kind::Map(entries) => entries.is_empty(),
        Kind::Call { name: None, body } => *body == Body::Empty,
        _ => false,
    }
}

/// Whether a field of a `ForEach` says what most of its elements may be where it does not say it.
pub fn is_usual_most(field: &Field) -> bool {
    let is_usual = matches!(&field.value.kind, Kind::Number { value, .. } if *value == MOST as f64);
    field.name.text == "most" && is_usual
}
