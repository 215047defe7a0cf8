//! The text of a graph file as a tree of values with their places.
//!
//! `ronin-core` parses it without losing a byte and recovers from mistakes; this module and [`TreeReader`] alone know it. What
//! comes out is [`Tree`], small enough to be substituted into, checked against a schema and read by serde.

use ronin_core::lexer::tokenize;
use ronin_core::{SyntaxKind, SyntaxNode, TextRange};

use super::help::Help;
use super::hyphens::hyphened_fields;
use super::marks::conflict_marks;
use super::tree::{Kind, Tree, cut};
use super::tree_reader::{TreeReader, is_value};
use crate::error::{Place, Span};

/// A mistake in the text itself: where, what, and what to do.
#[derive(Clone, Debug, PartialEq)]
pub struct Mistake {
    pub span: Span,
    pub message: String,
    pub help: Help,
}

/// What is said of a text without an end.
pub(super) const NO_END: &str = "this text has an unknown escape or no end";

/// What is said of a comment without an end.
pub(super) const OPEN_COMMENT: &str = "this comment is never closed";

/// What is said of a bracket that is one too many.
pub(super) const CLOSES_NOTHING: &str = " closes nothing";

/// Values in each other, and with them all that walks through them, go no deeper: far deeper than any node needs, and far less
/// deep than the stack of a thread.
/// This is checked before the parser sees a text, so that nothing else needs a limit of its own.
pub const DEEPEST: usize = 128;

/// The tokens of a text in order, none left out, each with its place. Nothing in it is nested, so that any text will do.
pub(super) fn raw_tokens(text: &str) -> impl Iterator<Item = (SyntaxKind, Span)> + '_ {
    let mut end = 0;
    tokenize(text).into_iter().map(move |token| {
        let start = end;
        end += token.text.len();
        (token.kind, Span { start, end })
    })
}

/// The first word, bracket or sign of a text, which tells what it holds.
pub fn first_word(text: &str) -> &str {
    use SyntaxKind::{BlockComment, Bom, LineComment, Whitespace};
    fn is_trivia(kind: SyntaxKind) -> bool {
        matches!(kind, Bom | Whitespace | LineComment | BlockComment)
    }
    let first = raw_tokens(text).find(|(kind, _)| !is_trivia(*kind));
    first.map_or("", |(_, at)| &text[at.start..at.end])
}

/// The first bracket that opens too deep inside of others. One that the wrong bracket closes counts as open, as it may for the
/// parser, whose own limit does not hold for all that it recurs into.
fn too_deep(mut tokens: impl Iterator<Item = (SyntaxKind, Span)>) -> Option<Span> {
    use SyntaxKind::{LBrace, LBracket, LParen, RBrace, RBracket, RParen};
    let mut open = Vec::new();
    tokens.find_map(|(kind, at)| {
        let opener = match kind {
            LParen | LBracket | LBrace if open.len() == DEEPEST => return Some(at),
            LParen | LBracket | LBrace => {
                open.push(kind);
                return None;
            }
            RParen => LParen,
            RBracket => LBracket,
            RBrace => LBrace,
            _ => return None,
        };
        open.pop_if(|last| *last == opener);
        None
    })
}

