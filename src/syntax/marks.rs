//! The marks that a merge leaves in a text where both sides do not agree.

use super::file::{Mistake, raw_tokens};
use crate::error::Span;

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
    Some(Mistake {
        span: *first,
        message: "this file has the conflict marks of a merge".into(),
        help: "keep one side of each conflict, or what is right of both, and take the lines of the marks away".into(),
    })
}
