//! Entries of a map that go to another text with their comments: those inside of them, behind them on their line and directly above.

use std::collections::BTreeSet;
use std::path::Path;

use maquette_graph::{
    Splice, Tail, apply, indent_of, newline, opened, parts, reindented, without,
    without_blank_lines,
};
use maquette_syntax::error::{Problem, Span};
use maquette_syntax::{Ends, Kind, Token, Tree, parse, tokens};

/// Columns before an entry of a graph's section in the canonical form.
const COLUMNS: usize = 8;

/// What comes of entries that are taken out of a map.
pub(crate) struct Moved {
    /// The edits of the text that they stood in.
    pub(crate) splices: Vec<Splice>,
    /// The entries, each with a comma and its comments.
    pub(crate) text: String,
}

/// Takes entries out of a map, with other words in them, and puts a new one in the place of the last of them; `write` gives it as it
/// stands behind an indentation.
pub(crate) fn moved(
    text: &str,
    map: &Tree,
    taken: &BTreeSet<usize>,
    inner: &[Splice],
    write: impl Fn(&str) -> String,
) -> Moved {
    let parts = parts(map);
    let Some(&last) = taken.last() else {
        return Moved { splices: Vec::new(), text: String::new() };
    };
    let Some(runs) = runs(text, map, &parts, taken) else {
        // They share lines with others.
        let all = taken.iter().map(|&at| part_with(text, parts[at], inner) + ",\n").collect();
        let others = taken.iter().copied().filter(|&at| at != last).collect();
        let mut splices = without(text, map, &others);
        splices.push((parts[last], write("")));
        return Moved { splices, text: all };
    };
    let mut inner = inner.to_vec();
    let comma = Tail::of(text, parts[last].end, map.span.end).comma;
    if comma.is_none() {
        let end = parts[last].end;
        inner.push((Span { start: end, end }, ",".into()));
    }
    let (open, close) = (opened(text, map.span), map.span.end - 1);
    let (mut splices, mut all) = (Vec::new(), String::new());
    for (nth, run) in runs.iter().enumerate() {
        let newline = newline(text, parts[last].start);
        if nth > 0 && text[..run.start].trim_end_matches([' ', '\t']).ends_with(&newline.repeat(2))
        {
            all += "\n";
        }
        all += &part_with(text, *run, &inner);
        if nth + 1 == runs.len() {
            let indent = indent_of(text, map.span, parts[last]).unwrap_or_default();
            splices.push((*run, format!("{indent}{},{newline}", write(indent))));
        } else {
            let gap = without_blank_lines(text, *run, open, close);
            splices.push((gap, String::new()));
        }
    }
    Moved { splices, text: all }
}

/// The lines of entries that stand together, with their comments; none if one of them shares its lines with another thing.
fn runs(text: &str, map: &Tree, parts: &[Span], taken: &BTreeSet<usize>) -> Option<Vec<Span>> {
    let mut runs: Vec<(usize, Span)> = Vec::new();
    for &at in taken {
        let lines = lines_of(text, map, parts, at)?;
        match runs.last_mut() {
            Some((before, run)) if *before + 1 == at => (*before, run.end) = (at, lines.end),
            _ => runs.push((at, lines)),
        }
    }
    Some(runs.into_iter().map(|(_, run)| run).collect())
}

/// The lines of an entry, with the comments directly above it and behind it; none if something else stands there.
fn lines_of(text: &str, map: &Tree, parts: &[Span], at: usize) -> Option<Span> {
    indent_of(text, map.span, parts[at])?;
    let tail = Tail::of(text, parts[at].end, map.span.end);
    let rest = text[tail.line_end..].trim_start_matches([' ', '\t', '\r']);
    if tail.comma.is_some_and(|comma: usize| text[parts[at].end..comma].contains('\n'))
        || !rest.starts_with('\n')
    {
        return None;
    }
    let end = text.len() - rest.len() + 1;
    let before = match at.checked_sub(1) {
        Some(before) => Tail::of(text, parts[before].end, map.span.end).line_end,
        None => opened(text, map.span),
    };
    fn line_of(at: usize, text: &str) -> usize {
        text[..at].rfind('\n').map_or(0, |newline| newline + 1)
    }
    let mut start = line_of(parts[at].start, text);
    for (token, span) in tokens(&text[before..parts[at].start]).into_iter().rev() {
        if token == Token::Space {
            continue;
        }
        let comment = text[before + span.start..before + span.end].trim_end();
        let (first, last) = (before + span.start, before + span.start + comment.len());
        let is_above = last <= start && text[last..start].matches('\n').count() == 1;
        let line = line_of(first, text);
        if !is_above || line < before || !text[line..first].trim().is_empty() {
            break;
        }
        start = line;
    }
    Some(Span { start, end })
}

