//! Three texts of one value: what two people made of a third, as one.

use std::collections::BTreeSet;

use super::parts::{Merged, Part, Parts, Piece, Value, put_together};
use crate::text::{Token, tokens};

/// What both made of a value. Both texts are the same if they agree.
pub(super) struct Both {
    pub(super) ours: String,
    pub(super) theirs: String,
}

impl Both {
    fn agreed(text: &str) -> Self {
        Self { ours: text.to_owned(), theirs: text.to_owned() }
    }
}

/// What both renamed, differently.
pub(super) struct RenamedTwice {
    pub(super) section: &'static str,
    pub(super) old: String,
    /// Their name, which it has in all texts now.
    pub(super) theirs: String,
    pub(super) ours: String,
}

/// Puts two people's versions of a value together.
pub(super) struct Merger<'r> {
    pub(super) renamed_twice: &'r [RenamedTwice],
    /// Where they do not agree: `nodes.red.select.distance`.
    pub(super) conflicts: Vec<String>,
}

/// Where a value stands.
#[derive(Clone, Copy)]
struct Place<'p> {
    path: &'p str,
    /// Whether conflicts are marked around its parts, not around what it is a part of.
    marks: bool,
    /// How far it is from the whole.
    depth: usize,
}

/// The value before, in our text, and in theirs.
#[derive(Clone, Copy)]
struct Three<'t> {
    base: Option<Value<'t>>,
    ours: Value<'t>,
    theirs: Value<'t>,
}

impl Merger<'_> {
    /// The whole of three texts.
    pub(super) fn whole(&mut self, base: Value<'_>, ours: Value<'_>, theirs: Value<'_>) -> String {
        let three = Three { base: Some(base), ours, theirs };
        let place = Place { path: "", marks: true, depth: 0 };
        let Both { ours: left, theirs: right } = self.value(three, place);
        match left == right {
            true => left,
            // Not even what they are is the same.
            false => format!("<<<<<<< ours\n{left}\n=======\n{right}\n>>>>>>> theirs"),
        }
    }

    fn value(&mut self, three: Three<'_>, place: Place<'_>) -> Both {
        let Three { base, ours, theirs } = three;
        let (left, right) = (ours.written(), theirs.written());
        let before = base.map(Value::written);
        // All texts are alike where both have another name for the same.
        let is_around = |it: &RenamedTwice| {
            place.path.is_empty() || place.depth == 1 && place.path == it.section
        };
        if self.renamed_twice.iter().any(is_around)
            && let Some(merged) = self.parts(three, place)
        {
            return merged;
        }
        if left == right || before == Some(right) {
            return Both::agreed(left);
        }
        if before == Some(left) {
            return Both::agreed(right);
        }
        if let Some(merged) = self.parts(three, place) {
            return merged;
        }
        let says = |value: Value<'_>| base.is_some_and(|base| base.says(value));
        if ours.says(theirs) || says(theirs) {
            return Both::agreed(left);
        }
        if says(ours) {
            return Both::agreed(right);
        }
        self.conflicts.push(place.path.to_owned());
        Both { ours: left.to_owned(), theirs: right.to_owned() }
    }

    /// The same part by part, if all are made of parts with names.
    fn parts(&mut self, three: Three<'_>, place: Place<'_>) -> Option<Both> {
        let name = |value: Value<'_>| value.tree.name().map(|name| name.text);
        if name(three.ours) != name(three.theirs) {
            return None;
        }
        // What is expected hangs on no order.
        let lists = place.path == "expect";
        let (ours, theirs) = (Parts::of(three.ours, lists)?, Parts::of(three.theirs, lists)?);
        let like_ours = |value: &Value<'_>| {
            name(*value) == name(three.ours)
                && std::mem::discriminant(&value.tree.kind)
                    == std::mem::discriminant(&three.ours.tree.kind)
        };
        let base = three.base.filter(like_ours).and_then(|base| Parts::of(base, lists));
        let base = base.as_ref();
        if lists {
            let lacks = |parts: &Parts<'_>| {
                base.is_some_and(|base| base.all.iter().any(|(key, _)| parts.get(key).is_none()))
            };
            if lacks(&ours) && lacks(&theirs) {
                return None;
            }
        }
        let (mut left, mut right, mut marked) = (Vec::new(), Vec::new(), Vec::new());
        for key in order(base, &ours, &theirs) {
            let before = base.and_then(|base| base.get(&key));
            let known = self.conflicts.len();
            let path = match place.path {
                "" => key.clone(),
                path => format!("{path}.{key}"),
            };
            // The entries of the sections of a graph are marked, and the other fields of it.
            let inside = Place { path: &path, marks: place.depth == 0, depth: place.depth + 1 };
            let sides = (ours.get(&key), theirs.get(&key));
            let (mine, other) = self.part(before, sides, inside);
            let mine = self.by_our_name(&place, &key, mine);
            let is_open = self.conflicts.len() > known;
            let is_section = place.depth == 0 && mine.as_ref().is_some_and(|it| is_marked(&it.own));
            left.extend(mine.clone().map(Merged::Piece));
            right.extend(other.clone().map(Merged::Piece));
            marked.extend(match (place.marks && is_open && !is_section, mine) {
                (true, mine) => Some(Merged::Conflict(mine, other)),
                (false, mine) => mine.map(Merged::Piece),
            });
        }
        if place.marks {
            return Some(Both::agreed(&put_together(&ours, &marked)));
        }
        Some(Both { ours: put_together(&ours, &left), theirs: put_together(&ours, &right) })
    }

    /// A part that both gave another name, under ours.
    fn by_our_name(&mut self, place: &Place<'_>, key: &str, mine: Option<Piece>) -> Option<Piece> {
        let twice = self
            .renamed_twice
            .iter()
            .find(|twice| place.depth == 1 && place.path == twice.section && twice.theirs == key);
        let (Some(RenamedTwice { section, old, theirs, ours }), Some(mine)) = (twice, &mine) else {
            return mine;
        };
        self.conflicts.push(format!("{section}.{old}"));
        let own = mine.own.replacen(&format!("\"{theirs}\""), &format!("\"{ours}\""), 1);
        Some(Piece { own, ..mine.clone() })
    }

    /// What becomes of a part on both sides; nothing if it goes.
    fn part(
        &mut self,
        base: Option<Part<'_>>,
        sides: (Option<Part<'_>>, Option<Part<'_>>),
        place: Place<'_>,
    ) -> (Option<Piece>, Option<Piece>) {
        match sides {
            (Some(ours), Some(theirs)) => {
                let three =
                    Three { base: base.map(|it| it.value), ours: ours.value, theirs: theirs.value };
                let Both { ours: left, theirs: right } = self.value(three, place);
                let around = |of: fn(&Part<'_>) -> String| {
                    let before = base.as_ref().map(of).unwrap_or_default();
                    comments(&before, &of(&ours), &of(&theirs))
                };
                let piece = Piece {
                    before: around(|part| part.before.to_owned()),
                    own: format!("{}{left}", ours.name),
                    comma: ours.behind.comma.to_owned(),
                    line: around(|part| part.behind.line.to_owned()),
                };
                let theirs = Piece { own: format!("{}{right}", ours.name), ..piece.clone() };
                (Some(piece), Some(theirs))
            }
            (Some(only), None) | (None, Some(only)) => {
                let piece = Some(Piece {
                    before: only.before.to_owned(),
                    own: format!("{}{}", only.name, only.value.written()),
                    comma: only.behind.comma.to_owned(),
                    line: only.behind.line.to_owned(),
                });
                match base {
                    // One of them added it.
                    None => (piece.clone(), piece),
                    // One of them took it away, and the other one left it as it was.
                    Some(base) if base.value.says(only.value) => (None, None),
                    Some(_) => {
                        self.conflicts.push(place.path.to_owned());
                        if sides.0.is_some() { (piece, None) } else { (None, piece) }
                    }
                }
            }
            (None, None) => (None, None),
        }
    }
}

