//! Space and comments of three texts, as one: what one side changed is taken, and no comment is lost.

use std::collections::{BTreeMap, BTreeSet};

use maquette_syntax::{Token, tokens};

use super::align::matched;

/// A comment, and the space before it.
#[derive(Clone, Copy)]
struct Note<'t> {
    lead: &'t str,
    text: &'t str,
}

impl Note<'_> {
    /// Whether it runs to the end of its line.
    fn is_line(self) -> bool {
        self.text.starts_with("//")
    }
}

/// The comments of a text in their order.
pub(super) fn comments(text: &str) -> Vec<&str> {
    read(text).0.into_iter().map(|note| note.text).collect()
}

/// The comments of a text, and what stands behind the last one.
fn read(text: &str) -> (Vec<Note<'_>>, &str) {
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

/// Whether a text ends within a comment that runs to the end of its line.
pub(super) fn is_open(text: &str) -> bool {
    tokens(text).last().is_some_and(|(token, _)| *token == Token::LineComment)
}

/// What stands around some words, such as `"name" : `, which are the same in all texts; if not, the text of the side that changed
/// them.
pub(super) fn around(base: &str, ours: &str, theirs: &str) -> String {
    let [before, left, right] = [base, ours, theirs].map(gaps);
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
            between(base, left[k].0, right[k].0) + left[k].1
        })
        .collect()
}

/// What stands before each word and the word; behind the last one, with none.
fn gaps(text: &str) -> Vec<(&str, &str)> {
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

/// Space and comments between two words: those of the side that changed the comments, or their form; if both changed the comments,
/// all that is new.
fn between(base: &str, ours: &str, theirs: &str) -> String {
    let [before, left, right] = [base, ours, theirs].map(comments);
    if left == right || right == before {
        let is_theirs = left == right && ours == base;
        return if is_theirs { theirs } else { ours }.to_owned();
    }
    if ours == base {
        return theirs.to_owned();
    }
    let ((mine, tail), (other, their_tail)) = (read(ours), read(theirs));
    fn indent_of(text: &str) -> Option<String> {
        text.rsplit_once('\n').map(|(_, indent)| indent.to_owned())
    }
    let indent = indent_of(tail).or_else(|| indent_of(their_tail)).unwrap_or_default();
    fn new_line(lines: usize, indent: &str) -> String {
        format!("{}{indent}", "\n".repeat(lines))
    }
    let mut text = String::new();
    let mut is_line = false;
    for (is_ours, k) in together(&before, &left, &right) {
        let note = if is_ours { mine[k] } else { other[k] };
        let lead = match (is_ours, note.lead.matches('\n').count()) {
            (true, _) => note.lead.to_owned(),
            // Where they reworded what stands there, it stands as it did.
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
        is_line = note.is_line();
    }
    match is_line && !tail.contains('\n') {
        true => text + if their_tail.contains('\n') { their_tail } else { "" },
        false => text + tail,
    }
}

/// The comments of both: ours without those that they took away, and their new ones, by whether they are ours and their place there.
fn together(before: &[&str], left: &[&str], right: &[&str]) -> Vec<(bool, usize)> {
    let (ours, theirs) = (matched(before, left), matched(before, right));
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

/// Whether a result lacks a comment that one side wrote and the other left alone, or has one that one of them took away or reworded.
pub(super) fn is_amiss(texts: [&str; 3], result: &str, has_conflicts: bool) -> bool {
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
        // What stands in a conflict stands there for each side.
        found < least || !has_conflicts && found > most
    })
}
