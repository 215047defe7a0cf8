//! Parses the text of a graph file to a tree of values with positions.
//!
//! The parser is `ronin-core`, which keeps all bytes of the text and recovers from errors. Only this module and [`TreeReader`] use it. The
//! result is a [`Tree`]. A [`Tree`] is simpler than the parser's own tree: values can be replaced, checked against a schema and
//! deserialized.

use ronin_core::lexer::tokenize;
use ronin_core::{SyntaxKind, SyntaxNode, TextRange};

use super::conflict_markers::conflict_error;
use super::cursor::ends_escaped;
use super::help::Help;
use super::hyphens::hyphened_fields;
use super::tree::{Kind, Tree, truncate};
use super::tree_reader::{TreeReader, is_value};
use crate::error::{Position, Span};

/// A syntax error with its span and help.
#[derive(Clone, Debug, PartialEq)]
pub struct SyntaxError {
    pub span: Span,
    pub message: String,
    pub help: Help,
}

/// The message for a string without a closing quote.
pub(super) const UNTERMINATED_STRING: &str = "unterminated text or unknown escape";

/// The message for a block comment that is not closed.
pub(super) const UNTERMINATED_COMMENT: &str = "unterminated comment";

/// The end of the message for a surplus closing bracket.
pub(super) const CLOSES_NOTHING: &str = " closes nothing";

/// Maximum nesting depth of values. No node needs more, and this depth is far from overflowing the stack of a thread.
///
/// The depth is checked before a text is parsed, so recursive code needs no depth limit of its own.
pub const MAX_DEPTH: usize = 128;

/// Splits a text into tokens that cover all of it. The lexer is not recursive, so deep nesting cannot overflow the stack.
pub(super) fn raw_tokens(text: &str) -> impl Iterator<Item = (SyntaxKind, Span)> + '_ {
    let mut end = 0;
    tokenize(text).into_iter().map(move |token| {
        let start = end;
        end += token.text.len();
        (token.kind, Span { start, end })
    })
}

/// Returns the first token that is not space or a comment. This is the kind of the file, such as `Graph` or `Sweep`.
pub fn first_word(text: &str) -> &str {
    use SyntaxKind::{BlockComment, Bom, LineComment, Whitespace};
    fn is_trivia(kind: SyntaxKind) -> bool {
        matches!(kind, Bom | Whitespace | LineComment | BlockComment)
    }
    let first = raw_tokens(text).find(|(kind, _)| !is_trivia(*kind));
    first.map_or("", |(_, at)| &text[at.start..at.end])
}

