//! The fields of a graph that have a value for a first look.

use std::collections::HashMap;

use maquette_syntax::{Body, Kind, Tree, parse};

use crate::Graph;
use crate::quality::{is_draft, side};
use crate::tree::{entries, joined, show};

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
pub(crate) fn collect(tree: &Tree, path: &str, found: &mut Vec<DraftField>) {
    if is_draft(tree) {
        fn text(draft: bool, tree: &Tree) -> String {
            side(tree, draft).map_or(String::new(), show)
        }
        found.push(DraftField {
            field: path.to_owned(),
            sides: [text(false, tree), text(true, tree)],
        });
        return;
    }
    fn inside(step: &str, tree: &Tree, path: &str, found: &mut Vec<DraftField>) {
        collect(tree, &joined(path, step), found)
    }
    match &tree.kind {
        Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
            items
                .iter()
                .enumerate()
                .for_each(|(index, item)| inside(&index.to_string(), item, path, found));
        }
        Kind::Call { body: Body::Fields(fields), .. } => {
            fields.iter().for_each(|field| inside(&field.name.text, &field.value, path, found));
        }
        Kind::Map(entries) => {
            for (key, value) in entries {
                inside(key.text().unwrap_or_default(), value, path, found);
            }
        }
        _ => {}
    }
}
