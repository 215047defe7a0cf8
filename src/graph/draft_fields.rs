//! The fields of a graph whose values contain a `Draft(..)`.

use std::collections::HashMap;

use maquette_syntax::{Body, Kind, Tree, parse};

use crate::Graph;
use crate::draft_value::{is_draft, side};
use crate::tree::{entries, join_path, show};

/// A `Draft(..)` in a field of a node, with its values as text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DraftField {
    /// The dotted path of the field: `select.distance`.
    pub field: String,
    /// The value for final results and the value for drafts.
    pub sides: [String; 2],
}

impl Graph {
    /// Returns the `Draft(..)` values in the fields of the graph's own nodes, by the names of the nodes.
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

/// Collects the `Draft(..)` values in a value and in its parts; `path` is the path of the value.
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
    match &tree.kind {
        Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
            for (index, item) in items.iter().enumerate() {
                collect(item, &join_path(path, &index.to_string()), found);
            }
        }
        Kind::Call { body: Body::Fields(fields), .. } => {
            for field in fields {
                collect(&field.value, &join_path(path, &field.name.text), found);
            }
        }
        Kind::Map(entries) => {
            for (key, value) in entries {
                collect(value, &join_path(path, key.text().unwrap_or_default()), found);
            }
        }
        _ => {}
    }
}