/// Returns the first bracket that is nested deeper than [`MAX_DEPTH`]. A bracket counts as open until it is closed by the right kind of
/// bracket, because the parser may treat it as open. The parser has a limit of its own, but not for all of its recursive functions.
fn too_deep(mut tokens: impl Iterator<Item = (SyntaxKind, Span)>) -> Option<Span> {
    use SyntaxKind::{LBrace, LBracket, LParen, RBrace, RBracket, RParen};
    let mut open = Vec::new();
    tokens.find_map(|(kind, at)| {
        let opener = match kind {
            LParen | LBracket | LBrace if open.len() == MAX_DEPTH => return Some(at),
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

/// Parses a text. Returns the readable part of its value, and all syntax errors.
pub fn parse(text: &str) -> (Tree, Vec<SyntaxError>) {
    let tokens = raw_tokens(text).collect::<Vec<_>>();
    if let Some(span) = too_deep(tokens.iter().copied()) {
        let message = format!("values are nested more than {MAX_DEPTH} deep here");
        let error = SyntaxError { span, message, help: "reduce the nesting".into() };
        return (Tree::new(Span::default(), Kind::Broken), vec![error]);
    }
    let document = ronin_core::parse(text);
    let root = document.root();
    let mut errors: Vec<SyntaxError> = document
        .diagnostics()
        .iter()
        .map(|found| explain(text, span(found.range), &found.message))
        .collect();
    let hyphened = if errors.is_empty() { Vec::new() } else { hyphened_fields(text, &tokens) };
    for field in hyphened {
        // Drop the parser's own errors at the hyphens of the field's name.
        let Span { start, end } = field.span;
        errors.retain(|error| !(start..=end).contains(&error.span.start));
        errors.push(field);
    }
    // An unterminated string or comment extends to the end of the text. Its error is reported below.
    let ends_unterminated = ends_unterminated(text, &tokens);
    let mut unclosed_bracket = unclosed_bracket(text, &tokens);
    if let Some(unclosed) = &unclosed_bracket {
        // Drop later errors of the parser, which are consequences of the unclosed bracket.
        errors.retain(|error| error.span.end <= unclosed.span.start);
    }
    errors.extend(unclosed_bracket.take_if(|_| !ends_unterminated));
    if errors.is_empty() && !ends_unterminated {
        errors.extend(separator_errors(&tokens, &root));
    }
    let is_in_order = errors.is_empty();
    errors.extend(invalid_space_errors(text, &tokens));
    let mut reader = TreeReader::default();
    for node in root.children() {
        if node.kind() == SyntaxKind::ExtensionAttr && !is_known_extension(&node) {
            let at = span(node.text_range());
            match node.text().starts_with("#![") {
                true => reader.report(at, "unknown extension of RON", "remove it"),
                false => {
                    let help = "write a color as text: \"#c33923\"";
                    reader.report(at, "expected a value, found `#`", help)
                }
            };
        }
    }
    let value = root.children().find(|node| is_value(node.kind()));
    let tree = match value {
        Some(node) => reader.value(&node),
        None => {
            if errors.is_empty() {
                errors.push(SyntaxError {
                    span: Span { start: 0, end: text.len().min(1) },
                    message: "the file is empty".into(),
                    help: "a graph begins with `Graph(format: 1, ..)`".into(),
                });
            }
            Tree::new(Span::default(), Kind::Broken)
        }
    };
    if is_in_order {
        errors.extend(reader.misplaced);
    }
    errors.extend(reader.errors);
    if errors.is_empty() {
        errors.extend(unclosed_bracket);
    }
    if let Some((_, last)) = tokens.last().filter(|_| ends_unterminated) {
        fn is_of_end(it: &SyntaxError) -> bool {
            [UNTERMINATED_STRING, UNTERMINATED_COMMENT].contains(&&it.message[..])
        }
        if errors.iter().any(is_of_end) {
            errors.retain(|error| error.span.start < last.start || is_of_end(error));
        }
    }
    // If the text has conflict markers, all other errors are consequences of them.
    if !errors.is_empty()
        && let Some(marks) = conflict_error(text)
    {
        return (Tree::new(Span::default(), Kind::Broken), vec![marks]);
    }
    errors.sort_by_key(|error| error.span);
    (tree, errors)
}

/// Returns true for an attribute `#![enable(..)]` that enables extensions of RON. These extensions do not change the meaning of a graph.
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

/// Reports space characters that RON does not allow, and comments that are not closed. Ignores a byte order mark at the start of the text.
fn invalid_space_errors(text: &str, tokens: &[(SyntaxKind, Span)]) -> Vec<SyntaxError> {
    fn is_space(c: char) -> bool {
        c.is_ascii_whitespace() || "\u{b}\u{85}\u{200e}\u{200f}\u{2028}\u{2029}".contains(c)
    }
    let mut errors = Vec::new();
    for &(kind, at) in tokens {
        let piece = &text[at.start..at.end];
        let (start, message, help) = match kind {
            SyntaxKind::Whitespace => match piece.find(|c| !is_space(c)) {
                Some(start) => (start, "unsupported space character", "use a plain space instead"),
                None => continue,
            },
            SyntaxKind::BlockComment if !is_closed(piece) => {
                (0, UNTERMINATED_COMMENT, "add the missing `*/`")
            }
            _ => continue,
        };
        let start = at.start + start;
        let length = text[start..].chars().next().map_or(0, char::len_utf8);
        let span = Span { start, end: start + length };
        errors.push(SyntaxError { span, message: message.into(), help: help.into() });
    }
    errors
}

/// Returns true if the last token is an unterminated string or comment.
fn ends_unterminated(text: &str, tokens: &[(SyntaxKind, Span)]) -> bool {
    let Some(&(kind, at)) = tokens.last() else { return false };
    let piece = &text[at.start..at.end];
    match kind {
        SyntaxKind::BlockComment => !is_closed(piece),
        SyntaxKind::String => {
            let inside = piece.get(1..).and_then(|rest| rest.strip_suffix('"'));
            inside.is_none_or(ends_escaped)
        }
        _ => false,
    }
}

/// Returns true if a block comment is closed. Block comments may be nested.
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

/// The kind of a token, for code that changes the layout of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Token {
    Space,
    LineComment,
    BlockComment,
    Open,
    Close,
    Comma,
    Colon,
    /// A name, a literal, or any other token.
    Word,
}

/// Splits a text into tokens that cover all of it.
pub fn tokens(text: &str) -> Vec<(Token, Span)> {
    raw_tokens(text).map(|(kind, span)| (Token::from_kind(kind), span)).collect()
}

impl Token {
    pub(super) fn from_kind(kind: SyntaxKind) -> Self {
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

/// Parses a text and prints it again. The result has the same bytes, even if the text has errors. A text that is nested deeper than
/// `MAX_DEPTH` is returned unchanged.
pub fn reprint(text: &str) -> String {
    match too_deep(raw_tokens(text)) {
        None => ronin_core::print(&ronin_core::parse(text)),
        Some(_) => text.to_owned(),
    }
}

/// Rewords an error of the parser. The new message includes the token that was found.
fn explain(text: &str, found: Span, message: &str) -> SyntaxError {
    let found_text = text.get(found.start..found.end).unwrap_or_default();
    let (message, help): (String, Help) = if message.contains("trailing") {
        let end = found_text.find('\n').map_or(found.end, |line| found.start + line);
        return SyntaxError {
            span: Span { end, ..found },
            message: "unexpected text after the end of the graph".into(),
            help: "a file contains a single `Graph(..)`".into(),
        };
    } else if message.contains("delimited group") {
        fn begins_value(c: char) -> bool {
            c.is_alphanumeric() || "\"'([{-+_".contains(c)
        }
        match found_text.starts_with(begins_value) {
            true => (
                format!("missing comma before `{}`", truncate(found_text)),
                missing_comma(text, found),
            ),
            false => (format!("unexpected `{found_text}`"), Help::edit(REMOVE_HELP, found, "")),
        }
    } else if found_text.chars().count() <= 24 && !found_text.is_empty() {
        (
            format!("{message}, found `{found_text}`"),
            "is a comma, colon or parenthesis missing before it?".into(),
        )
    } else {
        (message.to_owned(), "is a comma, colon or parenthesis missing before it?".into())
    };
    SyntaxError { span: found, message, help }
}

/// Proposes to insert a comma after the token before `found`, unless that token is a comment or is too far away.
fn missing_comma(text: &str, found: Span) -> Help {
    const MAX_DISTANCE: usize = 400;
    let words = "add a comma before it";
    let from = (found.start.saturating_sub(MAX_DISTANCE)..=found.start)
        .find(|&at| text.is_char_boundary(at));
    let before = text[from.unwrap_or(found.start)..found.start].trim_end();
    let line = before.rsplit('\n').next().unwrap_or_default();
    if before.is_empty() || line.contains("//") || line.contains("*/") {
        return words.into();
    }
    let end = from.unwrap_or(found.start) + before.len();
    Help::edit(words, Span { start: end, end }, ",")
}

pub(super) const REMOVE_HELP: &str = "remove it";

/// Reports missing and surplus commas and colons that the parser does not report.
fn separator_errors(tokens: &[(SyntaxKind, Span)], root: &SyntaxNode) -> Vec<SyntaxError> {
    use SyntaxKind::{Colon, Comma, Ident, LBrace, LBracket, LParen, RBrace, RBracket, RParen};
    let extensions = root.children().filter(|node| node.kind() == SyntaxKind::ExtensionAttr);
    let extensions: Vec<_> = extensions.map(|node| span(node.text_range())).collect();
    let mut before = None;
    let mut errors = Vec::new();
    for &(kind, at) in tokens.iter().filter(|(kind, _)| !kind.is_trivia()) {
        if extensions.iter().any(|it| it.start <= at.start && at.end <= it.end) {
            continue;
        }
        let begins = matches!(before, None | Some(Comma | Colon | LParen | LBracket | LBrace));
        let error = match kind {
            Comma if begins => Some(("expected a value before this `,`", REMOVE_HELP)),
            Colon if begins => Some(("expected a value before this `:`", REMOVE_HELP)),
            RParen | RBracket | RBrace if before == Some(Colon) => {
                Some(("expected a value after the `:` before this", "add a value"))
            }
            Comma | Colon | RParen | RBracket | RBrace => None,
            LParen if before == Some(Ident) => None,
            _ if begins => None,
            _ => Some(("expected a comma or a colon before this", "add a comma or a colon")),
        };
        errors.extend(error.map(|(message, help)| SyntaxError {
            span: at,
            message: message.into(),
            help: if help == REMOVE_HELP { Help::edit(help, at, "") } else { help.into() },
        }));
        before = Some(kind);
    }
    errors
}

/// Reports the first bracket that is not closed, or is closed by a bracket of another kind.
fn unclosed_bracket(text: &str, tokens: &[(SyntaxKind, Span)]) -> Option<SyntaxError> {
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
                let help = Help::edit(REMOVE_HELP, at, "");
                return Some(SyntaxError { span: at, message, help });
            };
            if closer(opener).0 != kind {
                let Position { line, column } = Position::from_offset(text, at.start);
                let opener_text = &text[opened.start..opened.end];
                let message = format!(
                    "this `{opener_text}` is not closed before the `{found}` at {line}:{column}"
                );
                let help = closing_help(text, opened, closer(opener).1);
                return Some(SyntaxError { span: opened, message, help });
            }
        }
    }
    let (opener, opened) = open.pop()?;
    let message = format!("this `{}` is never closed", &text[opened.start..opened.end]);
    Some(SyntaxError { span: opened, message, help: closing_help(text, opened, closer(opener).1) })
}

/// Proposes to insert a missing closing bracket. If the next line is indented no deeper than the line of the opening bracket, the bracket
/// is inserted at the end of that line.
pub(super) fn closing_help(text: &str, opened: Span, closer: char) -> Help {
    let words = format!("add the missing `{closer}`");
    fn depth(line: &str) -> usize {
        line.len() - line.trim_start().len()
    }
    let start = text[..opened.start].rfind('\n').map_or(0, |newline| newline + 1);
    let mut lines = text[start..].lines();
    let line = lines.next().unwrap_or_default();
    let next = lines.find(|line| !line.trim().is_empty());
    // Do not insert the bracket after a comment, because it would become part of a line comment.
    let code = tokens(line).into_iter().filter(|(token, _)| !matches!(token, Token::Space));
    let end = match code.collect::<Vec<_>>()[..] {
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
    fn spans_exclude_surrounding_space() {
        let (tree, _) = parse("( a : Near( b: 1 ) , )");
        let field = &tree.fields().unwrap()[0];
        assert_eq!(
            (field.name.span, field.value.span),
            (Span { start: 2, end: 3 }, Span { start: 6, end: 18 })
        );
    }

    #[test]
    fn deep_nesting_of_anything_is_one_error_at_its_position() {
        // Use a thread with the stack size of a worker thread.
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
                let (tree, errors) = parse(&text);
                assert!(tree.is_broken());
                let [SyntaxError { span, message, .. }] = &errors[..] else { panic!("{errors:?}") };
                assert_eq!(message, "values are nested more than 128 deep here");
                assert!((130..2000).contains(&span.start), "{open} at {}", span.start);
                assert_eq!(reprint(&text), text);
            }
        });
        all.unwrap().join().unwrap();
    }

    #[test]
    fn the_maximum_depth_is_parsed_on_a_worker_thread() {
        let worker = std::thread::Builder::new().stack_size(2 << 20);
        let all = worker.spawn(|| {
            for (open, close) in [("[", "]"), ("A(", ")"), ("A(b: ", ")"), ("{\"a\": ", "}")] {
                let text = format!("{}1{}", open.repeat(MAX_DEPTH), close.repeat(MAX_DEPTH));
                let (tree, errors) = parse(&text);
                assert!(errors.is_empty() && tree.clone().is_complete(), "{open} {errors:?}");
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
    fn a_text_or_a_comment_without_an_end_is_one_error() {
        for (text, message) in [
            ("Graph(doc: \"abc", "unterminated text or unknown escape"),
            ("Graph(doc: \"abc\\\"", "unterminated text or unknown escape"),
            ("Graph(/* format: 1, nodes: {}", "unterminated comment"),
            ("Graph(nodes: {} /* in /* it */", "unterminated comment"),
            ("Graph(doc: \"abc\"", "this `(` is never closed"),
        ] {
            let messages = parse(text).1.into_iter().map(|error| error.message);
            assert_eq!(messages.collect::<Vec<_>>(), [message], "{text}");
        }
    }

    #[test]
    fn an_empty_file_is_an_error() {
        assert_eq!(parse("// nothing\n").1[0].message, "the file is empty");
    }
}