/// The value of a whole text, as far as it can be read, and the mistakes in it.
pub fn parse(text: &str) -> (Tree, Vec<Mistake>) {
    let tokens = Vec::from_iter(raw_tokens(text));
    if let Some(span) = too_deep(tokens.iter().copied()) {
        let message = format!("values are nested more than {DEEPEST} deep here");
        let mistake = Mistake { span, message, help: "no node needs that".into() };
        return (Tree::new(Span::default(), Kind::Broken), vec![mistake]);
    }
    let document = ronin_core::parse(text);
    let root = document.root();
    let mut mistakes: Vec<Mistake> = document
        .diagnostics()
        .iter()
        .map(|found| explain(text, span(found.range), &found.message))
        .collect();
    let hyphened = if mistakes.is_empty() { Vec::new() } else { hyphened_fields(text, &tokens) };
    for field in hyphened {
        // What the parser finds in the word follows from its hyphens.
        let Span { start, end } = field.span;
        mistakes.retain(|mistake| !(start..=end).contains(&mistake.span.start));
        mistakes.push(field);
    }
    // A text or a comment without an end has all of the rest in it, and is told as that below.
    let is_swallowed = is_swallowed(text, &tokens);
    let mut unclosed = unclosed(text, &tokens);
    if let Some(unclosed) = &unclosed {
        // Whatever the parser finds behind it follows from it.
        mistakes.retain(|mistake| mistake.span.end <= unclosed.span.start);
    }
    mistakes.extend(unclosed.take_if(|_| !is_swallowed));
    if mistakes.is_empty() && !is_swallowed {
        mistakes.extend(wrong_separators(&tokens, &root));
    }
    let is_in_order = mistakes.is_empty();
    mistakes.extend(strange_spaces(text, &tokens));
    let mut reader = TreeReader::default();
    for node in root.children() {
        if node.kind() == SyntaxKind::ExtensionAttr && !is_known_extension(&node) {
            let at = span(node.text_range());
            match node.text().starts_with("#![") {
                true => reader.mistake(at, "RON has no such extension", "leave it out"),
                false => {
                    let help = "colors are texts: \"#c33923\"";
                    reader.mistake(at, "`#` begins no value", help)
                }
            };
        }
    }
    let value = root.children().find(|node| is_value(node.kind()));
    let tree = match value {
        Some(node) => reader.value(&node),
        None => {
            if mistakes.is_empty() {
                mistakes.push(Mistake {
                    span: Span { start: 0, end: text.len().min(1) },
                    message: "the file is empty".into(),
                    help: "a graph begins with `Graph(format: 1, ..)`".into(),
                });
            }
            Tree::new(Span::default(), Kind::Broken)
        }
    };
    if is_in_order {
        mistakes.extend(reader.misplaced);
    }
    mistakes.extend(reader.mistakes);
    if mistakes.is_empty() {
        mistakes.extend(unclosed);
    }
    if let Some((_, last)) = tokens.last().filter(|_| is_swallowed) {
        fn is_of_end(it: &Mistake) -> bool {
            [NO_END, OPEN_COMMENT].contains(&&it.message[..])
        }
        if mistakes.iter().any(is_of_end) {
            mistakes.retain(|mistake| mistake.span.start < last.start || is_of_end(mistake));
        }
    }
    // Whatever else is wrong follows from them.
    if !mistakes.is_empty()
        && let Some(marks) = conflict_marks(text)
    {
        return (Tree::new(Span::default(), Kind::Broken), vec![marks]);
    }
    mistakes.sort_by_key(|mistake| mistake.span);
    (tree, mistakes)
}

/// Whether this is `#![enable(..)]` with RON's own extensions, none of which changes what a graph says.
fn is_known_extension(node: &SyntaxNode) -> bool {
    const KNOWN: [&str; 4] =
        ["implicit_some", "unwrap_newtypes", "unwrap_variant_newtypes", "explicit_struct_names"];
    let words = node.descendant_tokens().filter(|token| token.kind() == SyntaxKind::Ident);
    let mut words = words.map(|token| token.text().to_string());
    node.text().starts_with("#![")
        && words.next().is_some_and(|word| word == "enable")
        && words.next().is_some_and(|word| KNOWN.contains(&&word[..]))
        && words.all(|word| KNOWN.contains(&&word[..]))
}

/// Spaces that are none in RON, and comments without an end. A mark of the byte order at the start, which editors put there, is
/// no part of the text.
fn strange_spaces(text: &str, tokens: &[(SyntaxKind, Span)]) -> Vec<Mistake> {
    fn is_space(c: char) -> bool {
        c.is_ascii_whitespace() || "\u{b}\u{85}\u{200e}\u{200f}\u{2028}\u{2029}".contains(c)
    }
    let mut mistakes = Vec::new();
    for &(kind, at) in tokens {
        let piece = &text[at.start..at.end];
        let (start, message, help) = match kind {
            SyntaxKind::Whitespace => match piece.find(|c| !is_space(c)) {
                Some(start) => (start, "RON knows no such space", "write a plain one"),
                None => continue,
            },
            SyntaxKind::BlockComment if !is_closed(piece) => {
                (0, OPEN_COMMENT, "put a `*/` where it ends")
            }
            _ => continue,
        };
        let start = at.start + start;
        let length = text[start..].chars().next().map_or(0, char::len_utf8);
        let span = Span { start, end: start + length };
        mistakes.push(Mistake { span, message: message.into(), help: help.into() });
    }
    mistakes
}

