//! Splits the text of a value, such as a list, into the texts of its parts, each with the white space around it. Also builds the text of a
//! value from such parts.

use std::collections::BTreeSet;

use maquette_graph::canonical::canonical_value;
use maquette_graph::tree::show;
use maquette_graph::{content_start, parts as places};
use maquette_syntax::{Body, Kind, Token, Tree, tokens};

use super::comments::ends_in_line_comment;
use super::units::PlainNumbers;

/// A value, together with the whole text of the file that contains it.
#[derive(Clone, Copy)]
pub(super) struct Value<'t> {
    pub(super) text: &'t str,
    pub(super) tree: &'t Tree,
    pub(super) interpretation: &'t Interpretation,
}

/// Data about the values in a text that the tokens of the text do not show.
pub(super) struct Interpretation {
    /// The byte offsets of the fields whose values equal their defaults.
    pub(super) defaults: BTreeSet<usize>,
    /// Values with units, converted to plain numbers, by their byte offsets.
    pub(super) numbers: PlainNumbers,
}

impl<'t> Value<'t> {
    /// Returns the part of the text that is the value.
    pub(super) fn source_text(self) -> &'t str {
        &self.text[self.tree.span.start..self.tree.span.end]
    }

    /// Returns true if both values have the same meaning.
    pub(super) fn means_same(self, other: Self) -> bool {
        self.normal_form() == other.normal_form()
    }

    /// Returns the value in a form for comparison: with plain numbers, and without fields that equal their defaults.
    fn normal_form(self) -> Tree {
        let mut tree = self.tree.clone();
        self.interpretation.normalize(&mut tree);
        canonical_value(&tree)
    }

    /// Returns the items of a list or a tuple.
    fn items(self) -> Option<&'t [Tree]> {
        match &self.tree.kind {
            Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => Some(items),
            _ => None,
        }
    }

    /// Returns the normalized text of each item of a list or a tuple.
    pub(super) fn normalized_items(self) -> Option<Vec<String>> {
        Some(
            self.items()?
                .iter()
                .map(|item| show(&Self { tree: item, ..self }.normal_form()))
                .collect(),
        )
    }
}

impl Interpretation {
    fn normalize(&self, tree: &mut Tree) {
        if let Some(plain) = self.numbers.get(&tree.span.start)
            && matches!(tree.kind, Kind::Call { .. })
        {
            *tree = plain.clone();
        }
        match &mut tree.kind {
            Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
                items.iter_mut().for_each(|item| self.normalize(item));
            }
            Kind::Call { body: Body::Fields(fields), .. } => {
                fields.retain(|field| !self.defaults.contains(&field.name.span.start));
                fields.iter_mut().for_each(|field| self.normalize(&mut field.value));
            }
            Kind::Map(entries) => entries.iter_mut().for_each(|(_, value)| self.normalize(value)),
            _ => {}
        }
    }
}

/// A part of a value: a field of a call, an entry of a map or an item of a list.
#[derive(Clone, Copy)]
pub(super) struct Part<'t> {
    /// The spaces and comments before the part.
    pub(super) before: &'t str,
    /// The name of the part and its colon. Empty for an item.
    pub(super) name: &'t str,
    pub(super) value: Value<'t>,
    pub trailing: Trailing<'t>,
    /// True if the value of the part equals its default.
    pub(super) is_default: bool,
}

impl Part<'_> {
    /// Returns the text of the part, ready to be written into the merged value.
    pub(super) fn piece(&self) -> Piece {
        Piece {
            before: self.before.to_owned(),
            own: format!("{}{}", self.name, self.value.source_text()),
            comma: self.trailing.comma.to_owned(),
            line: self.trailing.line.to_owned(),
        }
    }
}

/// The text that follows a part and belongs to it: the text before its comma, and the comment on the same line.
#[derive(Clone, Copy, Default)]
pub(super) struct Trailing<'t> {
    pub(super) comma: &'t str,
    pub(super) line: &'t str,
}

/// A value that is split into its parts.
pub(super) struct Parts<'t> {
    /// The text up to and including the opening bracket.
    pub(super) open: &'t str,
    pub(super) all: Vec<(String, Part<'t>)>,
    /// The text after the last part, up to and including the closing bracket.
    pub(super) close: &'t str,
    /// True if a comma follows the last part of the value.
    pub(super) comma: bool,
}

impl<'t> Parts<'t> {
    /// Splits a map or a call with fields. Returns `None` if a name occurs twice. If `lists` is set, also splits a list, using the
    /// canonical text of each item as its name.
    pub(super) fn read(value: Value<'t>, lists: bool) -> Option<Self> {
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
                items.iter().map(|item| (show(&canonical_value(item)), item)).collect()
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
        Some(Self::from_entries(value, named))
    }

    /// Splits a list or a tuple, using `names` as the names of its items.
    pub(super) fn from_items(value: Value<'t>, names: Vec<String>) -> Option<Self> {
        let items = value.items()?;
        Some(Self::from_entries(value, names.into_iter().zip(items).collect()))
    }

