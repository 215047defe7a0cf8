//! Paths in a text that goes to another folder.

use std::collections::{BTreeSet, HashMap};
use std::path::Path;
use std::sync::Arc;

use maquette_syntax::error::Span;
use maquette_syntax::paths::{path_between, without_dots};
use maquette_syntax::{Origin, Tree, Walk, parse, quoted};

use super::definition::Definition;
use super::quality::side;
use super::top::name_of;
use super::{Splice, apply, field};
use crate::definition::{Draft, What};
use crate::tree::entries;

/// A path that is relative to one folder, relative to another one.
fn rebased(given: &str, from: &Path, to: &Path) -> String {
    if from == to || given.is_empty() {
        return given.to_owned();
    }
    path_between(to, &without_dots(&from.join(given)))
}

/// The text in an entry of `use` that is the path of a graph.
pub fn path_of_use(value: &Tree) -> Option<&Tree> {
    let value = value.call_of("Graph").unwrap_or(value);
    let path = field(value, "path").map_or(value, |field| &field.value);
    path.text().map(|_| path)
}

/// The text of a definition with paths that are relative to another folder, of files and of graphs that it uses. Those of a patched
/// graph are relative to several folders.
pub(super) fn seen_from(definition: &Definition, to: &Path) -> String {
    let sheet = &definition.sheet;
    let (text, tree) = (&sheet.source.text, &definition.tree);
    let uses = entries(tree.fields().unwrap_or_default(), "use");
    let uses = uses.filter_map(|(_, value)| Some(path_of_use(value)?.span));
    let places = files(definition).into_iter().chain(uses);
    let paths = places.filter_map(|span| rebased_at(text, span, sheet.folder_of(span), to));
    apply(text, paths.collect())
}

/// The places of all texts in nodes, and of defaults of parameters, that are paths of files.
pub fn files(definition: &Definition) -> BTreeSet<Span> {
    let mut files = Files::default().of(definition);
    for (_, declaration) in entries(definition.tree.fields().unwrap_or_default(), "params") {
        let Some(default) = field(declaration, "default").map(|field| &field.value) else {
            continue;
        };
        // Of a `Draft` both sides are.
        if files.iter().any(|at| default.span.start <= at.start && at.end <= default.span.end) {
            let sides = [false, true].into_iter().filter_map(|draft| side(default, draft));
            files.extend(sides.map(|side| side.span));
        }
    }
    files
}

/// The edit of a path that leads to the same file from another folder, if that is another path.
pub fn rebased_at(text: &str, span: Span, from: &Path, to: &Path) -> Option<Splice> {
    let given = parse(&text[span.start..span.end]).0.text()?.to_owned();
    let path = rebased(&given, from, to);
    (path != given).then(|| (span, quoted(&path)))
}

/// Finds texts that are paths of files; each graph that others use is looked at once.
#[derive(Default)]
struct Files(HashMap<*const Definition, BTreeSet<Span>>);

impl Files {
    fn of(&mut self, definition: &Definition) -> BTreeSet<Span> {
        let drafts = definition.drafts.iter();
        drafts.flat_map(|draft| self.of_draft(definition, draft)).collect()
    }

    fn of_draft(&mut self, definition: &Definition, draft: &Draft) -> Vec<Span> {
        let Some(schema) = draft.what.schema() else { return Vec::new() };
        let mut found = Vec::new();
        for values in [definition.defaults.clone(), definition.defaults.of_other_side()] {
            let tree = values.fitted(&draft.tree, draft.what.kind(), schema, &mut Vec::new());
            let mut walk = Walk {
                node: draft.what.kind(),
                root: schema,
                sheet: None,
                findings: Vec::new(),
                links: Vec::new(),
                files: Vec::new(),
            };
            walk.node(&tree);
            found.extend(walk.files.into_iter().map(|file| file.at));
            let What::Use(_, graph) = &draft.what else { continue };
            let fields = tree.fields().unwrap_or_default().iter();
            let texts = fields.filter(|field| field.value.text().is_some());
            let files = texts.filter(|field| self.takes_file(graph, &field.name.text));
            found.extend(files.map(|field| written_at(&field.value)));
        }
        found
    }

    /// Whether what a field of a use is given goes on to where a file is named.
    fn takes_file(&mut self, graph: &Arc<Definition>, field: &str) -> bool {
        let known = Arc::as_ptr(graph);
        if !self.0.contains_key(&known) {
            let inside = self.of(graph);
            self.0.insert(known, inside);
        }
        let name = name_of(field);
        let declared = graph.declared.iter().find(|declared| declared.name == name);
        declared.is_some_and(|it| self.0[&known].contains(&written_at(&it.default)))
    }
}

/// Where a value is written in its own file: itself, or the default of the parameter that it comes from.
fn written_at(value: &Tree) -> Span {
    match value.origin {
        Some(Origin::Default(at)) => at,
        _ => value.span,
    }
}
