//! A diagnostic at a span of a text, for code that does not know the file of the text.

use std::sync::Arc;

use super::help::Help;
use crate::error::{Diagnostic, Severity, Source, Span, code};

/// A diagnostic without its file and severity.
#[derive(Clone, Debug, PartialEq)]
pub struct LocalDiagnostic {
    pub code: &'static str,
    pub span: Span,
    pub message: String,
    pub help: Help,
    pub note: Option<(Span, String)>,
}

impl LocalDiagnostic {
    /// Creates a diagnostic without a note.
    pub fn new(
        code: &'static str,
        span: Span,
        message: impl Into<String>,
        help: impl Into<Help>,
    ) -> Self {
        Self { code, span, message: message.into(), help: help.into(), note: None }
    }

    /// Adds the file and the severity: a warning for [`code::OUTDATED`], an error for all other codes.
    pub fn into_diagnostic(self, source: &Arc<Source>) -> Diagnostic {
        let Self { code, span, message, help, note } = self;
        // Outdated names still work, so they cause only a warning.
        let severity = if code == code::OUTDATED { Severity::Warning } else { Severity::Error };
        Diagnostic {
            fix: help.edits(&source.text, span),
            help: help.into(),
            note,
            ..Diagnostic::new(severity, code, (source.clone(), span), message)
        }
    }
}
