//! Merges texts by lines, as git does. For texts that cannot be parsed.

use maquette_syntax::error::Diagnostic;

use super::Merge;

/// Merges texts by lines, with conflict markers as in git.
pub(super) fn merge_lines(texts: [&str; 3], diagnostics: Vec<Diagnostic>) -> Merge {
    let [base, ours, theirs] = texts.map(|text| match text.is_empty() || text.ends_with('\n') {
        true => text.to_owned(),
        false => format!("{text}\n"),
    });
    let (text, conflicts) = match diffy::merge(&base, &ours, &theirs) {
        Ok(text) => (text, Vec::new()),
        Err(text) => (text, vec![String::new()]),
    };
    Merge { text, conflicts, diagnostics, by_lines: true }
}
