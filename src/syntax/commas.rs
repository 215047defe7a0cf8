//! Texts whose commas begin lines, as in `, "red": Transform(..)`.
//!
//! Comments belong to the entry that they stand above, so tools that move entries want each comma directly behind its entry.
//! [`commas_behind`] moves the commas there, and [`with_commas_behind`] moves them back after an edit.

use std::borrow::Cow;
use std::collections::BTreeMap;

use super::file::{Token, tokens};
use crate::error::Span;

/// Moves each comma that is on a later line than the value before it directly behind that value.
///
/// The text must have no syntax errors. Comments and line breaks stay where they are, except that a line with nothing but a comma
/// is removed.
pub fn commas_behind(text: &str) -> Cow<'_, str> {
    let mut edits = Vec::new();
    let mut end = None;
    for (token, span) in tokens(text) {
        match token {
            Token::Space | Token::LineComment | Token::BlockComment => {}
            Token::Comma => {
                if let Some(end) = end.take().filter(|&end| text[end..span.start].contains('\n')) {
                    edits.push((Span { start: end, end }, ","));
                    edits.push((removed(text, span), ""));
                }
            }
            Token::Word | Token::Close => end = Some(span.end),
            Token::Open | Token::Colon => end = None,
        }
    }
    if edits.is_empty() { Cow::Borrowed(text) } else { Cow::Owned(edited(text, edits)) }
}

/// The comma with the spaces behind it, or its whole line if nothing else is there.
fn removed(text: &str, comma: Span) -> Span {
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

fn edited(text: &str, edits: Vec<(Span, &str)>) -> String {
    let mut result = String::with_capacity(text.len() + 64);
    let mut copied = 0;
    for (span, new) in edits {
        result.push_str(&text[copied..span.start]);
        result.push_str(new);
        copied = span.end;
    }
    result + &text[copied..]
}

/// Which groups of a text have their commas at the beginning of lines, and the spaces behind these.
#[derive(Clone, Debug, Default, PartialEq)]
struct CommaStyle {
    /// By the names that lead to the group; `None` if its commas are behind the values.
    groups: BTreeMap<Vec<String>, Option<String>>,
    /// The style of groups that the text does not have.
    other: Option<String>,
}

impl CommaStyle {
    fn of(text: &str) -> Self {
        let mut style = Self::default();
        let (mut leading, mut all) = (0, 0);
        each_break(text, |path, comma, before, next| {
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

    /// Moves commas behind values to the beginning of the next line, in the groups that had them there.
    fn put(&self, text: &str) -> String {
        let mut edits = Vec::new();
        each_break(text, |path, comma, before, next| {
            let spaces = self.groups.get(path).unwrap_or(&self.other);
            let line = text[..next].rfind('\n').map_or(0, |newline| newline + 1);
            let begins_line = text[line..next].trim().is_empty();
            if let Some(spaces) = spaces.as_ref().filter(|_| begins_line && before == comma.start) {
                edits.push((comma, String::new()));
                edits.push((Span { start: next, end: next }, format!(",{spaces}")));
            }
        });
        // Groups end behind those in them.
        edits.sort_by_key(|(span, _)| *span);
        edited(text, edits.iter().map(|(span, new)| (*span, &new[..])).collect())
    }
}

/// Runs an edit on a text with its commas behind values, and moves them back in the result. If they cannot be moved back exactly,
/// they stay behind the values.
pub fn with_commas_behind<E>(
    text: &str,
    edit: impl FnOnce(&str) -> Result<String, E>,
) -> Result<String, E> {
    let Cow::Owned(behind) = commas_behind(text) else { return edit(text) };
    let edited = edit(&behind)?;
    if edited == behind {
        return Ok(text.to_owned());
    }
    let style = CommaStyle::of(text);
    Ok(if style.put(&behind) == text { style.put(&edited) } else { edited })
}

/// What is read of a group that is open.
#[derive(Default)]
struct Group {
    /// The comma behind the last value, and where that value ends.
    comma: Option<(Span, usize)>,
    /// The name of the value that is being read; empty if it has none.
    name: String,
    index: usize,
}

/// Calls `see` for each comma between two values on different lines, with the names that lead to its group, the comma, the end of
/// the value before it, and the start of the value behind it.
fn each_break(text: &str, mut see: impl FnMut(&[String], Span, usize, usize)) {
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
    fn commas_go_behind_their_values_and_back() {
        let behind = commas_behind(LEADING);
        let expected = LEADING
            .replace("1\n    , nodes", "1,\n    nodes")
            .replace("A(x: 1) //", "A(x: 1), //")
            .replace(", \"b\"", "\"b\"")
            .replace("y: 2\n", "y: 2,\n")
            .replace(", z", "z")
            .replace("    }\n    //", "    },\n    //")
            .replace(", outputs", "outputs");
        assert_eq!(behind, expected);
        assert_eq!(CommaStyle::of(LEADING).put(&behind), LEADING);
        assert!(matches!(commas_behind(&expected), Cow::Borrowed(_)));
        assert_eq!(CommaStyle::of(&expected).put(&expected), expected);
    }

    #[test]
    fn comments_behind_a_leading_comma_stay_below_it() {
        fn check(text: &str, expected: &str) {
            assert_eq!(commas_behind(text), expected, "{text}")
        }
        check("(a: 1\n, // above b\n  b: 2)", "(a: 1,\n// above b\n  b: 2)");
        check("(a: 1 // behind a\n,\n  b: 2)", "(a: 1, // behind a\n  b: 2)");
        check("[1\r\n , 2\r\n , 3]", "[1,\r\n 2,\r\n 3]");
        check("[1, 2, // two\n 3,\n]", "[1, 2, // two\n 3,\n]");
    }

    #[test]
    fn groups_that_are_new_follow_the_others() {
        let style = CommaStyle::of(LEADING);
        let new = "Graph(nodes: {\n \"c\": C(\n  x: 1,\n  y: 2\n )\n})";
        assert_eq!(style.put(new), "Graph(nodes: {\n \"c\": C(\n  x: 1\n  , y: 2\n )\n})");
    }
}
