//! The canonical form of a graph file.
//!
//! The form depends on the words, the comments and the blank lines of the text, but not on its line breaks and other spaces. The comments,
//! the order, and the spelling of literals are kept.
//!
//! An entry is on one line if it fits. Otherwise, if its last field is a list or map, the fields before it stay on the first line, and only
//! the content of the list or map is broken into lines. Any other value is broken into one entry per line. A list of short values is
//! filled: each line contains as many values as fit. The entries of `nodes`, and the rows of a list of lists, always begin on lines of
//! their own.
//!
//! The formatted text is compared with the original text before it is returned, to be sure that nothing was lost.

use std::mem::take;
use std::path::Path;
use std::sync::Arc;

use maquette_syntax::error::{Diagnostic, Severity, Source, Span, code};
use maquette_syntax::{LineEnding, Token, parse, syntax_diagnostics, tokens, with_trailing_commas};

/// Maximum line width in columns. The graphs for which the canonical form was designed have nodes of up to 146 columns on one line. With a
/// maximum of 120, one in five of these long nodes would become a block of five to ten lines.
const MAX_WIDTH: usize = 150;

/// The number of columns per level of indentation.
const INDENT: usize = 4;

/// Maximum number of entries of a map on one line.
const MAX_INLINE_ENTRIES: usize = 4;

/// Maximum width in columns of a short value, which may share its line with other values of a list.
const MAX_SHORT_WIDTH: usize = 30;

/// Returns the text of a graph file in its canonical form. If the text cannot be parsed, returns diagnostics, in which the file has the
/// name `name`.
///
/// The comments and the order are kept. A text in the canonical form is not changed. Uniform line endings are kept; mixed ones become `\n`.
pub fn format_text(name: &Path, text: &str) -> Result<String, Vec<Diagnostic>> {
    let (_, errors) = parse(text);
    if !errors.is_empty() {
        return Err(syntax_diagnostics(name, text, errors));
    }
    let ends = LineEnding::detect(text);
    let plain = ends.map_or_else(|| text.to_owned(), |ends| ends.normalize(text));
    let form =
        Printer::default().write_file(&Reader::new(&with_trailing_commas(&plain)).read_file());
    if inventory(&plain) == inventory(&form) {
        return Ok(ends.unwrap_or(LineEnding::Unix).apply(form));
    }
    Err(vec![internal_error(name, text, "the canonical form")])
}

/// Returns the error that the formatted text has another meaning than the original text. `what` is the operation that failed.
pub(super) fn internal_error(name: &Path, text: &str, what: &str) -> Diagnostic {
    let source = Arc::new(Source { name: name.to_owned(), text: text.to_owned() });
    let message = format!("{what} would change the meaning of the file");
    let help = "this is a bug in the formatter; the file is unchanged".into();
    let place = (source, Span::default());
    Diagnostic { help, ..Diagnostic::new(Severity::Error, code::SYNTAX, place, message) }
}

/// Formats an entry, `name: value`, whose first line starts at column `indent`. Its other lines are indented by at least `indent` spaces.
pub(super) fn format_entry(entry: &str, indent: usize) -> String {
    let group = Reader::new(entry).read_group("", 1);
    let mut printer = Printer { text: String::new(), column: indent };
    for entry in &group.entries {
        printer.write_pieces(&entry.pieces, indent, 1);
    }
    if inventory(entry) == inventory(&printer.text) { printer.text } else { entry.to_owned() }
}

/// Returns the parts of a text that formatting must keep: the words in order, without redundant commas, and the comments, sorted.
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

/// An entry: the text between two commas, with its comments.
#[derive(Default)]
struct Entry<'t> {
    above: Vec<Note<'t>>,
    /// True if a blank line precedes the entry and its comments.
    has_blank_line: bool,
    pieces: Vec<Piece<'t>>,
    /// The comments after the entry, on the last line of the entry.
    trailing: Vec<&'t str>,
}

/// A comment that is on a line of its own.
struct Note<'t> {
    text: &'t str,
    /// True if a blank line precedes the comment.
    has_blank_line: bool,
}

