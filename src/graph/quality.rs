//! `Draft(final: 4, draft: 1)`: a value for final results, and one for a first look.

use std::collections::HashMap;

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Body, Field, Finding, Help, Kind, Name, Tree, nearest_or_all, parse};

use super::Graph;
use super::diff::joined;
use super::meaning::{entries, show};

/// The fields of a `Draft`: of final runs, and of drafts.
const SIDES: [&str; 2] = ["final", "draft"];

/// Whether a value is a `Draft(..)`.
pub fn is_draft(tree: &Tree) -> bool {
    matches!(&tree.kind, Kind::Call { name: Some(name), .. } if name.text == "Draft")
}

/// A `Draft(..)` of what its sides have, by their names.
pub(super) fn draft_of(value: impl Fn(&str) -> Tree) -> Tree {
    let name = |text: &str| Name { text: text.to_owned(), span: Span::default() };
    let fields = SIDES.map(|side| Field { name: name(side), value: value(side) });
    let kind = Kind::Call { name: Some(name("Draft")), body: Body::Fields(fields.to_vec()) };
    Tree::new(Span::default(), kind)
}

/// Whether a part of the value is a `Draft(..)`.
pub fn has_draft(tree: &Tree) -> bool {
    is_draft(tree)
        || match &tree.kind {
            Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
                items.iter().any(has_draft)
            }
            Kind::Call { body: Body::Fields(fields), .. } => {
                fields.iter().any(|field| has_draft(&field.value))
            }
            Kind::Map(entries) => entries.iter().any(|(_, value)| has_draft(value)),
            _ => false,
        }
}

/// Whether a word names a field of a `Draft`.
pub fn is_side(word: &str) -> bool {
    SIDES.contains(&word)
}

/// What a `Draft` has for drafts, or for final results; none if that is not there.
pub fn side(tree: &Tree, draft: bool) -> Option<&Tree> {
    let wanted = SIDES[usize::from(draft)];
    let found = tree.fields()?.iter().find(|field| field.name.text == wanted);
    found.map(|field| &field.value)
}

/// A `Draft(..)` that stands in a field of a node, as text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DraftField {
    /// The way there: `select.distance`.
    pub field: String,
    /// What final results have, and what drafts have.
    pub sides: [String; 2],
}

impl Graph {
    /// The drafts in the fields of the nodes of its own file, by the nodes' names.
    pub fn draft_fields(&self) -> HashMap<String, Vec<DraftField>> {
        let (tree, _) = parse(&self.source.text);
        let nodes = entries(tree.fields().unwrap_or_default(), "nodes");
        let found = nodes.map(|(name, node)| {
            let mut found = Vec::new();
            collect(node, "", &mut found);
            (name.to_owned(), found)
        });
        found.filter(|(_, found)| !found.is_empty()).collect()
    }
}

/// The drafts in a value, to which this way leads.
fn collect(tree: &Tree, path: &str, found: &mut Vec<DraftField>) {
    if is_draft(tree) {
        let text = |draft| side(tree, draft).map_or(String::new(), show);
        found.push(DraftField { field: path.to_owned(), sides: [text(false), text(true)] });
        return;
    }
    let mut inside = |step: &str, tree: &Tree| collect(tree, &joined(path, step), found);
    match &tree.kind {
        Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
            items.iter().enumerate().for_each(|(index, item)| inside(&index.to_string(), item));
        }
        Kind::Call { body: Body::Fields(fields), .. } => {
            fields.iter().for_each(|field| inside(&field.name.text, &field.value));
        }
        Kind::Map(entries) => {
            for (key, value) in entries {
                inside(key.text().unwrap_or_default(), value);
            }
        }
        _ => {}
    }
}

/// The `Draft` with each of its values replaced.
pub(super) fn each_side(tree: &Tree, mut replaced: impl FnMut(&Tree) -> Tree) -> Tree {
    let Kind::Call { name, body: Body::Fields(fields) } = &tree.kind else { return tree.clone() };
    let field = |field: &Field| Field { name: field.name.clone(), value: replaced(&field.value) };
    let body = Body::Fields(fields.iter().map(field).collect());
    Tree { kind: Kind::Call { name: name.clone(), body }, ..tree.clone() }
}

/// The same of any value, which stands for itself if it is no `Draft`. What is wrong with the `Draft` goes to the findings; then it
/// has no value.
pub(super) fn chosen<'t>(
    tree: &'t Tree,
    draft: bool,
    findings: &mut Vec<Finding>,
) -> Option<&'t Tree> {
    if !is_draft(tree) {
        return Some(tree);
    }
    let mut find = |code, span, message: String, help: Help| {
        findings.push(Finding { code, span, message, help, note: None });
    };
    let Some(fields) = tree.fields() else {
        let message = "the values of a Draft have names".to_owned();
        find(code::WRONG_VALUE, tree.span, message, "write Draft(final: 4, draft: 1)".into());
        return None;
    };
    let unknown = fields.iter().filter(|field| !is_side(&field.name.text));
    let mut is_sound = true;
    for field in unknown {
        let word = &field.name.text;
        let help = nearest_or_all(word, "its fields", &SIDES);
        find(code::UNKNOWN_FIELD, field.name.span, format!("Draft has no field `{word}`"), help);
        is_sound = false;
    }
    if let Some(lacking) = SIDES.iter().find(|side| fields.iter().all(|f| f.name.text != **side))
        && is_sound
    {
        let message = format!("Draft needs a field `{lacking}`");
        find(code::MISSING_FIELD, tree.span, message, "write Draft(final: 4, draft: 1)".into());
        is_sound = false;
    }
    side(tree, draft).filter(|_| is_sound)
}
