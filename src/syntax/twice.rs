//! Names that stand twice where each stands once.

use std::collections::BTreeMap;

use super::schema::Finding;
use super::spelling::{file_key, one_file};
use super::tree::{Field, Tree};
use crate::error::{Span, code};

/// An error for each key of a map that stood before it; `what` it names, for messages.
pub fn twice(entries: &[(Tree, Tree)], what: &str) -> Vec<Finding> {
    told(entries.iter().filter_map(|(key, _)| Some((key.text()?, key.span))), what)
}

/// An error for each key of a map that is one file with another one on macOS or Windows; `what` they name, for messages.
pub fn one_file_twice(entries: &[(Tree, Tree)], what: &str) -> Vec<Finding> {
    let mut seen: BTreeMap<String, (&str, Span)> = BTreeMap::new();
    let names = entries.iter().filter_map(|(key, _)| Some((key.text()?, key.span)));
    let again = names.filter_map(|(name, span)| {
        let (first, first_span) = *seen.entry(file_key(name)).or_insert((name, span));
        (first != name).then(|| Finding {
            code: code::BAD_NAME,
            span,
            message: one_file(what, first, name),
            help: "give one of them another name".into(),
            note: Some((first_span, "the first one".into())),
        })
    });
    again.collect()
}

/// An error for each field that was given before.
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
