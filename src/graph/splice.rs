//! Inserts, replaces and removes parts of a text, and preserves the author's layout.

use std::collections::BTreeSet;

use maquette_syntax::error::Span;
use maquette_syntax::{Body, Field, Kind, LineEnding, Token, Tree, tokens};

/// An edit of a text: the span to be replaced, and the new text.
pub type Splice = (Span, String);

pub fn apply(text: &str, mut edits: Vec<Splice>) -> String {
    // The sort must be stable: insertions at one position keep their order.
    edits.sort_by_key(|(span, _)| *span);
    let mut result = String::with_capacity(text.len() + 64);
    let mut copied = 0;
    for (span, new) in edits {
        // Drop edits inside of a part that another edit replaces.
        if span.start < copied {
            continue;
        }
        result.push_str(&text[copied..span.start]);
        result.push_str(&new);
        copied = span.end;
    }
    result + &text[copied..]
}

/// Returns the edits that add a field to a call or to a bare word. The layout follows that of the existing fields.
pub fn add_field(text: &str, owner: &Tree, name: &str, value: &str) -> Vec<Splice> {
    fn insert(at: usize, text: String) -> (Span, String) {
        (Span { start: at, end: at }, text)
    }
    let Some(last) = owner.fields().and_then(<[Field]>::last) else {
        // The value is `Name` or `Name()`, possibly with spaces or comments inside.
        let inside = &text[owner.span.start..owner.span.end];
        return match inside.find('(') {
            Some(open) => vec![insert(owner.span.start + open + 1, format!("{name}: {value}"))],
            None => vec![insert(owner.span.end, format!("({name}: {value})"))],
        };
    };
    let colon = &text[last.name.span.end..last.value.span.start];
    let colon = if colon.trim() == ":" && !colon.contains('\n') { colon } else { ": " };
    let new = format!("{name}{colon}{value}");
    let before = match owner.fields() {
        Some([.., before, _]) => Some(before.value.span.end),
        _ => None,
    };
    let last = Span { start: last.name.span.start, end: last.value.span.end };
    insert_after(text, owner.span, before, last, &new)
}

/// Returns the edits that insert a field, entry or item of `owner` after its part `last`. The new part is on its own line if `last` is.
/// `before` is the end of the part that precedes `last`.
pub fn insert_after(
    text: &str,
    owner: Span,
    before: Option<usize>,
    last: Span,
    new: &str,
) -> Vec<Splice> {
    fn insert(at: usize, text: String) -> (Span, String) {
        (Span { start: at, end: at }, text)
    }
    let tail = Tail::find(text, last.end, owner.end);
    if let Some(indent) = indent_of(text, owner, last) {
        let newline = newline(text, last.start);
        return match tail.comma {
            Some(_) => vec![insert(tail.line_end, format!("{newline}{indent}{new},"))],
            None if tail.line_end == last.end => {
                vec![insert(tail.line_end, format!(",{newline}{indent}{new}"))]
            }
            None => vec![
                insert(last.end, ",".into()),
                insert(tail.line_end, format!("{newline}{indent}{new}")),
            ],
        };
    }
    let is_tight = before.is_some_and(|before| &text[before..last.start] == ",");
    let comma = if is_tight { "," } else { ", " };
    vec![insert(last.end, format!("{comma}{new}"))]
}

/// Returns the indentation of a part of `owner`. `None` if other text, such as the beginning of `owner`, precedes the part on its line.
pub fn indent_of(text: &str, owner: Span, part: Span) -> Option<&str> {
    let line = line_start(text, part.start);
    let indent = &text[line..part.start];
    (line > owner.start && indent.trim().is_empty()).then_some(indent)
}

/// Returns the edits that insert an entry into a map, after one of its entries. If the map is empty and `broken` is set, the new entry is
/// on its own line. `write` returns the text of the entry for a given indentation.
pub fn put_entry(
    text: &str,
    map: &Tree,
    behind_entry: Option<usize>,
    broken: bool,
    write: impl Fn(&str) -> String,
) -> Vec<Splice> {
    let parts = parts(map);
    let place = behind_entry.or(parts.len().checked_sub(1)).filter(|&place| place < parts.len());
    if let Some(place) = place {
        let last = parts[place];
        let before = place.checked_sub(1).map(|before| parts[before].end);
        let entry = write(indent_of(text, map.span, last).unwrap_or_default());
        return insert_after(text, map.span, before, last, &entry);
    }
    let open = content_start(text, map.span);
    let inside = &text[open..map.span.end - 1];
    if inside.trim().is_empty() && !broken {
        return vec![(map.span, format!("{{ {} }}", write("")))];
    }
    // The new entry is inserted after all comments in the map.
    let line = &text[line_start(text, map.span.start)..];
    let outer = &line[..line.len() - line.trim_start_matches([' ', '\t']).len()];
    let step = if outer.contains('\t') { "\t" } else { "    " };
    let indent = format!("{outer}{step}");
    let at = Span { start: open + inside.trim_end().len(), end: map.span.end - 1 };
    let newline = newline(text, map.span.start);
    vec![(at, format!("{newline}{indent}{},{newline}{outer}", write(&indent)))]
}

