//! Converts the positions and URIs of the editor: lines, columns in one of three encodings, and file paths.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use gen_lsp_types::{Position, PositionEncodingKind, Range, TextEdit, Uri};
use line_index::{LineCol, LineIndex, TextSize, WideEncoding, WideLineCol};
use maquette_syntax::LineEnding;
use maquette_syntax::error::Span;
use percent_encoding::{AsciiSet, CONTROLS, percent_decode_str, utf8_percent_encode};

/// The unit in which the editor counts columns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Columns {
    Utf8,
    #[default]
    Utf16,
    Utf32,
}

impl Columns {
    /// Chooses a unit that both the editor and the server support. UTF-8 bytes are preferred because they need no conversion.
    pub(super) fn negotiate(offered: &[&str]) -> Self {
        match () {
            () if offered.contains(&"utf-8") => Self::Utf8,
            () if offered.contains(&"utf-16") || !offered.contains(&"utf-32") => Self::Utf16,
            () => Self::Utf32,
        }
    }

    pub(super) fn kind(self) -> PositionEncodingKind {
        match self {
            Self::Utf8 => PositionEncodingKind::UTF8,
            Self::Utf16 => PositionEncodingKind::UTF16,
            Self::Utf32 => PositionEncodingKind::UTF32,
        }
    }

    fn wide(self) -> Option<WideEncoding> {
        match self {
            Self::Utf8 => None,
            Self::Utf16 => Some(WideEncoding::Utf16),
            Self::Utf32 => Some(WideEncoding::Utf32),
        }
    }
}

/// Replaces each `\r` that no `\n` follows by `\n`. Editors treat such a `\r` as a line end, but the line index does not.
fn with_line_feeds(text: &str) -> Cow<'_, str> {
    fn is_lone_return(bytes: &[u8], at: usize) -> bool {
        bytes[at] == b'\r' && bytes.get(at + 1) != Some(&b'\n')
    }
    let bytes = text.as_bytes();
    if !(0..bytes.len()).any(|at| is_lone_return(bytes, at)) {
        return text.into();
    }
    text.char_indices().map(|(at, c)| if is_lone_return(bytes, at) { '\n' } else { c }).collect()
}

/// The lines of a text, for converting between positions and byte offsets.
pub(super) struct Lines<'t> {
    text: &'t str,
    index: LineIndex,
    columns: Columns,
    ends: LineEnding,
}

/// Returns the line ending that is most frequent in a text.
fn line_ending(text: &str) -> LineEnding {
    let windows = text.matches("\r\n").count();
    let [feeds, returns] = ["\n", "\r"].map(|end| text.matches(end).count() - windows);
    match feeds.max(windows).max(returns) {
        most if feeds == most => LineEnding::Unix,
        most if windows == most => LineEnding::Windows,
        _ => LineEnding::Mac,
    }
}

impl<'t> Lines<'t> {
    pub(super) fn new(text: &'t str, columns: Columns) -> Self {
        let ends = line_ending(text);
        Self { text, index: LineIndex::new(&with_line_feeds(text)), columns, ends }
    }

    /// Converts the line endings of `text` to those of this document.
    pub(super) fn with_ends(&self, text: &str) -> String {
        let is_plain = self.ends == LineEnding::Unix && !text.contains('\r');
        match is_plain || !text.contains(['\n', '\r']) {
            true => text.to_owned(),
            false => {
                self.ends.apply(LineEnding::Mac.normalize(&LineEnding::Windows.normalize(text)))
            }
        }
    }

