//! Problems with one answer: each edit that is one is made, if its problem goes away by it.

use std::collections::BTreeSet;
use std::path::Path;

use maquette_graph::catalog::Catalog;
use maquette_graph::{Graph, Options};
use maquette_syntax::error::{Problem, code};

/// A text for the file at `path` in which problems with one answer are gone, and what was wrong, in the order in which it was mended.
/// Problems of other files stay: their texts are not these.
pub fn fixed(
    path: &Path,
    text: &str,
    catalog: &Catalog,
    options: &Options,
) -> (String, Vec<Problem>) {
    fn check(text: &str, path: &Path, catalog: &Catalog, options: &Options) -> Vec<Problem> {
        let checked = Graph::load_text(path, text.to_owned(), catalog, options);
        let unused = checked.graph.as_ref().map(Graph::unused).unwrap_or_default().to_vec();
        [checked.problems, unused].concat()
    }
    let (mut text, mut mended, mut problems) =
        (text.to_owned(), Vec::new(), check(text, path, catalog, options));
    // What one mistake has hidden is put right as well; what came out before does not come again.
    let mut seen = BTreeSet::from([text.clone()]);
    let mut next = 0;
    while let Some(problem) = problems.get(next) {
        let better = problem.fixed().filter(|_| problem.source.name == path);
        let better = better.filter(|text| seen.insert(text.clone()));
        let better = better.map(|text| (check(&text, path, catalog, options), text));
        match better.filter(|(now, _)| is_gone(problem, &problems, now)) {
            Some((now, better)) => {
                mended.push(problems.swap_remove(next));
                (text, problems, next) = (better, now, 0);
            }
            None => next += 1,
        }
    }
    (text, mended)
}

/// Whether there is one less of a problem, and the text is no worse a text.
fn is_gone(problem: &Problem, before: &[Problem], now: &[Problem]) -> bool {
    let of_it = |other: &&Problem| (other.code, &other.message) == (problem.code, &problem.message);
    fn of_text(other: &&Problem) -> bool {
        other.code == code::SYNTAX
    }
    now.iter().filter(of_it).count() < before.iter().filter(of_it).count()
        && now.iter().filter(of_text).count() <= before.iter().filter(of_text).count()
}