/// Whether the last piece of a text is a text or a comment without an end.
fn is_swallowed(text: &str, tokens: &[(SyntaxKind, Span)]) -> bool {
    let Some(&(kind, at)) = tokens.last() else { return false };
    let piece = &text[at.start..at.end];
    match kind {
        SyntaxKind::BlockComment => !is_closed(piece),
        SyntaxKind::String => {
            let inside = piece.get(1..).and_then(|rest| rest.strip_suffix('"'));
            let is_escaped =
                |inside: &str| (inside.len() - inside.trim_end_matches('\\').len()) % 2 == 1;
            inside.is_none_or(is_escaped)
        }
        _ => false,
    }
}

/// Whether a comment, in which others may stand, comes to its end.
fn is_closed(comment: &str) -> bool {
    let (mut depth, mut rest) = (0usize, comment);
    while !rest.is_empty() {
        let step = if rest.starts_with("/*") {
            depth += 1;
            2
        } else if rest.starts_with("*/") {
            depth = depth.saturating_sub(1);
            2
        } else {
            rest.chars().next().map_or(1, char::len_utf8)
        };
        rest = &rest[step..];
    }
    depth == 0
}

/// What a piece of the text is, as far as its layout goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Token {
    Space,
    LineComment,
    BlockComment,
    Open,
    Close,
    Comma,
    Colon,
    /// A name, a literal, or anything else.
    Word,
}

/// The pieces of the text in order, none left out.
pub fn tokens(text: &str) -> Vec<(Token, Span)> {
    raw_tokens(text).map(|(kind, span)| (Token::of(kind), span)).collect()
}

impl Token {
    pub(super) fn of(kind: SyntaxKind) -> Self {
        use SyntaxKind::{LBrace, LBracket, LParen, RBrace, RBracket, RParen};
        match kind {
            SyntaxKind::Whitespace | SyntaxKind::Bom => Self::Space,
            SyntaxKind::LineComment => Self::LineComment,
            SyntaxKind::BlockComment => Self::BlockComment,
            LParen | LBracket | LBrace => Self::Open,
            RParen | RBracket | RBrace => Self::Close,
            SyntaxKind::Comma => Self::Comma,
            SyntaxKind::Colon => Self::Colon,
            _ => Self::Word,
        }
    }
}

/// The text as its syntax tree prints it: the same bytes, however broken the text is. What is nested too deep has no tree.
pub fn printed(text: &str) -> String {
    match too_deep(raw_tokens(text)) {
        None => ronin_core::print(&ronin_core::parse(text)),
        Some(_) => text.to_owned(),
    }
}

/// Says of a parser's finding what was found, not only what was missed.
fn explain(text: &str, found: Span, message: &str) -> Mistake {
    let found_text = text.get(found.start..found.end).unwrap_or_default();
    let (message, help): (String, Help) = if message.contains("trailing") {
        let end = found_text.find('\n').map_or(found.end, |line| found.start + line);
        return Mistake {
            span: Span { end, ..found },
            message: "there is something behind the end of the graph".into(),
            help: "a file holds one `Graph(..)` and nothing behind it".into(),
        };
    } else if message.contains("delimited group") {
        fn begins_value(c: char) -> bool {
            c.is_alphanumeric() || "\"'([{-+_".contains(c)
        }
        match found_text.starts_with(begins_value) {
            true => (
                format!("there is no comma before `{}`", cut(found_text)),
                missing_comma(text, found),
            ),
            false => {
                (format!("`{found_text}` has no meaning here"), Help::edit(ONE_TOO_MANY, found, ""))
            }
        }
    } else if found_text.chars().count() <= 24 && !found_text.is_empty() {
        (
            format!("{message}, but here is `{found_text}`"),
            "is a comma, colon or parenthesis missing before it?".into(),
        )
    } else {
        (message.to_owned(), "is a comma, colon or parenthesis missing before it?".into())
    };
    Mistake { span: found, message, help }
}

