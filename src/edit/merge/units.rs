//! Converts numbers with units to plain numbers, so that `cm(1)` and `mm(10)` count as equal.

use std::collections::BTreeMap;
use std::path::Path;

use maquette_graph::catalog::{Catalog, Entry};
use maquette_graph::constants::{declaration_in_own_unit, in_plain_numbers};
use maquette_graph::tree::entries;
use maquette_graph::{Expectation, Files, Graph, Options};
use maquette_syntax::{Body, Kind, Tree, unit_names};

/// Returns plain numbers for the values with units in the text of a graph, by the byte offsets of these values.
pub(super) fn plain_numbers(
    path: &Path,
    text: &str,
    tree: &Tree,
    catalog: &Catalog,
) -> PlainNumbers {
    let options = Options { files: Files::Ignored, ..Options::default() };
    let fields = tree.fields().unwrap_or_default();
    let mut plain = PlainNumbers::new();
    if !has_units(tree) {
        return plain;
    }
    for (name, declared) in entries(fields, "params") {
        collect_differences(
            declared,
            &declaration_in_own_unit(declared, name, &mut Vec::new()),
            &mut plain,
        );
    }
    for field in fields.iter().filter(|field| field.name.text == "expect") {
        collect_differences(
            &field.value,
            &Expectation::in_plain_numbers(&field.value).0,
            &mut plain,
        );
    }
    // Read the used graphs only if the text has numbers with units.
    let uses = entries(fields, "use").next().is_some();
    let graphs = match uses {
        true => Graph::subgraphs_of(path, text.to_owned(), catalog, &options).0,
        false => Vec::new(),
    };
    let schema = |kind: &str| {
        catalog
            .find(kind)
            .map(Entry::schema)
            .or_else(|| graphs.iter().find(|graph| graph.name == kind).map(|graph| graph.schema()))
    };
    for (_, node) in entries(fields, "nodes") {
        let kind = node.name().map(|name| name.text).unwrap_or_default();
        if let Some(schema) = schema(&kind) {
            collect_differences(node, &in_plain_numbers(node, schema), &mut plain);
        }
    }
    plain
}

/// Values with units, converted to plain numbers, by their byte offsets in the text.
pub(super) type PlainNumbers = BTreeMap<usize, Tree>;

/// Returns true if a number in the value is written with a unit.
fn has_units(tree: &Tree) -> bool {
    match &tree.kind {
        Kind::List(items) => items.iter().any(has_units),
        Kind::Map(entries) => entries.iter().any(|(_, value)| has_units(value)),
        Kind::Call { body: Body::Fields(fields), .. } => {
            fields.iter().any(|field| has_units(&field.value))
        }
        Kind::Call { name, body: Body::Items(items) } => {
            name.as_ref().is_some_and(|name| unit_names().any(|unit| unit == name.text))
                || items.iter().any(has_units)
        }
        _ => false,
    }
}

/// Compares a value with its form in plain numbers, and collects the parts that differ.
fn collect_differences(tree: &Tree, plain: &Tree, found: &mut PlainNumbers) {
    match (&tree.kind, &plain.kind) {
        (Kind::List(items), Kind::List(others)) => {
            items
                .iter()
                .zip(others)
                .for_each(|(item, other)| collect_differences(item, other, found));
        }
        (Kind::Map(entries), Kind::Map(others)) => {
            entries
                .iter()
                .zip(others)
                .for_each(|(entry, other)| collect_differences(&entry.1, &other.1, found));
        }
        (
            Kind::Call { name: a, body: Body::Items(items) },
            Kind::Call { name: b, body: Body::Items(others) },
        ) if a == b => {
            items
                .iter()
                .zip(others)
                .for_each(|(item, other)| collect_differences(item, other, found));
        }
        (
            Kind::Call { name: a, body: Body::Fields(fields) },
            Kind::Call { name: b, body: Body::Fields(others) },
        ) if a == b => {
            let both = fields.iter().zip(others);
            both.for_each(|(field, other)| collect_differences(&field.value, &other.value, found));
        }
        (Kind::Call { .. }, _) if tree.kind != plain.kind => {
            found.insert(tree.span.start, plain.clone());
        }
        _ => {}
    }
}
