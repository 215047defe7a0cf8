//! A value of a text as the parts that it is made of, each with what stands around it, and parts put together again.

use crate::graph::edit::{opened, parts as places};
use crate::graph::meaning::{plain, show};
use crate::text::{Body, Kind, Token, Tree, tokens};

/// A value, and the text in which it stands.
#[derive(Clone, Copy)]
pub(super) struct Value<'t> {
    pub(super) text: &'t str,
    pub(super) tree: &'t Tree,
}

impl<'t> Value<'t> {
    /// It as it is written.
    pub(super) fn written(self) -> &'t str {
        &self.text[self.tree.span.start..self.tree.span.end]
    }

    /// Whether both say the same.
    pub(super) fn says(self, other: Self) -> bool {
        plain(self.tree) == plain(other.tree)
    }
}

/// A field or an entry of a value, or an item of a list.
#[derive(Clone, Copy)]
pub(super) struct Part<'t> {
    /// What stands before it: space and comments.
    pub(super) before: &'t str,
    /// Its name with the colon; empty for an item.
    pub(super) name: &'t str,
    pub(super) value: Value<'t>,
    pub(super) behind: Behind<'t>,
}

/// What belongs to a part behind it: what stands before its comma, and the comment on its line.
#[derive(Clone, Copy, Default)]
pub(super) struct Behind<'t> {
    pub(super) comma: &'t str,
    pub(super) line: &'t str,
}

/// A value that is made of parts with names.
pub(super) struct Parts<'t> {
    /// The text up to and with the bracket.
    pub(super) open: &'t str,
    pub(super) all: Vec<(String, Part<'t>)>,
    /// The text behind the last part.
    pub(super) close: &'t str,
    /// Whether a comma follows the last part.
    pub(super) comma: bool,
}

impl<'t> Parts<'t> {
    /// The parts of a map or of a call with fields, whose names are all different; of a list, by what its items say.
    pub(super) fn of(value: Value<'t>, lists: bool) -> Option<Self> {
        let Value { text, tree } = value;
        let named: Vec<(String, &Tree)> = match &tree.kind {
            Kind::Map(entries) => {
                let entry = |(key, value): &'t (Tree, Tree)| Some((key.text()?.to_owned(), value));
                entries.iter().map(entry).collect::<Option<_>>()?
            }
            Kind::Call { body: Body::Fields(fields), .. } => {
                fields.iter().map(|field| (field.name.text.clone(), &field.value)).collect()
            }
            Kind::Call { body: Body::Empty, .. } => Vec::new(),
            Kind::List(items) if lists => {
                items.iter().map(|item| (show(&plain(item)), item)).collect()
            }
            _ => return None,
        };
        let is_twice = |(k, (name, _)): (usize, &(String, &Tree))| {
            named[..k].iter().any(|(before, _)| before == name)
        };
        if named.iter().enumerate().any(is_twice) {
            return None;
        }
        let start = opened(text, tree.span);
        let (mut at, mut comma, mut before) = (start, false, "");
        let mut all: Vec<(String, Part<'_>)> = Vec::with_capacity(named.len());
        let ends = places(tree).into_iter().map(Some).chain([None]);
        let mut named = named.into_iter();
        for place in ends {
            let end = place.map_or(tree.span.end - 1, |place| place.start);
            let gap = &text[at..end];
            match all.last_mut() {
                Some((_, part)) => {
                    let Gap { behind, rest, has_comma } = Gap::of(gap);
                    (part.behind, before, comma) = (behind, rest, has_comma);
                }
                None => before = gap,
            }
            let (Some(place), Some((key, value))) = (place, named.next()) else { break };
            let name = &text[place.start..value.span.start];
            let value = Value { text, tree: value };
            all.push((key, Part { before, name, value, behind: Behind::default() }));
            at = place.end;
        }
        let rest = before.len() + 1;
        let close = &text[tree.span.end - rest..tree.span.end];
        Some(Self { open: &text[tree.span.start..start], all, close, comma })
    }

    pub(super) fn get(&self, key: &str) -> Option<Part<'t>> {
        self.all.iter().find(|(known, _)| known == key).map(|(_, part)| *part)
    }
}

/// What stands between two parts.
struct Gap<'t> {
    behind: Behind<'t>,
    rest: &'t str,
    has_comma: bool,
}

impl<'t> Gap<'t> {
    fn of(gap: &'t str) -> Self {
        let (mut comma, mut line) = (None, 0);
        for (token, span) in tokens(gap) {
            match token {
                Token::Comma if comma.is_none() => (comma, line) = (Some(span.start), span.end),
                Token::Space if gap[span.start..span.end].contains('\n') && comma.is_some() => {
                    break;
                }
                Token::LineComment | Token::BlockComment => {
                    let is_same_line = !gap[line..span.start].contains('\n');
                    if is_same_line {
                        line = span.start + gap[span.start..span.end].trim_end().len();
                    }
                }
                _ => {}
            }
        }
        let start = comma.map_or(0, |comma| comma + 1);
        let behind =
            Behind { comma: &gap[..comma.unwrap_or(0)], line: &gap[start..line.max(start)] };
        Self { behind, rest: &gap[line.max(start)..], has_comma: comma.is_some() }
    }
}

/// A part as it will be written.
#[derive(Clone)]
pub(super) struct Piece {
    pub(super) before: String,
    pub(super) own: String,
    pub(super) comma: String,
    pub(super) line: String,
}

/// A part, or what both sides make of it if they do not agree.
pub(super) enum Merged {
    Piece(Piece),
    Conflict(Option<Piece>, Option<Piece>),
}

/// Parts put together, as the value that they were made of stands on one line or on several.
pub(super) fn put_together(parts: &Parts<'_>, pieces: &[Merged]) -> String {
    let mut text = parts.open.to_owned();
    let first = parts.all.first().map_or("", |(_, part)| part.before);
    let mut on_new_line = false;
    for (index, piece) in pieces.iter().enumerate() {
        let is_last = index + 1 == pieces.len();
        match piece {
            Merged::Piece(piece) => {
                let is_plain = piece.before.trim().is_empty() && !piece.before.contains('\n');
                let before = match (is_plain, index) {
                    (true, 0) if !first.contains('\n') => first,
                    (true, 1..) => " ",
                    _ => &piece.before,
                };
                if on_new_line && !before.starts_with(['\n', '\r']) {
                    text.push('\n');
                }
                text += before;
                text += &piece.own;
                text += &piece.comma;
                if !is_last || parts.comma {
                    text.push(',');
                }
                text += &piece.line;
                on_new_line = false;
            }
            Merged::Conflict(ours, theirs) => {
                let before = ours.as_ref().or(theirs.as_ref()).map_or("", |piece| &piece.before);
                let (above, indent) = before.rsplit_once('\n').unwrap_or(("", before));
                let side = |piece: &Option<Piece>| match piece {
                    Some(Piece { own, comma, line, .. }) => {
                        format!("{indent}{own}{comma},{line}\n")
                    }
                    None => String::new(),
                };
                let (ours, theirs) = (side(ours), side(theirs));
                text += &format!("{above}\n<<<<<<< ours\n{ours}=======\n{theirs}>>>>>>> theirs");
                on_new_line = true;
            }
        }
    }
    if on_new_line && !parts.close.starts_with(['\n', '\r']) {
        text.push('\n');
    }
    text + parts.close
}
