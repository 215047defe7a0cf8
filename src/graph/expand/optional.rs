//! Links to inputs that a use leaves out.
//!
//! The node is read again without such a link, so that its key is that of a node that is written without it.

use std::collections::HashMap;

use maquette_syntax::error::Span;
use maquette_syntax::{Body, Field, Kind, Tree};

use super::Scope;
use crate::definition::{Definition, Draft};

/// The places of links that are left out, and whether each is at a port that takes many.
pub(super) type Absent = HashMap<Span, bool>;

/// The links of a draft to inputs that are left out, by their places.
pub(super) fn absent(definition: &Definition, draft: &Draft, scope: &Scope) -> Absent {
    let links = draft.links.iter().zip(&draft.targets);
    let absent = links.filter(|(_, targets)| {
        targets.iter().flatten().any(|&(node, _)| {
            definition.drafts[node].is_optional
                && scope.inputs.get(node).is_none_or(Option::is_none)
        })
    });
    absent.map(|(link, _)| (link.span, link.many)).collect()
}

/// A node's fields without these links: one at a port of its own goes with its field, one in a list leaves the others there.
pub(super) fn without_links(tree: &Tree, gone: &Absent) -> Tree {
    if gone.is_empty() {
        return tree.clone();
    }
    fn is_gone(tree: &Tree, gone: &HashMap<Span, bool>) -> Option<bool> {
        let link = tree.call_of("Some").unwrap_or(tree);
        gone.get(&link.span).copied().filter(|_| link.text().is_some())
    }
    fn items(items: &[Tree], gone: &HashMap<Span, bool>) -> Vec<Tree> {
        let kept = items.iter().filter(|item| is_gone(item, gone).is_none());
        kept.map(|item| without_links(item, gone)).collect()
    }
    let kind = match &tree.kind {
        Kind::Call { name, body: Body::Fields(fields) } => {
            let kept = fields.iter().filter_map(|field| {
                let value = match is_gone(&field.value, gone) {
                    None => without_links(&field.value, gone),
                    // The only link of a list.
                    Some(true) => Tree::new(field.value.span, Kind::List(Vec::new())),
                    Some(false) => return None,
                };
                Some(Field { name: field.name.clone(), value })
            });
            Kind::Call { name: name.clone(), body: Body::Fields(kept.collect()) }
        }
        Kind::Call { name, body: Body::Items(list) } => {
            Kind::Call { name: name.clone(), body: Body::Items(items(list, gone)) }
        }
        Kind::List(list) => Kind::List(items(list, gone)),
        plain => plain.clone(),
    };
    Tree { kind, ..tree.clone() }
}
