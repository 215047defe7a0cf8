//! What can still be read of a text with syntax errors.
//!
//! The text is repaired, read again, and the places of all values are moved back to those in the text as it is. A repair may guess
//! wrong, so each says which part of the text is in doubt.

use std::collections::BTreeSet;

use ronin_core::SyntaxKind;

use super::brackets::Brackets;
use super::cursor::recovered_tokens;
use super::file::{CLOSES_NOTHING, Mistake, NO_END, OPEN_COMMENT, parse, raw_tokens};
use super::marks::conflict_marks;
use super::repair::{Edit, Repair};
use super::tree::{Body, Kind, Tree};
use crate::error::Span;

/// What can be read of a text with syntax errors.
pub(crate) struct Recovered {
    pub tree: Tree,
    /// All syntax errors, those included that others hide.
    pub mistakes: Vec<Mistake>,
    /// Parts of the text whose values may be other ones than the author meant.
    pub doubtful: Vec<Span>,
}

/// A text with more syntax errors is not read: it is no graph that somebody edits, and each error costs a look at the whole text.
const MAX_MISTAKES: usize = 1000;

/// Reads what can be read of a text in which the parser finds these mistakes. `None` if nothing is left of it, or there are more than
/// [`MAX_MISTAKES`].
pub(crate) fn recovered(text: &str, found: &[Mistake]) -> Option<Recovered> {
    if conflict_marks(text).is_some() || MAX_MISTAKES < found.len() {
        return None;
    }
    let mut repair = Repair::of(text);
    let mut mistakes = found.to_vec();
    let strings = unclosed_strings(text);
    // A text or comment without an end has all of the rest in it.
    let is_swallowed = found.iter().any(|it| [NO_END, OPEN_COMMENT].contains(&&it.message[..]));
    if !strings.is_empty() && !is_swallowed {
        // Whatever else the parser finds follows from them.
        mistakes = strings.iter().map(|(string, _)| no_quote(*string)).collect();
    }
    let quotes: Vec<_> = strings.iter().map(|(_, edit)| edit.clone()).collect();
    repair.doubt(&quotes.iter().map(|edit| edit.0).collect::<Vec<_>>());
    repair.apply(&quotes);
    let Brackets { edits: brackets, doubtful, wrong, .. } = Brackets::of(&repair, text);
    // Of several wrong brackets the parser finds the first one.
    if !wrong.is_empty() && !is_swallowed {
        fn is_wrong(known: &Mistake, wrong: &[Mistake]) -> bool {
            wrong.iter().any(|wrong| wrong.span == known.span)
        }
        mistakes.retain(|known| !is_about_bracket(known) && !is_wrong(known, &wrong));
        fn known(wrong: &Mistake, found: &[Mistake]) -> Option<Mistake> {
            found.iter().find(|known| is_about_bracket(known) && known.span == wrong.span).cloned()
        }
        mistakes.extend(wrong.into_iter().map(|wrong| known(&wrong, found).unwrap_or(wrong)));
    }
    repair.doubt(&doubtful);
    repair.apply(&brackets);
    // Behind an unclosed bracket or string the parser reports nothing.
    let is_hidden = !is_swallowed && (!quotes.is_empty() || !brackets.is_empty());
    let hidden = if is_hidden { parse(&repair.text).1 } else { Vec::new() };
    let Separators { edits, doubtful, strange } = Separators::of(&repair.text);
    // What else the parser finds in this text follows from these.
    fn begins(edit: &Edit, repair_text: &str) -> usize {
        let rest = &repair_text[edit.0.start..];
        repair_text.len() - rest.trim_start().len()
    }
    let begins = BTreeSet::from_iter(
        edits.iter().flat_map(|edit| [edit.0.start, begins(edit, &repair.text)]),
    );
    fn moved(repair: &Repair, mistake: &Mistake) -> Mistake {
        Mistake {
            span: repair.place(mistake.span),
            help: mistake.help.clone().moved(|_| None),
            ..mistake.clone()
        }
    }
    let hidden = hidden.iter().filter(|mistake| begins.contains(&mistake.span.start));
    let hidden: Vec<_> = hidden.map(|mistake| moved(&repair, mistake)).collect();
    let of_brackets = repair.doubtful.len();
    repair.doubt(&strange);
    let narrow: Vec<_> = doubtful.iter().map(|span| repair.place(*span)).collect();
    repair.apply(&edits);
    let (mut tree, left) = parse(&repair.text);
    // A bracket that was guessed in a wrong place leaves pieces that make no sense.
    if tree.is_broken() || MAX_MISTAKES < left.len() {
        return None;
    }
    if !brackets.is_empty()
        && left.iter().any(|mistake| mistake.message.ends_with("has no meaning here"))
    {
        return None;
    }
    let of_signs = repair.doubtful.len();
    repair.doubt(&left.iter().map(|mistake| mistake.span).collect::<Vec<_>>());
    move_back(&mut tree, &repair);
    let doubtful = repair.doubtful.iter().map(|span| entry_around(&tree, *span).unwrap_or(*span));
    let doubtful: Vec<_> = doubtful.chain(narrow).collect();
    // What is misplaced does not follow from itself.
    let left = left.iter().filter(|_| is_hidden).map(|mistake| moved(&repair, mistake));
    let all = hidden.into_iter().map(|it| (it, of_brackets)).chain(left.map(|it| (it, of_signs)));
    for (mistake, certain) in all.collect::<Vec<_>>() {
        let is_at = |span: &Span| overlaps(*span, mistake.span);
        if !doubtful[..certain].iter().any(is_at) && !mistakes.iter().any(|it| is_at(&it.span)) {
            mistakes.push(mistake);
        }
    }
    // Of brackets that end the value too early.
    mistakes.sort_by_key(|mistake| (is_behind_the_end(mistake), mistake.span));
    mistakes.dedup_by(|it, _| is_behind_the_end(it));
    Some(Recovered { tree, mistakes, doubtful })
}

