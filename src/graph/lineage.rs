//! Which values from outside may shape an output: those that are named by what it hangs on, `Switch`es included.

use maquette_syntax::{Body, Kind, Tree, parse};

use super::Options;
use super::expression::named_parameters;
use super::needs::Needs;
use super::parameters::Parameters;
use crate::definition::{Draft, Repeat};
use crate::flat::Lineage;

impl Lineage {
    /// What shapes the draft at this place.
    pub(super) fn of(
        draft: usize,
        drafts: &[Draft],
        needs: &Needs,
        declared: &Parameters,
        options: &Options,
    ) -> Self {
        let Options { draft: is_draft, set, .. } = options;
        let names = declared.names();
        if names.is_empty() && set.is_empty() {
            return Self { draft: *is_draft, ..Self::default() };
        }
        let needed = needs.of([draft]);
        let needed = || drafts.iter().zip(&needed).filter(|(_, needed)| **needed);
        let mut is_named = vec![false; names.len()];
        for (draft, _) in needed() {
            named(&draft.tree, &names, &mut is_named);
            let numbers = draft.repeat.iter().flat_map(Repeat::numbers);
            numbers.for_each(|number| named(number, &names, &mut is_named));
        }
        let is_of = |target: &str| {
            let of = |name: &str| target.strip_prefix(name).is_some_and(|it| it.starts_with('.'));
            let each = |name: &str| name.split_once('/').is_some_and(|(each, _)| of(each));
            needed().any(|(draft, _)| of(&draft.name.text) || each(&draft.name.text))
        };
        let set = set.iter().filter(|(target, _)| is_of(target));
        Self {
            draft: *is_draft,
            parameters: names
                .iter()
                .zip(is_named)
                .filter(|(_, is_named)| *is_named)
                .map(|(name, _)| (*name).to_owned())
                .collect(),
            set: set.map(|(target, value)| (target.clone(), plain(value).into())).collect(),
        }
    }
}

/// Marks the parameters that are named in a value.
fn named(tree: &Tree, names: &[&str], is_named: &mut [bool]) {
    let mut mark = |found: &str| {
        if let Some(index) = names.iter().position(|name| *name == found) {
            is_named[index] = true;
        }
    };
    if let Some(name) = tree.call_of("Param").and_then(Tree::text) {
        return mark(name);
    }
    if let Some(text) = tree.call_of("Expr").and_then(Tree::text) {
        let found = named_parameters(text, &|name| names.contains(&name));
        return found.into_iter().flatten().for_each(|at| mark(&text[at]));
    }
    let mut inside = |tree: &Tree| named(tree, names, is_named);
    match &tree.kind {
        Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
            items.iter().for_each(inside);
        }
        Kind::Map(entries) => entries.iter().for_each(|(_, value)| inside(value)),
        Kind::Call { body: Body::Fields(fields), .. } => {
            fields.iter().for_each(|field| inside(&field.value));
        }
        _ => {}
    }
}

/// A text without its quotes, as it may be given, too.
fn plain(value: &str) -> String {
    let tree = parse(value).0;
    tree.text().unwrap_or(value).to_owned()
}
