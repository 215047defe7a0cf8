//! Recovers the value of a text that has syntax errors.
//!
//! The text is repaired and parsed again, and the positions of all values are mapped back to the original text. A repair may be wrong, so
//! it records the part of the text whose value is uncertain.

use std::collections::BTreeSet;

use ronin_core::SyntaxKind;

use super::brackets::Brackets;
use super::conflict_markers::conflict_error;
use super::cursor::{ends_escaped, recover_tokens};
use super::parser::{
    CLOSES_NOTHING, SyntaxError, UNTERMINATED_COMMENT, UNTERMINATED_STRING, parse, raw_tokens,
};
use super::repair::{Edit, Repair};
use super::tree::{Body, Kind, Tree};
use crate::error::Span;

/// The result of recovering a text with syntax errors.
pub(crate) struct Recovery {
    pub tree: Tree,
    /// All syntax errors, including those that the parser misses because of earlier errors.
    pub errors: Vec<SyntaxError>,
    /// Spans of the text whose values may not be those that the author meant.
    pub doubtful: Vec<Span>,
}

/// Maximum number of syntax errors in a text that can be recovered. Each error costs a pass over the whole text.
const MAX_ERRORS: usize = 1000;

/// Recovers the value of a text. `found` contains the errors that the parser has reported. Returns `None` if the value cannot be recovered,
/// or if there are more than [`MAX_ERRORS`] errors.
pub(crate) fn recover(text: &str, found: &[SyntaxError]) -> Option<Recovery> {
    if conflict_error(text).is_some() || MAX_ERRORS < found.len() {
        return None;
    }
    let mut repair = Repair::new(text);
    let mut errors = found.to_vec();
    let strings = unclosed_strings(text);
    // An unterminated string or comment extends to the end of the text.
    let is_unterminated = found
        .iter()
        .any(|it| [UNTERMINATED_STRING, UNTERMINATED_COMMENT].contains(&&it.message[..]));
    if !strings.is_empty() && !is_unterminated {
        // All errors other than the missing quotes are consequences of these, so drop them.
        errors = strings.iter().map(|(string, _)| missing_quote_error(*string)).collect();
    }
    let quotes: Vec<_> = strings.iter().map(|(_, edit)| edit.clone()).collect();
    repair.mark_doubtful(&quotes.iter().map(|edit| edit.0).collect::<Vec<_>>());
    repair.apply(&quotes);
    let Brackets { edits: brackets, doubtful, errors: wrong, .. } =
        Brackets::analyze(&repair, text);
    // The parser reports only the first wrong bracket. Report the others too.
    if !wrong.is_empty() && !is_unterminated {
        fn is_wrong(known: &SyntaxError, wrong: &[SyntaxError]) -> bool {
            wrong.iter().any(|wrong| wrong.span == known.span)
        }
        errors.retain(|known| !is_about_bracket(known) && !is_wrong(known, &wrong));
        fn matching_error(wrong: &SyntaxError, found: &[SyntaxError]) -> Option<SyntaxError> {
            found.iter().find(|known| is_about_bracket(known) && known.span == wrong.span).cloned()
        }
        errors
            .extend(wrong.into_iter().map(|wrong| matching_error(&wrong, found).unwrap_or(wrong)));
    }
    repair.mark_doubtful(&doubtful);
    repair.apply(&brackets);
    // The parser stops at an unclosed bracket or string. Parse the repaired text to find the errors after it.
    let is_hidden = !is_unterminated && (!quotes.is_empty() || !brackets.is_empty());
    let hidden = if is_hidden { parse(&repair.text).1 } else { Vec::new() };
    let Separators { edits, doubtful, strange } = Separators::analyze(&repair.text);
    // Of the errors in the repaired text, keep those at positions that `edits` fix. All other errors there are consequences of these.
    fn first_affected(edit: &Edit, repair_text: &str) -> usize {
        let rest = &repair_text[edit.0.start..];
        repair_text.len() - rest.trim_start().len()
    }
    let begins = BTreeSet::from_iter(
        edits.iter().flat_map(|edit| [edit.0.start, first_affected(edit, &repair.text)]),
    );
    fn map_to_source(repair: &Repair, error: &SyntaxError) -> SyntaxError {
        SyntaxError {
            span: repair.source_span(error.span),
            help: error.help.clone().map_spans(|_| None),
            ..error.clone()
        }
    }
    let hidden = hidden.iter().filter(|error| begins.contains(&error.span.start));
    let hidden: Vec<_> = hidden.map(|error| map_to_source(&repair, error)).collect();
    let of_brackets = repair.doubtful.len();
    repair.mark_doubtful(&strange);
    let narrow: Vec<_> = doubtful.iter().map(|span| repair.source_span(*span)).collect();
    repair.apply(&edits);
    let (mut tree, left) = parse(&repair.text);
    // Unexpected tokens are left over if a repair has inserted a bracket at a wrong position. The recovery has then failed.
    if tree.is_broken() || MAX_ERRORS < left.len() {
        return None;
    }
    if !brackets.is_empty() && left.iter().any(|error| error.message.starts_with("unexpected `")) {
        return None;
    }
    let of_signs = repair.doubtful.len();
    repair.mark_doubtful(&left.iter().map(|error| error.span).collect::<Vec<_>>());
    move_back(&mut tree, &repair);
    let doubtful = repair.doubtful.iter().map(|span| entry_around(&tree, *span).unwrap_or(*span));
    let doubtful: Vec<_> = doubtful.chain(narrow).collect();
    // Do not report errors inside of parts that earlier repairs made uncertain.
    let left = left.iter().filter(|_| is_hidden).map(|error| map_to_source(&repair, error));
    let candidates =
        hidden.into_iter().map(|it| (it, of_brackets)).chain(left.map(|it| (it, of_signs)));
    for (error, certain) in candidates.collect::<Vec<_>>() {
        let is_at = |span: &Span| overlaps(*span, error.span);
        if !doubtful[..certain].iter().any(is_at) && !errors.iter().any(|it| is_at(&it.span)) {
            errors.push(error);
        }
    }
    // A bracket that ends the value too early causes errors after the end of the value. Keep only one of them.
    errors.sort_by_key(|error| (is_after_end(error), error.span));
    errors.dedup_by(|it, _| is_after_end(it));
    Some(Recovery { tree, errors, doubtful })
}