/// Returns true if a mistake is a bracket that is not closed, or closes nothing.
fn is_about_bracket(mistake: &Mistake) -> bool {
    let message = &mistake.message;
    message.starts_with("this `")
        && (message.contains("` is n") || message.ends_with(CLOSES_NOTHING))
}

fn is_behind_the_end(mistake: &Mistake) -> bool {
    mistake.message.contains("behind the end of the graph")
}

fn no_quote(string: Span) -> Mistake {
    let message = "this text has no closing quote".into();
    Mistake { span: string, message, help: "put a `\"` where it ends".into() }
}

/// Returns true if a part of one is in the other; a place without length counts where it is.
pub(crate) fn overlaps(a: Span, b: Span) -> bool {
    a.start <= b.start && b.start < a.end.max(a.start + 1)
        || b.start <= a.start && a.start < b.end.max(b.start + 1)
}

fn move_back(tree: &mut Tree, repair: &Repair) {
    tree.span = repair.place(tree.span);
    fn all(trees: &mut Vec<Tree>, repair: &Repair) {
        trees.iter_mut().for_each(|tree| move_back(tree, repair))
    }
    match &mut tree.kind {
        Kind::List(items) => all(items, repair),
        Kind::Map(entries) => entries.iter_mut().for_each(|(key, value)| {
            move_back(key, repair);
            move_back(value, repair);
        }),
        Kind::Call { name, body } => {
            if let Some(name) = name {
                name.span = repair.place(name.span);
            }
            match body {
                Body::Items(items) => all(items, repair),
                Body::Fields(fields) => fields.iter_mut().for_each(|field| {
                    field.name.span = repair.place(field.name.span);
                    move_back(&mut field.value, repair);
                }),
                Body::Empty => {}
            }
        }
        _ => {}
    }
}

/// The entry of a section around a place, such as a node; the field of the graph if it is no section.
fn entry_around(tree: &Tree, at: Span) -> Option<Span> {
    fn joined(name: Span, value: &Tree) -> Span {
        Span { start: name.start, end: value.span.end }
    }
    let fields =
        tree.fields()?.iter().map(|field| (joined(field.name.span, &field.value), &field.value));
    let (field, value) = fields.into_iter().find(|(span, _)| overlaps(*span, at))?;
    let Kind::Map(entries) = &value.kind else { return Some(field) };
    let mut entries = entries.iter().map(|(key, value)| joined(key.span, value));
    entries.find(|entry| overlaps(*entry, at))
}

/// The strings without a closing quote, and the quote behind the last letter on the line that may belong to the string.
fn unclosed_strings(text: &str) -> Vec<(Span, Edit)> {
    let mut strings = Vec::new();
    for (kind, span) in recovered_tokens(text) {
        let piece = &text[span.start..span.end];
        let inside = piece.strip_prefix('"').and_then(|inside| inside.strip_suffix('"'));
        let is_escaped =
            |inside: &str| (inside.len() - inside.trim_end_matches('\\').len()) % 2 == 1;
        if kind == SyntaxKind::String && inside.is_none_or(is_escaped) {
            let line = piece.lines().next().unwrap_or_default();
            let end =
                span.start + line.trim_end_matches([',', ')', ']', '}', ' ', '\r']).len().max(1);
            strings.push((Span { end, ..span }, (Span { start: end, end }, "\"".into())));
        }
    }
    strings
}

/// The commas and colons that are missing or too many.
#[derive(Default)]
struct Separators {
    edits: Vec<Edit>,
    /// Parts that may have another name, or none.
    doubtful: Vec<Span>,
    /// Signs that have no meaning.
    strange: Vec<Span>,
}

