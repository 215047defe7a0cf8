//! The canonical form of a graph file.
//!
//! It hangs on the words, the comments and the blank lines of the text alone, and not on how the author broke its lines: two
//! texts that differ in spaces and line breaks have one form. Every comment, the author's order and the spelling of every
//! literal are kept. What is on one line stays there as long as it fits; otherwise a list or map in last place is opened
//! behind what stands before it, and anything else is broken into one entry a line. Lists of short values are filled. The
//! entries of `nodes` and the rows of a list of lists are always on lines of their own.
//!
//! The printed text is compared with the text that was read before it is returned.

use std::mem::take;
use std::path::Path;
use std::sync::Arc;

use maquette_syntax::error::{Problem, Severity, Source, Span, code};
use maquette_syntax::{Ends, Token, commas_behind, parse, syntax_problems, tokens};

/// Columns of the longest line that is not broken. The graphs that the form was taken from have nodes of up to 146 columns on
/// one line; at 120 every fifth of the long ones would become a block of five to ten lines.
const WIDTH: usize = 150;

/// Columns of a step to the right.
const STEP: usize = 4;

/// A map with more entries than this is broken, even if it would fit.
const MOST_IN_LINE: usize = 4;

/// A value of at most so many columns is short: many of them share a line.
const SHORT: usize = 30;

/// A graph file's text in its canonical form; problems if it cannot be read. `name` is for the problems.
///
/// Every comment is kept, and the order; the form of a canonical text is the text itself. Lines end as all of them do in the text;
/// with `\n` if they end differently.
pub fn formatted(name: &Path, text: &str) -> Result<String, Vec<Problem>> {
    let (_, mistakes) = parse(text);
    if !mistakes.is_empty() {
        return Err(syntax_problems(name, text, mistakes));
    }
    let ends = Ends::of(text);
    let plain = ends.map_or_else(|| text.to_owned(), |ends| ends.plain(text));
    let form = Printer::default().file(&Parts::new(&commas_behind(&plain)).file());
    if inventory(&plain) == inventory(&form) {
        return Ok(ends.unwrap_or(Ends::Unix).put(form));
    }
    Err(vec![fault(name, text, "the canonical form")])
}

/// What is made of a text, and would not say the same.
pub(super) fn fault(name: &Path, text: &str, what: &str) -> Problem {
    let source = Arc::new(Source { name: name.to_owned(), text: text.to_owned() });
    let message = format!("{what} would not say the same");
    let help = "this is a fault of the formatter: the file is left as it is".into();
    let place = (source, Span::default());
    Problem { help, ..Problem::new(Severity::Error, code::SYNTAX, place, message) }
}

/// An entry, `name: value`, in its canonical form, as it stands behind so many columns. Its other lines begin with as many spaces.
pub(super) fn entry_form(entry: &str, indent: usize) -> String {
    let group = Parts::new(entry).group("", 1);
    let mut printer = Printer { text: String::new(), column: indent };
    for entry in &group.entries {
        printer.pieces(&entry.pieces, indent, 1);
    }
    if inventory(entry) == inventory(&printer.text) { printer.text } else { entry.to_owned() }
}

/// All that a form must keep: the words in their order, without commas that mean nothing, and the comments.
fn inventory(text: &str) -> (Vec<&str>, Vec<&str>) {
    let (mut words, mut comments): (Vec<&str>, Vec<&str>) = (Vec::new(), Vec::new());
    for (part, span) in tokens(text) {
        let word = &text[span.start..span.end];
        match part {
            Token::Space => {}
            Token::LineComment | Token::BlockComment => comments.push(word.trim_end()),
            Token::Close => {
                words.pop_if(|last| *last == ",");
                words.push(word);
            }
            _ => words.push(word),
        }
    }
    comments.sort_unstable();
    (words, comments)
}

/// What stands between two commas, with the comments that go with it.
#[derive(Default)]
struct Entry<'t> {
    above: Vec<Note<'t>>,
    /// Whether a blank line stands before it, behind the comments above.
    gap: bool,
    pieces: Vec<Piece<'t>>,
    /// Comments behind it on its last line.
    behind: Vec<&'t str>,
}

/// A comment on a line of its own.
struct Note<'t> {
    text: &'t str,
    /// Whether a blank line stands before it.
    gap: bool,
}