/// Returns true if an error reports an unclosed bracket or a surplus closing bracket.
fn is_about_bracket(error: &SyntaxError) -> bool {
    let message = &error.message;
    message.starts_with("this `")
        && (message.contains("` is n") || message.ends_with(CLOSES_NOTHING))
}

fn is_after_end(error: &SyntaxError) -> bool {
    error.message.contains("after the end of the graph")
}

fn missing_quote_error(string: Span) -> SyntaxError {
    let message = "missing closing quote".into();
    SyntaxError { span: string, message, help: "add the missing `\"`".into() }
}

/// Returns true if two spans overlap. An empty span counts as one byte.
pub(crate) fn overlaps(a: Span, b: Span) -> bool {
    a.start <= b.start && b.start < a.end.max(a.start + 1)
        || b.start <= a.start && a.start < b.end.max(b.start + 1)
}

fn move_back(tree: &mut Tree, repair: &Repair) {
    tree.span = repair.source_span(tree.span);
    fn move_all_back(trees: &mut [Tree], repair: &Repair) {
        trees.iter_mut().for_each(|tree| move_back(tree, repair));
    }
    match &mut tree.kind {
        Kind::List(items) => move_all_back(items, repair),
        Kind::Map(entries) => entries.iter_mut().for_each(|(key, value)| {
            move_back(key, repair);
            move_back(value, repair);
        }),
        Kind::Call { name, body } => {
            if let Some(name) = name {
                name.span = repair.source_span(name.span);
            }
            match body {
                Body::Items(items) => move_all_back(items, repair),
                Body::Fields(fields) => fields.iter_mut().for_each(|field| {
                    field.name.span = repair.source_span(field.name.span);
                    move_back(&mut field.value, repair);
                }),
                Body::Empty => {}
            }
        }
        _ => {}
    }
}

/// Returns the span of the section entry, such as a node, that contains the offset of `at`. If the field around `at` is not a section,
/// returns the span of the whole field.
fn entry_around(tree: &Tree, at: Span) -> Option<Span> {
    fn entry_span(name: Span, value: &Tree) -> Span {
        Span { start: name.start, end: value.span.end }
    }
    let fields = tree
        .fields()?
        .iter()
        .map(|field| (entry_span(field.name.span, &field.value), &field.value));
    let (field, value) = fields.into_iter().find(|(span, _)| overlaps(*span, at))?;
    let Kind::Map(entries) = &value.kind else { return Some(field) };
    let mut entries = entries.iter().map(|(key, value)| entry_span(key.span, value));
    entries.find(|entry| overlaps(*entry, at))
}

