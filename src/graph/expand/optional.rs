//! Removes links to the optional inputs that are omitted when a graph is used.
//!
//! The fields of a node are read again without such a link. The node then has the same cache key as a node that never had the link.

use std::collections::HashMap;

use maquette_syntax::error::Span;
use maquette_syntax::{Body, Field, Kind, Tree};

use super::Scope;
use crate::definition::{Definition, ParsedNode};

/// The positions of links to omitted inputs. The value is true if the link is at a port that takes a list of links.
pub(super) type AbsentLinks = HashMap<Span, bool>;

/// Returns those links of a node that lead to omitted inputs.
pub(super) fn absent_links(
    definition: &Definition,
    parsed: &ParsedNode,
    scope: &Scope,
) -> AbsentLinks {
    let links = parsed.links.iter().zip(&parsed.targets);
    let absent = links.filter(|(_, targets)| {
        targets.iter().flatten().any(|&(node, _)| {
            definition.parsed_nodes[node].is_optional
                && scope.inputs.get(node).is_none_or(Option::is_none)
        })
    });
    absent.map(|(link, _)| (link.span, link.is_list)).collect()
}

/// Removes links from the fields of a node. A field of a port that takes a single link is removed. In a port that takes a list, only the
/// item is removed.
pub(super) fn without_links(tree: &Tree, gone: &AbsentLinks) -> Tree {
    if gone.is_empty() {
        return tree.clone();
    }
    fn is_absent(tree: &Tree, gone: &HashMap<Span, bool>) -> Option<bool> {
        let link = tree.call_of("Some").unwrap_or(tree);
        gone.get(&link.span).copied().filter(|_| link.text().is_some())
    }
    fn items(items: &[Tree], gone: &HashMap<Span, bool>) -> Vec<Tree> {
        let kept = items.iter().filter(|item| is_absent(item, gone).is_none());
        kept.map(|item| without_links(item, gone)).collect()
    }
    let kind = match &tree.kind {
        Kind::Call { name, body: Body::Fields(fields) } => {
            let kept = fields.iter().filter_map(|field| {
                let value = match is_absent(&field.value, gone) {
                    None => without_links(&field.value, gone),
                    // A port that takes a list has a single link without brackets.
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
