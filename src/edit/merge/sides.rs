//! Three-way merge of one value, given its base version and the versions of both sides.

use std::collections::BTreeSet;

use super::align::pair_items;
use super::comments::{comments, merge_gaps};
use super::parts::{MergedPart, Part, Parts, Piece, Value, join_parts};

/// The merged text of a value, once for each side. The two texts differ only in conflicts.
pub(super) struct MergedSides {
    pub(super) ours: String,
    pub(super) theirs: String,
}

impl MergedSides {
    fn equal(text: &str) -> Self {
        Self { ours: text.to_owned(), theirs: text.to_owned() }
    }
}

/// An entry to which the two sides have given different new names.
pub(super) struct RenamedTwice {
    pub(super) section: &'static str,
    pub(super) old: String,
    /// The name that the other side gave to the entry. During the merge, the entry has this name in all three texts.
    pub(super) theirs: String,
    pub(super) ours: String,
}

/// Merges the versions of a value, and collects conflicts.
pub(super) struct Merger<'r> {
    pub(super) renamed_twice: &'r [RenamedTwice],
    /// Entries, such as `nodes.red`, that are reported as conflicts even if they could be merged.
    pub(super) kept_separate: &'r BTreeSet<String>,
    /// The comments of the base text. All other comments are new.
    pub(super) known: BTreeSet<&'r str>,
    /// The paths of the conflicts, such as `nodes.red.select.distance`.
    pub(super) conflicts: Vec<String>,
}

/// The path of a value in the graph, and how conflicts in it are marked.
#[derive(Clone, Copy)]
struct Location<'p> {
    path: &'p str,
    /// True if conflict markers surround single parts of the value. False if they surround a larger value.
    marks_parts: bool,
    /// Nesting depth of the value: 0 for the graph, 1 for its fields.
    depth: usize,
}

impl Location<'_> {
    /// Returns true if the location is the whole graph or the whole section `section`.
    fn is_around(&self, section: &str) -> bool {
        self.path.is_empty() || self.depth == 1 && self.path == section
    }
}

/// The three versions of a value: in the base text, in our text and in the other side's text.
#[derive(Clone, Copy)]
struct Versions<'t> {
    base: Option<Value<'t>>,
    ours: Value<'t>,
    theirs: Value<'t>,
}

impl Versions<'_> {
    /// Returns true if the version `side` differs in meaning from the base version.
    fn is_changed(&self, side: Value<'_>) -> bool {
        self.base.is_none_or(|base| !base.means_same(side))
    }
}

