//! Automatic fixes: applies the suggested edits of diagnostics, and keeps each edit that removes its diagnostic.

use std::collections::BTreeSet;
use std::path::Path;

use maquette_graph::catalog::Catalog;
use maquette_graph::{Graph, Options};
use maquette_syntax::error::{Diagnostic, code};

/// Applies the fixes of all diagnostics that have one. Returns the new text, and the fixed diagnostics in order. Diagnostics of other files
/// are not fixed.
pub fn apply_fixes(
    path: &Path,
    text: &str,
    catalog: &Catalog,
    options: &Options,
) -> (String, Vec<Diagnostic>) {
    let (mut text, mut mended, mut diagnostics) =
        (text.to_owned(), Vec::new(), check(text, path, catalog, options));
    // A fix can reveal further errors, which are fixed too. Do not return to an earlier text, which would be an endless loop.
    let mut seen = BTreeSet::from([text.clone()]);
    let mut next = 0;
    while let Some(diagnostic) = diagnostics.get(next) {
        let better = diagnostic.apply_fix().filter(|_| diagnostic.source.name == path);
        let better = better.filter(|text| seen.insert(text.clone()));
        let better = better.map(|text| (check(&text, path, catalog, options), text));
        match better.filter(|(now, _)| is_fixed(diagnostic, &diagnostics, now)) {
            Some((now, better)) => {
                mended.push(diagnostics.swap_remove(next));
                (text, diagnostics, next) = (better, now, 0);
            }
            None => next += 1,
        }
    }
    (text, mended)
}

fn check(text: &str, path: &Path, catalog: &Catalog, options: &Options) -> Vec<Diagnostic> {
    let checked = Graph::load_text(path, text.to_owned(), catalog, options);
    let unused = checked.graph.as_ref().map(Graph::unused_warnings).unwrap_or_default().to_vec();
    [checked.diagnostics, unused].concat()
}

/// Returns true if a fix has removed one of the diagnostics with the code and message of `diagnostic`, and has not added a syntax error.
fn is_fixed(diagnostic: &Diagnostic, before: &[Diagnostic], now: &[Diagnostic]) -> bool {
    let [same_before, same_now] = [before, now].map(|all| {
        let same = all
            .iter()
            .filter(|it| (it.code, &it.message) == (diagnostic.code, &diagnostic.message));
        same.count()
    });
    let [syntax_before, syntax_now] =
        [before, now].map(|all| all.iter().filter(|it| it.code == code::SYNTAX).count());
    same_now < same_before && syntax_now <= syntax_before
}
