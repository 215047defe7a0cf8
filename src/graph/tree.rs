//! Operations on syntax trees that several modules need.

use maquette_syntax::{Body, Field, Kind, Tree};

/// Appends a step to a dotted path.
pub(crate) fn join_path(path: &str, step: &str) -> String {
    if path.is_empty() { step.to_owned() } else { format!("{path}.{step}") }
}

/// Returns the entries of a section of a graph, such as `nodes`, as pairs of a name and a value.
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

/// Returns the text argument of a call such as `Param("..")` or `Expr("..")`.
pub fn text_in_call<'t>(tree: &'t Tree, name: &str) -> Option<&'t str> {
    tree.call_of(name).and_then(Tree::text)
}

/// Prints a value on one line, in the syntax of graph files.
pub fn show(tree: &Tree) -> String {
    fn show_all(items: &[Tree]) -> String {
        items.iter().map(show).collect::<Vec<_>>().join(", ")
    }
    match &tree.kind {
        Kind::Number { value, .. } if value.abs() < 1e-4 && *value != 0.0 => format!("{value:e}"),
        Kind::Number { value, .. } => value.to_string(),
        Kind::Bool(value) => value.to_string(),
        Kind::Text(text) => format!("{text:?}"),
        Kind::Word(word) => word.clone(),
        Kind::List(items) => format!("[{}]", show_all(items)),
        Kind::Map(entries) => {
            let entries =
                entries.iter().map(|(key, value)| format!("{}: {}", show(key), show(value)));
            format!("{{ {} }}", entries.collect::<Vec<_>>().join(", "))
        }
        Kind::Call { name, body } => {
            let name = name.as_ref().map_or("", |name| &name.text);
            let body = match body {
                Body::Empty => String::new(),
                Body::Items(items) => show_all(items),
                Body::Fields(fields) => {
                    let fields = fields
                        .iter()
                        .map(|field| format!("{}: {}", field.name.text, show(&field.value)));
                    fields.collect::<Vec<_>>().join(", ")
                }
            };
            format!("{name}({body})")
        }
        Kind::Broken => "?".into(),
    }
}

/// Returns true if the outermost value of a file is `Patch(..)`.
pub fn is_patch(tree: &Tree) -> bool {
    tree.name().is_some_and(|name| name.text == "Patch")
}
