//! A value of a text as the parts that it is made of, each with what stands around it, and parts put together again.

use std::collections::BTreeSet;

use maquette_graph::meaning::plain;
use maquette_graph::tree::show;
use maquette_graph::{opened, parts as places};
use maquette_syntax::{Body, Kind, Token, Tree, tokens};

use super::notes::is_open;
use super::units::Plain;

/// A value, and the text in which it stands.
#[derive(Clone, Copy)]
pub(super) struct Value<'t> {
    pub(super) text: &'t str,
    pub(super) tree: &'t Tree,
    pub(super) means: &'t Means,
}

/// What parts of a text say beside their words.
pub(super) struct Means {
    /// Where the fields begin that would say the same if they were left out.
    pub(super) defaults: BTreeSet<usize>,
    /// What values with units say.
    pub(super) numbers: Plain,
}

impl<'t> Value<'t> {
    /// It as it is written.
    pub(super) fn written(self) -> &'t str {
        &self.text[self.tree.span.start..self.tree.span.end]
    }

    /// Whether both say the same.
    pub(super) fn says(self, other: Self) -> bool {
        self.said() == other.said()
    }

    /// What it says, in plain numbers, and without values that would be the same if they were left out.
    fn said(self) -> Tree {
        let mut tree = self.tree.clone();
        self.means.of(&mut tree);
        plain(&tree)
    }

    /// The items of a list or a tuple.
    fn items(self) -> Option<&'t [Tree]> {
        match &self.tree.kind {
            Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => Some(items),
            _ => None,
        }
    }

    /// What each item of a list or a tuple says.
    pub(super) fn said_by_items(self) -> Option<Vec<String>> {
        Some(self.items()?.iter().map(|item| show(&Self { tree: item, ..self }.said())).collect())
    }
}

impl Means {
    fn of(&self, tree: &mut Tree) {
        if let Some(plain) = self.numbers.get(&tree.span.start)
            && matches!(tree.kind, Kind::Call { .. })
        {
            *tree = plain.clone();
        }
        match &mut tree.kind {
            Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
                items.iter_mut().for_each(|item| self.of(item));
            }
            Kind::Call { body: Body::Fields(fields), .. } => {
                fields.retain(|field| !self.defaults.contains(&field.name.span.start));
                fields.iter_mut().for_each(|field| self.of(&mut field.value));
            }
            Kind::Map(entries) => entries.iter_mut().for_each(|(_, value)| self.of(value)),
            _ => {}
        }
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
    pub behind: Behind<'t>,
    /// Whether it would say the same if it were left out.
    pub(super) is_default: bool,
}

impl Part<'_> {
    /// It as it is written.
    pub(super) fn piece(&self) -> Piece {
        Piece {
            before: self.before.to_owned(),
            own: format!("{}{}", self.name, self.value.written()),
            comma: self.behind.comma.to_owned(),
            line: self.behind.line.to_owned(),
        }
    }
}

/// What belongs to a part behind it: what stands before its comma, and the comment on its line.
#[derive(Clone, Copy, Default)]
pub(super) struct Behind<'t> {
    pub(super) comma: &'t str,
    pub(super) line: &'t str,
}

/// A value that is made of parts.
pub(super) struct Parts<'t> {
    /// The text up to and with the bracket.
    pub(super) open: &'t str,
    pub(super) all: Vec<(String, Part<'t>)>,
    /// The text behind the last part, with the bracket.
    pub(super) close: &'t str,
    /// Whether a comma follows the last part.
    pub(super) comma: bool,
}

impl<'t> Parts<'t> {
    /// The parts of a map or of a call with fields, whose names are all different; with `lists`, of a list by what its items say.
    pub(super) fn of(value: Value<'t>, lists: bool) -> Option<Self> {
        let named: Vec<(String, &Tree)> = match &value.tree.kind {
            Kind::Map(entries) => entries
                .iter()
                .map(|(key, value)| Some((key.text()?.to_owned(), value)))
                .collect::<Option<_>>()?,
            Kind::Call { body: Body::Fields(fields), .. } => {
                fields.iter().map(|field| (field.name.text.clone(), &field.value)).collect()
            }
            Kind::Call { body: Body::Empty, .. } => Vec::new(),
            Kind::List(items) if lists => {
                items.iter().map(|item| (show(&plain(item)), item)).collect()
            }
            _ => return None,
        };
        if named
            .iter()
            .enumerate()
            .any(|(k, (name, _))| named[..k].iter().any(|(before, _)| before == name))
        {
            return None;
        }
        Some(Self::named(value, named))
    }

    /// The items of a list or a tuple, under these names.
    pub(super) fn numbered(value: Value<'t>, names: Vec<String>) -> Option<Self> {
        let items = value.items()?;
        Some(Self::named(value, names.into_iter().zip(items).collect()))
    }

    fn named(value: Value<'t>, named: Vec<(String, &'t Tree)>) -> Self {
        let Value { text, tree, means } = value;
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
            let is_default = !name.is_empty() && means.defaults.contains(&place.start);
            let value = Value { text, tree: value, means };
            all.push((key, Part { before, name, value, behind: Behind::default(), is_default }));
            at = place.end;
        }
        let rest = before.len() + 1;
        let close = &text[tree.span.end - rest..tree.span.end];
        Self { open: &text[tree.span.start..start], all, close, comma }
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

/// Parts put together between `open` and `close`, as the value that they were made of stands on one line or on several.
pub(super) fn put_together(
    parts: &Parts<'_>,
    (open, close): &(String, String),
    pieces: &[Merged],
) -> String {
    let mut writer = Writer { text: open.clone(), must_end: is_open(open) };
    let first = parts.all.first().map_or("", |(_, part)| part.before);
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
                writer.put(before);
                writer.put(&piece.own);
                writer.put(&piece.comma);
                if !is_last || parts.comma {
                    writer.put(",");
                }
                writer.put(&piece.line);
            }
            Merged::Conflict(ours, theirs) => {
                let before = ours.as_ref().or(theirs.as_ref()).map_or("", |piece| &piece.before);
                let (above, indent) = before.rsplit_once('\n').unwrap_or(("", before));
                fn side(piece: &Option<Piece>, indent: &str) -> String {
                    match piece {
                        Some(Piece { own, comma, line, .. }) => {
                            let end = if is_open(comma) { "\n" } else { "" };
                            format!("{indent}{own}{comma}{end},{line}\n")
                        }
                        None => String::new(),
                    }
                }
                let (ours, theirs) = (side(ours, indent), side(theirs, indent));
                writer.put(above);
                writer.text += &format!("\n<<<<<<< ours\n{ours}=======\n{theirs}>>>>>>> theirs");
                writer.must_end = true;
            }
        }
    }
    writer.put(close);
    writer.text
}

/// Writes a text piece by piece. Behind a comment that runs to the end of its line, and behind a mark, comes a new line.
struct Writer {
    text: String,
    must_end: bool,
}

impl Writer {
    fn put(&mut self, piece: &str) {
        if piece.is_empty() {
            return;
        }
        if self.must_end && !piece.starts_with(['\n', '\r']) {
            self.text.push('\n');
        }
        self.text += piece;
        self.must_end = is_open(piece);
    }
}
