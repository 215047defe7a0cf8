//! What stands around a place of a text: the brackets that are open there, what each of them belongs to, and what has been typed. It is
//! read from the tokens alone, so that nothing behind the place need be right, or there.

use ronin_core::SyntaxKind;

use super::file::raw_tokens;
use super::tree::Name;
use crate::error::Span;

/// What stands around a place of a text.
#[derive(Clone, Debug, PartialEq)]
pub struct Cursor {
    /// The brackets that are open, from the outermost on.
    pub frames: Vec<Frame>,
    /// What is being written.
    pub typed: Typed,
}

/// A bracket that is open.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// `(`, `[` or `{`.
    pub bracket: char,
    /// Where it stands.
    pub start: usize,
    /// The word before it: `Threshold` of `Threshold(`.
    pub name: Option<Name>,
    /// The field or key whose value stands, or would stand, here; none where a name is due.
    pub field: Option<Name>,
    /// How many parts, each with its comma, stand before.
    pub index: usize,
    /// The fields and keys that it has, those behind the place included as far as the text is in order.
    pub given: Vec<Name>,
}

/// What is being written at a place.
#[derive(Clone, Debug, PartialEq)]
pub struct Typed {
    pub kind: TypedKind,
    /// The whole word, or the whole text without its quotes; empty between two words.
    pub span: Span,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TypedKind {
    /// Nothing yet.
    Nothing,
    /// A word, or a number.
    Word,
    /// A text in quotes.
    Text,
    Comment,
}

/// A field, a key or an item that a walk over the tokens passes, with the brackets around it.
pub enum Passed<'a> {
    /// `name:`, whose value follows.
    Name(&'a Name),
    /// A word, a number, or a text without its quotes.
    Word(&'a Name, TypedKind),
}

/// Walks over the tokens of a text and keeps the brackets that are open.
#[derive(Default)]
struct Walk {
    frames: Vec<Frame>,
    /// The last word or text, which may turn out to be a name, and whether it was a text.
    last: Option<(Name, TypedKind)>,
}

impl Walk {
    /// Passes a token. `see` is told of names, words and texts as soon as it is known which they are.
    fn pass(
        &mut self,
        text: &str,
        kind: SyntaxKind,
        at: Span,
        see: &mut dyn FnMut(&[Frame], Passed<'_>),
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
            frame.given.push(name.clone());
            frame.field = Some(name.clone());
            see(&self.frames, Passed::Name(&name));
            return;
        }
        // A word before a bracket is told of, too: `Threshold` of `Threshold(`.
        if let Some((name, kind)) = &last {
            see(&self.frames, Passed::Word(name, *kind));
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
                    given: Vec::new(),
                });
            }
            RParen | RBracket | RBrace => drop(self.frames.pop()),
            Comma => {
                if let Some(frame) = self.frames.last_mut() {
                    (frame.field, frame.index) = (None, frame.index + 1);
                }
            }
            Ident => self.last = Some((named(text, at), TypedKind::Word)),
            String | RawString => {
                let inside = inside(text, at);
                self.last = Some((named(text, inside), TypedKind::Text));
            }
            _ => see(&self.frames, Passed::Word(&named(text, at), TypedKind::Word)),
        }
    }
}

fn named(text: &str, span: Span) -> Name {
    Name { text: text[span.start..span.end].to_owned(), span }
}

