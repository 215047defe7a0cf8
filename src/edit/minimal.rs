//! A graph's text without what would be the same if it were left out: `maquette fmt --minimal`.

use std::collections::HashMap;
use std::path::Path;

use maquette_graph::catalog::Catalog;
use maquette_graph::fitting::in_plain_numbers;
use maquette_graph::load::{first, load_text};
use maquette_graph::meaning::{EMPTY, is_default, is_empty, is_usual_most, named_node};
use maquette_graph::tree::entries;
use maquette_graph::{Files, Options};
use maquette_syntax::error::{Problem, Span};
use maquette_syntax::{Body, Expected, Field, Kind, Token, Tree, parse, tokens};
use serde_json::Value as Json;

use super::format::{fault, formatted};

/// A graph file's text in its canonical form, without values that are their defaults. Every comment is kept. What is no graph of its
/// own, as a `Patch` or a test, is only brought into its form.
///
/// # Errors
/// If the text cannot be read.
pub fn minimal(
    path: &Path,
    text: &str,
    catalog: &Catalog,
    options: &Options,
) -> Result<String, Vec<Problem>> {
    let form = formatted(path, text)?;
    let options = Options { files: Files::Ignored, ..options.clone() };
    let mut short = form.clone();
    // What has nothing left in it may be a default itself.
    loop {
        let cuts = cuts(path, &short, catalog, &options);
        if cuts.is_empty() {
            break;
        }
        short = formatted(path, &without(&short, &cuts))?;
    }
    if short == form {
        return Ok(form);
    }
    fn load(
        text: &str,
        options: &Options,
        path: &Path,
        catalog: &Catalog,
    ) -> maquette_graph::Checked {
        load_text(path, text.to_owned(), catalog, options)
    }
    let (before, after) =
        (load(&form, &options, path, catalog), load(&short, &options, path, catalog));
    let is_same = match (&before.graph, &after.graph) {
        (Some(before), Some(after)) => before.has_the_same_parts(after),
        (None, None) => before.problems.len() == after.problems.len(),
        _ => false,
    };
    if is_same && comments(&form) == comments(&short) {
        return Ok(short);
    }
    Err(vec![fault(path, text, "the shorter text")])
}