enum Piece<'t> {
    Word(&'t str),
    Colon,
    Comment(&'t str),
    Group(Group<'t>),
}

/// A group: the text between two brackets.
struct Group<'t> {
    open: &'t str,
    close: &'t str,
    entries: Vec<Entry<'t>>,
    /// The comments between the last entry and the closing bracket.
    last: Vec<Note<'t>>,
    /// The width of the group in columns if it is written on one line. `None` if it must be broken into lines.
    inline_width: Option<usize>,
    /// True for the outermost call of the file, such as `Graph(..)`.
    is_top: bool,
}

impl<'t> Entry<'t> {
    /// Returns the width of the entry in columns if it is written on one line. `None` if it must be broken into lines.
    fn inline_width(&self) -> Option<usize> {
        let plain = self.above.is_empty() && self.trailing.is_empty();
        plain.then(|| inline_width(&self.pieces)).flatten()
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

    /// Returns true if the entry is a list without a name.
    fn is_list(&self) -> bool {
        self.pieces.len() == 1 && self.last_group().is_some_and(|group| group.open == "[")
    }

    /// Returns true if the entry may share a line with other items of its list.
    fn is_short(&self) -> bool {
        !self.has_colon()
            && self
                .last_group()
                .is_none_or(|group| group.open == "(" && !group.entries.iter().any(Self::has_colon))
            && inline_width(&self.pieces).is_some_and(|columns| columns <= MAX_SHORT_WIDTH)
    }
}

fn inline_width(pieces: &[Piece<'_>]) -> Option<usize> {
    let mut columns = 0;
    for (index, piece) in pieces.iter().enumerate() {
        columns += usize::from(index > 0 && needs_space(&pieces[index - 1], piece));
        columns += match piece {
            Piece::Word(text) | Piece::Comment(text) => text.chars().count(),
            Piece::Colon => 1,
            Piece::Group(group) => group.inline_width?,
        };
    }
    Some(columns)
}

/// Returns true if two adjacent pieces must be separated by a space.
fn needs_space(before: &Piece<'_>, after: &Piece<'_>) -> bool {
    match (before, after) {
        (_, Piece::Colon) => false,
        (Piece::Colon | Piece::Comment(_), _) | (_, Piece::Comment(_)) => true,
        _ => false,
    }
}

impl<'t> Group<'t> {
    fn new(open: &'t str, close: &'t str, entries: Vec<Entry<'t>>, last: Vec<Note<'t>>) -> Self {
        let mut group = Self { open, close, entries, last, inline_width: None, is_top: false };
        group.inline_width = group.measure();
        group
    }

    fn measure(&self) -> Option<usize> {
        if !self.last.is_empty() || self.is_long_map() || self.is_matrix() {
            return None;
        }
        let columns = self.entries.iter().map(Entry::inline_width).sum::<Option<usize>>()?;
        let commas = 2 * self.entries.len().saturating_sub(1);
        Some(self.open.len() + columns + commas + self.close.len() + 2 * self.padding().len())
    }

    fn is_long_map(&self) -> bool {
        let count = self.entries.len();
        fn has_calls(entries: &[Entry<'_>]) -> bool {
            entries.iter().any(|entry| entry.last_group().is_some())
        }
        self.open == "{" && (count > MAX_INLINE_ENTRIES || (count > 1 && has_calls(&self.entries)))
    }

    fn is_matrix(&self) -> bool {
        self.open == "[" && self.entries.len() > 1 && self.entries.iter().all(Entry::is_list)
    }

    /// Returns the space between the brackets and the content of a group on one line.
    fn padding(&self) -> &'static str {
        if self.open == "{" && !self.entries.is_empty() { " " } else { "" }
    }

    /// Returns true if each line of the group contains as many values as fit.
    fn is_filled(&self) -> bool {
        self.open != "{" && self.entries.len() > 1 && self.entries.iter().all(Entry::is_short)
    }

    /// Returns the last entry if it is a list or map whose content can be broken into lines while the entries before it stay on the first
    /// line. Also returns the number of columns up to the bracket of that entry.
    fn last_opened(&self) -> Option<(&Self, usize)> {
        let (last, before) = self.entries.split_last()?;
        let group = last.last_group()?;
        let is_plain = last.above.is_empty() && last.trailing.is_empty() && self.last.is_empty();
        if self.open != "(" || self.is_top || group.open == "(" || !is_plain {
            return None;
        }
        let columns =
            before.iter().map(Entry::inline_width).sum::<Option<usize>>()? + 2 * before.len();
        let name = inline_width(&last.pieces[..last.pieces.len() - 1])?;
        Some((group, self.open.len() + columns + name + 1 + group.open.len()))
    }
}

/// Reads the tokens of a text as nested groups and entries. The text must have no syntax errors.
struct Reader<'t> {
    text: &'t str,
    parts: Vec<(Token, Span)>,
    at: usize,
}

/// An entry that has not been read completely.
#[derive(Default)]
struct PartialEntry<'t> {
    entry: Entry<'t>,
    /// The comments after the last piece that has been read. The flag is true if the comment is on a line of its own.
    pending: Vec<(Note<'t>, bool)>,
}

impl<'t> Reader<'t> {
    fn new(text: &'t str) -> Self {
        Self { text, parts: tokens(text), at: 0 }
    }

    /// Reads a whole file, as the content of a group without brackets.
    fn read_file(mut self) -> Group<'t> {
        self.read_group("", 0)
    }

    fn slice(&self, span: Span) -> &'t str {
        &self.text[span.start..span.end]
    }

    fn read_group(&mut self, open: &'t str, depth: usize) -> Group<'t> {
        let (mut entries, mut last) = (Vec::new(), Vec::new());
        let mut partial = PartialEntry::default();
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
                    partial.finish(&mut entries, None);
                }
                Token::Close => {
                    close = text;
                    break;
                }
                Token::LineComment | Token::BlockComment => {
                    if depth == 0 && newlines > 0 && !partial.entry.pieces.is_empty() {
                        partial.finish(&mut entries, None);
                    }
                    let is_inline = part == Token::BlockComment
                        && !text.contains('\n')
                        && (!partial.entry.pieces.is_empty() || self.word_follows());
                    let note = Note { text: text.trim_end(), has_blank_line: newlines > 1 };
                    partial.push_comment(note, newlines > 0, is_inline, entries.last_mut());
                }
                Token::Colon => partial.push(Piece::Colon, false),
                Token::Word => {
                    // The outermost value of the file may follow an attribute, such as `#![enable(..)]`, without a comma.
                    if depth == 0 && partial.entry.last_group().is_some() {
                        partial.finish(&mut entries, None);
                    }
                    partial.push(Piece::Word(text), newlines > 1);
                }
                Token::Open => {
                    let mut group = self.read_group(text, depth + 1);
                    group.is_top = depth == 0;
                    if group.is_top
                        || (depth == 1 && partial.is_nodes_section() && !group.entries.is_empty())
                    {
                        group.inline_width = None;
                    }
                    partial.push(Piece::Group(group), newlines > 1);
                }
            }
            newlines = 0;
        }
        partial.finish(&mut entries, Some(&mut last));
        Group::new(open, close, entries, last)
    }

    /// Returns true if a value follows the last comment on the same line.
    fn word_follows(&self) -> bool {
        let rest = &self.parts[self.at..];
        let next = rest
            .iter()
            .find(|(part, span)| *part != Token::Space || self.slice(*span).contains('\n'));
        next.is_some_and(|(part, _)| matches!(part, Token::Word | Token::Open))
    }
}

