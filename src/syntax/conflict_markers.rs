//! Conflict markers, which a version control system leaves in a file if a merge fails.

use std::path::Path;
use std::sync::Arc;

use super::parser::{SyntaxError, raw_tokens};
use crate::error::{Diagnostic, Severity, Source, Span, code};

/// The message for a file with conflict markers.
pub const CONFLICT_MESSAGE: &str = "this file contains merge conflict markers";

const CONFLICT_HELP: &str = "resolve each conflict and remove the lines with the markers";

/// Returns the number, from 1, of the first line with a conflict marker. For texts in formats other than RON.
pub fn conflict_line(text: &str) -> Option<usize> {
    let has_end = text.lines().any(|line| line.starts_with(">>>>>>> "));
    let place = text.lines().position(|line| line.starts_with("<<<<<<< "));
    place.filter(|_| has_end).map(|place| place + 1)
}

/// Reports the first conflict in the text of a file that is not RON.
pub fn conflict_diagnostic(name: &Path, text: &str) -> Option<Diagnostic> {
    let start = text.split_inclusive('\n').take(conflict_line(text)? - 1).map(str::len).sum();
    let source = Arc::new(Source { name: name.to_owned(), text: text.to_owned() });
    let end = start + text[start..].lines().next().map_or(0, str::len);
    let place = (source, Span { start, end });
    let diagnostic =
        Diagnostic::new(Severity::Error, code::SYNTAX, place, CONFLICT_MESSAGE.to_owned());
    Some(Diagnostic { help: CONFLICT_HELP.into(), ..diagnostic })
}

/// Reports the first conflict marker in a RON text. Markers inside of strings and comments are ignored.
pub(super) fn conflict_error(text: &str) -> Option<SyntaxError> {
    const MARKS: [&str; 4] = ["<<<<<<<", "|||||||", "=======", ">>>>>>>"];
    let mut start = 0;
    let lines = text.split_inclusive('\n').filter_map(|line| {
        let at = Span { start, end: start + line.trim_end().len() };
        start += line.len();
        MARKS.iter().any(|mark| line.starts_with(mark)).then_some(at)
    });
    let marks = lines.collect::<Vec<_>>();
    let first = raw_tokens(text).find_map(|(_, token)| {
        // A marker inside of a string or comment is not the start of a token.
        marks.iter().find(|mark| mark.start == token.start)
    })?;
    Some(SyntaxError { span: *first, message: CONFLICT_MESSAGE.into(), help: CONFLICT_HELP.into() })
}
