//! What the tools that work on a graph's text share.

use std::path::Path;
use std::sync::Arc;

use super::file::Mistake;
use crate::error::{Problem, Severity, Source, code};

/// Mistakes in a text as problems.
pub(crate) fn syntax_problems(name: &Path, text: &str, mistakes: Vec<Mistake>) -> Vec<Problem> {
    let source = Arc::new(Source { name: name.to_owned(), text: text.to_owned() });
    let problem = |mistake: Mistake| Problem {
        severity: Severity::Error,
        code: code::SYNTAX,
        source: source.clone(),
        span: mistake.span,
        message: mistake.message,
        help: mistake.help,
        note: None,
        uses: Vec::new(),
        elements: Vec::new(),
    };
    mistakes.into_iter().map(problem).collect()
}