impl Merger<'_> {
    /// Merges three whole texts: the base text, our text and the other side's text.
    pub(super) fn merge_root(
        &mut self,
        base: Value<'_>,
        ours: Value<'_>,
        theirs: Value<'_>,
    ) -> String {
        let versions = Versions { base: Some(base), ours, theirs };
        let place = Location { path: "", marks_parts: true, depth: 0 };
        let MergedSides { ours: left, theirs: right } = self.merge_value(versions, place);
        match left == right {
            true => left,
            // The outermost values cannot be merged part by part, so the whole texts are in conflict.
            false => format!("<<<<<<< ours\n{left}\n=======\n{right}\n>>>>>>> theirs"),
        }
    }

    fn merge_value(&mut self, versions: Versions<'_>, place: Location<'_>) -> MergedSides {
        let Versions { base, ours, theirs } = versions;
        let (left, right) = (ours.source_text(), theirs.source_text());
        let before = base.map(Value::source_text);
        // Entries that are kept separate are conflicts even if all three texts are equal.
        let mut sections_apart = self
            .kept_separate
            .iter()
            .filter_map(|entry| entry.split('.').next())
            .chain(self.renamed_twice.iter().map(|it| it.section));
        if sections_apart.any(|section| place.is_around(section))
            && let Some(merged) = self.merge_named_parts(versions, place)
        {
            return merged;
        }
        if left == right || before == Some(right) {
            return MergedSides::equal(left);
        }
        if before == Some(left) {
            return MergedSides::equal(right);
        }
        if let Some(merged) = self.merge_named_parts(versions, place) {
            return merged;
        }
        let (by_us, by_them) = (versions.is_changed(ours), versions.is_changed(theirs));
        let is_agreed = ours.means_same(theirs) || !by_us || !by_them;
        if is_agreed {
            if let Some(merged) = self.merge_items(versions, by_us, by_them, place) {
                return merged;
            }
            let (kept, gone) = if by_us || !by_them { (left, right) } else { (right, left) };
            if !self.has_new_comment(gone) {
                return MergedSides::equal(kept);
            }
        }
        self.conflicts.push(place.path.to_owned());
        MergedSides { ours: left.to_owned(), theirs: right.to_owned() }
    }

    /// Returns true if a text has a comment that does not occur in the base text.
    fn has_new_comment(&self, text: &str) -> bool {
        comments(text).iter().any(|comment| !self.known.contains(comment))
    }

    /// Merges a value part by part. Returns `None` if a version cannot be split into parts with names.
    fn merge_named_parts(
        &mut self,
        versions: Versions<'_>,
        place: Location<'_>,
    ) -> Option<MergedSides> {
        if name(versions.ours) != name(versions.theirs) {
            return None;
        }
        // In a list of expectations, the order is irrelevant, so the items can be merged by their texts.
        let lists = place.path == "expect"
            && versions.is_changed(versions.ours)
            && versions.is_changed(versions.theirs);
        let (ours, theirs) =
            (Parts::read(versions.ours, lists)?, Parts::read(versions.theirs, lists)?);
        let base = versions.base.filter(|base| has_same_form(*base, versions.ours));
        let base = base.and_then(|base| Parts::read(base, lists));
        let base = base.as_ref();
        if lists && base.is_some_and(|base| !ours.has_all(base) && !theirs.has_all(base)) {
            return None;
        }
        Some(self.merge_parts(base, &ours, &theirs, place))
    }

    /// Merges lists or tuples item by item. Possible only if at most one side has changed the meaning of the value, or if both sides have
    /// changed it in the same way.
    fn merge_items(
        &mut self,
        versions: Versions<'_>,
        by_us: bool,
        by_them: bool,
        place: Location<'_>,
    ) -> Option<MergedSides> {
        if name(versions.ours) != name(versions.theirs)
            || !has_same_form(versions.theirs, versions.ours)
        {
            return None;
        }
        let base = versions.base.filter(|base| has_same_form(*base, versions.ours));
        let before = base.and_then(Value::normalized_items);
        let (before, count) = match &before {
            Some(before) => (&before[..], before.len()),
            None => (&[][..], 0),
        };
        let numbers = |value: Value<'_>, is_changed: bool| {
            let said = value.normalized_items()?;
            let places = match is_changed {
                true => pair_items(before, &said),
                false => (0..said.len()).map(Some).collect(),
            };
            // Number the added items too, so that equal items that both sides have added get equal numbers.
            let numbered = places.into_iter().enumerate();
            Some(
                numbered
                    .map(|(k, place)| place.unwrap_or(count + k).to_string())
                    .collect::<Vec<_>>(),
            )
        };
        let ours = Parts::from_items(versions.ours, numbers(versions.ours, by_us)?)?;
        let theirs = Parts::from_items(versions.theirs, numbers(versions.theirs, by_them)?)?;
        let base = base.and_then(|base| Parts::from_items(base, numbers(base, false)?));
        Some(self.merge_parts(base.as_ref(), &ours, &theirs, place))
    }

    /// Merges each part, and joins the merged parts to one text per side.
    fn merge_parts(
        &mut self,
        base: Option<&Parts<'_>>,
        ours: &Parts<'_>,
        theirs: &Parts<'_>,
        place: Location<'_>,
    ) -> MergedSides {
        let (mut left, mut right, mut marked) = (Vec::new(), Vec::new(), Vec::new());
        for key in merged_order(base, ours, theirs) {
            let before = base.and_then(|base| base.get(&key));
            let known = self.conflicts.len();
            let path = match place.path {
                "" => key.clone(),
                path => format!("{path}.{key}"),
            };
            // Conflict markers surround entries of a section, or whole fields of the graph that are not sections.
            let inside =
                Location { path: &path, marks_parts: place.depth == 0, depth: place.depth + 1 };
            let sides = (ours.get(&key), theirs.get(&key));
            let is_kept_apart = inside.depth == 2 && self.kept_separate.contains(&path);
            let (mine, other) = match is_kept_apart {
                true => {
                    self.conflicts.push(path.clone());
                    (sides.0.map(|part| part.piece()), sides.1.map(|part| part.piece()))
                }
                false => self.merge_part(before, sides, inside),
            };
            let mine = self.with_our_name(&place, &key, mine);
            let is_open = self.conflicts.len() > known;
            let is_section =
                place.depth == 0 && mine.as_ref().is_some_and(|it| has_conflict_marks(&it.own));
            left.extend(mine.clone().map(MergedPart::Piece));
            right.extend(other.clone().map(MergedPart::Piece));
            marked.extend(match (place.marks_parts && is_open && !is_section, mine) {
                (true, mine) => Some(MergedPart::Conflict(mine, other)),
                (false, mine) => mine.map(MergedPart::Piece),
            });
        }
        let close = merge_gaps(base.map_or("", |base| base.close), ours.close, theirs.close);
        let ends = (merge_gaps(base.map_or("", |base| base.open), ours.open, theirs.open), close);
        if place.marks_parts {
            return MergedSides::equal(&join_parts(ours, &ends, &marked));
        }
        let (left, right) = (join_parts(ours, &ends, &left), join_parts(ours, &ends, &right));
        MergedSides { ours: left, theirs: right }
    }

    /// If both sides have renamed a part, returns the part with the name that our side gave it.
    fn with_our_name(
        &mut self,
        place: &Location<'_>,
        key: &str,
        mine: Option<Piece>,
    ) -> Option<Piece> {
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

    /// Merges the versions of a part. Returns the merged part for each side, or `None` for a part that the merge removes.
    fn merge_part(
        &mut self,
        base: Option<Part<'_>>,
        sides: (Option<Part<'_>>, Option<Part<'_>>),
        place: Location<'_>,
    ) -> (Option<Piece>, Option<Piece>) {
        match sides {
            (Some(ours), Some(theirs)) => {
                let MergedSides { ours: left, theirs: right } = match (base, ours, theirs) {
                    // Our side only wrote the default of the field explicitly, so take the other side's value.
                    (None, Part { is_default: true, .. }, _) => {
                        MergedSides::equal(theirs.value.source_text())
                    }
                    (None, _, Part { is_default: true, .. }) => {
                        MergedSides::equal(ours.value.source_text())
                    }
                    _ => {
                        let base = base.map(|it| it.value);
                        let versions = Versions { base, ours: ours.value, theirs: theirs.value };
                        self.merge_value(versions, place)
                    }
                };
                let around = |of: fn(&Part<'_>) -> String| {
                    let before = base.as_ref().map(of).unwrap_or_default();
                    merge_gaps(&before, &of(&ours), &of(&theirs))
                };
                let name = around(|part| part.name.to_owned());
                let piece = Piece {
                    before: around(|part| part.before.to_owned()),
                    own: format!("{name}{left}"),
                    comma: around(|part| part.trailing.comma.to_owned()),
                    line: around(|part| part.trailing.line.to_owned()),
                };
                let theirs = Piece { own: format!("{name}{right}"), ..piece.clone() };
                (Some(piece), Some(theirs))
            }
            (Some(only), None) | (None, Some(only)) => {
                let piece = only.piece();
                let texts = [&piece.before, &piece.own, &piece.comma, &piece.line];
                let has_new = texts.into_iter().any(|text| self.has_new_comment(text));
                let is_same = base.is_some_and(|base| base.value.means_same(only.value));
                match base {
                    // Only one side has the part, and the base does not: it was added.
                    None => (Some(piece.clone()), Some(piece)),
                    // One side removed the part, and the other did not change it.
                    Some(_) if is_same && !has_new => (None, None),
                    // The value equals its default, so removing it has not changed the meaning. Keep the changed version.
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

/// Returns the name of a call, such as `Near` in `Near(..)`.
fn name(value: Value<'_>) -> Option<String> {
    value.tree.name().map(|name| name.text)
}

/// Returns true if both values have the same kind and name.
fn has_same_form(value: Value<'_>, other: Value<'_>) -> bool {
    name(value) == name(other)
        && std::mem::discriminant(&value.tree.kind) == std::mem::discriminant(&other.tree.kind)
}

/// Returns true if a text contains conflict markers.
fn has_conflict_marks(text: &str) -> bool {
    text.contains("\n<<<<<<< ours\n")
}

/// Returns the names of all parts, in the order of our text. A part that only the other side has comes after the part that precedes it in
/// the other side's text.
fn merged_order(base: Option<&Parts<'_>>, ours: &Parts<'_>, theirs: &Parts<'_>) -> Vec<String> {
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
