//! Support for texts with leading commas: a line begins with the comma that separates it from the line before, as in `, "red":
//! Transform(..)`.
//!
//! A comment belongs to the entry below it, so tools that move entries need each comma directly after its entry. [`with_trailing_commas`]
//! moves commas to the ends of entries, and [`edit_with_trailing_commas`] moves them back after an edit.

use std::borrow::Cow;
use std::collections::BTreeMap;

use super::parser::{Token, tokens};
use crate::error::Span;

/// Moves each comma that is on a later line than the value before it to the end of that value.
///
/// The text must have no syntax errors. Comments and line breaks are not moved. Lines that contain only a comma are removed.
pub fn with_trailing_commas(text: &str) -> Cow<'_, str> {
    let mut edits = Vec::new();
    let mut end = None;
    for (token, span) in tokens(text) {
        match token {
            Token::Space | Token::LineComment | Token::BlockComment => {}
            Token::Comma => {
                if let Some(end) = end.take().filter(|&end| text[end..span.start].contains('\n')) {
                    edits.push((Span { start: end, end }, ","));
                    edits.push((removal_span(text, span), ""));
                }
            }
            Token::Word | Token::Close => end = Some(span.end),
            Token::Open | Token::Colon => end = None,
        }
    }
    if edits.is_empty() { Cow::Borrowed(text) } else { Cow::Owned(apply_edits(text, edits)) }
}

/// Returns the span of the comma and the spaces after it. If nothing else is on the line of the comma, returns the span of the whole line.
fn removal_span(text: &str, comma: Span) -> Span {
    fn spaces(text: &str) -> usize {
        text.len() - text.trim_start_matches([' ', '\t', '\r']).len()
    }
    let end = comma.end + spaces(&text[comma.end..]);
    let line = text[..comma.start].rfind('\n').map_or(0, |newline| newline + 1);
    match text[line..comma.start].trim().is_empty() && text[end..].starts_with('\n') {
        true => Span { start: line, end: end + 1 },
        false => Span { start: comma.start, end },
    }
}

fn apply_edits(text: &str, edits: Vec<(Span, &str)>) -> String {
    let mut result = String::with_capacity(text.len() + 64);
    let mut copied = 0;
    for (span, new) in edits {
        result.push_str(&text[copied..span.start]);
        result.push_str(new);
        copied = span.end;
    }
    result + &text[copied..]
}

/// For each group (a bracket with its content): whether its commas lead or trail, and the spaces after leading commas.
#[derive(Clone, Debug, Default, PartialEq)]
struct CommaStyle {
    /// The spaces after the leading commas, by the path of the group. `None` if the commas of the group are trailing.
    groups: BTreeMap<Vec<String>, Option<String>>,
    /// The spaces after leading commas in groups that an edit adds. `None` if such groups get trailing commas.
    other: Option<String>,
}

impl CommaStyle {
    fn detect(text: &str) -> Self {
        let mut style = Self::default();
        let (mut leading, mut all) = (0, 0);
        for_each_break(text, |path, comma, before, next| {
            let leads = text[before..comma.start].contains('\n');
            let behind = &text[comma.end..next];
            let spaces =
                if behind.trim().is_empty() && !behind.contains('\n') { behind } else { " " };
            let found = leads.then(|| spaces.to_owned());
            (leading, all) = (leading + usize::from(leads), all + 1);
            if style.other.is_none() {
                style.other.clone_from(&found);
            }
            style.groups.entry(path.to_vec()).or_insert(found);
        });
        if 2 * leading <= all {
            style.other = None;
        }
        style
    }

    /// Moves the commas of groups with leading commas back to the beginnings of lines.
    fn apply(&self, text: &str) -> String {
        let mut edits = Vec::new();
        for_each_break(text, |path, comma, before, next| {
            let spaces = self.groups.get(path).unwrap_or(&self.other);
            let line = text[..next].rfind('\n').map_or(0, |newline| newline + 1);
            let begins_line = text[line..next].trim().is_empty();
            if let Some(spaces) = spaces.as_ref().filter(|_| begins_line && before == comma.start) {
                edits.push((comma, String::new()));
                edits.push((Span { start: next, end: next }, format!(",{spaces}")));
            }
        });
        // Commas of inner groups are visited before those of outer groups, so the edits must be sorted.
        edits.sort_by_key(|(span, _)| *span);
        apply_edits(text, edits.iter().map(|(span, new)| (*span, &new[..])).collect())
    }
}

