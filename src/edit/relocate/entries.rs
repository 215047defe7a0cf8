//! Moves entries of a map to another text. Comments move with an entry if they are inside of it, after it on its line, or directly above
//! it.

use std::collections::BTreeSet;
use std::path::Path;

use maquette_graph::{
    Splice, Tail, apply, content_start, indent_of, newline, parts, reindent, remove_parts,
    without_blank_lines,
};
use maquette_syntax::error::{Diagnostic, Span};
use maquette_syntax::{Kind, LineEnding, Token, Tree, parse, tokens};

/// Indentation, in columns, of an entry of a section in the canonical form.
const ENTRY_INDENT: usize = 8;

/// Entries that were removed from a map, to be inserted elsewhere.
pub(crate) struct TakenEntries {
    /// The edits that remove the entries from the original text.
    pub(crate) splices: Vec<Splice>,
    /// The text of all entries, each with its comments and a comma.
    pub(crate) text: String,
}

/// Removes entries from a map, and applies the edits `inner` to the removed text. A new entry takes the place of the last removed entry.
/// `write` returns the text of the new entry for a given indentation.
pub(crate) fn take_entries(
    text: &str,
    map: &Tree,
    taken: &BTreeSet<usize>,
    inner: &[Splice],
    write: impl Fn(&str) -> String,
) -> TakenEntries {
    let parts = parts(map);
    let Some(&last) = taken.last() else {
        return TakenEntries { splices: Vec::new(), text: String::new() };
    };
    let Some(runs) = line_runs(text, map, &parts, taken) else {
        // The entries share lines with other text, so whole lines cannot be moved.
        let all = taken.iter().map(|&at| apply_within(text, parts[at], inner) + ",\n").collect();
        let others = taken.iter().copied().filter(|&at| at != last).collect();
        let mut splices = remove_parts(text, map, &others);
        splices.push((parts[last], write("")));
        return TakenEntries { splices, text: all };
    };
    let mut inner = inner.to_vec();
    let comma = Tail::find(text, parts[last].end, map.span.end).comma;
    if comma.is_none() {
        let end = parts[last].end;
        inner.push((Span { start: end, end }, ",".into()));
    }
    let (open, close) = (content_start(text, map.span), map.span.end - 1);
    let (mut splices, mut all) = (Vec::new(), String::new());
    for (nth, run) in runs.iter().enumerate() {
        let newline = newline(text, parts[last].start);
        if nth > 0 && text[..run.start].trim_end_matches([' ', '\t']).ends_with(&newline.repeat(2))
        {
            all += "\n";
        }
        all += &apply_within(text, *run, &inner);
        if nth + 1 == runs.len() {
            let indent = indent_of(text, map.span, parts[last]).unwrap_or_default();
            splices.push((*run, format!("{indent}{},{newline}", write(indent))));
        } else {
            let gap = without_blank_lines(text, *run, open, close);
            splices.push((gap, String::new()));
        }
    }
    TakenEntries { splices, text: all }
}