    fn from_entries(value: Value<'t>, named: Vec<(String, &'t Tree)>) -> Self {
        let Value { text, tree, interpretation: means } = value;
        let start = content_start(text, tree.span);
        let (mut at, mut comma, mut before) = (start, false, "");
        let mut all: Vec<(String, Part<'_>)> = Vec::with_capacity(named.len());
        let ends = places(tree).into_iter().map(Some).chain([None]);
        let mut named = named.into_iter();
        for place in ends {
            let end = place.map_or(tree.span.end - 1, |place| place.start);
            let gap = &text[at..end];
            match all.last_mut() {
                Some((_, part)) => {
                    let Gap { trailing: behind, rest, has_comma } = Gap::parse(gap);
                    (part.trailing, before, comma) = (behind, rest, has_comma);
                }
                None => before = gap,
            }
            let (Some(place), Some((key, value))) = (place, named.next()) else { break };
            let name = &text[place.start..value.span.start];
            let is_default = !name.is_empty() && means.defaults.contains(&place.start);
            let value = Value { text, tree: value, interpretation: means };
            all.push((
                key,
                Part { before, name, value, trailing: Trailing::default(), is_default },
            ));
            at = place.end;
        }
        let rest = before.len() + 1;
        let close = &text[tree.span.end - rest..tree.span.end];
        Self { open: &text[tree.span.start..start], all, close, comma }
    }

    /// Returns true if this value has a part of the same name for each part of `other`.
    pub(super) fn has_all(&self, other: &Parts<'_>) -> bool {
        other.all.iter().all(|(key, _)| self.get(key).is_some())
    }

    pub(super) fn get(&self, key: &str) -> Option<Part<'t>> {
        self.all.iter().find(|(known, _)| known == key).map(|(_, part)| *part)
    }
}

/// The text between two parts of a value.
struct Gap<'t> {
    trailing: Trailing<'t>,
    rest: &'t str,
    has_comma: bool,
}

impl<'t> Gap<'t> {
    fn parse(gap: &'t str) -> Self {
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
            Trailing { comma: &gap[..comma.unwrap_or(0)], line: &gap[start..line.max(start)] };
        Self { trailing: behind, rest: &gap[line.max(start)..], has_comma: comma.is_some() }
    }
}

/// The text of a part, to be written into the merged value.
#[derive(Clone)]
pub(super) struct Piece {
    pub(super) before: String,
    pub(super) own: String,
    pub(super) comma: String,
    pub(super) line: String,
}

/// A merged part, or the versions of both sides if they conflict. A version is `None` if that side has removed the part.
pub(super) enum MergedPart {
    Piece(Piece),
    Conflict(Option<Piece>, Option<Piece>),
}

/// Writes parts between the brackets `open` and `close`, in the layout of the original value: on one line or on several lines.
pub(super) fn join_parts(
    parts: &Parts<'_>,
    (open, close): &(String, String),
    pieces: &[MergedPart],
) -> String {
    let mut writer = Writer { text: open.clone(), must_end: ends_in_line_comment(open) };
    let first = parts.all.first().map_or("", |(_, part)| part.before);
    for (index, piece) in pieces.iter().enumerate() {
        let is_last = index + 1 == pieces.len();
        match piece {
            MergedPart::Piece(piece) => {
                let is_plain = piece.before.trim().is_empty() && !piece.before.contains('\n');
                let before = match (is_plain, index) {
                    (true, 0) if !first.contains('\n') => first,
                    (true, 1..) => " ",
                    _ => &piece.before,
                };
                writer.push(before);
                writer.push(&piece.own);
                writer.push(&piece.comma);
                if !is_last || parts.comma {
                    writer.push(",");
                }
                writer.push(&piece.line);
            }
            MergedPart::Conflict(ours, theirs) => {
                let before = ours.as_ref().or(theirs.as_ref()).map_or("", |piece| &piece.before);
                let (above, indent) = before.rsplit_once('\n').unwrap_or(("", before));
                fn conflict_side(piece: &Option<Piece>, indent: &str) -> String {
                    match piece {
                        Some(Piece { own, comma, line, .. }) => {
                            let end = if ends_in_line_comment(comma) { "\n" } else { "" };
                            format!("{indent}{own}{comma}{end},{line}\n")
                        }
                        None => String::new(),
                    }
                }
                let (ours, theirs) = (conflict_side(ours, indent), conflict_side(theirs, indent));
                writer.push(above);
                writer.text += &format!("\n<<<<<<< ours\n{ours}=======\n{theirs}>>>>>>> theirs");
                writer.must_end = true;
            }
        }
    }
    writer.push(close);
    writer.text
}

/// Writes the merged text piece by piece. Writes a line break after each line comment and each conflict marker.
struct Writer {
    text: String,
    must_end: bool,
}

impl Writer {
    fn push(&mut self, piece: &str) {
        if piece.is_empty() {
            return;
        }
        if self.must_end && !piece.starts_with(['\n', '\r']) {
            self.text.push('\n');
        }
        self.text += piece;
        self.must_end = ends_in_line_comment(piece);
    }
}