/// Returns the line ending before an offset. On the first line of the text, returns the line ending after the offset.
pub fn newline(text: &str, at: usize) -> &'static str {
    if LineEnding::detect(text) == Some(LineEnding::Mac) {
        return "\r";
    }
    let end = text[..at].rfind('\n').or_else(|| text.find('\n'));
    if end.is_some_and(|end| text[..end].ends_with('\r')) { "\r\n" } else { "\n" }
}

/// Changes the indentation of formatted lines from `columns` spaces to `indent`, and their line endings to `newline`. The first line is not
/// changed.
pub fn reindent(form: &str, columns: usize, indent: &str, newline: &str) -> String {
    let mut text = String::with_capacity(form.len());
    for (token, Span { start, end }) in tokens(form) {
        let piece = &form[start..end];
        let breaks = piece.matches('\n').count();
        if token != Token::Space || breaks == 0 {
            text.push_str(piece);
            continue;
        }
        let spaces = piece.len() - piece.rfind('\n').map_or(0, |at| at + 1);
        let inner = spaces.saturating_sub(columns);
        let steps = if indent.contains('\t') { "\t".repeat(inner / 4) } else { " ".repeat(inner) };
        let is_last = end == form.len();
        text += &newline.repeat(breaks);
        text += &if is_last { String::new() } else { format!("{indent}{steps}") };
    }
    text
}

fn line_start(text: &str, at: usize) -> usize {
    text[..at].rfind(['\n', '\r']).map_or(0, |newline| newline + 1)
}

/// Returns the offset after the opening bracket of a value.
pub fn content_start(text: &str, value: Span) -> usize {
    let pieces = tokens(&text[value.start..value.end]);
    let open = pieces.iter().find(|(piece, _)| *piece == Token::Open);
    open.map_or(value.start, |(_, span)| value.start + span.end)
}

/// Returns the spans of the fields, items or entries of a value.
pub fn parts(value: &Tree) -> Vec<Span> {
    match &value.kind {
        Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
            items.iter().map(|item| item.span).collect()
        }
        Kind::Call { body: Body::Fields(fields), .. } => {
            let fields = fields.iter();
            fields
                .map(|field| Span { start: field.name.span.start, end: field.value.span.end })
                .collect()
        }
        Kind::Map(entries) => {
            let entries = entries.iter();
            entries
                .map(|(key, value)| Span { start: key.span.start, end: value.span.end })
                .collect()
        }
        _ => Vec::new(),
    }
}

/// Returns the edits that remove parts of a value, together with their commas and lines. `gone` contains the indices of the parts.
pub fn remove_parts(text: &str, owner: &Tree, gone: &BTreeSet<usize>) -> Vec<Splice> {
    let parts = parts(owner);
    let (open, close) = (content_start(text, owner.span), owner.span.end - 1);
    let mut cuts = Vec::new();
    let ends = parts.iter().map(|part| part.end);
    let starts = parts.iter().map(|part| part.start).chain([close]);
    let mut gaps = [open].into_iter().chain(ends).zip(starts).map(|(start, end)| &text[start..end]);
    if gone.len() == parts.len()
        && gaps.all(|gap| gap.chars().all(|c| c.is_whitespace() || c == ','))
    {
        return vec![(Span { start: open, end: close }, String::new())];
    }
    for &index in gone {
        let Some(part) = parts.get(index) else { continue };
        cuts.push(cut(text, owner.span, *part, index == 0));
    }
    // If the removed last part has no comma after it, remove the comma before it.
    let kept = (0..parts.len()).rev().find(|index| !gone.contains(index));
    let last = parts.last().filter(|last| Tail::find(text, last.end, close).comma.is_none());
    if let (Some(kept), Some(_)) = (kept, last)
        && let Some(next) = parts.get(kept + 1)
        && let Some(comma) = Tail::find(text, parts[kept].end, close).comma
    {
        let gap = &text[comma + 1..next.start];
        let is_space = gap.trim().is_empty() && !gap.contains('\n');
        cuts.push(Span { start: comma, end: if is_space { next.start } else { comma + 1 } });
    }
    let mut cuts = merge_spans(cuts);
    for cut in &mut cuts {
        *cut = without_blank_lines(text, *cut, open, close);
    }
    merge_spans(cuts).into_iter().map(|cut| (cut, String::new())).collect()
}

