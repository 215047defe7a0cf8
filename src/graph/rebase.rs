//! Adapts the relative paths in the text of a graph that is moved to another folder.

use std::collections::{BTreeSet, HashMap};
use std::path::Path;
use std::sync::Arc;

use maquette_syntax::error::Span;
use maquette_syntax::paths::{path_between, without_dots};
use maquette_syntax::{Origin, Tree, Walk, parse, quote};

use super::definition::Definition;
use super::draft_value::side;
use super::header::name_of;
use super::{Splice, apply, field};
use crate::definition::{NodeKind, ParsedNode};
use crate::tree::entries;

/// Converts a path relative to the folder `from` into a path relative to the folder `to`.
fn rebase_path(given: &str, from: &Path, to: &Path) -> String {
    if from == to || given.is_empty() {
        return given.to_owned();
    }
    path_between(to, &without_dots(&from.join(given)))
}

/// Returns the path of the graph in an entry of the section `use`.
pub fn path_of_use(value: &Tree) -> Option<&Tree> {
    let value = value.call_of("Graph").unwrap_or(value);
    let path = field(value, "path").map_or(value, |field| &field.value);
    path.text().map(|_| path)
}

/// Returns the text of a definition with all paths relative to the folder `to`. The original paths of a patched graph may be relative to
/// several folders.
pub(super) fn text_relative_to(definition: &Definition, to: &Path) -> String {
    let source_map = &definition.source_map;
    let (text, tree) = (&source_map.source.text, &definition.tree);
    let uses = entries(tree.fields().unwrap_or_default(), "use");
    let uses = uses.filter_map(|(_, value)| Some(path_of_use(value)?.span));
    let places = files(definition).into_iter().chain(uses);
    let paths = places.filter_map(|span| rebase_edit(text, span, source_map.folder_of(span), to));
    apply(text, paths.collect())
}

/// Returns the positions of all paths of files, in fields of nodes and in defaults of parameters.
pub fn files(definition: &Definition) -> BTreeSet<Span> {
    let mut files = Files::default().find_in(definition);
    for (_, declaration) in entries(definition.tree.fields().unwrap_or_default(), "params") {
        let Some(default) = field(declaration, "default").map(|field| &field.value) else {
            continue;
        };
        // If one side of a `Draft` is a path, the other side is a path too.
        if files.iter().any(|at| default.span.start <= at.start && at.end <= default.span.end) {
            let sides = [false, true].into_iter().filter_map(|draft| side(default, draft));
            files.extend(sides.map(|side| side.span));
        }
    }
    files
}

/// Returns the edit that makes a path relative to the folder `to` instead of `from`. `None` if the path does not change.
pub fn rebase_edit(text: &str, span: Span, from: &Path, to: &Path) -> Option<Splice> {
    let given = parse(&text[span.start..span.end]).0.text()?.to_owned();
    let path = rebase_path(&given, from, to);
    (path != given).then(|| (span, quote(&path)))
}

/// Finds the texts in a graph that are paths of files. The result for each used graph is cached.
#[derive(Default)]
struct Files(HashMap<*const Definition, BTreeSet<Span>>);

impl Files {
    fn find_in(&mut self, definition: &Definition) -> BTreeSet<Span> {
        let parsed_nodes = definition.parsed_nodes.iter();
        parsed_nodes.flat_map(|parsed| self.find_in_node(definition, parsed)).collect()
    }

    fn find_in_node(&mut self, definition: &Definition, parsed: &ParsedNode) -> Vec<Span> {
        let Some(schema) = parsed.what.schema() else { return Vec::new() };
        let mut found = Vec::new();
        for values in [definition.defaults.clone(), definition.defaults.for_other_side()] {
            let tree =
                values.resolve_call(&parsed.tree, parsed.what.kind(), schema, &mut Vec::new());
            let mut walk = Walk {
                node: parsed.what.kind(),
                root: schema,
                source_map: None,
                diagnostics: Vec::new(),
                links: Vec::new(),
                files: Vec::new(),
            };
            walk.node(&tree);
            found.extend(walk.files.into_iter().map(|file| file.at));
            let NodeKind::Use(_, graph) = &parsed.what else { continue };
            let fields = tree.fields().unwrap_or_default().iter();
            let texts = fields.filter(|field| field.value.text().is_some());
            let files = texts.filter(|field| self.takes_file(graph, &field.name.text));
            found.extend(files.map(|field| source_span(&field.value)));
        }
        found
    }

    /// Returns true if a graph passes the value of its parameter `field` on to a field that takes the path of a file.
    fn takes_file(&mut self, graph: &Arc<Definition>, field: &str) -> bool {
        let known = Arc::as_ptr(graph);
        if !self.0.contains_key(&known) {
            let inside = self.find_in(graph);
            self.0.insert(known, inside);
        }
        let name = name_of(field);
        let declared = graph.declared.iter().find(|declared| declared.name == name);
        declared.is_some_and(|it| self.0[&known].contains(&source_span(&it.default)))
    }
}

/// Returns the position of a value in its own file. For the default of a parameter, that is the position of the default.
fn source_span(value: &Tree) -> Span {
    match value.origin {
        Some(Origin::Default(at)) => at,
        _ => value.span,
    }
}
