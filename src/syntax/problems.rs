//! What the tools that work on a graph's text share.

use std::path::Path;
use std::sync::Arc;

use super::file::Mistake;
use super::recovery::recovered;
use crate::error::{Problem, Severity, Source, code};

/// Mistakes that the parser finds in a text as problems, with those that they hide.
pub fn syntax_problems(name: &Path, text: &str, mistakes: Vec<Mistake>) -> Vec<Problem> {
    let source = Arc::new(Source { name: name.to_owned(), text: text.to_owned() });
    if mistakes.is_empty() {
        return Vec::new();
    }
    let mistakes = recovered(text, &mistakes).map_or(mistakes, |found| found.mistakes);
    mistakes
        .into_iter()
        .map(|Mistake { span, message, help }: Mistake| Problem {
            fix: help.edits(text, span),
            help: help.into(),
            ..Problem::new(Severity::Error, code::SYNTAX, (source.clone(), span), message)
        })
        .collect()
}
