//! The context of a position in an unfinished text, for completion in editors: the brackets that are open at the position, the value to
//! which each bracket belongs, and the token that is being typed. Only tokens are needed, so the text after the position may be invalid or
//! missing.

use ronin_core::SyntaxKind;

use super::parser::raw_tokens;
use super::tree::Name;
use crate::error::Span;

/// The context of a position in a text.
#[derive(Clone, Debug, PartialEq)]
pub struct Cursor {
    /// The brackets that are open at the position, from the outermost to the innermost.
    pub frames: Vec<Frame>,
    /// The token at the position, which the user may be typing.
    pub typed: TypedToken,
}

/// A bracket that is open at a position, with the names in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The character of the bracket: `(`, `[` or `{`.
    pub bracket: char,
    /// The byte offset of the bracket.
    pub start: usize,
    /// The name before the bracket, such as `Threshold` in `Threshold(`.
    pub name: Option<Name>,
    /// The field or key whose value is expected at the position. `None` if a name is expected.
    pub field: Option<Name>,
    /// Number of commas between the bracket and the position, not counting those in inner brackets.
    pub index: usize,
    /// The names of the fields or keys in the bracket, including those after the position as far as the text is valid.
    pub names: Vec<Name>,
}

/// The token at a position.
#[derive(Clone, Debug, PartialEq)]
pub struct TypedToken {
    pub kind: TypedKind,
    /// The span of the whole word, or of the string without its quotes. Empty if the position is between two words.
    pub span: Span,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TypedKind {
    /// There is no token at the position, only space.
    Nothing,
    /// The token is a word or a number.
    Word,
    /// The token is a string.
    Text,
    Comment,
}

/// A name or value that [`for_each_word`] visits.
pub enum WalkEvent<'a> {
    /// A field or key with its colon, `name:`; its value follows.
    Name(&'a Name),
    /// A value: a word, a number, or a string without its quotes.
    Word(&'a Name, TypedKind),
}

/// Walks over the tokens of a text and keeps track of the open brackets.
#[derive(Default)]
struct Walk {
    frames: Vec<Frame>,
    /// The last word or string, and its kind. It is a name if a colon follows, and a value otherwise.
    last: Option<(Name, TypedKind)>,
}

impl Walk {
    /// Processes a token. Calls `see` for each word and string as soon as the next token shows if it is a name or a value.
    fn process_token(
        &mut self,
        text: &str,
        kind: SyntaxKind,
        at: Span,
        see: &mut dyn FnMut(&[Frame], WalkEvent<'_>),
    ) {
        use SyntaxKind::{
            Bom, Colon, Comma, Ident, LBrace, LBracket, LParen, LineComment, RBrace, RBracket,
            RParen, RawString, String, Whitespace,
        };
        let last = match kind {
            Whitespace | Bom | LineComment | SyntaxKind::BlockComment => return,
            _ => self.last.take(),
        };
        if kind == Colon {
            let Some(((name, _), frame)) = last.zip(self.frames.last_mut()) else { return };
            frame.names.push(name.clone());
            frame.field = Some(name.clone());
            see(&self.frames, WalkEvent::Name(&name));
            return;
        }
        // Visit the name before a bracket, such as `Threshold` in `Threshold(`.
        if let Some((name, kind)) = &last {
            see(&self.frames, WalkEvent::Word(name, *kind));
        }
        match kind {
            LParen | LBracket | LBrace => {
                let name = last.filter(|(_, kind)| *kind == TypedKind::Word).map(|(name, _)| name);
                self.frames.push(Frame {
                    bracket: text[at.start..].chars().next().unwrap_or('('),
                    start: at.start,
                    name,
                    field: None,
                    index: 0,
                    names: Vec::new(),
                });
            }
            RParen | RBracket | RBrace => drop(self.frames.pop()),
            Comma => {
                if let Some(frame) = self.frames.last_mut() {
                    (frame.field, frame.index) = (None, frame.index + 1);
                }
            }
            Ident => self.last = Some((make_name(text, at), TypedKind::Word)),
            String | RawString => {
                let string_content = string_content(text, at);
                self.last = Some((make_name(text, string_content), TypedKind::Text));
            }
            _ => see(&self.frames, WalkEvent::Word(&make_name(text, at), TypedKind::Word)),
        }
    }
}

fn make_name(text: &str, span: Span) -> Name {
    Name { text: text[span.start..span.end].to_owned(), span }
}

/// Returns the span of a string without its quotes. A string without a closing quote ends at the end of its line.
fn string_content(text: &str, at: Span) -> Span {
    let literal = &text[at.start..at.end];
    let Some(quote) = literal.find('"') else { return at };
    let hashes = &literal[..quote].trim_start_matches('r');
    let (start, close) = (quote + 1, format!("\"{hashes}"));
    let is_closed = start + close.len() <= literal.len()
        && literal.ends_with(&close)
        && (!hashes.is_empty() || !ends_escaped(&literal[start..literal.len() - 1]));
    let end = if is_closed {
        literal.len() - close.len()
    } else {
        literal[start..].find(['\n', '\r']).map_or(literal.len(), |line| start + line)
    };
    Span { start: at.start + start, end: at.start + end.max(start) }
}

/// Maximum number of unterminated strings that are skipped. It bounds the time for broken texts.
const MAX_RECOVERIES: usize = 16;

/// Splits an unfinished text into tokens. An unterminated string would extend to the opening quote of the next string. Such a string is cut
/// at the end of its line, and the rest of the text is split again.
pub(super) fn recover_tokens(text: &str) -> Vec<(SyntaxKind, Span)> {
    let mut tokens = Vec::new();
    let (mut start, mut recoveries) = (0, 0);
    while start < text.len() {
        let from = start;
        start = text.len();
        for (kind, span) in raw_tokens(&text[from..]) {
            let span = Span { start: from + span.start, end: from + span.end };
            match unclosed_end(text, kind, span).filter(|_| recoveries < MAX_RECOVERIES) {
                Some(end) => {
                    tokens.push((kind, Span { end, ..span }));
                    (start, recoveries) = (end, recoveries + 1);
                    break;
                }
                None => tokens.push((kind, span)),
            }
        }
    }
    tokens
}

/// Returns the end of the first line of a multi-line string that seems to be unterminated. A string seems unterminated if it has no closing
/// quote, or if no value can end at that quote. `None` for other strings.
fn unclosed_end(text: &str, kind: SyntaxKind, at: Span) -> Option<usize> {
    if !matches!(kind, SyntaxKind::String | SyntaxKind::RawString) {
        return None;
    }
    let line = text[at.start..at.end].find(['\n', '\r'])?;
    let rest = &text[at.end..];
    let ends_value = rest.is_empty()
        || rest.starts_with(|c: char| c.is_whitespace() || ",:)]}".contains(c))
        || rest.starts_with("//")
        || rest.starts_with("/*");
    // Without a closing quote, the content of the string ends at the end of the line.
    let is_closed = string_content(text, at).end != at.start + line;
    (!(is_closed && ends_value)).then_some(at.start + line)
}

/// Returns true if `text` ends with a backslash that would escape a quote after it.
pub(super) fn ends_escaped(text: &str) -> bool {
    (text.len() - text.trim_end_matches('\\').len()) % 2 == 1
}

/// Returns the context of the byte offset `at`. An offset inside of a character is moved to the start of the character.
pub fn cursor(text: &str, at: usize) -> Cursor {
    let at = (0..=at.min(text.len())).rfind(|&at| text.is_char_boundary(at)).unwrap_or(0);
    let mut walk = Walk::default();
    let mut typed = TypedToken { kind: TypedKind::Nothing, span: Span { start: at, end: at } };
    let mut tokens = recover_tokens(text).into_iter().peekable();
    while let Some((kind, span)) = tokens.next_if(|(_, span)| span.start < at) {
        if at < span.end || (at == span.end && is_open_end(text, kind, span)) {
            typed = TypedToken::new(text, kind, span, at);
            if typed.kind != TypedKind::Nothing {
                break;
            }
        }
        walk.process_token(text, kind, span, &mut |_, _| {});
    }
    // A word that begins exactly at the position is the one that is being typed.
    if typed.kind == TypedKind::Nothing
        && let Some((kind, span)) = tokens.next_if(|(_, span)| span.start == at)
    {
        match TypedToken::new(text, kind, span, at) {
            found if found.kind == TypedKind::Word => typed = found,
            _ => {
                let describe_cursor = walk.frames.clone();
                return Cursor {
                    frames: complete_frames(text, describe_cursor, &mut walk, (kind, span), tokens),
                    typed,
                };
            }
        }
    }
    let describe_cursor = walk.frames.clone();
    if let Some(next) = tokens.next() {
        return Cursor {
            frames: complete_frames(text, describe_cursor, &mut walk, next, tokens),
            typed,
        };
    }
    Cursor { frames: describe_cursor, typed }
}

/// Adds the fields and keys after the position to the frames of the open brackets.
fn complete_frames(
    text: &str,
    mut around: Vec<Frame>,
    walk: &mut Walk,
    next: (SyntaxKind, Span),
    rest: impl Iterator<Item = (SyntaxKind, Span)>,
) -> Vec<Frame> {
    let mut depth = around.len();
    // The word before the position is unfinished. Forget it, so that a colon after the position does not make it a name.
    walk.last = None;
    for (kind, span) in std::iter::once(next).chain(rest) {
        walk.process_token(text, kind, span, &mut |_, _| {});
        while walk.frames.len() < depth {
            depth -= 1;
        }
        if depth == 0 {
            break;
        }
        if let Some((known, now)) = around.get_mut(depth - 1).zip(walk.frames.get(depth - 1))
            && known.start == now.start
            && known.names.len() < now.names.len()
        {
            known.names.clone_from(&now.names);
        }
    }
    around
}

/// Returns true if a character typed directly after this token would extend the token.
fn is_open_end(text: &str, kind: SyntaxKind, span: Span) -> bool {
    match kind {
        SyntaxKind::String | SyntaxKind::RawString => string_content(text, span).end == span.end,
        SyntaxKind::LineComment => true,
        SyntaxKind::BlockComment => !text[span.start..span.end].ends_with("*/"),
        _ => is_word(kind),
    }
}

fn is_word(kind: SyntaxKind) -> bool {
    use SyntaxKind::{FalseKw, Float, Ident, Integer, TrueKw};
    matches!(kind, Ident | Integer | Float | TrueKw | FalseKw)
}

impl TypedToken {
    fn new(text: &str, kind: SyntaxKind, span: Span, at: usize) -> Self {
        match kind {
            SyntaxKind::LineComment | SyntaxKind::BlockComment => {
                Self { kind: TypedKind::Comment, span }
            }
            SyntaxKind::String | SyntaxKind::RawString => {
                let inside = string_content(text, span);
                match inside.start <= at && at <= inside.end {
                    true => Self { kind: TypedKind::Text, span: inside },
                    false => Self { kind: TypedKind::Nothing, span: Span { start: at, end: at } },
                }
            }
            _ if is_word(kind) => Self { kind: TypedKind::Word, span },
            _ => Self { kind: TypedKind::Nothing, span: Span { start: at, end: at } },
        }
    }
}

/// Calls `see` for all names, words and strings of a text in order, with the brackets that are open at each.
pub fn for_each_word(text: &str, mut see: impl FnMut(&[Frame], WalkEvent<'_>)) {
    let mut walk = Walk::default();
    for (kind, span) in recover_tokens(text) {
        walk.process_token(text, kind, span, &mut see);
    }
    if let Some((name, kind)) = walk.last.take() {
        see(&walk.frames, WalkEvent::Word(&name, kind));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Formats the context of the position that the sign `|` marks in a text.
    fn describe_cursor(text: &str) -> String {
        let at = text.find('|').unwrap();
        let found = cursor(&text.replacen('|', "", 1), at);
        fn name(name: &Option<Name>) -> String {
            name.as_ref().map_or("", |name| &name.text).to_owned()
        }
        let frames = found
            .frames
            .iter()
            .map(|frame| {
                let (owner, field) = (name(&frame.name), name(&frame.field));
                format!("{owner}{}{field}#{}", frame.bracket, frame.index)
            })
            .collect::<Vec<_>>()
            .join(" ");
        let span = found.typed.span;
        let text = text.replacen('|', "", 1);
        format!("{frames} {:?} `{}`", found.typed.kind, &text[span.start..span.end])
    }

    #[test]
    fn open_brackets_are_found_in_unfinished_texts() {
        fn check(text: &str, expected: &str) {
            assert_eq!(describe_cursor(text), expected, "{text}");
        }
        check("|", " Nothing ``");
        check("Gra|", " Word `Gra`");
        check("Graph(|", "Graph(#0 Nothing ``");
        check("Graph(nodes: {\"a\": Thr|", "Graph(nodes#0 {a#0 Word `Thr`");
        check(
            "Graph(nodes: {\"a\": Threshold(image: \"sc|",
            "Graph(nodes#0 {a#0 Threshold(image#0 Text `sc`",
        );
        check(
            "Graph(nodes: {\"a\": Threshold(image: \"scan.color\", |",
            "Graph(nodes#0 {a#0 Threshold(#1 Nothing ``",
        );
        check(
            "Graph(nodes: {\"a\": Threshold(le|vel: 2)})",
            "Graph(nodes#0 {a#0 Threshold(#0 Word `level`",
        );
        check("A(b: [(c: 1), (d: |2)])", "A(b#0 [#1 (d#0 Word `2`");
        check("A(b: \"x|\n c: 2", "A(b#0 Text `x`");
        check("A(// b: |\n", "A(#0 Comment `// b: `");
        check("A(b: \"ä|ö\")", "A(b#0 Text `äö`");
        check("A(b: r#\"x|y\"#)", "A(b#0 Text `xy`");
        check("A(b: \"x\"|)", "A(b#0 Nothing ``");
        // A quote on a later line closes the string, unless it is the opening quote of another string.
        check("A(b: \"x\n |y\")", "A(b#0 Text `x\n y`");
        check("A(b: \"x|\n c: \"y\")", "A(b#0 Text `x`");
        check("A(b: \"x\r\n c: \"y|\")", "A(c#0 Text `y`");
        check("A(b: {\"k\": \"x\r \"l\": B(c: \"|\n \"m\": 2", "A(b#0 {l#0 B(c#0 Text ``");
        check("A(b: \"x\"), |", " Nothing ``");
        check(")}|", " Nothing ``");
    }

    #[test]
    fn fields_after_the_position_are_included() {
        let found = cursor("A(a: 1, , b: (c: 2), d: 3)", 8);
        let names = found.frames[0].names.iter().map(|name| &name.text[..]);
        assert_eq!(names.collect::<Vec<_>>(), ["a", "b", "d"]);
        assert_eq!(found.frames[0].field, None);
    }

    #[test]
    fn each_word_is_visited_once() {
        let mut visited = String::new();
        for_each_word("A(b: \"c\", d: [E(1), true])", |frames, passed| {
            visited += &match passed {
                WalkEvent::Name(name) => format!("{}{}: ", "-".repeat(frames.len()), name.text),
                WalkEvent::Word(word, _) => format!("{}{} ", "-".repeat(frames.len()), word.text),
            };
        });
        assert_eq!(visited, "A -b: -c -d: --E ---1 --true ");
    }

    #[test]
    fn words_of_an_invalid_text_are_visited_in_order() {
        for text in ["A(b: : c: d", "A(b: (: )", "a: b: \"c", "A(\"b\": {: 1, : }"] {
            let mut last = 0;
            for_each_word(text, |_, passed| {
                let (WalkEvent::Name(word) | WalkEvent::Word(word, _)) = passed;
                assert!(last <= word.span.start, "{text}");
                last = word.span.end;
            });
        }
    }
}