impl Separators {
    /// The brackets of the text are in order.
    fn of(text: &str) -> Self {
        use SyntaxKind::{
            Colon, Comma, Ident, LBrace, LBracket, LParen, LexError, RBrace, RBracket, RParen,
            String,
        };
        let is_attribute =
            |kind| matches!(kind, SyntaxKind::Hash | SyntaxKind::Bang | SyntaxKind::EnableKw);
        let tokens: Vec<_> = raw_tokens(text).filter(|(kind, _)| !kind.is_trivia()).collect();
        let mut it = Self::default();
        if tokens.iter().any(|(kind, _)| is_attribute(*kind)) {
            return it;
        }
        // The open brackets, and whether the part that is being read in each has a name.
        let mut open: Vec<(SyntaxKind, bool)> = Vec::new();
        fn name(open: &mut Vec<(SyntaxKind, bool)>, is_named: bool) {
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

    /// A value as a text.
    fn shown(tree: &Tree) -> String {
        fn all(trees: &[Tree]) -> String {
            trees.iter().map(shown).collect::<Vec<_>>().join(", ")
        }
        match &tree.kind {
            Kind::Number { value, .. } => value.to_string(),
            Kind::Text(text) | Kind::Word(text) => text.clone(),
            Kind::List(items) => format!("[{}]", all(items)),
            Kind::Map(entries) => {
                let entry =
                    |(key, value): &(Tree, Tree)| format!("{}: {}", shown(key), shown(value));
                format!("{{{}}}", entries.iter().map(entry).collect::<Vec<_>>().join(", "))
            }
            Kind::Call { name, body } => {
                let fields =
                    |field: &Field| format!("{}: {}", field.name.text, shown(&field.value));
                let body = match body {
                    Body::Empty => String::new(),
                    Body::Items(items) => all(items),
                    Body::Fields(all) => all.iter().map(fields).collect::<Vec<_>>().join(", "),
                };
                format!("{}({body})", name.as_ref().map_or("", |name| &name.text))
            }
            _ => "?".into(),
        }
    }

    /// What is read of a text, and what of it is in doubt.
    fn check(text: &str, expected: &str, doubtful: &[&str]) {
        let found =
            recovered(text, &parse(text).1).unwrap_or_else(|| panic!("nothing is read of {text}"));
        assert_eq!(shown(&found.tree), expected, "{text}");
        let parts = found.doubtful.iter().map(|span| &text[span.start..span.end]);
        assert_eq!(Vec::from_iter(parts), doubtful, "{text}");
    }

    #[test]
    fn brackets_are_closed_where_their_parts_end() {
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
    fn commas_colons_and_quotes_are_put_in() {
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
    fn what_an_unclosed_bracket_hides_is_found() {
        let text = "G(n: {\"a\": A(x: 1, \"b\": B(y: 1 z: 2)})";
        let found = recovered(text, &parse(text).1).unwrap();
        let messages = found.mistakes.iter().map(|mistake| &mistake.message[..]);
        let expected =
            ["this `(` is not closed before the `}` at 1:37", "there is no comma before `z`"];
        assert_eq!(Vec::from_iter(messages), expected);
    }

    #[test]
    fn every_wrong_bracket_is_told_once_with_what_was_expected() {
        let text = "G(n: {\"a\": A(x: (1, 2]), \"b\": B(y: [1)), \"c\": C(z: 1}}, o: {}]";
        let found = recovered(text, &parse(text).1).unwrap();
        let messages = found.mistakes.iter().map(|mistake| &mistake.message[..]);
        let expected = [
            "expected `)`, which closes the `(` at 1:17, found `]`",
            "expected `]`, which closes the `[` at 1:36, found `)`",
            "expected `)`, which closes the `(` at 1:48, found `}`",
            "expected `)`, which closes the `(` at 1:2, found `]`",
        ];
        assert_eq!(Vec::from_iter(messages), expected);
    }

    #[test]
    fn brackets_that_swap_places_are_read_as_they_were_meant() {
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
        let messages = recovered(&text, &parse(&text).1).unwrap().mistakes.into_iter();
        let expected = [
            "expected `]`, which closes the `[` at 1:17, found `)`",
            "expected `)`, which closes the `(` at 1:13, found `]`",
            "expected `(` behind `B`, found `[`",
        ];
        assert_eq!(messages.map(|mistake| mistake.message).collect::<Vec<_>>(), expected);
    }

    #[test]
    fn calls_with_a_text_before_their_fields_are_in_order() {
        fn check_repair(text: &str, right: &str) {
            check(text, &shown(&parse(right).0), &[]);
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
    fn a_text_that_is_cut_off_in_a_word_or_comment_has_one_mistake() {
        for text in ["G(n: {\"a\": A(x: 1), \"b", "G(n: {\"a\": A(x: [1, /* two"] {
            let found = parse(text).1;
            assert_eq!(found.len(), 1, "{found:?}");
            assert_eq!(recovered(text, &found).map_or(found.clone(), |it| it.mistakes), found);
        }
    }

    #[test]
    fn any_spoiled_text_is_read_or_given_up() {
        let text = "G(n: {\"a\": A(x: [1, (2, 3)], y: \"p\"), \"b\": B()}, o: {})";
        for at in 0..text.len() {
            for piece in
                ["", "(", ")", "[", "]", "{", "}", ",", ":", "\"", "=", "x", "\n", "ä", "/*"]
            {
                for end in [at, at + 1] {
                    let spoiled = format!("{}{piece}{}", &text[..at], &text[end..]);
                    if let Some(found) = recovered(&spoiled, &parse(&spoiled).1) {
                        assert!(found.tree.span.end <= spoiled.len());
                    }
                }
            }
        }
    }
}
