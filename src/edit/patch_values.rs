//! Setting a part of a value in a patch, such as an item of a list or the draft value of a field. A patch cannot refer to such a part, so
//! the whole value is copied from the patched graph into the patch.

use maquette_graph::draft_value::{is_draft, is_side};
use maquette_graph::element::target_in_file;
use maquette_graph::load::check_file;
use maquette_graph::place::{EditError, PathEnd, field, find, place_value};
use maquette_graph::splice::{Splice, apply};
use maquette_graph::tree::is_patch;
use maquette_graph::{Files, Options};
use maquette_syntax::error::Span;
use maquette_syntax::{Kind, Tree, parse};

use super::Editor;

impl Editor<'_> {
    /// Returns the edits that set a value at its target in a graph or patch, and the previous value.
    pub(super) fn put_value(
        &self,
        text: &str,
        target: &str,
        value: &str,
    ) -> Result<(Vec<Splice>, Option<String>), EditError> {
        let draft = self.options.draft;
        let put = |target: &str, value: &str| place_value(text, target, value, false, draft);
        let (patch, _) = parse(text);
        let patched = if is_patch(&patch) { self.patched_text(text) } else { None };
        let Some(patched) = patched else { return put(target, value) };
        let (tree, _) = parse(&patched);
        let in_graph = || {
            place_value(&patched, target, value, false, draft)
                .map_err(|error| EditError { span: Span::default(), ..error })
        };
        let Some(part) = Part::find(&tree, target) else {
            // A missing value has no items, so an item of it cannot be set.
            let error = in_graph().err().filter(|_| ends_at_item(target));
            return error.map_or_else(|| put(target, value), Err);
        };
        let is_named = part.is_draft_named || !draft || is_draft(&parse(value).0);
        let direct = put(target, value);
        if direct.is_ok() && !ends_at_item(target) && is_named {
            return direct;
        }
        if !is_named && is_draft(part.tree) && has_entry(&patch, &part.owner) {
            return put(&part.of_draft, value);
        }
        let (splices, before) = in_graph()?;
        let Span { start, end } = part.tree.span;
        let behind = patched.len() - end;
        let edited = apply(&patched, splices);
        let (splices, _) = put(&part.owner, &edited[start..edited.len() - behind])?;
        Ok((splices, before))
    }

    /// Translates a target to the names that the text or the patched graph contains; see [`target_in_file`].
    pub(super) fn target_in_file(&self, text: &str, target: &str) -> Result<String, EditError> {
        let (tree, _) = parse(text);
        let patched = (is_patch(&tree) && target.contains('/')).then(|| self.patched_text(text));
        match patched.flatten() {
            Some(patched) => target_in_file(&parse(&patched).0, target, self.options.draft)
                .map_err(|error| EditError { span: Span::default(), ..error }),
            None => target_in_file(&tree, target, self.options.draft),
        }
    }

    /// Returns the text of the graph that results from a patch. `None` if the patch has errors.
    pub(super) fn patched_text(&self, text: &str) -> Option<String> {
        let options = Options { files: Files::Ignored, ..self.options.clone() };
        let (_, whole) = check_file(self.path, text.to_owned(), self.catalog, &options);
        Some(whole?.definition.source_map.source.text.clone())
    }
}

/// The innermost value on the path of a target that a patch can set as a whole.
struct Part<'t> {
    /// The path of the value that the patch can set, as a patch contains it.
    owner: String,
    tree: &'t Tree,
    /// True if the value is a `Draft`, and the next step of the target is one of its sides, such as `draft`.
    is_draft_named: bool,
    /// The target, with the step `draft` inserted after the path of the value.
    of_draft: String,
}

impl<'t> Part<'t> {
    fn find(graph: &'t Tree, target: &str) -> Option<Self> {
        let (section, name, path) = match target.split_once('.') {
            Some((node, path)) => ("nodes", node, path.split('.').collect::<Vec<_>>()),
            None => ("params", target, vec!["default"]),
        };
        let Kind::Map(entries) = &field(graph, section)?.value.kind else { return None };
        let mut tree = &entries.iter().find(|(key, _)| key.text() == Some(name))?.1;
        let mut count = 0;
        for step in &path {
            let inside =
                (!is_draft(tree) && is_field_name(step)).then(|| find(tree, &[*step], None));
            let Some(Ok(PathEnd::Value(inside))) = inside else { break };
            (tree, count) = (inside, count + 1);
        }
        let (named, rest) = path.split_at_checked(count).filter(|_| 0 < count)?;
        let named = if section == "params" { &[] } else { named };
        let owner = [&[name], named].concat().join(".");
        let of_draft = [&[&owner[..], "draft"], rest].concat().join(".");
        Some(Self {
            tree,
            is_draft_named: rest.first().is_some_and(|step| is_side(step)),
            of_draft,
            owner,
        })
    }
}

/// Returns true if a patch already has an entry for the node or fields `owner`.
fn has_entry(patch: &Tree, owner: &str) -> bool {
    let Some(Kind::Map(entries)) = field(patch, "nodes").map(|field| &field.value.kind) else {
        return false;
    };
    entries.iter().any(|(key, _)| key.text() == Some(owner))
}

/// Returns true if the last step of a target is the number of an item in a list.
fn ends_at_item(target: &str) -> bool {
    target.rsplit_once('.').is_some_and(|(_, last)| !is_field_name(last))
}

/// Returns true if a step of a path can be the name of a field.
fn is_field_name(step: &str) -> bool {
    step.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && step.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}