enum Piece<'t> {
    Word(&'t str),
    Colon,
    Comment(&'t str),
    Group(Group<'t>),
}

/// What stands between two brackets.
struct Group<'t> {
    open: &'t str,
    close: &'t str,
    entries: Vec<Entry<'t>>,
    /// Comments before the closing bracket.
    last: Vec<Note<'t>>,
    /// How many columns it has on one line; none if it must be broken.
    flat: Option<usize>,
    /// Whether it is the graph itself.
    is_top: bool,
}

impl<'t> Entry<'t> {
    /// How many columns it has on one line; none if it needs more than one.
    fn flat(&self) -> Option<usize> {
        let plain = self.above.is_empty() && self.behind.is_empty();
        plain.then(|| flat(&self.pieces)).flatten()
    }

    fn has_colon(&self) -> bool {
        self.pieces.iter().any(|piece| matches!(piece, Piece::Colon))
    }

    fn last_group(&self) -> Option<&Group<'t>> {
        match self.pieces.last() {
            Some(Piece::Group(group)) => Some(group),
            _ => None,
        }
    }

    /// Whether it is a list and nothing else.
    fn is_list(&self) -> bool {
        self.pieces.len() == 1 && self.last_group().is_some_and(|group| group.open == "[")
    }

    /// Whether it is a value that shares its line with others of its list.
    fn is_short(&self) -> bool {
        let has_names =
            |group: &Group<'t>| group.open != "(" || group.entries.iter().any(Self::has_colon);
        !self.has_colon()
            && !self.last_group().is_some_and(has_names)
            && flat(&self.pieces).is_some_and(|columns| columns <= SHORT)
    }
}

fn flat(pieces: &[Piece<'_>]) -> Option<usize> {
    let mut columns = 0;
    for (index, piece) in pieces.iter().enumerate() {
        columns += usize::from(index > 0 && is_apart(&pieces[index - 1], piece));
        columns += match piece {
            Piece::Word(text) | Piece::Comment(text) => text.chars().count(),
            Piece::Colon => 1,
            Piece::Group(group) => group.flat?,
        };
    }
    Some(columns)
}

/// Whether a space stands between two pieces.
fn is_apart(before: &Piece<'_>, after: &Piece<'_>) -> bool {
    match (before, after) {
        (_, Piece::Colon) => false,
        (Piece::Colon | Piece::Comment(_), _) | (_, Piece::Comment(_)) => true,
        _ => false,
    }
}

impl<'t> Group<'t> {
    fn new(open: &'t str, close: &'t str, entries: Vec<Entry<'t>>, last: Vec<Note<'t>>) -> Self {
        let mut group = Self { open, close, entries, last, flat: None, is_top: false };
        group.flat = group.measure();
        group
    }

    fn measure(&self) -> Option<usize> {
        if !self.last.is_empty() || self.is_long_map() || self.is_matrix() {
            return None;
        }
        let columns = self.entries.iter().map(Entry::flat).sum::<Option<usize>>()?;
        let commas = 2 * self.entries.len().saturating_sub(1);
        Some(self.open.len() + columns + commas + self.close.len() + 2 * self.padding().len())
    }

    fn is_long_map(&self) -> bool {
        let count = self.entries.len();
        fn has_calls(entries: &[Entry<'_>]) -> bool {
            entries.iter().any(|entry| entry.last_group().is_some())
        }
        self.open == "{" && (count > MOST_IN_LINE || (count > 1 && has_calls(&self.entries)))
    }

    fn is_matrix(&self) -> bool {
        self.open == "[" && self.entries.len() > 1 && self.entries.iter().all(Entry::is_list)
    }

    /// What stands inside of the brackets on one line.
    fn padding(&self) -> &'static str {
        if self.open == "{" && !self.entries.is_empty() { " " } else { "" }
    }

    /// Whether its lines hold as many values as fit.
    fn is_filled(&self) -> bool {
        self.open != "{" && self.entries.len() > 1 && self.entries.iter().all(Entry::is_short)
    }

    /// The list or map in last place that can be opened behind all that stands before it, and the columns up to there.
    fn opened_last(&self) -> Option<(&Self, usize)> {
        let (last, before) = self.entries.split_last()?;
        let group = last.last_group()?;
        let is_plain = last.above.is_empty() && last.behind.is_empty() && self.last.is_empty();
        if self.open != "(" || self.is_top || group.open == "(" || !is_plain {
            return None;
        }
        let columns = before.iter().map(Entry::flat).sum::<Option<usize>>()? + 2 * before.len();
        let name = flat(&last.pieces[..last.pieces.len() - 1])?;
        Some((group, self.open.len() + columns + name + 1 + group.open.len()))
    }
}

/// Reads the pieces of a text into entries. The text has no mistakes.
struct Parts<'t> {
    text: &'t str,
    parts: Vec<(Token, Span)>,
    at: usize,
}

/// An entry as far as it has been read.
#[derive(Default)]
struct Draft<'t> {
    entry: Entry<'t>,
    /// Comments behind the last piece, and whether each is on its own line.
    late: Vec<(Note<'t>, bool)>,
}

impl<'t> Parts<'t> {
    fn new(text: &'t str) -> Self {
        Self { text, parts: tokens(text), at: 0 }
    }

