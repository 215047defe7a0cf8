//! The marks that a merge leaves in a text where both sides do not agree.

use std::path::Path;
use std::sync::Arc;

use super::file::{Mistake, raw_tokens};
use crate::error::{Problem, Severity, Source, Span, code};

/// What is said of a file with the marks.
pub const CONFLICT: &str = "this file has the conflict marks of a merge";

const CONFLICT_HELP: &str = "keep one side of each conflict, or what is right of both, and take the lines of the marks away";

/// The number of the first line, from 1, that begins with the mark of a conflict, in a text that is not RON.
pub fn conflict_line(text: &str) -> Option<usize> {
    let has_end = text.lines().any(|line| line.starts_with(">>>>>>> "));
    let place = text.lines().position(|line| line.starts_with("<<<<<<< "));
    place.filter(|_| has_end).map(|place| place + 1)
}

/// The conflict in the text of a file that is not RON.
pub fn conflict_of(name: &Path, text: &str) -> Option<Problem> {
    let start = text.split_inclusive('\n').take(conflict_line(text)? - 1).map(str::len).sum();
    let source = Arc::new(Source { name: name.to_owned(), text: text.to_owned() });
    let end = start + text[start..].lines().next().map_or(0, str::len);
    let place = (source, Span { start, end });
    let problem = Problem::new(Severity::Error, code::SYNTAX, place, CONFLICT.to_owned());
    Some(Problem { help: CONFLICT_HELP.into(), ..problem })
}

/// The first line of the marks in a text, if there are any that stand in no text or comment of it.
pub(super) fn conflict_marks(text: &str) -> Option<Mistake> {
    const MARKS: [&str; 4] = ["<<<<<<<", "|||||||", "=======", ">>>>>>>"];
    let mut start = 0;
    let lines = text.split_inclusive('\n').filter_map(|line| {
        let at = Span { start, end: start + line.trim_end().len() };
        start += line.len();
        MARKS.iter().any(|mark| line.starts_with(mark)).then_some(at)
    });
    let marks = Vec::from_iter(lines);
    let first = raw_tokens(text).find_map(|(_, token)| {
        // It begins with the line, and is no comment that begins so.
        marks.iter().find(|mark| mark.start == token.start)
    })?;
    Some(Mistake { span: *first, message: CONFLICT.into(), help: CONFLICT_HELP.into() })
}
