//! Brackets that are missing, wrong or too many in a text, and where others belong.

use ronin_core::SyntaxKind;

use super::file::{CLOSES_NOTHING, Mistake, ONE_TOO_MANY, closing, first_word, raw_tokens};
use super::help::Help;
use super::repair::{Edit, Repair};
use crate::error::{Place, Span};

/// A bracket that is open.
struct Open {
    kind: SyntaxKind,
    at: Span,
    /// Where the part of it begins that is being read.
    part: Option<usize>,
    has_names: bool,
    /// How many parts without a name are behind commas.
    items: usize,
    /// Whether its first part is a text, behind which fields may come: `Graph("lib.ron", version: "1.0")`, and in sweeps
    /// `picture: ("model.glb", zoom: 2)`.
    is_of_text: bool,
}

impl Open {
    fn closer(&self) -> char {
        match self.kind {
            SyntaxKind::LParen => ')',
            SyntaxKind::LBracket => ']',
            _ => '}',
        }
    }

    /// Returns true if a part with such a name can be in it.
    fn takes(&self, name: SyntaxKind) -> bool {
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

/// The brackets that are missing, wrong or too many.
pub(super) struct Brackets<'t> {
    repair: &'t Repair,
    /// The text as it was.
    text: &'t str,
    tokens: Vec<(SyntaxKind, Span)>,
    pub(super) edits: Vec<Edit>,
    pub(super) doubtful: Vec<Span>,
    /// The mistakes, at their places in the text as it was.
    pub(super) wrong: Vec<Mistake>,
    open: Vec<Open>,
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
    /// A name tells which bracket it belongs to: texts name entries of maps, and words name fields of calls.
    pub(super) fn of(repair: &'t Repair, text: &'t str) -> Self {
        use SyntaxKind::{Colon, Comma, LBrace, LBracket, LParen};
        let tokens: Vec<_> =
            raw_tokens(&repair.text).filter(|(kind, _)| !kind.is_trivia()).collect();
        let (edits, doubtful, wrong, open) = Default::default();
        let mut it = Self { repair, text, tokens, edits, doubtful, wrong, open };
        let is_sweep = first_word(&repair.text) == "Sweep";
        for index in 0..it.tokens.len() {
            let (kind, at) = it.tokens[index];
            match kind {
                LParen | LBracket | LBrace => {
                    it.begin(at.start);
                    let is_call = index > 0 && it.tokens[index - 1].0 == SyntaxKind::Ident;
                    let kind = if is_call { it.begin_call(kind, index) } else { kind };
                    let first = it.tokens.get(index + 1).map(|(kind, _)| *kind);
                    let is_of_text = (is_call || is_sweep) && first == Some(SyntaxKind::String);
                    let (part, has_names, items) = (None, false, 0);
                    it.open.push(Open { kind, at, part, has_names, items, is_of_text });
                }
                Comma => {
                    if let Some(open) = it.open.last_mut() {
                        open.items += usize::from(open.part.is_some() && !open.has_names);
                        open.part = None;
                    }
                }
                Colon => it.name(index),
                _ => match opener_of(kind) {
                    Some(opener) => it.end(index, opener),
                    None => it.begin(at.start),
                },
            }
        }
        let end = it.tokens.last().map_or(0, |(_, last)| last.end);
        it.close(0, end, None);
        it
    }

    fn begin(&mut self, at: usize) {
        if let Some(open) = self.open.last_mut() {
            open.part.get_or_insert(at);
        }
    }

    /// Reads a bracket behind a name, which begins a call. Returns the kind that it must have.
    fn begin_call(&mut self, kind: SyntaxKind, index: usize) -> SyntaxKind {
        let at = self.tokens[index].1;
        if kind != SyntaxKind::LParen {
            self.edits.push((at, "(".into()));
            let (name, _) = self.shown(self.tokens[index - 1].1);
            let (found, span) = self.shown(at);
            let message = format!("expected `(` behind `{name}`, found `{found}`");
            self.wrong.push(Mistake { span, message, help: Help::edit("write `(`", span, "(") });
        }
        SyntaxKind::LParen
    }

    /// Reads the colon at `index`: what cannot have the name before it ends before that name.
    fn name(&mut self, index: usize) {
        let Some(&(name, named)) = index.checked_sub(1).map(|before| &self.tokens[before]) else {
            return;
        };
        let is_name = matches!(name, SyntaxKind::Ident | SyntaxKind::String);
        if is_name
            && self.open.last().is_some_and(|open| !open.takes(name))
            && let Some(place) = self.open.iter().rposition(|open| open.takes(name))
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

    /// Reads the closing bracket at `index`.
    fn end(&mut self, index: usize, opener: SyntaxKind) {
        let at = self.tokens[index].1;
        let Some(last) = self.open.len().checked_sub(1) else {
            return self.remove(at);
        };
        if self.open[last].kind == opener {
            self.open.pop();
            return;
        }
        // It closes an outer bracket, stands for another one, or is one too many: whatever agrees with what follows.
        let outer = self.open.iter().rposition(|open| open.kind == opener);
        let next = self.tokens.get(index + 1);
        let is_before_another = next.is_some_and(|(kind, _)| opener_of(*kind).is_some());
        let closes = outer.is_some_and(|outer| self.agrees(outer, index + 1));
        if !closes && (self.agrees(last, index + 1) || self.is_swapped(index, opener)) {
            self.replace(at);
        } else if !closes && self.agrees(last + 1, index + 1) {
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

    /// Returns true if the bracket at `index` and the one behind it close what is open in the other order.
    fn is_swapped(&self, index: usize, opener: SyntaxKind) -> bool {
        let [.., outer, last] = &self.open[..] else { return false };
        let next = self.tokens.get(index + 1).and_then(|(kind, _)| opener_of(*kind));
        let is_other_order = outer.kind == opener && next == Some(last.kind);
        is_other_order && self.agrees(self.open.len() - 2, index + 2)
    }

    /// Returns true if the text goes on from this token as it must where so many brackets are open.
    fn agrees(&self, mut open: usize, from: usize) -> bool {
        for (index, &(kind, _)) in self.tokens.iter().enumerate().skip(from) {
            let last = open.checked_sub(1).map(|last| &self.open[last]);
            let next = self.tokens.get(index + 1).map(|(kind, _)| *kind);
            match (kind, last) {
                (SyntaxKind::Comma, _) => {}
                (_, None) => return false,
                (_, Some(last)) if next == Some(SyntaxKind::Colon) => return last.takes(kind),
                (_, Some(last)) => match opener_of(kind) {
                    Some(opener) if opener == last.kind => open -= 1,
                    Some(_) => return false,
                    None => return last.kind != SyntaxKind::LBrace && !last.has_names,
                },
            }
        }
        open == 0
    }

    /// Closes the brackets from this one on, before what is found in the place of their own closing brackets.
    fn close(&mut self, from: usize, at: usize, found: Option<Span>) {
        let known = self.wrong.len();
        while from < self.open.len() {
            let Some(open) = self.open.pop() else { return };
            self.edits.push((Span { start: at, end: at }, open.closer().into()));
            // Entries of a map are what they are, wherever it ends.
            let part = self.open.last().and_then(|outer| outer.part);
            if open.kind != SyntaxKind::LBrace && self.open.len() > 1 {
                self.doubtful.push(Span { start: part.unwrap_or(open.at.start), end: at });
            }
            // A text that is cut off leaves all of them open.
            if found.is_none() && known < self.wrong.len() {
                continue;
            }
            let (opener, span) = self.shown(open.at);
            let message = match found.map(|found| self.shown(found)) {
                Some((found, at)) => {
                    let Place { line, column } = Place::of(self.text, at.start);
                    format!("this `{opener}` is not closed before the `{found}` at {line}:{column}")
                }
                None => format!("this `{opener}` is never closed"),
            };
            let help = closing(self.text, span, open.closer());
            self.wrong.push(Mistake { span, message, help });
        }
    }

    /// Puts the right bracket in the place of a wrong one.
    fn replace(&mut self, at: Span) {
        let Some(open) = self.open.pop() else { return };
        let closer = open.closer();
        self.edits.push((at, closer.into()));
        let ((opener, opened), (found, span)) = (self.shown(open.at), self.shown(at));
        let Place { line, column } = Place::of(self.text, opened.start);
        let message = format!(
            "expected `{closer}`, which closes the `{opener}` at {line}:{column}, found `{found}`"
        );
        let help = Help::edit(format!("write `{closer}`"), span, closer);
        self.wrong.push(Mistake { span, message, help });
    }

    /// Leaves out a bracket that closes nothing.
    fn remove(&mut self, at: Span) {
        self.edits.push((at, String::new()));
        let (found, span) = self.shown(at);
        let message = format!("this `{found}`{CLOSES_NOTHING}");
        let help = Help::edit(ONE_TOO_MANY, span, "");
        self.wrong.push(Mistake { span, message, help });
    }

    /// A piece of the repaired text, and its place in the text as it was.
    fn shown(&self, at: Span) -> (&'t str, Span) {
        (&self.repair.text[at.start..at.end], self.repair.place(at))
    }
}