    /// The whole file: its top level is a group without brackets.
    fn file(mut self) -> Group<'t> {
        self.group("", 0)
    }

    fn slice(&self, span: Span) -> &'t str {
        &self.text[span.start..span.end]
    }

    fn group(&mut self, open: &'t str, depth: usize) -> Group<'t> {
        let (mut entries, mut last) = (Vec::new(), Vec::new());
        let mut draft = Draft::default();
        let mut newlines = 0;
        let mut close = "";
        while let Some(&(part, span)) = self.parts.get(self.at) {
            self.at += 1;
            let text = self.slice(span);
            match part {
                Token::Space => {
                    newlines += text.matches('\n').count();
                    continue;
                }
                Token::Comma => {
                    draft.finish(&mut entries, None);
                }
                Token::Close => {
                    close = text;
                    break;
                }
                Token::LineComment | Token::BlockComment => {
                    if depth == 0 && newlines > 0 && !draft.entry.pieces.is_empty() {
                        draft.finish(&mut entries, None);
                    }
                    let is_inline = part == Token::BlockComment
                        && !text.contains('\n')
                        && (!draft.entry.pieces.is_empty() || self.word_follows());
                    let note = Note { text: text.trim_end(), gap: newlines > 1 };
                    draft.comment(note, newlines > 0, is_inline, entries.last_mut());
                }
                Token::Colon => draft.push(Piece::Colon, false),
                Token::Word => {
                    // What is behind an attribute of the file is not behind it on its line.
                    if depth == 0 && draft.entry.last_group().is_some() {
                        draft.finish(&mut entries, None);
                    }
                    draft.push(Piece::Word(text), newlines > 1);
                }
                Token::Open => {
                    let mut group = self.group(text, depth + 1);
                    group.is_top = depth == 0;
                    if group.is_top || (depth == 1 && draft.is_nodes() && !group.entries.is_empty())
                    {
                        group.flat = None;
                    }
                    draft.push(Piece::Group(group), newlines > 1);
                }
            }
            newlines = 0;
        }
        draft.finish(&mut entries, Some(&mut last));
        Group::new(open, close, entries, last)
    }

    /// Whether a value begins on the line of the comment that has just been read.
    fn word_follows(&self) -> bool {
        let rest = &self.parts[self.at..];
        let next = rest
            .iter()
            .find(|(part, span)| *part != Token::Space || self.slice(*span).contains('\n'));
        next.is_some_and(|(part, _)| matches!(part, Token::Word | Token::Open))
    }
}

impl<'t> Draft<'t> {
    fn is_nodes(&self) -> bool {
        matches!(self.entry.pieces.first(), Some(Piece::Word("nodes")))
    }

    fn push(&mut self, piece: Piece<'t>, gap: bool) {
        // Comments in the middle of an entry are put above it.
        self.entry.above.extend(take(&mut self.late).into_iter().map(|(note, _)| note));
        if self.entry.pieces.is_empty() {
            self.entry.gap = gap;
        }
        self.entry.pieces.push(piece);
    }

    fn comment(
        &mut self,
        note: Note<'t>,
        own_line: bool,
        is_inline: bool,
        before: Option<&mut Entry<'t>>,
    ) {
        if is_inline {
            self.push(Piece::Comment(note.text), note.gap);
        } else if !self.entry.pieces.is_empty() {
            self.late.push((note, own_line));
        } else if let Some(before) = before.filter(|_| !own_line && self.entry.above.is_empty()) {
            before.add_behind(note);
        } else {
            self.entry.above.push(note);
        }
    }

    /// Puts the entry behind the others, and comments that stand before the closing bracket into `last`.
    fn finish(&mut self, entries: &mut Vec<Entry<'t>>, last: Option<&mut Vec<Note<'t>>>) {
        let Self { mut entry, late } = take(self);
        let Some(last) = last else {
            for (note, own_line) in late {
                match own_line {
                    true => entry.above.push(note),
                    false => entry.add_behind(note),
                }
            }
            if !entry.pieces.is_empty() || !entry.above.is_empty() {
                entries.push(entry);
            }
            return;
        };
        if entry.pieces.is_empty() {
            last.append(&mut entry.above);
            return;
        }
        for (note, own_line) in late {
            match own_line {
                true => last.push(note),
                false => entry.add_behind(note),
            }
        }
        entries.push(entry);
    }
}

impl<'t> Entry<'t> {
    /// A line holds one comment that runs to its end; what stood there before goes above.
    fn add_behind(&mut self, note: Note<'t>) {
        if let Some(text) = self.behind.pop_if(|text| text.starts_with("//")) {
            self.above.push(Note { text, gap: false });
        }
        self.behind.push(note.text);
    }
}