/// Returns the strings without a closing quote, each with an edit that inserts the quote. It is inserted after the last character on the
/// line that may belong to the string.
fn unclosed_strings(text: &str) -> Vec<(Span, Edit)> {
    let mut strings = Vec::new();
    for (kind, span) in recover_tokens(text) {
        let piece = &text[span.start..span.end];
        let inside = piece.strip_prefix('"').and_then(|inside| inside.strip_suffix('"'));
        if kind == SyntaxKind::String && inside.is_none_or(ends_escaped) {
            let line = piece.lines().next().unwrap_or_default();
            let end =
                span.start + line.trim_end_matches([',', ')', ']', '}', ' ', '\r']).len().max(1);
            strings.push((Span { end, ..span }, (Span { start: end, end }, "\"".into())));
        }
    }
    strings
}

/// The missing and surplus commas and colons of a text.
#[derive(Default)]
struct Separators {
    edits: Vec<Edit>,
    /// Spans of parts whose name was guessed. Such a part may have another name, or no name.
    doubtful: Vec<Span>,
    /// Spans of pieces of the text that could not be interpreted.
    strange: Vec<Span>,
}

impl Separators {
    /// Finds missing and surplus commas and colons. All brackets of the text must be correct.
    fn analyze(text: &str) -> Self {
        use SyntaxKind::{
            Colon, Comma, Ident, LBrace, LBracket, LParen, LexError, RBrace, RBracket, RParen,
            String,
        };
        fn is_attribute(kind: SyntaxKind) -> bool {
            matches!(kind, SyntaxKind::Hash | SyntaxKind::Bang | SyntaxKind::EnableKw)
        }
        let tokens: Vec<_> = raw_tokens(text).filter(|(kind, _)| !kind.is_trivia()).collect();
        let mut it = Self::default();
        if tokens.iter().any(|(kind, _)| is_attribute(*kind)) {
            return it;
        }
        // The open brackets. The flag is true if the current part inside of the bracket has a name.
        let mut open: Vec<(SyntaxKind, bool)> = Vec::new();
        fn name(open: &mut [(SyntaxKind, bool)], is_named: bool) {
            open.last_mut().into_iter().for_each(|open| open.1 = is_named);
        }
        let mut before: Option<SyntaxKind> = None;
        for (index, &(kind, at)) in tokens.iter().enumerate() {
            let next = tokens.get(index + 1).map(|(kind, _)| *kind);
            let begins = matches!(before, None | Some(Comma | Colon | LParen | LBracket | LBrace));
            match kind {
                LexError => {
                    let is_colon =
                        &text[at.start..at.end] == "=" && !open.last().is_some_and(|open| open.1);
                    it.edits.push((at, if is_colon { ":" } else { " " }.into()));
                    it.strange.push(at);
                    if is_colon {
                        name(&mut open, true);
                        before = Some(Colon);
                    }
                    continue;
                }
                Comma | Colon if begins => {
                    it.edits.push((at, " ".into()));
                    continue;
                }
                Comma => name(&mut open, false),
                Colon => name(&mut open, true),
                RParen | RBracket | RBrace => drop(open.pop()),
                _ if begins || kind == LParen && before == Some(Ident) => {}
                _ => {
                    let is_named = open.last().is_some_and(|open| open.1);
                    let end = tokens[index - 1].1.end;
                    let is_name = match open.last() {
                        Some((LParen, _)) => before == Some(Ident),
                        Some((LBrace, _)) => before == Some(String),
                        _ => false,
                    };
                    let colon = !is_named && is_name && next != Some(Colon);
                    let sign = if colon { ":" } else { "," };
                    it.edits.push((Span { start: end, end }, sign.into()));
                    if !is_named {
                        it.doubtful.push(at);
                    }
                    name(&mut open, colon);
                }
            }
            if matches!(kind, LParen | LBracket | LBrace) {
                open.push((kind, false));
            }
            before = Some(kind);
        }
        it
    }
}

#[cfg(test)]
mod tests {
    use super::super::tree::Field;
    use super::*;

    /// Formats a value as text, for comparison with the expected value.
    fn format_tree(tree: &Tree) -> String {
        fn format_all(trees: &[Tree]) -> String {
            trees.iter().map(format_tree).collect::<Vec<_>>().join(", ")
        }
        match &tree.kind {
            Kind::Number { value, .. } => value.to_string(),
            Kind::Text(text) | Kind::Word(text) => text.clone(),
            Kind::List(items) => format!("[{}]", format_all(items)),
            Kind::Map(entries) => {
                let entries = entries.iter();
                let entries = entries
                    .map(|(key, value)| format!("{}: {}", format_tree(key), format_tree(value)));
                format!("{{{}}}", entries.collect::<Vec<_>>().join(", "))
            }
            Kind::Call { name, body } => {
                fn format_field(field: &Field) -> String {
                    format!("{}: {}", field.name.text, format_tree(&field.value))
                }
                let body = match body {
                    Body::Empty => String::new(),
                    Body::Items(items) => format_all(items),
                    Body::Fields(all) => {
                        all.iter().map(format_field).collect::<Vec<_>>().join(", ")
                    }
                };
                format!("{}({body})", name.as_ref().map_or("", |name| &name.text))
            }
            _ => "?".into(),
        }
    }