/// Returns the span to delete in order to remove a part. If nothing else is on the part's lines, it consists of these lines. Otherwise it
/// consists of the part, its comma and the adjacent space.
fn cut(text: &str, owner: Span, part: Span, is_first: bool) -> Span {
    let tail = Tail::find(text, part.end, owner.end);
    let comma = tail.comma.filter(|&comma| !text[part.end..comma].contains('\n'));
    let rest = text[tail.line_end..].trim_start_matches([' ', '\t', '\r']);
    let is_alone = rest.starts_with('\n') && comma == tail.comma;
    if let Some(indent) = indent_of(text, owner, part).filter(|_| is_alone) {
        return Span { start: part.start - indent.len(), end: text.len() - rest.len() + 1 };
    }
    let Some(comma) = comma else { return part };
    let behind = &text[comma + 1..];
    let spaces = behind.len() - behind.trim_start_matches([' ', '\t']).len();
    if !behind[spaces..].starts_with(['\r', '\n']) || is_first {
        return Span { start: part.start, end: comma + 1 + spaces };
    }
    let before = text[..part.start].trim_end_matches([' ', '\t']).len();
    Span { start: before, end: comma + 1 }
}

/// Extends a span of whole lines to the blank lines before it, if a blank line or the closing bracket follows the span.
pub fn without_blank_lines(text: &str, cut: Span, open: usize, close: usize) -> Span {
    let Span { mut start, mut end } = cut;
    fn begins_line(at: usize, text: &str) -> bool {
        text[..at].ends_with('\n')
    }
    if !begins_line(start, text) || !begins_line(end, text) {
        return cut;
    }
    fn first_line(text: &str) -> &str {
        text.split_inclusive('\n').next().unwrap_or_default()
    }
    fn is_blank(line: &str) -> bool {
        line.ends_with('\n') && line.trim().is_empty()
    }
    fn line_before(at: usize, text: &str) -> &str {
        &text[line_start(text, at - 1)..at]
    }
    fn is_behind(start: usize, open: usize, text: &str) -> bool {
        open < start && is_blank(line_before(start, text))
    }
    if text[open..start].trim().is_empty() {
        while is_blank(first_line(&text[end..close])) {
            end += first_line(&text[end..close]).len();
        }
    }
    if is_behind(start, open, text)
        && (is_blank(first_line(&text[end..close])) || text[end..close].trim().is_empty())
    {
        while is_behind(start, open, text) && line_start(text, start - 1) > open {
            start = line_start(text, start - 1);
        }
    }
    Span { start, end }
}

/// Sorts spans, and merges spans that touch or overlap.
fn merge_spans(mut spans: Vec<Span>) -> Vec<Span> {
    spans.sort_unstable();
    let mut merged: Vec<Span> = Vec::with_capacity(spans.len());
    for span in spans {
        match merged.last_mut() {
            Some(last) if span.start <= last.end => last.end = last.end.max(span.end),
            _ => merged.push(span),
        }
    }
    merged
}

/// The text that follows a part of a value, up to the end of the line.
pub struct Tail {
    /// The offset of the comma after the part. `None` if no comma follows.
    pub comma: Option<usize>,
    /// The end of the line on which the part or its comma ends, including comments on that line.
    pub line_end: usize,
}

impl Tail {
    pub fn find(text: &str, value_end: usize, call_end: usize) -> Self {
        let mut tail = Self { comma: None, line_end: value_end };
        let mut same_line = true;
        // The text begins in the middle of a file, but the tokenizer does not depend on the text before it.
        for (part, span) in tokens(&text[value_end..call_end]) {
            let (start, end) = (value_end + span.start, value_end + span.end);
            match part {
                Token::Comma => {
                    tail = Self { comma: Some(start), line_end: end };
                    same_line = true;
                }
                Token::Space if text[start..end].contains('\n') => same_line = false,
                Token::LineComment | Token::BlockComment if same_line => {
                    tail.line_end = start + text[start..end].trim_end().len();
                }
                Token::Word | Token::Open | Token::Close => break,
                _ => {}
            }
        }
        tail
    }
}
