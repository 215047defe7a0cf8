//! Removes values that equal their defaults, for `maquette fmt --minimal`.

use std::collections::HashMap;
use std::path::Path;

use maquette_graph::canonical::{
    OMITTABLE_FIELDS, is_default, is_default_most, is_empty, node_of_link,
};
use maquette_graph::catalog::Catalog;
use maquette_graph::constants::in_plain_numbers;
use maquette_graph::load::{check_file, load_text};
use maquette_graph::tree::entries;
use maquette_graph::{Files, Options};
use maquette_syntax::error::{Diagnostic, Span};
use maquette_syntax::{Body, ExpectedValue, Field, Kind, Token, Tree, parse, tokens};
use serde_json::Value as Json;

use super::format::{format_text, internal_error};

/// Returns the text of a graph file in its canonical form, without values that equal their defaults. All comments are kept. A file that is
/// not a graph, such as a `Patch` or a test, is only formatted.
///
/// # Errors
/// The text cannot be parsed.
pub fn minimal(
    path: &Path,
    text: &str,
    catalog: &Catalog,
    options: &Options,
) -> Result<String, Vec<Diagnostic>> {
    let form = format_text(path, text)?;
    let options = Options { files: Files::Ignored, ..options.clone() };
    let mut short = form.clone();
    // After all fields of a value have been removed, the value itself may equal its default, so repeat.
    loop {
        let cuts = removable_fields(path, &short, catalog, &options);
        if cuts.is_empty() {
            break;
        }
        short = format_text(path, &remove_fields(&short, &cuts))?;
    }
    if short == form {
        return Ok(form);
    }
    let [before, after] =
        [&form, &short].map(|text| load_text(path, text.clone(), catalog, &options));
    let is_same = match (&before.graph, &after.graph) {
        (Some(before), Some(after)) => before.has_the_same_parts(after),
        (None, None) => before.diagnostics.len() == after.diagnostics.len(),
        _ => false,
    };
    if is_same && sorted_comments(&form) == sorted_comments(&short) {
        return Ok(short);
    }
    Err(vec![internal_error(path, text, "the shorter text")])
}

/// Returns the spans of the fields that can be removed, each from the name of the field to the end of its value.
pub(super) fn removable_fields(
    path: &Path,
    text: &str,
    catalog: &Catalog,
    options: &Options,
) -> Vec<Span> {
    let (tree, _) = parse(text);
    let is_graph = tree.name().is_some_and(|name| name.text == "Graph");
    let (_, whole) = check_file(path, text.to_owned(), catalog, options);
    let Some(whole) = whole.filter(|_| is_graph) else { return Vec::new() };
    let parsed_nodes = whole.definition.parsed_nodes.iter();
    // All nodes of a `ForEach` have the same type.
    let schemas =
        parsed_nodes.filter_map(|it| Some((node_of_link(&it.name.text), it.what.schema()?)));
    let schemas: HashMap<&str, &Json> = schemas.collect();
    let mut search = Search { catalog, cuts: Vec::new() };
    let fields = tree.fields().unwrap_or_default();
    search.cut_empty(fields, &OMITTABLE_FIELDS);
    for (_, declaration) in ["inputs", "params"].into_iter().flat_map(|it| entries(fields, it)) {
        let declaration = declaration.call_of("Optional").unwrap_or(declaration);
        search.cut_empty(declaration.fields().unwrap_or_default(), &["doc"]);
    }
    for (name, node) in entries(fields, "nodes") {
        let Some(schema) = schemas.get(name) else { continue };
        match node.name() {
            Some(kind) if kind.text == "ForEach" => search.search_for_each(node, schema),
            _ => search.search_value(
                &in_plain_numbers(node, schema),
                &ExpectedValue::for_node("", schema),
            ),
        }
    }
    search.cuts
}

struct Search<'a> {
    catalog: &'a Catalog,
    cuts: Vec<Span>,
}

