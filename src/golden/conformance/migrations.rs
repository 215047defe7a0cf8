//! Law 12: the old name in a migration (a rename of a node or field) does not exist, and the new name exists.

use maquette_graph::catalog::{Catalog, Entry};
use maquette_node::pack::{Migration, NewValue, Pack};

pub(super) fn check(pack: &Pack, catalog: &Catalog, broken: &mut Vec<String>) {
    for migration in pack.migrations {
        match *migration {
            Migration::Node { old, new } => {
                if catalog.has(old) {
                    broken.push(format!("{old} is called {new} now, but there is a node {old}"));
                }
                if present(new, pack, catalog).is_none() {
                    broken.push(format!("{old} is called {new} now, but there is no such node"));
                }
            }
            Migration::Field { node, old, new, value } => {
                let Some(entry) = present(node, pack, catalog) else {
                    broken
                        .push(format!("field {old} of {node} has changed, but there is no {node}"));
                    continue;
                };
                let name = new.split('.').next().unwrap_or_default();
                let is_kept = old == new && matches!(value, NewValue::Words(_));
                if has(entry, old) && !is_kept {
                    broken.push(format!(
                        "field {old} of {node} is called {new} now, but it is there"
                    ));
                }
                if !has(entry, name) && !is_renamed(pack, old, new) {
                    broken.push(format!(
                        "field {old} of {node} is called {new} now, which is not there"
                    ));
                }
            }
        }
    }
}

/// Returns true if a later migration renames the new name of the field again.
fn is_renamed(pack: &Pack, old: &str, new: &str) -> bool {
    pack.migrations.iter().any(|it| match *it {
        Migration::Field { old: again, .. } => again == new && again != old,
        Migration::Node { .. } => false,
    })
}

fn has(entry: &Entry, field: &str) -> bool {
    entry.schema()["properties"].get(field).is_some()
}

/// Returns the node with this name. If the node has been renamed, follows the migrations to its present name.
fn present<'c>(name: &str, pack: &Pack, catalog: &'c Catalog) -> Option<&'c Entry> {
    let mut name = name;
    for _ in 0..=pack.migrations.len() {
        if let Some(entry) = catalog.find(name) {
            return Some(entry);
        }
        name = pack.migrations.iter().find_map(|migration| match *migration {
            Migration::Node { old, new } if old == name => Some(new),
            _ => None,
        })?;
    }
    None
}
