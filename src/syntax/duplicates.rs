//! Reports duplicate names in maps and calls.

use std::collections::BTreeMap;

use super::local_diagnostic::LocalDiagnostic;
use super::spelling::{file_key, same_file_message};
use super::tree::{Field, Tree};
use crate::error::{Span, code};

/// Reports each key of a map that occurs earlier in the map. `what` is the kind of key, for messages.
pub fn duplicate_keys(entries: &[(Tree, Tree)], what: &str) -> Vec<LocalDiagnostic> {
    find_duplicates(entries.iter().filter_map(|(key, _)| Some((key.text()?, key.span))), what)
}

/// Reports each key of a map that refers to the same file as an earlier key on macOS or Windows. `what` is the kind of key, for messages.
pub fn duplicate_files(entries: &[(Tree, Tree)], what: &str) -> Vec<LocalDiagnostic> {
    let mut seen: BTreeMap<String, (&str, Span)> = BTreeMap::new();
    let names = entries.iter().filter_map(|(key, _)| Some((key.text()?, key.span)));
    let again = names.filter_map(|(name, span)| {
        let (first, first_span) = *seen.entry(file_key(name)).or_insert((name, span));
        (first != name).then(|| LocalDiagnostic {
            code: code::BAD_NAME,
            span,
            message: same_file_message(what, first, name),
            help: "give one of them another name".into(),
            note: Some((first_span, "the first one".into())),
        })
    });
    again.collect()
}

/// Reports each field that occurs earlier in the same value.
pub fn duplicate_fields(fields: &[Field]) -> Vec<LocalDiagnostic> {
    find_duplicates(fields.iter().map(|field| (&field.name.text[..], field.name.span)), "field")
}

fn find_duplicates<'t>(
    names: impl Iterator<Item = (&'t str, Span)>,
    what: &str,
) -> Vec<LocalDiagnostic> {
    let mut seen = BTreeMap::new();
    let again = names.filter_map(|(name, span)| {
        let first = *seen.entry(name).or_insert(span);
        (first != span).then(|| LocalDiagnostic {
            code: code::BAD_NAME,
            span,
            message: format!("{what} `{name}` is given twice"),
            help: "keep one of them".into(),
            note: Some((first, "the first one".into())),
        })
    });
    again.collect()
}
