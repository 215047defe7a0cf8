//! Chooses the names for an extracted graph: its file, its node type, and the node that uses it.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use maquette_graph::options::folder_of;
use maquette_graph::{EditError, is_type_name};
use maquette_syntax::error::{Span, code};
use maquette_syntax::paths::{folder_of_new, path_between};
use maquette_syntax::with_article;

use super::{Editor, Extraction, ParsedGraph, edit_error, free_name};
use crate::check_name;

/// The names for an extracted graph: its file, its node type, and the node that uses it.
pub(super) struct NewGraph {
    pub(super) path: PathBuf,
    /// The path of the new file, relative to the folder of the original graph, as it is written in that graph.
    pub(super) given: String,
    pub(super) kind: String,
    pub(super) name: String,
}

impl NewGraph {
    /// Chooses the names that the user has not given.
    ///
    /// # Errors
    /// A given name is taken or invalid.
    pub(super) fn new(
        editor: &Editor<'_>,
        known: &ParsedGraph,
        set: &BTreeSet<usize>,
        extraction: &Extraction,
    ) -> Result<Self, EditError> {
        let Extraction { to, kind, name, .. } = extraction;
        let nodes = known.entries("nodes");
        let last = set.last().and_then(|&at| nodes[at].0.text()).unwrap_or_default();
        let of_file = to.as_ref().and_then(|to| to.file_stem()).map(|stem| stem.to_string_lossy());
        let stem = of_file.map(|stem| stem.into_owned()).or_else(|| name.clone());
        let stem =
            stem.or_else(|| kind.as_deref().map(node_name_from)).unwrap_or_else(|| last.to_owned());
        let stem = match to {
            Some(_) => stem,
            None => free_name(
                [stem],
                |stem, nth| format!("{stem}-{nth}"),
                |stem| !editor.has_file(&sibling_file(stem, editor.path)),
            ),
        };
        let path = to.clone().unwrap_or_else(|| sibling_file(&stem, editor.path));
        if path.extension().is_none_or(|ending| ending != "ron") {
            let message = format!("`{}` cannot be the file of a graph", path.display());
            return name_error(message, "use the extension .ron");
        }
        let file = folder_of_new(&path).join(path.file_name().unwrap_or_default());
        let given = path_between(&folder_of_new(editor.path), &file);
        let in_place = folder_of(editor.path).join(&given);
        let own = folder_of_new(editor.path).join(editor.path.file_name().unwrap_or_default());
        if file == own || [&path, &file, &in_place].into_iter().any(|path| editor.has_file(path)) {
            let message = format!("`{}` is there already", path.display());
            return name_error(message, "name a file that does not exist yet");
        }
        let is_free = |kind: &str| {
            !is_reserved(kind) && !editor.catalog.has(kind) && known.position("use", kind).is_none()
        };
        let kind = match kind {
            Some(kind) if !is_type_name(kind) => {
                let message = format!("`{kind}` cannot be the name of a node type");
                return name_error(message, "use a capital letter followed by letters and digits");
            }
            Some(kind) if !is_free(kind) => {
                let message = format!("there is already a node type `{kind}`");
                return name_error(message, "give it another name");
            }
            Some(kind) => kind.clone(),
            None => free_name([type_name_from(&stem)], |kind, nth| format!("{kind}{nth}"), is_free),
        };
        let is_free = |name: &str| {
            let at = known.position("nodes", name);
            at.is_none_or(|at| set.contains(&at)) && known.position("inputs", name).is_none()
        };
        let name = match name {
            Some(name) => {
                check_name(name, "a node")?;
                if !is_free(name) {
                    let what =
                        if known.position("nodes", name).is_some() { "node" } else { "input" };
                    let message = format!("there is already {} `{name}`", with_article(what));
                    return name_error(message, "give the new node another name");
                }
                name.clone()
            }
            None => {
                free_name([node_name_from(&kind)], |name, nth| format!("{name}-{nth}"), is_free)
            }
        };
        Ok(Self { path, given, kind, name })
    }
}

fn name_error(message: String, help: &str) -> Result<NewGraph, EditError> {
    Err(edit_error(code::BAD_NAME, Span::default(), message, help))
}

/// Returns the path of the file `stem.ron` in the folder of the graph.
fn sibling_file(stem: &str, graph: &Path) -> PathBuf {
    graph.with_file_name(format!("{stem}.ron"))
}

/// Returns true for words that have a special meaning in graph files and cannot be the name of a node type.
fn is_reserved(kind: &str) -> bool {
    matches!(kind, "ForEach" | "Switch" | "Graph" | "Patch")
}

/// Converts the name of a node to the name of a node type: `nose-bump` to `NoseBump`.
fn type_name_from(name: &str) -> String {
    let words = name.split(|c: char| !c.is_ascii_alphanumeric());
    let words = words.filter_map(|word| {
        let first = word.get(..1)?;
        Some(first.to_ascii_uppercase() + &word[1..])
    });
    let kind = String::from_iter(words);
    if is_type_name(&kind) { kind } else { format!("Part{kind}") }
}

/// Converts the name of a node type to the name of a node: `NoseBump` to `nose-bump`.
fn node_name_from(kind: &str) -> String {
    let mut name = String::new();
    for (at, c) in kind.char_indices() {
        if at > 0 && c.is_ascii_uppercase() {
            name.push('-');
        }
        name.push(c.to_ascii_lowercase());
    }
    name
}
