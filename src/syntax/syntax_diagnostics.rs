//! Converts syntax errors to diagnostics.

use std::path::Path;
use std::sync::Arc;

use super::parser::SyntaxError;
use super::recovery::recover;
use crate::error::{Diagnostic, Severity, Source, code};

/// Converts the errors of the parser to diagnostics. Adds errors that the parser missed because of earlier errors.
pub fn syntax_diagnostics(name: &Path, text: &str, errors: Vec<SyntaxError>) -> Vec<Diagnostic> {
    let source = Arc::new(Source { name: name.to_owned(), text: text.to_owned() });
    if errors.is_empty() {
        return Vec::new();
    }
    let errors = recover(text, &errors).map_or(errors, |found| found.errors);
    errors
        .into_iter()
        .map(|SyntaxError { span, message, help }: SyntaxError| Diagnostic {
            fix: help.edits(text, span),
            help: help.into(),
            ..Diagnostic::new(Severity::Error, code::SYNTAX, (source.clone(), span), message)
        })
        .collect()
}