    pub(super) fn text(&self) -> &'t str {
        self.text
    }

    /// Converts a byte offset to a line and column. An offset inside of a character becomes the start of that character. An offset past the
    /// end of the text becomes the end.
    pub(super) fn position(&self, at: usize) -> Position {
        let at = (0..=at.min(self.text.len())).rfind(|&at| self.text.is_char_boundary(at));
        let at = TextSize::from(u32::try_from(at.unwrap_or(0)).unwrap_or(u32::MAX));
        let LineCol { line, col } = self.index.line_col(at);
        let wide =
            self.columns.wide().and_then(|wide| self.index.to_wide(wide, LineCol { line, col }));
        Position { line, character: wide.map_or(col, |wide| wide.col) }
    }

    pub(super) fn range(&self, span: Span) -> Range {
        Range { start: self.position(span.start), end: self.position(span.end) }
    }

    /// Converts a line and column to a byte offset. A column past the end of its line becomes the end of that line. A line past the end of
    /// the text becomes the end of the text.
    pub(super) fn offset(&self, position: Position) -> usize {
        let Position { line, character } = position;
        let Some(range) = self.index.line(line) else { return self.text.len() };
        let (start, end) = (usize::from(range.start()), usize::from(range.end()));
        let end = start + self.text[start..end].trim_end_matches(['\n', '\r']).len();
        let column = match self.columns.wide() {
            None => Some(LineCol { line, col: character }),
            Some(wide) => self.index.to_utf8(wide, WideLineCol { line, col: character }),
        };
        let column = column.map_or(usize::MAX, |column| column.col as usize);
        let at = start.saturating_add(column).min(end);
        (start..=at).rfind(|&at| self.text.is_char_boundary(at)).unwrap_or(start)
    }

    pub(super) fn edit(&self, span: Span, new_text: String) -> TextEdit {
        TextEdit { range: self.range(span), new_text: self.with_ends(&new_text) }
    }

    /// Returns the edit that changes this text to `new`, or `None` if they are equal. The edit leaves out the common start and end, and
    /// keeps the line endings of this text.
    pub(super) fn difference(&self, new: &str) -> Option<TextEdit> {
        // If this text has no line endings, keep those of `new`; otherwise convert them.
        let has_ends = self.text.contains(['\n', '\r']) && LineEnding::detect(self.text).is_some();
        let alike = has_ends.then(|| self.with_ends(new));
        let new = alike.as_deref().unwrap_or(new);
        if self.text == new {
            return None;
        }
        let same = self.text.bytes().zip(new.bytes()).take_while(|(a, b)| a == b).count();
        // An edit must not start or end between `\r` and `\n`.
        fn is_place(text: &str, at: usize) -> bool {
            text.is_char_boundary(at)
                && !(text[..at].ends_with('\r') && text[at..].starts_with('\n'))
        }
        let start = (0..=same).rfind(|&at| is_place(self.text, at) && is_place(new, at));
        let start = start.unwrap_or(0);
        let (old_rest, new_rest) = (&self.text[start..], &new[start..]);
        let same =
            old_rest.bytes().rev().zip(new_rest.bytes().rev()).take_while(|(a, b)| a == b).count();
        let same = (0..=same)
            .rev()
            .find(|&at| {
                is_place(old_rest, old_rest.len() - at) && is_place(new_rest, new_rest.len() - at)
            })
            .unwrap_or(0);
        let range = self.range(Span { start, end: self.text.len() - same });
        Some(TextEdit { range, new_text: new_rest[..new_rest.len() - same].to_owned() })
    }
}

/// The characters that are percent-encoded in the path of a URI.
const ESCAPED: &AsciiSet = &CONTROLS
    .add(b' ')
    .add(b'"')
    .add(b'#')
    .add(b'%')
    .add(b'<')
    .add(b'>')
    .add(b'?')
    .add(b'`')
    .add(b'{')
    .add(b'}')
    .add(b'[')
    .add(b']')
    .add(b'\\')
    .add(b'^')
    .add(b'|');

/// Returns the path of a `file:` URI, or `None` for any other URI.
pub(super) fn path_of(uri: &Uri) -> Option<PathBuf> {
    let rest = uri.0.strip_prefix("file://")?;
    let path = &rest[rest.find('/')?..];
    let path = percent_decode_str(path).decode_utf8().ok()?.into_owned();
    // On Windows, the URI path `/c:/x` stands for the file path `c:/x`.
    let is_drive = path.as_bytes().get(2) == Some(&b':');
    let path = if cfg!(windows) && is_drive { &path[1..] } else { &path[..] };
    Some(PathBuf::from(path))
}

