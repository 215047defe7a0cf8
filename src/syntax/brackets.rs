//! Finds missing, wrong and surplus brackets in a RON text, and proposes corrections.

use ronin_core::SyntaxKind;

use super::help::Help;
use super::parser::{
    CLOSES_NOTHING, REMOVE_HELP, SyntaxError, closing_help, first_word, raw_tokens,
};
use super::repair::{Edit, Repair};
use crate::error::{Position, Span};

/// A bracket that is not yet closed at the current position in the text.
struct OpenBracket {
    kind: SyntaxKind,
    at: Span,
    /// The offset at which the current field, entry or item inside of the bracket begins. `None` if no part has begun.
    part: Option<usize>,
    has_names: bool,
    /// The number of complete parts inside of the bracket that have no name.
    items: usize,
    /// True if the first part inside of the bracket is a string without a name, and fields may follow. Examples are `Graph("lib.ron",
    /// version: "1.0")` and, in sweeps, `picture: ("model.glb", zoom: 2)`.
    is_of_text: bool,
}

impl OpenBracket {
    fn closer(&self) -> char {
        match self.kind {
            SyntaxKind::LParen => ')',
            SyntaxKind::LBracket => ']',
            _ => '}',
        }
    }

    /// Returns true if a name of this kind can occur directly inside of the bracket: strings in maps, words in calls.
    fn accepts_name(&self, name: SyntaxKind) -> bool {
        match self.kind {
            SyntaxKind::LParen => {
                let most = usize::from(self.is_of_text);
                name == SyntaxKind::Ident && (self.has_names || self.items <= most)
            }
            SyntaxKind::LBrace => name == SyntaxKind::String,
            _ => false,
        }
    }
}

/// The missing, wrong and surplus brackets of a text.
pub(super) struct Brackets<'t> {
    repair: &'t Repair,
    /// The text of the file before it was repaired.
    text: &'t str,
    tokens: Vec<(SyntaxKind, Span)>,
    pub(super) edits: Vec<Edit>,
    pub(super) doubtful: Vec<Span>,
    /// The errors, with spans in the original text.
    pub(super) errors: Vec<SyntaxError>,
    open: Vec<OpenBracket>,
}

fn opener_of(kind: SyntaxKind) -> Option<SyntaxKind> {
    match kind {
        SyntaxKind::RParen => Some(SyntaxKind::LParen),
        SyntaxKind::RBracket => Some(SyntaxKind::LBracket),
        SyntaxKind::RBrace => Some(SyntaxKind::LBrace),
        _ => None,
    }
}

impl<'t> Brackets<'t> {
    /// Finds the errors in a text. The kind of a name shows which bracket contains it: strings are keys of maps, and words are fields of
    /// calls.
    pub(super) fn analyze(repair: &'t Repair, text: &'t str) -> Self {
        use SyntaxKind::{Colon, Comma, LBrace, LBracket, LParen};
        let tokens: Vec<_> =
            raw_tokens(&repair.text).filter(|(kind, _)| !kind.is_trivia()).collect();
        let (edits, doubtful, errors, open) = Default::default();
        let mut it = Self { repair, text, tokens, edits, doubtful, errors, open };
        let is_sweep = first_word(&repair.text) == "Sweep";
        for index in 0..it.tokens.len() {
            let (kind, at) = it.tokens[index];
            match kind {
                LParen | LBracket | LBrace => {
                    it.begin_part(at.start);
                    let is_call = index > 0 && it.tokens[index - 1].0 == SyntaxKind::Ident;
                    let kind = if is_call { it.begin_call(kind, index) } else { kind };
                    let first = it.tokens.get(index + 1).map(|(kind, _)| *kind);
                    let is_of_text = (is_call || is_sweep) && first == Some(SyntaxKind::String);
                    let (part, has_names, items) = (None, false, 0);
                    it.open.push(OpenBracket { kind, at, part, has_names, items, is_of_text });
                }
                Comma => {
                    if let Some(open) = it.open.last_mut() {
                        open.items += usize::from(open.part.is_some() && !open.has_names);
                        open.part = None;
                    }
                }
                Colon => it.read_name(index),
                _ => match opener_of(kind) {
                    Some(opener) => it.end(index, opener),
                    None => it.begin_part(at.start),
                },
            }
        }
        let read_closer = it.tokens.last().map_or(0, |(_, last)| last.end);
        it.close(0, read_closer, None);
        it
    }

    fn begin_part(&mut self, at: usize) {
        if let Some(open) = self.open.last_mut() {
            open.part.get_or_insert(at);
        }
    }

    /// Processes the opening bracket after a name, which begins a call. Returns the kind of bracket that a call requires.
    fn begin_call(&mut self, kind: SyntaxKind, index: usize) -> SyntaxKind {
        let at = self.tokens[index].1;
        if kind != SyntaxKind::LParen {
            self.edits.push((at, "(".into()));
            let (name, _) = self.source_piece(self.tokens[index - 1].1);
            let (found, span) = self.source_piece(at);
            let message = format!("expected `(` after `{name}`, found `{found}`");
            self.errors.push(SyntaxError {
                span,
                message,
                help: Help::edit("write `(`", span, "("),
            });
        }
        SyntaxKind::LParen
    }

    /// Processes the colon at `index`. Closes the open brackets that cannot contain the name before the colon.
    fn read_name(&mut self, index: usize) {
        let Some(&(name, named)) = index.checked_sub(1).map(|before| &self.tokens[before]) else {
            return;
        };
        let is_name = matches!(name, SyntaxKind::Ident | SyntaxKind::String);
        if is_name
            && self.open.last().is_some_and(|open| !open.accepts_name(name))
            && let Some(place) = self.open.iter().rposition(|open| open.accepts_name(name))
            && self.open[place].part != Some(named.start)
        {
            let before = self.tokens[..index - 1].iter().rev();
            let end = before.into_iter().find(|(kind, _)| *kind != SyntaxKind::Comma);
            self.close(place + 1, end.map_or(named.start, |(_, end)| end.end), Some(named));
            self.open[place].part = Some(named.start);
        }
        if let Some(open) = self.open.last_mut() {
            open.has_names = true;
        }
    }

