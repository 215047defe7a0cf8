//! What can still be read of a text with syntax errors.
//!
//! The text is repaired, read again, and the places of all values are moved back to those in the text as it is. A repair may guess
//! wrong, so each says which part of the text is in doubt.

use std::collections::BTreeSet;

use ronin_core::SyntaxKind;

use super::cursor::recovered_tokens;
use super::file::{Mistake, NO_END, parse, raw_tokens};
use super::marks::conflict_marks;
use super::tree::{Body, Kind, Tree};
use crate::error::Span;

/// What can be read of a text with syntax errors.
pub struct Recovered {
    pub tree: Tree,
    /// All syntax errors, those included that others hide.
    pub mistakes: Vec<Mistake>,
    /// Parts of the text whose values may be other ones than the author meant.
    pub doubtful: Vec<Span>,
}

/// A text in the place of a part of another one.
type Edit = (Span, &'static str);

/// A text with more syntax errors is not read: it is no graph that somebody edits, and each error costs a look at the whole text.
const MAX_MISTAKES: usize = 1000;

/// Reads what can be read of a text in which the parser finds these mistakes. `None` if nothing is left of it, or there are more than
/// [`MAX_MISTAKES`].
pub fn recovered(text: &str, found: &[Mistake]) -> Option<Recovered> {
    if conflict_marks(text).is_some() || MAX_MISTAKES < found.len() {
        return None;
    }
    let places = (0..=text.len()).collect();
    let mut repair = Repair { text: text.to_owned(), places, doubtful: Vec::new() };
    let mut mistakes = found.to_vec();
    let strings = unclosed_strings(text);
    if !strings.is_empty() && !found.iter().any(|mistake| mistake.message == NO_END) {
        // Whatever else the parser finds follows from them.
        mistakes = strings.iter().map(|(string, _)| no_quote(*string)).collect();
    }
    let quotes = Vec::from_iter(strings.iter().map(|(_, edit)| *edit));
    repair.doubt(&Vec::from_iter(quotes.iter().map(|edit| edit.0)));
    repair.apply(&quotes);
    let brackets = Brackets::of(&repair.text);
    repair.doubt(&brackets.doubtful);
    repair.apply(&brackets.edits);
    // Behind an unclosed bracket or string the parser reports nothing.
    let is_hidden = !quotes.is_empty() || !brackets.edits.is_empty();
    let hidden = if is_hidden { parse(&repair.text).1 } else { Vec::new() };
    let Separators { edits, doubtful } = Separators::of(&repair.text);
    // What else the parser finds in this text follows from these.
    let begins = |edit: &Edit| {
        let rest = &repair.text[edit.0.start..];
        repair.text.len() - rest.trim_start().len()
    };
    let begins = BTreeSet::from_iter(edits.iter().flat_map(|edit| [edit.0.start, begins(edit)]));
    let moved = |repair: &Repair, mistake: &Mistake| Mistake {
        span: repair.place(mistake.span),
        help: mistake.help.clone().moved(|_| None),
        ..mistake.clone()
    };
    let hidden = hidden.iter().filter(|mistake| begins.contains(&mistake.span.start));
    let mut hidden = Vec::from_iter(hidden.map(|mistake| moved(&repair, mistake)));
    repair.doubt(&doubtful);
    repair.apply(&edits);
    let (mut tree, left) = parse(&repair.text);
    // A bracket that was guessed in a wrong place leaves pieces that make no sense.
    let is_misplaced = |mistake: &Mistake| mistake.message.ends_with("has no meaning here");
    if tree.is_broken() || MAX_MISTAKES < left.len() {
        return None;
    }
    if !brackets.edits.is_empty() && left.iter().any(is_misplaced) {
        return None;
    }
    let certain = repair.doubtful.len();
    if is_hidden {
        hidden.extend(left.iter().map(|mistake| moved(&repair, mistake)));
    }
    repair.doubt(&Vec::from_iter(left.iter().map(|mistake| mistake.span)));
    move_back(&mut tree, &repair);
    let doubtful = repair.doubtful.iter().map(|span| entry_around(&tree, *span).unwrap_or(*span));
    let doubtful = Vec::from_iter(doubtful);
    let is_new = |mistake: &Mistake| {
        !doubtful[..certain].iter().any(|part| overlaps(*part, mistake.span))
            && !found.iter().any(|known| overlaps(known.span, mistake.span))
    };
    mistakes.extend(hidden.into_iter().filter(is_new));
    Some(Recovered { tree, mistakes, doubtful })
}

fn no_quote(string: Span) -> Mistake {
    let message = "this text has no closing quote".into();
    Mistake { span: string, message, help: "put a `\"` where it ends".into() }
}

/// Returns true if a part of one is in the other; a place without length counts where it is.
pub fn overlaps(a: Span, b: Span) -> bool {
    a.start <= b.start && b.start < a.end.max(a.start + 1)
        || b.start <= a.start && a.start < b.end.max(b.start + 1)
}

/// A text that is being repaired.
struct Repair {
    text: String,
    /// For each byte of it, and its end, the place in the text as it was.
    places: Vec<usize>,
    /// Places in the text as it was.
    doubtful: Vec<Span>,
}

impl Repair {
    /// Makes edits, which are in order.
    fn apply(&mut self, edits: &[Edit]) {
        let (mut text, mut places, mut copied) = (String::new(), Vec::new(), 0);
        for &(span, new) in edits {
            if span.start < copied {
                continue;
            }
            text.push_str(&self.text[copied..span.start]);
            places.extend(&self.places[copied..span.start]);
            text.push_str(new);
            places.extend(std::iter::repeat_n(self.places[span.start], new.len()));
            copied = span.end;
        }
        text.push_str(&self.text[copied..]);
        places.extend(&self.places[copied..]);
        (self.text, self.places) = (text, places);
    }

    fn place(&self, span: Span) -> Span {
        let end = self.text.len();
        let [start, end] = [span.start, span.end].map(|at| self.places[at.min(end)]);
        Span { start, end: end.max(start) }
    }

    fn doubt(&mut self, spans: &[Span]) {
        let places = Vec::from_iter(spans.iter().map(|span| self.place(*span)));
        self.doubtful.extend(places);
    }
}

fn move_back(tree: &mut Tree, repair: &Repair) {
    tree.span = repair.place(tree.span);
    let all = |trees: &mut Vec<Tree>| trees.iter_mut().for_each(|tree| move_back(tree, repair));
    match &mut tree.kind {
        Kind::List(items) => all(items),
        Kind::Map(entries) => entries.iter_mut().for_each(|(key, value)| {
            move_back(key, repair);
            move_back(value, repair);
        }),
        Kind::Call { name, body } => {
            if let Some(name) = name {
                name.span = repair.place(name.span);
            }
            match body {
                Body::Items(items) => all(items),
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
    let joined = |name: Span, value: &Tree| Span { start: name.start, end: value.span.end };
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
            strings.push((Span { end, ..span }, (Span { start: end, end }, "\"")));
        }
    }
    strings
}

/// A bracket that is open.
struct Open {
    kind: SyntaxKind,
    start: usize,
    /// The line on which it is.
    line: usize,
    /// Where the part of it begins that is being read.
    part: Option<usize>,
    has_names: bool,
    has_items: bool,
}

impl Open {
    fn closer(&self) -> &'static str {
        match self.kind {
            SyntaxKind::LParen => ")",
            SyntaxKind::LBracket => "]",
            _ => "}",
        }
    }

    /// Returns true if a part with such a name can be in it.
    fn takes(&self, name: SyntaxKind) -> bool {
        match self.kind {
            SyntaxKind::LParen => name == SyntaxKind::Ident && (self.has_names || !self.has_items),
            SyntaxKind::LBrace => name == SyntaxKind::String,
            _ => false,
        }
    }
}

/// The brackets that are missing or too many.
#[derive(Default)]
struct Brackets {
    edits: Vec<Edit>,
    doubtful: Vec<Span>,
    open: Vec<Open>,
}

impl Brackets {
    /// A name tells which bracket it belongs to: texts name entries of maps, and words name fields of calls.
    fn of(text: &str) -> Self {
        use SyntaxKind::{Colon, Comma, Ident, LBrace, LBracket, LParen, RBrace, RBracket, RParen};
        let tokens = Vec::from_iter(raw_tokens(text).filter(|(kind, _)| !kind.is_trivia()));
        let mut it = Self::default();
        let (mut line, mut counted) = (0, 0);
        for (index, &(kind, at)) in tokens.iter().enumerate() {
            line += text[counted..at.start].matches('\n').count();
            counted = at.start;
            let before = index.checked_sub(1).map(|before| tokens[before]);
            match kind {
                LParen | LBracket | LBrace => {
                    it.begin(at.start);
                    let (part, has_names, has_items) = (None, false, false);
                    it.open.push(Open { kind, start: at.start, line, part, has_names, has_items });
                }
                RParen | RBracket | RBrace => {
                    let opener = match kind {
                        RParen => LParen,
                        RBracket => LBracket,
                        _ => LBrace,
                    };
                    let end = before.map_or(at.start, |(_, before)| before.end);
                    let wanted = it.open.iter().rposition(|open| open.kind == opener);
                    let is_first = text[..at.start].trim_end_matches([' ', '\t']).ends_with('\n');
                    let last = it.open.len().saturating_sub(1);
                    match wanted {
                        Some(place) if place == last => {}
                        // The wrong bracket closes what is open on its own line.
                        Some(place)
                            if !is_first
                                && it.open[last].line == line
                                && it.open[place].line < line =>
                        {
                            it.replace(at);
                        }
                        Some(place) => it.close(place + 1, end),
                        None if it.open.is_empty()
                            || matches!(
                                tokens.get(index + 1),
                                Some((RParen | RBracket | RBrace, _))
                            ) =>
                        {
                            it.edits.push((at, ""));
                            continue;
                        }
                        None => it.replace(at),
                    }
                    it.open.pop();
                }
                Comma => {
                    if let Some(open) = it.open.last_mut() {
                        open.has_items |= open.part.is_some() && !open.has_names;
                        open.part = None;
                    }
                }
                Colon => {
                    let Some((name, named)) = before else { continue };
                    let takes = |open: &Open| open.takes(name);
                    if matches!(name, Ident | SyntaxKind::String)
                        && it.open.last().is_some_and(|open| !open.takes(name))
                        && let Some(place) = it.open.iter().rposition(takes)
                        && it.open[place].part != Some(named.start)
                    {
                        let before = &tokens[..index - 1];
                        let end = before.iter().rev().find(|(kind, _)| *kind != Comma);
                        it.close(place + 1, end.map_or(named.start, |(_, end)| end.end));
                        it.open[place].part = Some(named.start);
                    }
                    if let Some(open) = it.open.last_mut() {
                        open.has_names = true;
                    }
                }
                _ => it.begin(at.start),
            }
        }
        let end = tokens.last().map_or(0, |(_, last)| last.end);
        it.close(0, end);
        it
    }

    fn begin(&mut self, at: usize) {
        if let Some(open) = self.open.last_mut() {
            open.part.get_or_insert(at);
        }
    }

    /// Closes the brackets from this one on.
    fn close(&mut self, from: usize, at: usize) {
        while from < self.open.len() {
            let Some(open) = self.open.pop() else { return };
            self.edits.push((Span { start: at, end: at }, open.closer()));
            // Entries of a map are what they are, wherever it ends.
            let part = self.open.last().and_then(|outer| outer.part);
            if open.kind != SyntaxKind::LBrace && self.open.len() > 1 {
                self.doubtful.push(Span { start: part.unwrap_or(open.start), end: at });
            }
        }
    }

    /// Puts the right bracket in the place of a wrong one.
    fn replace(&mut self, at: Span) {
        if let Some(open) = self.open.last() {
            self.edits.push((at, open.closer()));
        }
    }
}

/// The commas and colons that are missing or too many.
#[derive(Default)]
struct Separators {
    edits: Vec<Edit>,
    doubtful: Vec<Span>,
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
        let tokens = Vec::from_iter(raw_tokens(text).filter(|(kind, _)| !kind.is_trivia()));
        let mut it = Self::default();
        if tokens.iter().any(|(kind, _)| is_attribute(*kind)) {
            return it;
        }
        // The open brackets, and whether the part that is being read in each has a name.
        let mut open: Vec<(SyntaxKind, bool)> = Vec::new();
        let name = |open: &mut Vec<(SyntaxKind, bool)>, is_named| {
            open.last_mut().into_iter().for_each(|open| open.1 = is_named);
        };
        let mut before: Option<SyntaxKind> = None;
        for (index, &(kind, at)) in tokens.iter().enumerate() {
            let next = tokens.get(index + 1).map(|(kind, _)| *kind);
            let begins = matches!(before, None | Some(Comma | Colon | LParen | LBracket | LBrace));
            match kind {
                LexError => {
                    let is_colon =
                        &text[at.start..at.end] == "=" && !open.last().is_some_and(|open| open.1);
                    it.edits.push((at, if is_colon { ":" } else { " " }));
                    it.doubtful.push(at);
                    if is_colon {
                        name(&mut open, true);
                        before = Some(Colon);
                    }
                    continue;
                }
                Comma | Colon if begins => {
                    it.edits.push((at, " "));
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
                    it.edits.push((Span { start: end, end }, if colon { ":" } else { "," }));
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

/// The names in the parts of a text that are in doubt: what seems to lack them may not.
pub fn names_in_doubt<'t>(text: &'t str, doubtful: &[Span]) -> BTreeSet<&'t str> {
    let is_part = |c: char| !(c.is_alphanumeric() || matches!(c, '_' | '-'));
    let parts = doubtful.iter().filter_map(|span| text.get(span.start..span.end));
    parts.flat_map(|part| part.split(is_part)).filter(|name| !name.is_empty()).collect()
}

#[cfg(test)]
mod tests {
    use super::super::tree::Field;
    use super::*;

    /// A value as a text.
    fn shown(tree: &Tree) -> String {
        let all = |trees: &[Tree]| Vec::from_iter(trees.iter().map(shown)).join(", ");
        match &tree.kind {
            Kind::Number { value, .. } => value.to_string(),
            Kind::Text(text) | Kind::Word(text) => text.clone(),
            Kind::List(items) => format!("[{}]", all(items)),
            Kind::Map(entries) => {
                let entry =
                    |(key, value): &(Tree, Tree)| format!("{}: {}", shown(key), shown(value));
                format!("{{{}}}", Vec::from_iter(entries.iter().map(entry)).join(", "))
            }
            Kind::Call { name, body } => {
                let fields =
                    |field: &Field| format!("{}: {}", field.name.text, shown(&field.value));
                let body = match body {
                    Body::Empty => String::new(),
                    Body::Items(items) => all(items),
                    Body::Fields(all) => Vec::from_iter(all.iter().map(fields)).join(", "),
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
        check("G(n: {\"a\": A(x: (1, 2])})", "G(n: {a: A(x: (1, 2))})", &["\"a\": A(x: (1, 2])"]);
    }

    #[test]
    fn commas_colons_and_quotes_are_put_in() {
        check("G(n: {\"a\": A(x: 1 y: 2)})", "G(n: {a: A(x: 1, y: 2)})", &[]);
        check("G(n: {\"a\": A(x: 1) \"b\": B()} o: {})", "G(n: {a: A(x: 1), b: B()}, o: {})", &[]);
        check("G(n: {\"a\": A(x: (1 2))})", "G(n: {a: A(x: (1, 2))})", &["\"a\": A(x: (1 2))"]);
        check("G(n: {\"a\" A(x: 1)})", "G(n: {a: A(x: 1)})", &["\"a\" A(x: 1)"]);
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