impl<'t> PartialEntry<'t> {
    fn is_nodes_section(&self) -> bool {
        matches!(self.entry.pieces.first(), Some(Piece::Word("nodes")))
    }

    fn push(&mut self, piece: Piece<'t>, gap: bool) {
        // Comments in the middle of an entry are moved above the entry.
        self.entry.above.extend(take(&mut self.pending).into_iter().map(|(note, _)| note));
        if self.entry.pieces.is_empty() {
            self.entry.has_blank_line = gap;
        }
        self.entry.pieces.push(piece);
    }

    fn push_comment(
        &mut self,
        note: Note<'t>,
        own_line: bool,
        is_inline: bool,
        before: Option<&mut Entry<'t>>,
    ) {
        if is_inline {
            self.push(Piece::Comment(note.text), note.has_blank_line);
        } else if !self.entry.pieces.is_empty() {
            self.pending.push((note, own_line));
        } else if let Some(before) = before.filter(|_| !own_line && self.entry.above.is_empty()) {
            before.add_trailing(note);
        } else {
            self.entry.above.push(note);
        }
    }

    /// Adds the complete entry to `entries`. Adds comments between the last entry and the closing bracket to `last`.
    fn finish(&mut self, entries: &mut Vec<Entry<'t>>, last: Option<&mut Vec<Note<'t>>>) {
        let Self { mut entry, pending: late } = take(self);
        let Some(last) = last else {
            for (note, own_line) in late {
                match own_line {
                    true => entry.above.push(note),
                    false => entry.add_trailing(note),
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
                false => entry.add_trailing(note),
            }
        }
        entries.push(entry);
    }
}

impl<'t> Entry<'t> {
    /// Adds a comment that follows the entry on the same line. A line comment must be the last comment on its line, so an earlier line
    /// comment is moved above the entry.
    fn add_trailing(&mut self, note: Note<'t>) {
        if let Some(text) = self.trailing.pop_if(|text| text.starts_with("//")) {
            self.above.push(Note { text, has_blank_line: false });
        }
        self.trailing.push(note.text);
    }
}

#[derive(Default)]
struct Printer {
    text: String,
    column: usize,
}

impl Printer {
    fn write_file(mut self, file: &Group<'_>) -> String {
        for (index, entry) in file.entries.iter().enumerate() {
            self.write_above(entry, 0, index == 0);
            if !entry.pieces.is_empty() {
                self.write_pieces(&entry.pieces, 0, 0);
                self.write_trailing(entry);
                self.end_line(0);
            }
        }
        for (index, note) in file.last.iter().enumerate() {
            self.write_note(note, 0, index == 0 && file.entries.is_empty());
        }
        self.text
    }