impl Search<'_> {
    fn cut(&mut self, field: &Field) {
        self.cuts.push(Span { start: field.name.span.start, end: field.value.span.end });
    }

    /// Marks those of `fields` for removal that have one of the given names and an empty value.
    fn cut_empty(&mut self, fields: &[Field], names: &[&str]) {
        for field in fields.iter().filter(|field| names.contains(&&field.name.text[..])) {
            if is_empty(&field.value) {
                self.cut(field);
            }
        }
    }

    fn is_default(&self, field: &Field, expected: &ExpectedValue<'_>) -> bool {
        let name = &field.name.text[..];
        let required = expected.schema.get("required").and_then(Json::as_array);
        let is_required = required.into_iter().flatten().any(|it| it.as_str() == Some(name));
        let schema = expected.schema.get("properties").and_then(|all| all.get(name));
        schema
            .filter(|_| !is_required)
            .is_some_and(|schema| is_default(&field.value, schema, expected.root, self.catalog))
    }

    /// Finds the fields that equal their defaults in a value whose numbers are plain.
    fn search_value(&mut self, tree: &Tree, expected: &ExpectedValue<'_>) {
        match &tree.kind {
            Kind::List(items) => self.search_items(items, |k| expected.item(k)),
            Kind::Map(entries) => {
                if let Some(expected) = expected.entry() {
                    entries.iter().for_each(|(_, value)| self.search_value(value, &expected));
                }
            }
            Kind::Call { name, body } => {
                let inside = match name {
                    Some(name) => expected.variant_content(&name.text),
                    None => Some(expected.clone()),
                };
                let Some(inside) = inside else { return };
                match body {
                    Body::Empty => {}
                    Body::Items(items) if name.is_some() => {
                        self.search_items(items, |k| inside.argument(k));
                    }
                    Body::Items(items) => self.search_items(items, |k| inside.item(k)),
                    Body::Fields(fields) => self.search_fields(fields, &inside, |_| false),
                }
            }
            _ => {}
        }
    }

    fn search_items<'e>(
        &mut self,
        items: &[Tree],
        expected: impl Fn(usize) -> Option<ExpectedValue<'e>>,
    ) {
        for (index, item) in items.iter().enumerate() {
            if let Some(expected) = expected(index) {
                self.search_value(item, &expected);
            }
        }
    }

    fn search_fields(
        &mut self,
        fields: &[Field],
        expected: &ExpectedValue<'_>,
        is_kept: impl Fn(&Field) -> bool,
    ) {
        for field in fields {
            if !is_kept(field) && self.is_default(field, expected) {
                self.cut(field);
            } else if let Some(expected) = expected.field(&field.name.text) {
                self.search_value(&field.value, &expected);
            }
        }
    }

    /// Finds the fields that equal their defaults in a `ForEach`.
    fn search_for_each(&mut self, tree: &Tree, schema: &Json) {
        let fields = tree.fields().unwrap_or_default();
        let expected = ExpectedValue::for_node("", schema);
        fn group(name: &str, fields: &[Field], schema: &Json) -> Option<Tree> {
            let field = fields.iter().find(|field| field.name.text == name);
            field.map(|field| in_plain_numbers(&field.value, schema))
        }
        self.cut_empty(fields, &["with", "links", "carry"]);
        fields.iter().filter(|field| is_default_most(field)).for_each(|field| self.cut(field));
        let with = group("with", fields, schema);
        let with = with.as_ref().and_then(Tree::fields).unwrap_or_default();
        self.search_fields(with, &expected, |_| false);
        // An element must state a default explicitly if `with` sets the field to another value.
        let others: Vec<_> = with.iter().filter(|it| !self.is_default(it, &expected)).collect();
        if let Some(Kind::List(elements)) =
            fields.iter().find(|field| field.name.text == "over").map(|field| &field.value.kind)
        {
            for element in elements {
                let element = in_plain_numbers(element, schema);
                self.search_fields(element.fields().unwrap_or_default(), &expected, |field| {
                    others.iter().any(|it| it.name.text == field.name.text)
                });
            }
        }
    }
}

/// Removes the fields at the spans `cuts` from a text, with their commas and empty lines. Comments inside of the fields are kept.
fn remove_fields(text: &str, cuts: &[Span]) -> String {
    let mut result = String::with_capacity(text.len());
    // `is_behind` is true until the comma of a removed field has been removed; `is_blank` is true while the line of that field is empty.
    let (mut is_behind, mut is_blank) = (false, false);
    for (token, span) in tokens(text) {
        let word = &text[span.start..span.end];
        let is_cut = cuts.iter().any(|cut| cut.start <= span.start && span.end <= cut.end);
        match token {
            Token::LineComment | Token::BlockComment => {
                is_blank = false;
                result.push_str(word);
                if token == Token::LineComment && is_cut {
                    result.push('\n');
                }
            }
            _ if is_cut => {
                is_blank |= !is_behind && result.trim_end_matches(' ').ends_with('\n');
                is_behind = true;
            }
            Token::Space => {
                let rest = word.split_once('\n').filter(|_| is_blank);
                is_blank &= rest.is_none();
                result.push_str(rest.map_or(word, |(_, rest)| rest));
            }
            Token::Comma if is_behind => is_behind = false,
            _ => {
                (is_behind, is_blank) = (false, false);
                result.push_str(word);
            }
        }
    }
    result
}

fn sorted_comments(text: &str) -> Vec<&str> {
    let comments = tokens(text)
        .into_iter()
        .filter(|(token, _)| matches!(token, Token::LineComment | Token::BlockComment));
    let mut comments: Vec<_> = comments.map(|(_, at)| text[at.start..at.end].trim_end()).collect();
    comments.sort_unstable();
    comments
}
