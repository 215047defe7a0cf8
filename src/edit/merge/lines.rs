//! Three texts merged line by line: what is no graph is merged as git would.

use maquette_syntax::error::Problem;

use super::Merge;

/// What both made of a text, with conflicts marked as git marks them.
pub(super) fn by_lines(texts: [&str; 3], problems: Vec<Problem>) -> Merge {
    let [base, ours, theirs] = texts.map(|text| match text.is_empty() || text.ends_with('\n') {
        true => text.to_owned(),
        false => format!("{text}\n"),
    });
    let (text, conflicts) = match diffy::merge(&base, &ours, &theirs) {
        Ok(text) => (text, Vec::new()),
        Err(text) => (text, vec![String::new()]),
    };
    Merge { text, conflicts, problems, by_lines: true }
}
