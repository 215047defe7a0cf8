//! Values that are set in a patch but are a part of what the other graph has: an item of a list, or the draft of a value. A patch names
//! no such part, so it gets all of the value that has it.

use maquette_graph::element::written;
use maquette_graph::load::first;
use maquette_graph::place::{Found, Refusal, field, find, place};
use maquette_graph::quality::{is_draft, is_side};
use maquette_graph::splice::{Splice, apply};
use maquette_graph::tree::is_patch;
use maquette_graph::{Files, Options};
use maquette_syntax::error::Span;
use maquette_syntax::{Kind, Tree, parse};

use super::Judge;

impl Judge<'_> {
    /// The edits that put a value to its place in a text, and what stands there now.
    pub(super) fn put(
        &self,
        text: &str,
        target: &str,
        value: &str,
    ) -> Result<(Vec<Splice>, Option<String>), Refusal> {
        let draft = self.options.draft;
        let put = |target: &str, value: &str| place(text, target, value, false, draft);
        let (patch, _) = parse(text);
        let patched = if is_patch(&patch) { self.patched(text) } else { None };
        let Some(patched) = patched else { return put(target, value) };
        let (tree, _) = parse(&patched);
        let in_graph = || {
            place(&patched, target, value, false, draft)
                .map_err(|refusal| Refusal { span: Span::default(), ..refusal })
        };
        let Some(part) = Part::of(&tree, target) else {
            // What is not there has no items.
            let refusal = in_graph().err().filter(|_| is_item(target));
            return refusal.map_or_else(|| put(target, value), Err);
        };
        let is_named = part.is_draft_named || !draft || is_draft(&parse(value).0);
        let direct = put(target, value);
        if direct.is_ok() && !is_item(target) && is_named {
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

    /// The target by the names of the text, or of the graph that is patched; see [`written`].
    pub(super) fn written(&self, text: &str, target: &str) -> Result<String, Refusal> {
        let (tree, _) = parse(text);
        let patched = (is_patch(&tree) && target.contains('/')).then(|| self.patched(text));
        match patched.flatten() {
            Some(patched) => written(&parse(&patched).0, target, self.options.draft)
                .map_err(|refusal| Refusal { span: Span::default(), ..refusal }),
            None => written(&tree, target, self.options.draft),
        }
    }

    /// The text of the graph that a patch makes.
    pub(super) fn patched(&self, text: &str) -> Option<String> {
        let options = Options { files: Files::Ignored, ..self.options.clone() };
        let (_, whole) = first(self.path, text.to_owned(), self.catalog, &options);
        Some(whole?.definition.sheet.source.text.clone())
    }
}

/// What of a graph a target leads to or into, as far as a patch can name it.
struct Part<'t> {
    /// The name of it.
    owner: String,
    tree: &'t Tree,
    /// Whether it is a `Draft`, of which the target names a side.
    is_draft_named: bool,
    /// The target in its draft.
    of_draft: String,
}

impl<'t> Part<'t> {
    fn of(graph: &'t Tree, target: &str) -> Option<Self> {
        let (section, name, path) = match target.split_once('.') {
            Some((node, path)) => ("nodes", node, path.split('.').collect::<Vec<_>>()),
            None => ("params", target, vec!["default"]),
        };
        let Kind::Map(entries) = &field(graph, section)?.value.kind else { return None };
        let mut tree = &entries.iter().find(|(key, _)| key.text() == Some(name))?.1;
        let mut count = 0;
        for step in &path {
            let inside = (!is_draft(tree) && is_word(step)).then(|| find(tree, &[*step], None));
            let Some(Ok(Found::Value(inside))) = inside else { break };
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

/// Whether a patch has an entry of its own for what lies in this.
fn has_entry(patch: &Tree, owner: &str) -> bool {
    let Some(Kind::Map(entries)) = field(patch, "nodes").map(|field| &field.value.kind) else {
        return false;
    };
    entries.iter().any(|(key, _)| key.text() == Some(owner))
}

/// Whether a target ends at an item of a list.
fn is_item(target: &str) -> bool {
    target.rsplit_once('.').is_some_and(|(_, last)| !is_word(last))
}

/// Whether a step can be the name of a field.
fn is_word(step: &str) -> bool {
    step.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && step.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}
