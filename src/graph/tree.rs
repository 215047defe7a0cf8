//! What is asked of the tree of a text in many places.

use maquette_syntax::{Body, Field, Kind, Tree};

/// A way through fields, and one step more.
pub(crate) fn joined(path: &str, step: &str) -> String {
    if path.is_empty() { step.to_owned() } else { format!("{path}.{step}") }
}

/// The entries of a section of a graph, such as `nodes`, with their names.
pub fn entries<'t>(
    fields: &'t [Field],
    section: &str,
) -> impl Iterator<Item = (&'t str, &'t Tree)> {
    let maps = fields.iter().filter(move |field| field.name.text == section);
    let entries = maps.filter_map(|field| match &field.value.kind {
        Kind::Map(entries) => Some(entries),
        _ => None,
    });
    entries.flatten().filter_map(|(key, value)| Some((key.text()?, value)))
}

/// The value on one line, as a file would have it.
pub fn show(tree: &Tree) -> String {
    fn all(items: &[Tree]) -> String {
        items.iter().map(show).collect::<Vec<_>>().join(", ")
    }
    match &tree.kind {
        Kind::Number { value, .. } if value.abs() < 1e-4 && *value != 0.0 => format!("{value:e}"),
        Kind::Number { value, .. } => value.to_string(),
        Kind::Bool(value) => value.to_string(),
        Kind::Text(text) => format!("{text:?}"),
        Kind::Word(word) => word.clone(),
        Kind::List(items) => format!("[{}]", all(items)),
        Kind::Map(entries) => {
            let entry = |(key, value): &(Tree, Tree)| format!("{}: {}", show(key), show(value));
            format!("{{ {} }}", entries.iter().map(entry).collect::<Vec<_>>().join(", "))
        }
        Kind::Call { name, body } => {
            let name = name.as_ref().map_or("", |name| &name.text);
            let body = match body {
                Body::Empty => String::new(),
                Body::Items(items) => all(items),
                Body::Fields(fields) => {
                    let field =
                        |field: &Field| format!("{}: {}", field.name.text, show(&field.value));
                    fields.iter().map(field).collect::<Vec<_>>().join(", ")
                }
            };
            format!("{name}({body})")
        }
        Kind::Broken => "?".into(),
    }
}

/// Whether a file holds `Patch(..)`.
pub fn is_patch(tree: &Tree) -> bool {
    tree.name().is_some_and(|name| name.text == "Patch")
}