    /// Processes the closing bracket at `index`.
    fn end(&mut self, index: usize, opener: SyntaxKind) {
        let at = self.tokens[index].1;
        let Some(last) = self.open.len().checked_sub(1) else {
            return self.remove(at);
        };
        if self.open[last].kind == opener {
            self.open.pop();
            return;
        }
        // The bracket may close an outer bracket, be of the wrong kind, or be surplus. The next tokens show which case applies.
        let outer = self.open.iter().rposition(|open| open.kind == opener);
        let next = self.tokens.get(index + 1);
        let is_before_another = next.is_some_and(|(kind, _)| opener_of(*kind).is_some());
        let closes = outer.is_some_and(|outer| self.is_consistent(outer, index + 1));
        if !closes && (self.is_consistent(last, index + 1) || self.is_swapped(index, opener)) {
            self.replace(at);
        } else if !closes && self.is_consistent(last + 1, index + 1) {
            self.remove(at);
        } else if let Some(outer) = outer {
            let end = index.checked_sub(1).map_or(at.start, |before| self.tokens[before].1.end);
            self.close(outer + 1, end, Some(at));
            self.open.pop();
        } else if is_before_another {
            self.remove(at);
        } else {
            self.replace(at);
        }
    }

    /// Returns true if the bracket at `index` and the bracket after it close the two innermost open brackets in the wrong order.
    fn is_swapped(&self, index: usize, opener: SyntaxKind) -> bool {
        let [.., outer, last] = &self.open[..] else { return false };
        let next = self.tokens.get(index + 1).and_then(|(kind, _)| opener_of(*kind));
        let is_other_order = outer.kind == opener && next == Some(last.kind);
        is_other_order && self.is_consistent(self.open.len() - 2, index + 2)
    }

    /// Returns true if the tokens with index `from` and greater can be read correctly while only the `open` outermost brackets are open.
    fn is_consistent(&self, mut open: usize, from: usize) -> bool {
        for (index, &(kind, _)) in self.tokens.iter().enumerate().skip(from) {
            let last = open.checked_sub(1).map(|last| &self.open[last]);
            let next = self.tokens.get(index + 1).map(|(kind, _)| *kind);
            match (kind, last) {
                (SyntaxKind::Comma, _) => {}
                (_, None) => return false,
                (_, Some(last)) if next == Some(SyntaxKind::Colon) => {
                    return last.accepts_name(kind);
                }
                (_, Some(last)) => match opener_of(kind) {
                    Some(opener) if opener == last.kind => open -= 1,
                    Some(_) => return false,
                    None => return last.kind != SyntaxKind::LBrace && !last.has_names,
                },
            }
        }
        open == 0
    }

    /// Closes the open brackets with indices `from` and greater at the offset `at`. `found` is the wrong bracket at this offset, if there
    /// is one.
    fn close(&mut self, from: usize, at: usize, found: Option<Span>) {
        let known = self.errors.len();
        while from < self.open.len() {
            let Some(open) = self.open.pop() else { return };
            self.edits.push((Span { start: at, end: at }, open.closer().into()));
            // The entries of a map can be read even if the end of the map is uncertain.
            let part = self.open.last().and_then(|outer| outer.part);
            if open.kind != SyntaxKind::LBrace && self.open.len() > 1 {
                self.doubtful.push(Span { start: part.unwrap_or(open.at.start), end: at });
            }
            // If the end of the text is missing, many brackets are open. Report an error for only one of them.
            if found.is_none() && known < self.errors.len() {
                continue;
            }
            let (opener, span) = self.source_piece(open.at);
            let message = match found.map(|found| self.source_piece(found)) {
                Some((found, at)) => {
                    let Position { line, column } = Position::from_offset(self.text, at.start);
                    format!("this `{opener}` is not closed before the `{found}` at {line}:{column}")
                }
                None => format!("this `{opener}` is never closed"),
            };
            let help = closing_help(self.text, span, open.closer());
            self.errors.push(SyntaxError { span, message, help });
        }
    }

    /// Replaces a closing bracket of the wrong kind.
    fn replace(&mut self, at: Span) {
        let Some(open) = self.open.pop() else { return };
        let closer = open.closer();
        self.edits.push((at, closer.into()));
        let ((opener, opened), (found, span)) = (self.source_piece(open.at), self.source_piece(at));
        let Position { line, column } = Position::from_offset(self.text, opened.start);
        let message = format!(
            "expected `{closer}`, which closes the `{opener}` at {line}:{column}, found `{found}`"
        );
        let help = Help::edit(format!("write `{closer}`"), span, closer);
        self.errors.push(SyntaxError { span, message, help });
    }

    /// Removes a surplus closing bracket.
    fn remove(&mut self, at: Span) {
        self.edits.push((at, String::new()));
        let (found, span) = self.source_piece(at);
        let message = format!("this `{found}`{CLOSES_NOTHING}");
        let help = Help::edit(REMOVE_HELP, span, "");
        self.errors.push(SyntaxError { span, message, help });
    }

    /// Returns the text at a span of the repaired text, and the corresponding span in the original text.
    fn source_piece(&self, at: Span) -> (&'t str, Span) {
        (&self.repair.text[at.start..at.end], self.repair.source_span(at))
    }
}