/// A comma behind what stands before a place, unless that is a comment, or far away.
fn missing_comma(text: &str, found: Span) -> Help {
    const FAR: usize = 400;
    let words = "put one between this and what stands before it";
    let from =
        (found.start.saturating_sub(FAR)..=found.start).find(|&at| text.is_char_boundary(at));
    let before = text[from.unwrap_or(found.start)..found.start].trim_end();
    let line = before.rsplit('\n').next().unwrap_or_default();
    if before.is_empty() || line.contains("//") || line.contains("*/") {
        return words.into();
    }
    let end = from.unwrap_or(found.start) + before.len();
    Help::edit(words, Span { start: end, end }, ",")
}

pub(super) const ONE_TOO_MANY: &str = "is it one too many?";

/// Commas and colons that are missing or have nothing before or behind them, as far as the parser lets them pass.
fn wrong_separators(tokens: &[(SyntaxKind, Span)], root: &SyntaxNode) -> Vec<Mistake> {
    use SyntaxKind::{Colon, Comma, Ident, LBrace, LBracket, LParen, RBrace, RBracket, RParen};
    let extensions = root.children().filter(|node| node.kind() == SyntaxKind::ExtensionAttr);
    let extensions: Vec<_> = extensions.map(|node| span(node.text_range())).collect();
    let is_in_extension =
        |at: Span| extensions.iter().any(|it| it.start <= at.start && at.end <= it.end);
    let mut before = None;
    let mut mistakes = Vec::new();
    for &(kind, at) in tokens.iter().filter(|(kind, _)| !kind.is_trivia()) {
        if is_in_extension(at) {
            continue;
        }
        let begins = matches!(before, None | Some(Comma | Colon | LParen | LBracket | LBrace));
        let mistake = match kind {
            Comma if begins => Some(("there is nothing before this `,`", ONE_TOO_MANY)),
            Colon if begins => Some(("there is nothing before this `:`", ONE_TOO_MANY)),
            RParen | RBracket | RBrace if before == Some(Colon) => {
                Some(("there is no value behind the `:` before this", "write one"))
            }
            Comma | Colon | RParen | RBracket | RBrace => None,
            LParen if before == Some(Ident) => None,
            _ if begins => None,
            _ => Some(("something is missing before this", "put a comma or a colon between them")),
        };
        mistakes.extend(mistake.map(|(message, help)| Mistake {
            span: at,
            message: message.into(),
            help: if help == ONE_TOO_MANY { Help::edit(help, at, "") } else { help.into() },
        }));
        before = Some(kind);
    }
    mistakes
}

/// The parenthesis, bracket or brace that is not closed, or closed by another one.
fn unclosed(text: &str, tokens: &[(SyntaxKind, Span)]) -> Option<Mistake> {
    use SyntaxKind::{LBrace, LBracket, LParen, RBrace, RBracket, RParen};
    fn closer(open: SyntaxKind) -> (SyntaxKind, char) {
        match open {
            LParen => (RParen, ')'),
            LBracket => (RBracket, ']'),
            _ => (RBrace, '}'),
        }
    }
    let mut open: Vec<(SyntaxKind, Span)> = Vec::new();
    for &(kind, at) in tokens {
        if matches!(kind, LParen | LBracket | LBrace) {
            open.push((kind, at));
        } else if matches!(kind, RParen | RBracket | RBrace) {
            let found = &text[at.start..at.end];
            let Some((opener, opened)) = open.pop() else {
                let message = format!("this `{found}`{CLOSES_NOTHING}");
                let help = Help::edit(ONE_TOO_MANY, at, "");
                return Some(Mistake { span: at, message, help });
            };
            if closer(opener).0 != kind {
                let Place { line, column } = Place::of(text, at.start);
                let opener_text = &text[opened.start..opened.end];
                let message = format!(
                    "this `{opener_text}` is not closed before the `{found}` at {line}:{column}"
                );
                let help = closing(text, opened, closer(opener).1);
                return Some(Mistake { span: opened, message, help });
            }
        }
    }
    let (opener, opened) = open.pop()?;
    let message = format!("this `{}` is never closed", &text[opened.start..opened.end]);
    Some(Mistake { span: opened, message, help: closing(text, opened, closer(opener).1) })
}