    fn write(&mut self, text: &str) {
        self.text.push_str(text);
        self.column = match text.rfind('\n') {
            Some(newline) => text[newline + 1..].chars().count(),
            None => self.column + text.chars().count(),
        };
    }

    /// Ends the current line, unless it is empty, and indents the next line.
    fn end_line(&mut self, indent: usize) {
        let kept = self.text.trim_end_matches(' ').len();
        self.text.truncate(kept);
        if !self.text.is_empty() && !self.text.ends_with('\n') {
            self.text.push('\n');
        }
        self.text.extend(std::iter::repeat_n(' ', indent));
        self.column = indent;
    }

    fn blank_line(&mut self, indent: usize) {
        self.end_line(0);
        self.text.push('\n');
        self.end_line(indent);
    }

    fn write_note(&mut self, note: &Note<'_>, indent: usize, is_first: bool) {
        match note.has_blank_line && !is_first {
            true => self.blank_line(indent),
            false => self.end_line(indent),
        }
        self.write(note.text);
        self.end_line(0);
    }

    /// Writes the comments above an entry, and starts the line of the entry.
    fn write_above(&mut self, entry: &Entry<'_>, indent: usize, is_first: bool) {
        for (index, note) in entry.above.iter().enumerate() {
            self.write_note(note, indent, is_first && index == 0);
        }
        match entry.has_blank_line && !(is_first && entry.above.is_empty()) {
            true => self.blank_line(indent),
            false => self.end_line(indent),
        }
    }

    fn write_trailing(&mut self, entry: &Entry<'_>) {
        for comment in &entry.trailing {
            self.write(" ");
            self.write(comment);
        }
    }

    /// Writes pieces of an entry. `tail` is the number of columns needed after them on the last line.
    fn write_pieces(&mut self, pieces: &[Piece<'_>], indent: usize, tail: usize) {
        for (index, piece) in pieces.iter().enumerate() {
            if index > 0 && needs_space(&pieces[index - 1], piece) {
                self.write(" ");
            }
            match piece {
                Piece::Word(text) | Piece::Comment(text) => self.write(text),
                Piece::Colon => self.write(":"),
                Piece::Group(group) => self.write_group(group, indent, tail),
            }
        }
    }

    fn write_group(&mut self, group: &Group<'_>, indent: usize, tail: usize) {
        if group.inline_width.is_some_and(|columns| self.column + columns + tail <= MAX_WIDTH) {
            return self.write_inline(group);
        }
        if let Some((last, columns)) = group.last_opened()
            && self.column + columns <= MAX_WIDTH
            && let Some((entry, before)) = group.entries.split_last()
        {
            self.write(group.open);
            for entry in before {
                self.write_pieces(&entry.pieces, indent, 0);
                self.write(", ");
            }
            let (name, list) = entry.pieces.split_at(entry.pieces.len() - 1);
            self.write_pieces(name, indent, 0);
            if name.last().is_some_and(|name| needs_space(name, &list[0])) {
                self.write(" ");
            }
            self.write_multiline(last, indent);
            return self.write(group.close);
        }
        self.write_multiline(group, indent);
    }

    fn write_inline(&mut self, group: &Group<'_>) {
        self.write(group.open);
        self.write(group.padding());
        for (index, entry) in group.entries.iter().enumerate() {
            if index > 0 {
                self.write(", ");
            }
            self.write_pieces(&entry.pieces, 0, 0);
        }
        self.write(group.padding());
        self.write(group.close);
    }

    fn write_multiline(&mut self, group: &Group<'_>, indent: usize) {
        self.write(group.open);
        let inner = indent + INDENT;
        let is_filled = group.is_filled();
        let mut must_end = true;
        for (index, entry) in group.entries.iter().enumerate() {
            let columns = inline_width(&entry.pieces).map_or(MAX_WIDTH, |columns| columns + 2);
            let is_alone = !is_filled || !entry.above.is_empty() || entry.has_blank_line;
            if must_end || is_alone || self.column + columns > MAX_WIDTH {
                self.write_above(entry, inner, index == 0);
            } else {
                self.write(" ");
            }
            self.write_pieces(&entry.pieces, inner, 1);
            self.write(",");
            self.write_trailing(entry);
            must_end = !entry.trailing.is_empty();
        }
        for (index, note) in group.last.iter().enumerate() {
            self.write_note(note, inner, index == 0 && group.entries.is_empty());
        }
        self.end_line(indent);
        self.write(group.close);
    }
}