/// Whether conflicts are marked in a text.
fn is_marked(text: &str) -> bool {
    text.contains("\n<<<<<<< ours\n")
}

/// The names of all parts: in our order, and what they added behind what it stands behind there.
fn order(base: Option<&Parts<'_>>, ours: &Parts<'_>, theirs: &Parts<'_>) -> Vec<String> {
    let mut order = Vec::from_iter(ours.all.iter().map(|(key, _)| key.clone()));
    let mut before: Option<&String> = None;
    for (key, _) in &theirs.all {
        if !order.contains(key) {
            let place = before.and_then(|before| order.iter().position(|known| known == before));
            order.insert(place.map_or(0, |place| place + 1), key.clone());
        }
        before = Some(key);
    }
    let gone = base.into_iter().flat_map(|base| &base.all).map(|(key, _)| key);
    let known = BTreeSet::from_iter(order.iter().cloned());
    order.extend(gone.filter(|key| !known.contains(*key)).cloned());
    order
}

/// Space and comments of three texts: those of the side that changed them; if both did, our text with their new comments.
pub(super) fn comments(base: &str, ours: &str, theirs: &str) -> String {
    if ours == theirs || theirs == base || ours.trim() == theirs.trim() && ours != base {
        return ours.to_owned();
    }
    if ours == base {
        return theirs.to_owned();
    }
    let all = |text: &str| {
        let pieces = tokens(text).into_iter();
        let comments =
            pieces.filter(|(kind, _)| matches!(kind, Token::LineComment | Token::BlockComment));
        let comments = comments.map(|(_, span)| text[span.start..span.end].trim().to_owned());
        Vec::from_iter(comments)
    };
    let known = [all(base), all(ours)].concat();
    let new = all(theirs).into_iter().filter(|comment| !known.contains(comment));
    match ours.rsplit_once('\n') {
        Some((above, indent)) => {
            let new = new.map(|comment| format!("\n{indent}{comment}"));
            format!("{above}{}\n{indent}", String::from_iter(new))
        }
        None => ours.to_owned() + &String::from_iter(new.map(|comment| format!(" {comment}"))),
    }
}