/// Runs an edit on a text with trailing commas, and restores the leading commas in the result. If they cannot be restored exactly, the
/// commas of the result are trailing.
pub fn edit_with_trailing_commas<E>(
    text: &str,
    edit: impl FnOnce(&str) -> Result<String, E>,
) -> Result<String, E> {
    let Cow::Owned(behind) = with_trailing_commas(text) else { return edit(text) };
    let edited = edit(&behind)?;
    if edited == behind {
        return Ok(text.to_owned());
    }
    let style = CommaStyle::detect(text);
    Ok(if style.apply(&behind) == text { style.apply(&edited) } else { edited })
}

/// The state of a group while its bracket is open.
#[derive(Default)]
struct Group {
    /// The span of the comma after the last value, and the end of that value. `None` if no comma has followed the last value yet.
    comma: Option<(Span, usize)>,
    /// The name of the current value; empty if it has none.
    name: String,
    index: usize,
}

/// Calls `see` for each comma between two values on different lines. The arguments are the path of the group that contains the comma, the
/// span of the comma, the end of the value before it, and the start of the value after it.
fn for_each_break(text: &str, mut see: impl FnMut(&[String], Span, usize, usize)) {
    let mut path: Vec<String> = Vec::new();
    let mut open: Vec<Group> = vec![Group::default()];
    let (mut start, mut end) = (0, 0);
    for (token, span) in tokens(text) {
        let Some(group) = open.last_mut() else { return };
        match token {
            Token::Space | Token::LineComment | Token::BlockComment => continue,
            Token::Word | Token::Open => {
                if let Some((comma, before)) = group.comma.take()
                    && text[before..span.start].contains('\n')
                {
                    see(&path, comma, before, span.start);
                }
                if token == Token::Open {
                    let name = std::mem::take(&mut group.name);
                    path.push(if name.is_empty() { group.index.to_string() } else { name });
                    open.push(Group::default());
                }
            }
            Token::Close => {
                open.pop();
                path.pop();
            }
            Token::Comma => {
                group.comma = Some((span, end));
                group.index += 1;
                group.name.clear();
            }
            Token::Colon => group.name = text[start..end].to_owned(),
        }
        (start, end) = (span.start, span.end);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEADING: &str = "Graph(
    format: 1
    , nodes: {
        \"a\": A(x: 1) // behind a
        // above b
        , \"b\": B(
            x: 1, y: 2
            /* above z */
            , z: [1,
                2]
        )
    }
    // above outputs
    , outputs: {}
)
";

    #[test]
    fn leading_commas_are_moved_and_restored() {
        let behind = with_trailing_commas(LEADING);
        let expected = LEADING
            .replace("1\n    , nodes", "1,\n    nodes")
            .replace("A(x: 1) //", "A(x: 1), //")
            .replace(", \"b\"", "\"b\"")
            .replace("y: 2\n", "y: 2,\n")
            .replace(", z", "z")
            .replace("    }\n    //", "    },\n    //")
            .replace(", outputs", "outputs");
        assert_eq!(behind, expected);
        assert_eq!(CommaStyle::detect(LEADING).apply(&behind), LEADING);
        assert!(matches!(with_trailing_commas(&expected), Cow::Borrowed(_)));
        assert_eq!(CommaStyle::detect(&expected).apply(&expected), expected);
    }

    #[test]
    fn comments_after_a_leading_comma_stay_below_it() {
        fn check(text: &str, expected: &str) {
            assert_eq!(with_trailing_commas(text), expected, "{text}");
        }
        check("(a: 1\n, // above b\n  b: 2)", "(a: 1,\n// above b\n  b: 2)");
        check("(a: 1 // behind a\n,\n  b: 2)", "(a: 1, // behind a\n  b: 2)");
        check("[1\r\n , 2\r\n , 3]", "[1,\r\n 2,\r\n 3]");
        check("[1, 2, // two\n 3,\n]", "[1, 2, // two\n 3,\n]");
    }

    #[test]
    fn new_groups_have_the_common_style() {
        let style = CommaStyle::detect(LEADING);
        let new = "Graph(nodes: {\n \"c\": C(\n  x: 1,\n  y: 2\n )\n})";
        assert_eq!(style.apply(new), "Graph(nodes: {\n \"c\": C(\n  x: 1\n  , y: 2\n )\n})");
    }
}