/// Returns the lines of the taken entries, with their comments; adjacent entries are joined. `None` if an entry shares lines with other
/// text.
fn line_runs(text: &str, map: &Tree, parts: &[Span], taken: &BTreeSet<usize>) -> Option<Vec<Span>> {
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

/// Returns the lines of an entry, with the comments directly above and after it. `None` if these lines contain other text.
fn lines_of(text: &str, map: &Tree, parts: &[Span], at: usize) -> Option<Span> {
    indent_of(text, map.span, parts[at])?;
    let tail = Tail::find(text, parts[at].end, map.span.end);
    let rest = text[tail.line_end..].trim_start_matches([' ', '\t', '\r']);
    if tail.comma.is_some_and(|comma: usize| text[parts[at].end..comma].contains('\n'))
        || !rest.starts_with('\n')
    {
        return None;
    }
    let end = text.len() - rest.len() + 1;
    let before = match at.checked_sub(1) {
        Some(before) => Tail::find(text, parts[before].end, map.span.end).line_end,
        None => content_start(text, map.span),
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

/// Returns the text that must separate a part of a value from a new part after it: a comma, and either a line break with indentation or a
/// space.
pub(crate) fn separator_after(text: &str, owner: &Tree, part: Span) -> String {
    let newline = newline(text, owner.span.end - 1);
    let indent = indent_of(text, owner.span, part);
    indent.map_or(", ".to_owned(), |indent| format!(",{newline}{indent}"))
}

/// Applies the edits that are inside of the span `part`, and returns the edited text of that span.
pub(crate) fn apply_within(text: &str, part: Span, splices: &[Splice]) -> String {
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

/// Formats entries of the section `nodes`. Each entry is on its own line, indented by [`ENTRY_INDENT`] columns. Empty if there are no
/// entries.
///
/// # Errors
/// The text does not consist of entries.
pub(crate) fn indented_entries(path: &Path, entries: &str) -> Result<String, Vec<Diagnostic>> {
    let entries = LineEnding::detect(entries).unwrap_or(LineEnding::Windows).normalize(entries);
    let form = crate::format_text(path, &format!("Graph(\n    nodes: {{{entries}\n    }},\n)\n"))?;
    let (tree, _) = parse(&form);
    let nodes = tree.fields().and_then(|fields| fields.first()).map(|field| &field.value);
    let Some(nodes) = nodes.filter(|nodes| !parts(nodes).is_empty()) else {
        return Ok(String::new());
    };
    let inside = &form[content_start(&form, nodes.span)..nodes.span.end - 1];
    Ok(format!("{}\n", inside.trim_matches('\n').trim_end()))
}

/// Returns the edits that replace an entry by `entries`, a result of [`indented_entries`]. Comments of the replaced entry are kept above
/// the new entries.
pub(crate) fn replace_entry(text: &str, map: &Tree, at: usize, entries: &str) -> Vec<Splice> {
    let parts = parts(map);
    let part = parts[at];
    if entries.is_empty() {
        return remove_parts(text, map, &BTreeSet::from([at]));
    }
    let newline = newline(text, map.span.end - 1);
    let entries = entries.strip_prefix(&" ".repeat(ENTRY_INDENT)).unwrap_or(entries);
    if let (Some(indent), Some(lines)) =
        (indent_of(text, map.span, part), lines_of(text, map, &parts, at))
    {
        let start = part.start - indent.len();
        let comments = comments(&text[start..lines.end])
            .into_iter()
            .map(|comment| format!("{indent}{comment}{newline}"));
        let mut new = String::from_iter(comments);
        new += indent;
        new += reindent(entries.trim_end(), ENTRY_INDENT, indent, newline).trim_end();
        new += newline;
        return vec![(Span { start, end: lines.end }, new)];
    }
    // The comma of the replaced entry stays in the text, so remove the comma after the last new entry.
    let whole = format!("{{{entries}}}");
    let tree = parse(&whole).0;
    let mut last = entries.to_owned();
    if let Kind::Map(_) = tree.kind
        && let Some(end) = maquette_graph::parts(&tree).last().map(|part| part.end)
        && let Some(comma) = Tail::find(&whole, end, tree.span.end).comma
    {
        last.replace_range(comma - 1..comma, "");
    }
    let comments = comments(&text[part.start..part.end])
        .into_iter()
        .map(|comment| format!("{comment}{newline}"));
    let new = String::from_iter(comments) + reindent(&last, ENTRY_INDENT, "", newline).trim_end();
    vec![(part, format!("{newline}{new}{newline}"))]
}

fn comments(text: &str) -> Vec<&str> {
    let pieces = tokens(text).into_iter();
    let comments =
        pieces.filter(|(token, _)| matches!(token, Token::LineComment | Token::BlockComment));
    comments.map(|(_, Span { start, end })| text[start..end].trim_end()).collect()
}
