//! Three texts of one value: what two people made of a third, as one.

use std::collections::BTreeSet;

use super::align::paired;
use super::notes::{around, comments};
use super::parts::{Merged, Part, Parts, Piece, Value, put_together};

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
    /// Entries that are not put together even where that could be done: `nodes.red`.
    pub(super) kept_apart: &'r BTreeSet<String>,
    /// The comments of the text that both began with.
    pub(super) known: BTreeSet<&'r str>,
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
        // All texts may be alike around what is marked all the same.
        let is_around =
            |section: &str| place.path.is_empty() || place.depth == 1 && place.path == section;
        if (self.renamed_twice.iter().any(|it| is_around(it.section))
            || self.kept_apart.iter().any(|entry| entry.split('.').next().is_some_and(is_around)))
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
        let (by_us, by_them) = (!says(ours), !says(theirs));
        let is_agreed = ours.says(theirs) || !by_us || !by_them;
        if is_agreed {
            if let Some(merged) = self.items(three, by_us, by_them, place) {
                return merged;
            }
            let (kept, gone) = if by_us || !by_them { (left, right) } else { (right, left) };
            if !self.has_news(gone) {
                return Both::agreed(kept);
            }
        }
        self.conflicts.push(place.path.to_owned());
        Both { ours: left.to_owned(), theirs: right.to_owned() }
    }

    /// Whether a text has a comment that was not there before.
    fn has_news(&self, text: &str) -> bool {
        comments(text).iter().any(|comment| !self.known.contains(comment))
    }

    /// The same part by part, if all are made of parts with names.
    fn parts(&mut self, three: Three<'_>, place: Place<'_>) -> Option<Both> {
        if name(three.ours) != name(three.theirs) {
            return None;
        }
        // What is expected hangs on no order.
        let is_changed = |side: Value<'_>| three.base.is_none_or(|base| !base.says(side));
        let lists = place.path == "expect" && is_changed(three.ours) && is_changed(three.theirs);
        let (ours, theirs) = (Parts::of(three.ours, lists)?, Parts::of(three.theirs, lists)?);
        let base = three.base.filter(|base| is_like(*base, three.ours));
        let base = base.and_then(|base| Parts::of(base, lists));
        let base = base.as_ref();
        if lists {
            let lacks = |parts: &Parts<'_>| {
                base.is_some_and(|base| base.all.iter().any(|(key, _)| parts.get(key).is_none()))
            };
            if lacks(&ours) && lacks(&theirs) {
                return None;
            }
        }
        Some(self.all_parts(base, &ours, &theirs, place))
    }

    /// The same item by item, of lists or tuples of which at most one says something else than before, or both the same.
    fn items(
        &mut self,
        three: Three<'_>,
        by_us: bool,
        by_them: bool,
        place: Place<'_>,
    ) -> Option<Both> {
        if name(three.ours) != name(three.theirs) || !is_like(three.theirs, three.ours) {
            return None;
        }
        let base = three.base.filter(|base| is_like(*base, three.ours));
        let before = base.and_then(Value::said_by_items);
        let (before, count) = match &before {
            Some(before) => (&before[..], before.len()),
            None => (&[][..], 0),
        };
        let numbers = |value: Value<'_>, is_changed: bool| {
            let said = value.said_by_items()?;
            let places = match is_changed {
                true => paired(before, &said),
                false => (0..said.len()).map(Some).collect(),
            };
            // What both added is the same.
            let number =
                |(k, place): (usize, Option<usize>)| place.unwrap_or(count + k).to_string();
            Some(places.into_iter().enumerate().map(number).collect::<Vec<_>>())
        };
        let ours = Parts::numbered(three.ours, numbers(three.ours, by_us)?)?;
        let theirs = Parts::numbered(three.theirs, numbers(three.theirs, by_them)?)?;
        let base = base.and_then(|base| Parts::numbered(base, numbers(base, false)?));
        Some(self.all_parts(base.as_ref(), &ours, &theirs, place))
    }

    /// What becomes of all parts, put together.
    fn all_parts(
        &mut self,
        base: Option<&Parts<'_>>,
        ours: &Parts<'_>,
        theirs: &Parts<'_>,
        place: Place<'_>,
    ) -> Both {
        let (mut left, mut right, mut marked) = (Vec::new(), Vec::new(), Vec::new());
        for key in order(base, ours, theirs) {
            let before = base.and_then(|base| base.get(&key));
            let known = self.conflicts.len();
            let path = match place.path {
                "" => key.clone(),
                path => format!("{path}.{key}"),
            };
            // The entries of the sections of a graph are marked, and the other fields of it.
            let inside = Place { path: &path, marks: place.depth == 0, depth: place.depth + 1 };
            let sides = (ours.get(&key), theirs.get(&key));
            let is_kept_apart = inside.depth == 2 && self.kept_apart.contains(&path);
            let (mine, other) = match is_kept_apart {
                true => {
                    self.conflicts.push(path.clone());
                    (sides.0.map(|part| part.piece()), sides.1.map(|part| part.piece()))
                }
                false => self.part(before, sides, inside),
            };
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
        let close = around(base.map_or("", |base| base.close), ours.close, theirs.close);
        let ends = (around(base.map_or("", |base| base.open), ours.open, theirs.open), close);
        if place.marks {
            return Both::agreed(&put_together(ours, &ends, &marked));
        }
        let (left, right) = (put_together(ours, &ends, &left), put_together(ours, &ends, &right));
        Both { ours: left, theirs: right }
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
                let Both { ours: left, theirs: right } = match (base, ours, theirs) {
                    // One of them wrote out what was meant anyway.
                    (None, Part { is_default: true, .. }, _) => {
                        Both::agreed(theirs.value.written())
                    }
                    (None, _, Part { is_default: true, .. }) => Both::agreed(ours.value.written()),
                    _ => {
                        let base = base.map(|it| it.value);
                        let three = Three { base, ours: ours.value, theirs: theirs.value };
                        self.value(three, place)
                    }
                };
                let around = |of: fn(&Part<'_>) -> String| {
                    let before = base.as_ref().map(of).unwrap_or_default();
                    around(&before, &of(&ours), &of(&theirs))
                };
                let name = around(|part| part.name.to_owned());
                let piece = Piece {
                    before: around(|part| part.before.to_owned()),
                    own: format!("{name}{left}"),
                    comma: around(|part| part.behind.comma.to_owned()),
                    line: around(|part| part.behind.line.to_owned()),
                };
                let theirs = Piece { own: format!("{name}{right}"), ..piece.clone() };
                (Some(piece), Some(theirs))
            }
            (Some(only), None) | (None, Some(only)) => {
                let piece = only.piece();
                let texts = [&piece.before, &piece.own, &piece.comma, &piece.line];
                let is_news = texts.into_iter().any(|text| self.has_news(text));
                let is_same = base.is_some_and(|base| base.value.says(only.value));
                match base {
                    // One of them added it.
                    None => (Some(piece.clone()), Some(piece)),
                    // One of them took it away, and the other one left it as it was.
                    Some(_) if is_same && !is_news => (None, None),
                    // It says the same without it.
                    Some(base) if base.is_default => (Some(piece.clone()), Some(piece)),
                    Some(_) => {
                        self.conflicts.push(place.path.to_owned());
                        if sides.0.is_some() { (Some(piece), None) } else { (None, Some(piece)) }
                    }
                }
            }
            (None, None) => (None, None),
        }
    }
}

/// The name before the parentheses of a value.
fn name(value: Value<'_>) -> Option<String> {
    value.tree.name().map(|name| name.text)
}

/// Whether values are of one kind and name.
fn is_like(value: Value<'_>, other: Value<'_>) -> bool {
    let kind = |value: Value<'_>| std::mem::discriminant(&value.tree.kind);
    name(value) == name(other) && kind(value) == kind(other)
}

/// Whether conflicts are marked in a text.
fn is_marked(text: &str) -> bool {
    text.contains("\n<<<<<<< ours\n")
}

/// The names of all parts: in our order, and what they added behind what it stands behind there.
fn order(base: Option<&Parts<'_>>, ours: &Parts<'_>, theirs: &Parts<'_>) -> Vec<String> {
    let mut order: Vec<_> = ours.all.iter().map(|(key, _)| key.clone()).collect();
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