/// The parenthesis that is missing, put at the end of the line where it was opened if the next line begins no deeper: there it ends.
pub(super) fn closing(text: &str, opened: Span, closer: char) -> Help {
    let words = format!("put a `{closer}` where it ends");
    fn depth(line: &str) -> usize {
        line.len() - line.trim_start().len()
    }
    let start = text[..opened.start].rfind('\n').map_or(0, |newline| newline + 1);
    let mut lines = text[start..].lines();
    let line = lines.next().unwrap_or_default();
    let next = lines.find(|line| !line.trim().is_empty());
    // What follows may be a part of a comment.
    let code = tokens(line).into_iter().filter(|(token, _)| !matches!(token, Token::Space));
    let end = match Vec::from_iter(code)[..] {
        [.., (Token::LineComment | Token::BlockComment, _)] => None,
        [.., (Token::Word | Token::Close, last), (Token::Comma, _)]
        | [.., (Token::Word | Token::Close, last)] => Some(start + last.end),
        _ => None,
    };
    let ends_here = next.is_some_and(|next| depth(next) <= depth(line));
    match end.filter(|end| ends_here && opened.end <= *end) {
        Some(end) => Help::edit(words, Span { start: end, end }, closer),
        None => words.into(),
    }
}

pub(crate) fn span(range: TextRange) -> Span {
    Span { start: range.start(), end: range.end() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_those_of_the_values_without_the_space_around_them() {
        let (tree, _) = parse("( a : Near( b: 1 ) , )");
        let field = &tree.fields().unwrap()[0];
        assert_eq!(
            (field.name.span, field.value.span),
            (Span { start: 2, end: 3 }, Span { start: 6, end: 18 })
        );
    }

    #[test]
    fn deep_nesting_of_anything_is_one_mistake_at_its_place() {
        // As it is on the thread of a worker.
        let worker = std::thread::Builder::new().stack_size(2 << 20);
        let all = worker.spawn(|| {
            for (open, close) in [
                ("[", "]"),
                ("(", ")"),
                ("{\"a\": ", "}"),
                ("{(): ", "}"),
                ("A(", ")"),
                ("A(b: ", ")"),
                ("A{b: ", "}"),
                ("Some(", ")"),
                ("A(]", ")"),
                ("A{(", ")}"),
                ("[A(b: {1: ", "})]"),
            ] {
                let text = format!("(a: {}1{})", open.repeat(9999), close.repeat(9999));
                let (tree, mistakes) = parse(&text);
                assert!(tree.is_broken());
                let [Mistake { span, message, .. }] = &mistakes[..] else { panic!("{mistakes:?}") };
                assert_eq!(message, "values are nested more than 128 deep here");
                assert!((130..2000).contains(&span.start), "{open} at {}", span.start);
                assert_eq!(printed(&text), text);
            }
        });
        all.unwrap().join().unwrap();
    }

    #[test]
    fn as_deep_as_may_be_is_read_on_the_thread_of_a_worker() {
        let worker = std::thread::Builder::new().stack_size(2 << 20);
        let all = worker.spawn(|| {
            for (open, close) in [("[", "]"), ("A(", ")"), ("A(b: ", ")"), ("{\"a\": ", "}")] {
                let text = format!("{}1{}", open.repeat(DEEPEST), close.repeat(DEEPEST));
                let (tree, mistakes) = parse(&text);
                assert!(mistakes.is_empty() && tree.clone().is_whole(), "{open} {mistakes:?}");
            }
        });
        all.unwrap().join().unwrap();
    }

    #[test]
    fn brackets_in_texts_and_comments_are_not_counted() {
        let open = "(".repeat(999);
        let text = format!("// {open}\n(a: \"{open}\", /* {open} */ b: r#\"{open}\"#)");
        assert_eq!(parse(&text).1, []);
    }

    #[test]
    fn a_text_or_a_comment_without_an_end_is_one_mistake() {
        for (text, message) in [
            ("Graph(doc: \"abc", "this text has an unknown escape or no end"),
            ("Graph(doc: \"abc\\\"", "this text has an unknown escape or no end"),
            ("Graph(/* format: 1, nodes: {}", "this comment is never closed"),
            ("Graph(nodes: {} /* in /* it */", "this comment is never closed"),
            ("Graph(doc: \"abc\"", "this `(` is never closed"),
        ] {
            let told = parse(text).1.into_iter().map(|mistake| mistake.message);
            assert_eq!(Vec::from_iter(told), [message], "{text}");
        }
    }

    #[test]
    fn an_empty_file_is_a_mistake() {
        assert_eq!(parse("// nothing\n").1[0].message, "the file is empty");
    }
}
