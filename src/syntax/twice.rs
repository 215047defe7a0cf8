//! Names that stand twice where each stands once.

use std::collections::BTreeMap;

use super::schema::Finding;
use super::tree::{Field, Tree};
use crate::error::{Span, code};

/// An error for each key of a map that stood before it; `what` it names, for messages.
pub fn twice(entries: &[(Tree, Tree)], what: &str) -> Vec<Finding> {
    told(entries.iter().filter_map(|(key, _)| Some((key.text()?, key.span))), what)
}

/// The same for fields.
pub fn fields_twice(fields: &[Field]) -> Vec<Finding> {
    told(fields.iter().map(|field| (&field.name.text[..], field.name.span)), "field")
}

fn told<'t>(names: impl Iterator<Item = (&'t str, Span)>, what: &str) -> Vec<Finding> {
    let mut seen = BTreeMap::new();
    let again = names.filter_map(|(name, span)| {
        let first = *seen.entry(name).or_insert(span);
        (first != span).then(|| Finding {
            code: code::BAD_NAME,
            span,
            message: format!("{what} `{name}` is given twice"),
            help: "keep one of them".into(),
            note: Some((first, "the first one".into())),
        })
    });
    again.collect()
}
