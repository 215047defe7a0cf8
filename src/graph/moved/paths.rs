//! Paths in a text that goes to another folder.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::Known;
use crate::error::Span;
use crate::graph::definition::Definition;
use crate::graph::draft::{Draft, What};
use crate::graph::edit::{Splice, field, quoted};
use crate::paths::without_dots;
use crate::text::{Origin, Tree, Walk, parse};

/// The folder of a file that may not be there yet, without links and dots.
pub(in crate::graph) fn folder_of_new(file: &Path) -> PathBuf {
    let file = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    let folder = file.parent().unwrap_or(&file);
    let there = folder.ancestors().find_map(|folder| {
        let real = std::fs::canonicalize(folder).ok()?;
        Some((real, folder))
    });
    let Some((real, there)) = there else { return without_dots(folder) };
    without_dots(&real.join(folder.strip_prefix(there).unwrap_or(Path::new(""))))
}

/// The path that leads from a folder to a file, both without dots.
pub(in crate::graph) fn path_between(folder: &Path, file: &Path) -> String {
    let common = folder.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(common).map(|_| "..".to_owned());
    let down = file.components().skip(common);
    let down = down.map(|part| part.as_os_str().to_string_lossy().into_owned());
    Vec::from_iter(up.chain(down)).join("/")
}

/// A path that is relative to one folder, relative to another one.
fn rebased(given: &str, from: &Path, to: &Path) -> String {
    if from == to || given.is_empty() {
        return given.to_owned();
    }
    path_between(to, &without_dots(&from.join(given)))
}

/// The text in an entry of `use` that is the path of a graph.
pub(in crate::graph) fn path_of_use(value: &Tree) -> Option<&Tree> {
    let value = value.call_of("Graph").unwrap_or(value);
    let path = field(value, "path").map_or(value, |field| &field.value);
    path.text().map(|_| path)
}

impl Known {
    /// The places of all texts in nodes, and of defaults of parameters, that are paths of files.
    pub(in crate::graph) fn files(&self) -> BTreeSet<Span> {
        files(self.definition())
    }

    /// The edits of paths in these places that lead to the same files from another folder.
    pub(in crate::graph) fn rebased(
        &self,
        places: impl IntoIterator<Item = Span>,
        from: &Path,
        to: &Path,
    ) -> Vec<Splice> {
        let path = |span: Span| {
            let given = parse(self.slice(span)).0.text()?.to_owned();
            let path = rebased(&given, from, to);
            (path != given).then(|| (span, quoted(&path)))
        };
        places.into_iter().filter_map(path).collect()
    }
}

fn files(definition: &Definition) -> BTreeSet<Span> {
    definition.drafts.iter().flat_map(|draft| files_of(definition, draft)).collect()
}

/// The places of texts that name files for a draft.
fn files_of(definition: &Definition, draft: &Draft) -> Vec<Span> {
    let mut found = Vec::new();
    let sides = [definition.defaults.clone(), definition.defaults.of_other_side()];
    for values in sides {
        let Some(schema) = draft.what.schema() else { continue };
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
        found.extend(walk.files.into_iter().filter(|file| file.from.is_none()).map(|it| it.at));
        if let What::Use(_, graph) = &draft.what {
            // A text that goes on to where a file is named.
            let inside = files(graph);
            let is_file = |name: &str| {
                let mut declared = graph.declared.iter();
                declared.any(|it| it.name == name && holds_one(&it.default, &inside))
            };
            let fields = tree.fields().unwrap_or_default().iter();
            let given = fields.filter(|field| is_file(&field.name.text)).map(|field| &field.value);
            found.extend(given.filter(|value| value.text().is_some()).map(written_at));
        }
    }
    found
}

/// Where a value is written in its own file: itself, or the default of the parameter that it comes from.
fn written_at(value: &Tree) -> Span {
    match value.origin {
        Some(Origin::Default(at)) => at,
        _ => value.span,
    }
}

fn holds_one(default: &Tree, files: &BTreeSet<Span>) -> bool {
    files.contains(&written_at(default))
}
