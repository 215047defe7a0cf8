//! Selection ranges around a position, and formatting of a range of lines.

use maquette_syntax::cursor;
use maquette_syntax::error::Span;
use serde_json::{Value as Json, json};

use super::outline;
use super::position::Lines;

/// Returns the selection ranges at an offset, each inside of the next one. The first is the word. Then each enclosing bracket adds its
/// content, the whole bracket, and the bracket with the name before it.
pub(super) fn selection(lines: &Lines<'_>, at: usize) -> Json {
    let text = lines.text();
    let cursor = cursor(text, at);
    let ends = outline::ends(text);
    let mut spans = vec![Span { start: 0, end: text.len() }];
    for frame in &cursor.frames {
        let end = ends.iter().find(|(start, _)| *start == frame.start).map(|(_, end)| *end);
        let Some(end) = end.filter(|end| at <= *end) else { continue };
        let name = frame.name.as_ref().map_or(frame.start, |name| name.span.start);
        spans.extend([name, frame.start].map(|start| Span { start, end }));
        spans.push(Span { start: frame.start + 1, end: end - 1 });
    }
    let word = cursor.typed.span;
    let is_quoted = text[..word.start].ends_with('"') && text[word.end..].starts_with('"');
    if is_quoted {
        spans.push(Span { start: word.start - 1, end: word.end + 1 });
    }
    spans.extend([word, Span { start: at, end: at }]);
    let mut found = Json::Null;
    let mut last: Option<Span> = None;
    for span in spans {
        let is_inside =
            last.is_none_or(|it| it.start <= span.start && span.end <= it.end && it != span);
        let is_around = span.start <= at && at <= span.end;
        if !(is_inside && is_around) {
            continue;
        }
        let range = json!(lines.range(span));
        found = match found {
            Json::Null => json!({ "range": range }),
            parent => json!({ "range": range, "parent": parent }),
        };
        last = Some(span);
    }
    found
}

/// Returns the span of the old lines that contain `span`, and the formatted lines that replace them. `old` and `new` are the whole text
/// before and after formatting. Returns `None` if the change cannot be limited to these lines.
pub(super) fn formatted_lines(old: &str, new: &str, span: Span) -> Option<(Span, String)> {
    // Formatting changes only white space and commas. So all other characters are kept: those of the old text and those of the new text
    // match one to one.
    fn is_kept(c: char) -> bool {
        !c.is_whitespace() && c != ','
    }
    let start = old[..span.start].rfind(['\n', '\r']).map_or(0, |at| at + 1);
    let end = match old[start..span.end].ends_with(['\n', '\r']) {
        true => span.end,
        false => line_end(old, span.end),
    };
    fn count(text: &str) -> usize {
        text.chars().filter(|c| is_kept(*c)).count()
    }
    let (before, within) = (count(&old[..start]), count(&old[start..end]));
    fn line_behind(kept: usize, new: &str) -> Option<usize> {
        if kept == 0 {
            return Some(0);
        }
        let (at, c) = new.char_indices().filter(|(_, c)| is_kept(*c)).nth(kept - 1)?;
        let offset_of = at + c.len_utf8();
        let end = line_end(new, offset_of);
        new[offset_of..end].chars().all(|c| !is_kept(c)).then_some(end)
    }
    let (new_start, new_end) = (line_behind(before, new)?, line_behind(before + within, new)?);
    Some((Span { start, end }, new.get(new_start..new_end)?.to_owned()))
}

/// Returns the offset of the end of the line that contains `at`, after its line break.
fn line_end(text: &str, at: usize) -> usize {
    let rest = &text[at..];
    match rest.find(['\n', '\r']) {
        None => text.len(),
        Some(end) if rest[end..].starts_with("\r\n") => at + end + 2,
        Some(end) => at + end + 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::position::Columns;

    #[test]
    fn selection_ranges_are_nested() {
        let text = "Graph(nodes: { \"ball\": Sphere(radius: 2.0) })";
        let lines = Lines::new(text, Columns::Utf8);
        for at in 0..=text.len() {
            let mut part = selection(&lines, at);
            let (mut depth, mut inner) = (0, (at, at));
            while part.is_object() {
                fn byte(name: &str, part: &Json) -> usize {
                    part["range"][name]["character"].as_u64().unwrap() as usize
                }
                let (start, end) = (byte("start", &part), byte("end", &part));
                assert!(start <= inner.0 && inner.1 <= end && start <= end, "{at}: {start} {end}");
                (depth, inner) = (depth + 1, (start, end));
                part = part["parent"].clone();
            }
            assert_eq!(inner, (0, text.len()));
            assert!(depth > 0);
        }
    }

    #[test]
    fn formatted_lines_agree_with_the_formatted_text() {
        let old = "G(\n a:1,\n  b: 2, // x\n c:3\n)\n";
        let new = "G(\n    a: 1,\n    b: 2, // x\n    c: 3,\n)\n";
        fn offset_of(mark: &str, old: &str) -> usize {
            old.find(mark).unwrap()
        }
        fn change(from: &str, to: &str, old: &str, new: &str) -> String {
            let span = Span { start: offset_of(from, old), end: offset_of(to, old) };
            let (span, with) = formatted_lines(old, new, span).unwrap();
            [&old[..span.start], &with, &old[span.end..]].concat()
        }
        assert_eq!(change("a", "a", old, new), "G(\n    a: 1,\n  b: 2, // x\n c:3\n)\n");
        assert_eq!(change("b", "c", old, new), "G(\n a:1,\n    b: 2, // x\n    c: 3,\n)\n");
        assert_eq!(change("G", ")", old, new), new);
        // Formatting would join these lines with the lines before them.
        assert_eq!(formatted_lines("G(\na: 1)", "G(a: 1)", Span { start: 4, end: 4 }), None);
    }
}