    /// Checks the recovered value of a text and its uncertain parts.
    fn check(text: &str, expected: &str, doubtful: &[&str]) {
        let found =
            recover(text, &parse(text).1).unwrap_or_else(|| panic!("nothing is read of {text}"));
        assert_eq!(format_tree(&found.tree), expected, "{text}");
        let parts = found.doubtful.iter().map(|span| &text[span.start..span.end]);
        assert_eq!(parts.collect::<Vec<_>>(), doubtful, "{text}");
    }

    #[test]
    fn brackets_are_closed_at_the_end_of_their_parts() {
        check(
            "G(n: {\"a\": A(x: 1, \"b\": B(y: (1, 2))}, o: {})",
            "G(n: {a: A(x: 1), b: B(y: (1, 2))}, o: {})",
            &["\"a\": A(x: 1"],
        );
        check("G(n: {\"a\": A(x: 1), o: {\"b\": \"a\"})", "G(n: {a: A(x: 1)}, o: {b: a})", &[]);
        check(
            "G(n: {\"a\": A(x: [1, 2, y: 3)})",
            "G(n: {a: A(x: [1, 2], y: 3)})",
            &["\"a\": A(x: [1, 2, y: 3)"],
        );
        check(
            "G(n: {\"a\": A(x: (1, 2, y: 3)})",
            "G(n: {a: A(x: (1, 2), y: 3)})",
            &["\"a\": A(x: (1, 2, y: 3)"],
        );
        check("G(n: {\"a\": A(x: 1)}", "G(n: {a: A(x: 1)})", &[]);
        check("G(n: {\"a\": A(x: 1)]})", "G(n: {a: A(x: 1)})", &[]);
        check("G(n: {\"a\": A(x: (1, 2])})", "G(n: {a: A(x: (1, 2))})", &[]);
        check("G(n: {\"a\": A(x: [1, 2)})", "G(n: {a: A(x: [1, 2])})", &["\"a\": A(x: [1, 2)"]);
        check("G(n: {\"a\": A(x: [1, 2))})", "G(n: {a: A(x: [1, 2])})", &[]);
        check("G(n: {\"a\": A(x: [1, 2), y: 3)})", "G(n: {a: A(x: [1, 2], y: 3)})", &[]);
        check("G(n: {\"a\": A(x: 1], \"b\": B(y: 2)})", "G(n: {a: A(x: 1), b: B(y: 2)})", &[]);
        check("G(n: {\"a\": A(x: [(1, 2], (3, 4)])})", "G(n: {a: A(x: [(1, 2), (3, 4)])})", &[]);
        check("G(n: {\"a\": A(x: [(1, 2]])})", "G(n: {a: A(x: [(1, 2)])})", &[]);
        check("G(n: {\"a\": A(x: 1)), o: {\"b\": \"a\"})", "G(n: {a: A(x: 1)}, o: {b: a})", &[]);
        check("G(n: {\"a\": A(x: 1)}]", "G(n: {a: A(x: 1)})", &[]);
    }

    #[test]
    fn commas_colons_and_quotes_are_inserted() {
        check("G(n: {\"a\": A(x: 1 y: 2)})", "G(n: {a: A(x: 1, y: 2)})", &[]);
        check("G(n: {\"a\": A(x: 1) \"b\": B()} o: {})", "G(n: {a: A(x: 1), b: B()}, o: {})", &[]);
        check("G(n: {\"a\": A(x: (1 2))})", "G(n: {a: A(x: (1, 2))})", &["2"]);
        check("G(n: {\"a\" A(x: 1)})", "G(n: {a: A(x: 1)})", &["A"]);
        check("G(n: {\"a\": A(x = 1)})", "G(n: {a: A(x: 1)})", &["\"a\": A(x = 1)"]);
        check("G(n: {\"a\": A(x: 1,, y: 2)})", "G(n: {a: A(x: 1, y: 2)})", &[]);
        check(
            "G(n: {\n\"a\": A(x: \"p.obj),\n\"b\": B(y: \"a\")})",
            "G(n: {a: A(x: p.obj), b: B(y: a)})",
            &["\"a\": A(x: \"p.obj)"],
        );
    }

