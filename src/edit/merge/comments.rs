//! Merges spaces and comments. A change that only one side made is taken, and no new comment is lost.

use std::collections::{BTreeMap, BTreeSet};

use maquette_syntax::{Token, tokens};

use super::align::match_items;

/// A comment, with the spaces and line breaks before it.
#[derive(Clone, Copy)]
struct Note<'t> {
    lead: &'t str,
    text: &'t str,
}

impl Note<'_> {
    /// Returns true for a comment that extends to the end of its line.
    fn is_line_comment(self) -> bool {
        self.text.starts_with("//")
    }
}

/// Returns the comments of a text in order.
pub(super) fn comments(text: &str) -> Vec<&str> {
    split_comments(text).0.into_iter().map(|note| note.text).collect()
}

/// Returns the comments of a text in order, and the text after the last comment.
fn split_comments(text: &str) -> (Vec<Note<'_>>, &str) {
    let (mut notes, mut end) = (Vec::new(), 0);
    for (token, span) in tokens(text) {
        if matches!(token, Token::LineComment | Token::BlockComment) {
            let (lead, note) = (&text[end..span.start], text[span.start..span.end].trim_end());
            notes.push(Note { lead, text: note });
            end = span.start + note.len();
        }
    }
    (notes, &text[end..])
}

/// Returns true if the end of a text is inside of a line comment.
pub(super) fn ends_in_line_comment(text: &str) -> bool {
    tokens(text).last().is_some_and(|(token, _)| *token == Token::LineComment)
}

/// Merges the gaps (spaces and comments) around tokens such as `"name" : `. If the tokens themselves differ, returns the text of the side
/// that changed them.
pub(super) fn merge_gaps(base: &str, ours: &str, theirs: &str) -> String {
    let [before, left, right] = [base, ours, theirs].map(tokens_with_gaps);
    fn words(gaps: &[(&str, &str)]) -> Vec<String> {
        gaps.iter().map(|gap| gap.1.to_owned()).collect::<Vec<_>>()
    }
    if words(&left) != words(&right) {
        let is_theirs = words(&left) == words(&before);
        return if is_theirs { theirs } else { ours }.to_owned();
    }
    let is_like = before.len() == left.len();
    (0..left.len())
        .map(|k: usize| {
            let base = if is_like { before[k].0 } else { "" };
            merge_gap(base, left[k].0, right[k].0) + left[k].1
        })
        .collect()
}

/// Returns each token with the gap before it. The last item has an empty token and the gap at the end of the text.
fn tokens_with_gaps(text: &str) -> Vec<(&str, &str)> {
    let (mut gaps, mut start) = (Vec::new(), 0);
    for (token, span) in tokens(text) {
        if !matches!(token, Token::Space | Token::LineComment | Token::BlockComment) {
            gaps.push((&text[start..span.start], &text[span.start..span.end]));
            start = span.end;
        }
    }
    gaps.push((&text[start..], ""));
    gaps
}

/// Merges the gap (spaces and comments) between two tokens. Takes the gap of the side that changed comments or, if neither did, of the side
/// that changed spaces. If both sides changed comments, keeps all new comments.
fn merge_gap(base: &str, ours: &str, theirs: &str) -> String {
    let [before, left, right] = [base, ours, theirs].map(comments);
    if left == right || right == before {
        let is_theirs = left == right && ours == base;
        return if is_theirs { theirs } else { ours }.to_owned();
    }
    if ours == base {
        return theirs.to_owned();
    }
    let ((mine, tail), (other, their_tail)) = (split_comments(ours), split_comments(theirs));
    fn indent_of(text: &str) -> Option<String> {
        text.rsplit_once('\n').map(|(_, indent)| indent.to_owned())
    }
    let indent = indent_of(tail).or_else(|| indent_of(their_tail)).unwrap_or_default();
    fn new_line(lines: usize, indent: &str) -> String {
        format!("{}{indent}", "\n".repeat(lines))
    }
    let mut text = String::new();
    let mut is_line = false;
    for (is_ours, k) in merge_comments(&before, &left, &right) {
        let note = if is_ours { mine[k] } else { other[k] };
        let lead = match (is_ours, note.lead.matches('\n').count()) {
            (true, _) => note.lead.to_owned(),
            // If the other side only reworded comments, keep our layout.
            _ if mine.len() == other.len() => mine[k].lead.to_owned(),
            (false, 0) if note.lead.is_empty() => " ".to_owned(),
            (false, 0) => note.lead.to_owned(),
            (false, lines) => new_line(lines, &indent),
        };
        if is_line && !lead.contains('\n') {
            text += &new_line(1, &indent);
        } else {
            text += &lead;
        }
        text += note.text;
        is_line = note.is_line_comment();
    }
    match is_line && !tail.contains('\n') {
        true => text + if their_tail.contains('\n') { their_tail } else { "" },
        false => text + tail,
    }
}

/// Merges two lists of comments: keeps our comments unless the other side removed them, and adds the other side's new comments. In the
/// result, the flag is true for our comments, and the number is the index of the comment on its side.
fn merge_comments(before: &[&str], left: &[&str], right: &[&str]) -> Vec<(bool, usize)> {
    let (ours, theirs) = (match_items(before, left), match_items(before, right));
    let kept = BTreeSet::from_iter(theirs.iter().flatten());
    let mut all: Vec<_> = (0..left.len())
        .filter(|k| ours[*k].is_none_or(|place| kept.contains(&place)))
        .map(|k| (true, k))
        .collect();
    let mut place = 0;
    for (k, known) in theirs.iter().enumerate() {
        if let Some(known) = known {
            let here = all.iter().position(|&(is_ours, k)| is_ours && ours[k] == Some(*known));
            place = here.map_or(place, |here| here + 1);
            continue;
        }
        if (0..left.len()).any(|mine: usize| ours[mine].is_none() && left[mine] == right[k]) {
            continue;
        }
        while all.get(place).is_some_and(|&(is_ours, k)| !is_ours || ours[k].is_none()) {
            place += 1;
        }
        all.insert(place, (false, k));
    }
    all
}

/// Returns true if a merged text has wrong comments: it lacks a comment that one side wrote and the other side did not remove, or contains
/// a comment that one side removed or reworded.
pub(super) fn has_wrong_comments(texts: [&str; 3], result: &str, has_conflicts: bool) -> bool {
    let [base, ours, theirs, found] = [texts[0], texts[1], texts[2], result].map(|text| {
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        for note in comments(text) {
            *counts.entry(note.to_owned()).or_default() += 1;
        }
        counts
    });
    let all = BTreeSet::from_iter([&base, &ours, &theirs].into_iter().flat_map(BTreeMap::keys));
    all.into_iter().any(|note| {
        let [base, ours, theirs, found] =
            [&base, &ours, &theirs, &found].map(|counts| counts.get(note).copied().unwrap_or(0));
        let sum = (ours + theirs).saturating_sub(base);
        let most = ours.max(theirs);
        let (least, most) = match (ours == base, theirs == base) {
            (true, _) => (theirs, theirs),
            (_, true) => (ours, ours),
            _ => (sum.min(most), sum.max(most)),
        };
        // A conflict repeats the comments of both sides, so there may be more comments but not fewer.
        found < least || !has_conflicts && found > most
    })
}