/// A text in quotes without these; one without an end goes on until its line does.
fn inside(text: &str, at: Span) -> Span {
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

/// A text has this many strings without an end at most that are recovered from, so that a broken one is read in little more time.
const MAX_RECOVERIES: usize = 16;

/// The tokens of a text that is being written. A string without an end reaches to the next quote, which begins another string: it is cut at the
/// end of its line, and what follows is read anew.
pub(super) fn recovered_tokens(text: &str) -> Vec<(SyntaxKind, Span)> {
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

/// The end of the first line of a string over several lines that has no closing quote, or one behind which no value can end.
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
    // Without a closing quote, what is inside ends with the line.
    let is_closed = inside(text, at).end != at.start + line;
    (!(is_closed && ends_value)).then_some(at.start + line)
}

/// Whether a quote behind this would be a part of the text.
fn ends_escaped(text: &str) -> bool {
    (text.len() - text.trim_end_matches('\\').len()) % 2 == 1
}

/// What stands around a place, which is moved back to the beginning of a letter if it is inside of one.
pub fn cursor(text: &str, at: usize) -> Cursor {
    let at = (0..=at.min(text.len())).rfind(|&at| text.is_char_boundary(at)).unwrap_or(0);
    let mut walk = Walk::default();
    let mut typed = Typed { kind: TypedKind::Nothing, span: Span { start: at, end: at } };
    let mut tokens = recovered_tokens(text).into_iter().peekable();
    while let Some((kind, span)) = tokens.next_if(|(_, span)| span.start < at) {
        if at < span.end || (at == span.end && is_open_end(text, kind, span)) {
            typed = Typed::of(text, kind, span, at);
            if typed.kind != TypedKind::Nothing {
                break;
            }
        }
        walk.pass(text, kind, span, &mut |_, _| {});
    }
    // A word at whose beginning the place is belongs to it.
    if typed.kind == TypedKind::Nothing
        && let Some((kind, span)) = tokens.next_if(|(_, span)| span.start == at)
    {
        match Typed::of(text, kind, span, at) {
            found if found.kind == TypedKind::Word => typed = found,
            _ => {
                let around = walk.frames.clone();
                return Cursor {
                    frames: with_rest(text, around, &mut walk, (kind, span), tokens),
                    typed,
                };
            }
        }
    }
    let around = walk.frames.clone();
    if let Some(next) = tokens.next() {
        return Cursor { frames: with_rest(text, around, &mut walk, next, tokens), typed };
    }
    Cursor { frames: around, typed }
}

/// The brackets with what they have behind the place.
fn with_rest(
    text: &str,
    mut around: Vec<Frame>,
    walk: &mut Walk,
    next: (SyntaxKind, Span),
    rest: impl Iterator<Item = (SyntaxKind, Span)>,
) -> Vec<Frame> {
    let mut depth = around.len();
    // What is being written is no name yet that the text has.
    walk.last = None;
    for (kind, span) in std::iter::once(next).chain(rest) {
        walk.pass(text, kind, span, &mut |_, _| {});
        while walk.frames.len() < depth {
            depth -= 1;
        }
        if depth == 0 {
            break;
        }
        if let Some((known, now)) = around.get_mut(depth - 1).zip(walk.frames.get(depth - 1))
            && known.start == now.start
            && known.given.len() < now.given.len()
        {
            known.given.clone_from(&now.given);
        }
    }
    around
}

/// Whether what ends here may go on behind it.
fn is_open_end(text: &str, kind: SyntaxKind, span: Span) -> bool {
    match kind {
        SyntaxKind::String | SyntaxKind::RawString => inside(text, span).end == span.end,
        SyntaxKind::LineComment => true,
        SyntaxKind::BlockComment => !text[span.start..span.end].ends_with("*/"),
        _ => is_word(kind),
    }
}

fn is_word(kind: SyntaxKind) -> bool {
    use SyntaxKind::{FalseKw, Float, Ident, Integer, TrueKw};
    matches!(kind, Ident | Integer | Float | TrueKw | FalseKw)
}

impl Typed {
    fn of(text: &str, kind: SyntaxKind, span: Span, at: usize) -> Self {
        match kind {
            SyntaxKind::LineComment | SyntaxKind::BlockComment => {
                Self { kind: TypedKind::Comment, span }
            }
            SyntaxKind::String | SyntaxKind::RawString => {
                let inside = inside(text, span);
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

/// Tells of all names, words and texts of a text in their order, each with the brackets around it.
pub fn each_word(text: &str, mut see: impl FnMut(&[Frame], Passed<'_>)) {
    let mut walk = Walk::default();
    for (kind, span) in recovered_tokens(text) {
        walk.pass(text, kind, span, &mut see);
    }
    if let Some((name, kind)) = walk.last.take() {
        see(&walk.frames, Passed::Word(&name, kind));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The brackets and what is typed at the mark, in short.
    fn around(text: &str) -> String {
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
    fn what_is_open_is_known_however_the_text_ends() {
        fn check(text: &str, expected: &str) {
            assert_eq!(around(text), expected, "{text}")
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
        // A string over several lines is one, unless its last quote begins another string.
        check("A(b: \"x\n |y\")", "A(b#0 Text `x\n y`");
        check("A(b: \"x|\n c: \"y\")", "A(b#0 Text `x`");
        check("A(b: \"x\r\n c: \"y|\")", "A(c#0 Text `y`");
        check("A(b: {\"k\": \"x\r \"l\": B(c: \"|\n \"m\": 2", "A(b#0 {l#0 B(c#0 Text ``");
        check("A(b: \"x\"), |", " Nothing ``");
        check(")}|", " Nothing ``");
    }

    #[test]
    fn fields_behind_the_place_are_given_too() {
        let found = cursor("A(a: 1, , b: (c: 2), d: 3)", 8);
        let names = found.frames[0].given.iter().map(|name| &name.text[..]);
        assert_eq!(Vec::from_iter(names), ["a", "b", "d"]);
        assert_eq!(found.frames[0].field, None);
    }

    #[test]
    fn each_word_is_told_once() {
        let mut told = String::new();
        each_word("A(b: \"c\", d: [E(1), true])", |frames, passed| {
            told += &match passed {
                Passed::Name(name) => format!("{}{}: ", "-".repeat(frames.len()), name.text),
                Passed::Word(word, _) => format!("{}{} ", "-".repeat(frames.len()), word.text),
            };
        });
        assert_eq!(told, "A -b: -c -d: --E ---1 --true ");
    }

    #[test]
    fn words_of_a_broken_text_come_in_their_order() {
        for text in ["A(b: : c: d", "A(b: (: )", "a: b: \"c", "A(\"b\": {: 1, : }"] {
            let mut last = 0;
            each_word(text, |_, passed| {
                let (Passed::Name(word) | Passed::Word(word, _)) = passed;
                assert!(last <= word.span.start, "{text}");
                last = word.span.end;
            });
        }
    }
}