/// What stands between two parts of a value, where one more comes behind this one.
pub(crate) fn gap_behind(text: &str, owner: &Tree, part: Span) -> String {
    let newline = newline(text, owner.span.end - 1);
    let indent = indent_of(text, owner.span, part);
    indent.map_or(", ".to_owned(), |indent| format!(",{newline}{indent}"))
}

/// A part of a text with the edits in it made.
pub(crate) fn part_with(text: &str, part: Span, splices: &[Splice]) -> String {
    fn is_inside(span: &Span, part_start: usize, part_end: usize) -> bool {
        part_start <= span.start && span.end <= part_end
    }
    let inside = splices.iter().filter(|(span, _)| is_inside(span, part.start, part.end));
    let moved = inside.map(|(span, new)| {
        let span = Span { start: span.start - part.start, end: span.end - part.start };
        (span, new.clone())
    });
    apply(&text[part.start..part.end], moved.collect())
}

/// Entries of `nodes` in their canonical form, each on lines of its own behind [`COLUMNS`], the first of these included. Empty if there are none.
///
/// # Errors
/// They are no entries.
pub(crate) fn indented_entries(path: &Path, entries: &str) -> Result<String, Vec<Problem>> {
    let entries = Ends::of(entries).unwrap_or(Ends::Windows).plain(entries);
    let form = crate::formatted(path, &format!("Graph(\n    nodes: {{{entries}\n    }},\n)\n"))?;
    let (tree, _) = parse(&form);
    let nodes = tree.fields().and_then(|fields| fields.first()).map(|field| &field.value);
    let Some(nodes) = nodes.filter(|nodes| !parts(nodes).is_empty()) else {
        return Ok(String::new());
    };
    let inside = &form[opened(&form, nodes.span)..nodes.span.end - 1];
    Ok(format!("{}\n", inside.trim_matches('\n').trim_end()))
}

/// The edits that put entries, as [`indented_entries`] gives them, into the place of one, whose comments stay above them.
pub(crate) fn put_in_place(text: &str, map: &Tree, at: usize, entries: &str) -> Vec<Splice> {
    let parts = parts(map);
    let part = parts[at];
    if entries.is_empty() {
        return without(text, map, &BTreeSet::from([at]));
    }
    let newline = newline(text, map.span.end - 1);
    let entries = entries.strip_prefix(&" ".repeat(COLUMNS)).unwrap_or(entries);
    if let (Some(indent), Some(lines)) =
        (indent_of(text, map.span, part), lines_of(text, map, &parts, at))
    {
        let start = part.start - indent.len();
        let comments = comments(&text[start..lines.end])
            .into_iter()
            .map(|comment| format!("{indent}{comment}{newline}"));
        let mut new = String::from_iter(comments);
        new += indent;
        new += reindented(entries.trim_end(), COLUMNS, indent, newline).trim_end();
        new += newline;
        return vec![(Span { start, end: lines.end }, new)];
    }
    // The comma behind it stays.
    let whole = format!("{{{entries}}}");
    let tree = parse(&whole).0;
    let mut last = entries.to_owned();
    if let Kind::Map(_) = tree.kind
        && let Some(end) = maquette_graph::parts(&tree).last().map(|part| part.end)
        && let Some(comma) = Tail::of(&whole, end, tree.span.end).comma
    {
        last.replace_range(comma - 1..comma, "");
    }
    let comments = comments(&text[part.start..part.end])
        .into_iter()
        .map(|comment| format!("{comment}{newline}"));
    let new = String::from_iter(comments) + reindented(&last, COLUMNS, "", newline).trim_end();
    vec![(part, format!("{newline}{new}{newline}"))]
}

fn comments(text: &str) -> Vec<&str> {
    let pieces = tokens(text).into_iter();
    let comments =
        pieces.filter(|(token, _)| matches!(token, Token::LineComment | Token::BlockComment));
    comments.map(|(_, Span { start, end })| text[start..end].trim_end()).collect()
}