/// The fields that can be left out, by the places of their names and values.
pub(super) fn cuts(path: &Path, text: &str, catalog: &Catalog, options: &Options) -> Vec<Span> {
    let (tree, _) = parse(text);
    let is_graph = tree.name().is_some_and(|name| name.text == "Graph");
    let (_, whole) = first(path, text.to_owned(), catalog, options);
    let Some(whole) = whole.filter(|_| is_graph) else { return Vec::new() };
    let drafts = whole.definition.drafts.iter();
    // The nodes of a `ForEach` have one type.
    let schemas = drafts.filter_map(|it| Some((named_node(&it.name.text), it.what.schema()?)));
    let schemas: HashMap<&str, &Json> = schemas.collect();
    let mut search = Search { catalog, cuts: Vec::new() };
    let fields = tree.fields().unwrap_or_default();
    search.empty(fields, &EMPTY);
    for (_, declaration) in ["inputs", "params"].into_iter().flat_map(|it| entries(fields, it)) {
        let declaration = declaration.call_of("Optional").unwrap_or(declaration);
        search.empty(declaration.fields().unwrap_or_default(), &["doc"]);
    }
    for (name, node) in entries(fields, "nodes") {
        let Some(schema) = schemas.get(name) else { continue };
        match node.name() {
            Some(kind) if kind.text == "ForEach" => search.each(node, schema),
            _ => search.value(&in_plain_numbers(node, schema), &Expected::of_node("", schema)),
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

    /// Those of the fields with these names that hold nothing.
    fn empty(&mut self, fields: &[Field], names: &[&str]) {
        for field in fields.iter().filter(|field| names.contains(&&field.name.text[..])) {
            if is_empty(&field.value) {
                self.cut(field);
            }
        }
    }

    fn is_default(&self, field: &Field, expected: &Expected<'_>) -> bool {
        let name = &field.name.text[..];
        let required = expected.schema.get("required").and_then(Json::as_array);
        let is_required = required.into_iter().flatten().any(|it| it.as_str() == Some(name));
        let schema = expected.schema.get("properties").and_then(|all| all.get(name));
        schema
            .filter(|_| !is_required)
            .is_some_and(|schema| is_default(&field.value, schema, expected.root, self.catalog))
    }

    /// The defaults within a value; its numbers are plain.
    fn value(&mut self, tree: &Tree, expected: &Expected<'_>) {
        match &tree.kind {
            Kind::List(items) => self.items(items, |k| expected.item(k)),
            Kind::Map(entries) => {
                if let Some(expected) = expected.entry() {
                    entries.iter().for_each(|(_, value)| self.value(value, &expected));
                }
            }
            Kind::Call { name, body } => {
                let inside = match name {
                    Some(name) => expected.behind(&name.text),
                    None => Some(expected.clone()),
                };
                let Some(inside) = inside else { return };
                match body {
                    Body::Empty => {}
                    Body::Items(items) if name.is_some() => {
                        self.items(items, |k| inside.argument(k));
                    }
                    Body::Items(items) => self.items(items, |k| inside.item(k)),
                    Body::Fields(fields) => self.fields(fields, &inside, |_| false),
                }
            }
            _ => {}
        }
    }

    fn items<'e>(&mut self, items: &[Tree], expected: impl Fn(usize) -> Option<Expected<'e>>) {
        for (index, item) in items.iter().enumerate() {
            if let Some(expected) = expected(index) {
                self.value(item, &expected);
            }
        }
    }

    fn fields(
        &mut self,
        fields: &[Field],
        expected: &Expected<'_>,
        is_kept: impl Fn(&Field) -> bool,
    ) {
        for field in fields {
            if !is_kept(field) && self.is_default(field, expected) {
                self.cut(field);
            } else if let Some(expected) = expected.field(&field.name.text) {
                self.value(&field.value, &expected);
            }
        }
    }

    /// The defaults of the nodes of a `ForEach`.
    fn each(&mut self, tree: &Tree, schema: &Json) {
        let fields = tree.fields().unwrap_or_default();
        let expected = Expected::of_node("", schema);
        fn group(name: &str, fields: &[Field], schema: &Json) -> Option<Tree> {
            let field = fields.iter().find(|field| field.name.text == name);
            field.map(|field| in_plain_numbers(&field.value, schema))
        }
        self.empty(fields, &["with", "links", "carry"]);
        fields.iter().filter(|field| is_usual_most(field)).for_each(|field| self.cut(field));
        let with = group("with", fields, schema);
        let with = with.as_ref().and_then(Tree::fields).unwrap_or_default();
        self.fields(with, &expected, |_| false);
        // An element says a default where all others have something else.
        let others: Vec<_> = with.iter().filter(|it| !self.is_default(it, &expected)).collect();
        if let Some(Kind::List(elements)) =
            fields.iter().find(|field| field.name.text == "over").map(|field| &field.value.kind)
        {
            for element in elements {
                let element = in_plain_numbers(element, schema);
                self.fields(element.fields().unwrap_or_default(), &expected, |field| {
                    others.iter().any(|it| it.name.text == field.name.text)
                });
            }
        }
    }
}

/// The text without these fields, the commas behind them and their lines, but with the comments in them.
fn without(text: &str, cuts: &[Span]) -> String {
    let mut result = String::with_capacity(text.len());
    // Whether a field has just ended whose comma goes along, and whether its line is still empty.
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

/// The comments of a text, in the order of their words.
fn comments(text: &str) -> Vec<&str> {
    let comments = tokens(text)
        .into_iter()
        .filter(|(token, _)| matches!(token, Token::LineComment | Token::BlockComment));
    let mut comments: Vec<_> = comments.map(|(_, at)| text[at.start..at.end].trim_end()).collect();
    comments.sort_unstable();
    comments
}