#[derive(Default)]
struct Printer {
    text: String,
    column: usize,
}

impl Printer {
    fn file(mut self, file: &Group<'_>) -> String {
        for (index, entry) in file.entries.iter().enumerate() {
            self.above(entry, 0, index == 0);
            if !entry.pieces.is_empty() {
                self.pieces(&entry.pieces, 0, 0);
                self.behind(entry);
                self.line(0);
            }
        }
        for (index, note) in file.last.iter().enumerate() {
            self.note(note, 0, index == 0 && file.entries.is_empty());
        }
        self.text
    }

    fn put(&mut self, text: &str) {
        self.text.push_str(text);
        self.column = match text.rfind('\n') {
            Some(newline) => text[newline + 1..].chars().count(),
            None => self.column + text.chars().count(),
        };
    }

    /// Ends the line, unless it is empty; the next one begins at `indent`.
    fn line(&mut self, indent: usize) {
        let kept = self.text.trim_end_matches(' ').len();
        self.text.truncate(kept);
        if !self.text.is_empty() && !self.text.ends_with('\n') {
            self.text.push('\n');
        }
        self.text.extend(std::iter::repeat_n(' ', indent));
        self.column = indent;
    }

    fn blank_line(&mut self, indent: usize) {
        self.line(0);
        self.text.push('\n');
        self.line(indent);
    }

    fn note(&mut self, note: &Note<'_>, indent: usize, is_first: bool) {
        match note.gap && !is_first {
            true => self.blank_line(indent),
            false => self.line(indent),
        }
        self.put(note.text);
        self.line(0);
    }

    /// The comments above an entry, and the beginning of its own line.
    fn above(&mut self, entry: &Entry<'_>, indent: usize, is_first: bool) {
        for (index, note) in entry.above.iter().enumerate() {
            self.note(note, indent, is_first && index == 0);
        }
        match entry.gap && !(is_first && entry.above.is_empty()) {
            true => self.blank_line(indent),
            false => self.line(indent),
        }
    }

    fn behind(&mut self, entry: &Entry<'_>) {
        for comment in &entry.behind {
            self.put(" ");
            self.put(comment);
        }
    }

    /// `tail` is how many columns follow on the last line.
    fn pieces(&mut self, pieces: &[Piece<'_>], indent: usize, tail: usize) {
        for (index, piece) in pieces.iter().enumerate() {
            if index > 0 && is_apart(&pieces[index - 1], piece) {
                self.put(" ");
            }
            match piece {
                Piece::Word(text) | Piece::Comment(text) => self.put(text),
                Piece::Colon => self.put(":"),
                Piece::Group(group) => self.group(group, indent, tail),
            }
        }
    }

    fn group(&mut self, group: &Group<'_>, indent: usize, tail: usize) {
        if group.flat.is_some_and(|columns| self.column + columns + tail <= WIDTH) {
            return self.flat(group);
        }
        if let Some((last, columns)) = group.opened_last()
            && self.column + columns <= WIDTH
            && let Some((entry, before)) = group.entries.split_last()
        {
            self.put(group.open);
            for entry in before {
                self.pieces(&entry.pieces, indent, 0);
                self.put(", ");
            }
            let (name, list) = entry.pieces.split_at(entry.pieces.len() - 1);
            self.pieces(name, indent, 0);
            if name.last().is_some_and(|name| is_apart(name, &list[0])) {
                self.put(" ");
            }
            self.broken(last, indent);
            return self.put(group.close);
        }
        self.broken(group, indent);
    }

    fn flat(&mut self, group: &Group<'_>) {
        self.put(group.open);
        self.put(group.padding());
        for (index, entry) in group.entries.iter().enumerate() {
            if index > 0 {
                self.put(", ");
            }
            self.pieces(&entry.pieces, 0, 0);
        }
        self.put(group.padding());
        self.put(group.close);
    }

    fn broken(&mut self, group: &Group<'_>, indent: usize) {
        self.put(group.open);
        let inner = indent + STEP;
        let is_filled = group.is_filled();
        let mut must_end = true;
        for (index, entry) in group.entries.iter().enumerate() {
            let columns = flat(&entry.pieces).map_or(WIDTH, |columns| columns + 2);
            let is_alone = !is_filled || !entry.above.is_empty() || entry.gap;
            if must_end || is_alone || self.column + columns > WIDTH {
                self.above(entry, inner, index == 0);
            } else {
                self.put(" ");
            }
            self.pieces(&entry.pieces, inner, 1);
            self.put(",");
            self.behind(entry);
            must_end = !entry.behind.is_empty();
        }
        for (index, note) in group.last.iter().enumerate() {
            self.note(note, inner, index == 0 && group.entries.is_empty());
        }
        self.line(indent);
        self.put(group.close);
    }
}