pub(super) fn uri_of(path: &Path) -> Uri {
    let text = path.to_string_lossy();
    let text = if cfg!(windows) { text.replace('\\', "/") } else { text.into_owned() };
    let slash = if text.starts_with('/') { "" } else { "/" };
    Uri(format!("file://{slash}{}", utf8_percent_encode(&text, ESCAPED)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "a\u{e4}\u{1f600}b\r\n\nx\u{e4}";

    #[test]
    fn positions_survive_a_round_trip() {
        for columns in [Columns::Utf8, Columns::Utf16, Columns::Utf32] {
            let lines = Lines::new(TEXT, columns);
            for at in (0..=TEXT.len()).filter(|&at| TEXT.is_char_boundary(at)) {
                // Skip positions between `\r` and `\n`, which are not valid.
                if TEXT[..at].ends_with('\r') {
                    continue;
                }
                assert_eq!(lines.offset(lines.position(at)), at, "{columns:?}");
            }
        }
        fn column(columns: Columns) -> u32 {
            Lines::new(TEXT, columns).position(8).character
        }
        assert_eq!([Columns::Utf8, Columns::Utf16, Columns::Utf32].map(column), [8, 5, 4]);
    }

    #[test]
    fn invalid_positions_are_clamped() {
        let lines = Lines::new(TEXT, Columns::Utf16);
        let at = |line, character| lines.offset(Position { line, character });
        assert_eq!([at(0, 99), at(1, 5), at(9, 9), at(2, 99)], [8, 10, TEXT.len(), TEXT.len()]);
        assert_eq!(
            lines.position(3),
            lines.position(4).min(lines.position(3)),
            "inside of a letter"
        );
    }

    #[test]
    fn all_three_line_endings_end_a_line() {
        let lines = Lines::new("a\rb\r\nc\nd\r", Columns::Utf16);
        let starts = [0, 2, 5, 7, 9];
        for (line, at) in (0..).zip(starts) {
            assert_eq!(lines.position(at), Position { line, character: 0 });
            assert_eq!(lines.offset(Position { line, character: 0 }), at);
        }
        assert_eq!(lines.offset(Position { line: 0, character: 5 }), 1);
    }

    #[test]
    fn a_difference_does_not_split_characters() {
        let lines = Lines::new("a\u{e4}b", Columns::Utf8);
        let edit = lines.difference("a\u{e5}b").unwrap();
        assert_eq!(
            (edit.range.start.character, edit.range.end.character, &edit.new_text[..]),
            (1, 3, "\u{e5}")
        );
        assert_eq!(lines.difference("a\u{e4}b"), None);
        let edit = Lines::new("aa", Columns::Utf8).difference("aaa").unwrap();
        assert_eq!(edit.new_text, "a");
    }

    #[test]
    fn an_edit_has_the_line_ending_of_the_text() {
        for end in ["\n", "\r\n", "\r"] {
            let text = format!("a{end}b{end}");
            let lines = Lines::new(&text, Columns::Utf16);
            let edit = lines.edit(Span { start: 0, end: 1 }, "x\ny\r\nz\r".into());
            assert_eq!(edit.new_text, format!("x{end}y{end}z{end}"));
            let edit = lines.difference("a\nx\nb\n").unwrap();
            assert_eq!(edit.new_text.replace(end, ""), "x");
            assert_eq!(lines.difference("a\r\nb\n"), None);
        }
        let lines = Lines::new("a", Columns::Utf16);
        assert_eq!(lines.edit(Span::default(), "\r\n".into()).new_text, "\n");
        // An edit must not end between `\r` and `\n`.
        let edit = Lines::new("a\r\nb\nc", Columns::Utf16).difference("a\nb\nc").unwrap();
        assert_eq!((edit.range.start.character, &edit.new_text[..]), (1, "\n"));
    }

    #[test]
    fn paths_in_uris_are_percent_encoded() {
        let path = Path::new("/a b/\u{e4}#%.ron");
        let uri = uri_of(path);
        assert_eq!(uri.0, "file:///a%20b/%C3%A4%23%25.ron");
        assert_eq!(path_of(&uri).as_deref(), Some(path));
        assert_eq!(
            path_of(&Uri("file:///c%3A/x.ron".into())).unwrap().to_string_lossy().len(),
            if cfg!(windows) { 8 } else { 9 }
        );
        assert_eq!(path_of(&Uri("untitled:x".into())), None);
        assert_eq!(path_of(&Uri("file://".into())), None);
    }
}