    #[test]
    fn errors_hidden_by_an_unclosed_bracket_are_found() {
        let text = "G(n: {\"a\": A(x: 1, \"b\": B(y: 1 z: 2)})";
        let found = recover(text, &parse(text).1).unwrap();
        let messages = found.errors.iter().map(|error| &error.message[..]);
        let expected =
            ["this `(` is not closed before the `}` at 1:37", "missing comma before `z`"];
        assert_eq!(messages.collect::<Vec<_>>(), expected);
    }

    #[test]
    fn every_wrong_bracket_is_reported_once() {
        let text = "G(n: {\"a\": A(x: (1, 2]), \"b\": B(y: [1)), \"c\": C(z: 1}}, o: {}]";
        let found = recover(text, &parse(text).1).unwrap();
        let messages = found.errors.iter().map(|error| &error.message[..]);
        let expected = [
            "expected `)`, which closes the `(` at 1:17, found `]`",
            "expected `]`, which closes the `[` at 1:36, found `)`",
            "expected `)`, which closes the `(` at 1:48, found `}`",
            "expected `)`, which closes the `(` at 1:2, found `]`",
        ];
        assert_eq!(messages.collect::<Vec<_>>(), expected);
    }

    #[test]
    fn swapped_brackets_are_corrected() {
        let right = "G(n: {a: A(x: [1, 2]), b: B(y: 2)}, o: {})";
        let text = "G(n: {\"a\": A(x: [1, 2]), \"b\": B(y: 2)}, o: {})";
        check(&text.replace("2])", "2)]"), right, &[]);
        check(&text.replace("2)}", "2})"), right, &[]);
        check(&text.replace("A(x: [1, 2])", "A[x: [1, 2])"), right, &[]);
        check(&text.replace("A(x: [1, 2])", "A[x: [1, 2]]"), right, &[]);
        check(&text.replace("A(", "A{"), right, &[]);
        let tuple = right.replace("[1, 2]", "(1, 2)");
        check(&text.replace("A(x: [1, 2])", "A[x: (1, 2])"), &tuple, &[]);
        let text = text.replace("2])", "2)]").replace("B(", "B[");
        let messages = recover(&text, &parse(&text).1).unwrap().errors.into_iter();
        let expected = [
            "expected `]`, which closes the `[` at 1:17, found `)`",
            "expected `)`, which closes the `(` at 1:13, found `]`",
            "expected `(` after `B`, found `[`",
        ];
        assert_eq!(messages.map(|error| error.message).collect::<Vec<_>>(), expected);
    }

    #[test]
    fn calls_with_an_unnamed_text_before_fields_are_valid() {
        fn check_repair(text: &str, right: &str) {
            check(text, &format_tree(&parse(right).0), &[]);
        }
        let right = "G(u: {\"L\": Graph(\"l.ron\", version: \"1\")}, n: {\"a\": A(x: 1, y: 2)})";
        check_repair(&right.replace("1, y", "1 y"), right);
        check_repair(
            "S(o: Graph(\"a\", version: \"b\"), p: 1], q: 2)",
            "S(o: Graph(\"a\", version: \"b\"), p: 1, q: 2)",
        );
        check_repair("Sweep(p: (\"m\", z: 1]), q: 2)", "Sweep(p: (\"m\", z: 1), q: 2)");
        check_repair("S(o: V(\"a\", [1, 2], p: 1)", "S(o: V(\"a\", [1, 2]), p: 1)");
    }

    #[test]
    fn a_text_cut_off_in_a_string_or_comment_has_one_error() {
        for text in ["G(n: {\"a\": A(x: 1), \"b", "G(n: {\"a\": A(x: [1, /* two"] {
            let found = parse(text).1;
            assert_eq!(found.len(), 1, "{found:?}");
            assert_eq!(recover(text, &found).map_or(found.clone(), |it| it.errors), found);
        }
    }

    #[test]
    fn recovery_of_mutated_texts_does_not_panic() {
        let text = "G(n: {\"a\": A(x: [1, (2, 3)], y: \"p\"), \"b\": B()}, o: {})";
        for at in 0..text.len() {
            for piece in
                ["", "(", ")", "[", "]", "{", "}", ",", ":", "\"", "=", "x", "\n", "ä", "/*"]
            {
                for end in [at, at + 1] {
                    let spoiled = format!("{}{piece}{}", &text[..at], &text[end..]);
                    if let Some(found) = recover(&spoiled, &parse(&spoiled).1) {
                        assert!(found.tree.span.end <= spoiled.len());
                    }
                }
            }
        }
    }
}
