//! Which values from outside may shape an output: those that are named by what it hangs on, `Switch`es included.

use std::collections::HashMap;

use maquette_syntax::parse;

use super::Options;
use super::needs::Needs;
use super::parameters::{Parameters, names_in};
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
        let places: HashMap<&str, usize> = names.iter().copied().zip(0..).collect();
        let mut is_named = vec![false; names.len()];
        for (draft, _) in needed() {
            let numbers = draft.repeat.iter().flat_map(Repeat::numbers);
            for value in numbers.chain([&draft.tree]) {
                let found = names_in(value, &|name| places.contains_key(name));
                let found = found.iter().filter_map(|name| places.get(&name[..]));
                found.for_each(|&place| is_named[place] = true);
            }
        }
        for (name, from) in declared.derived().rev() {
            if places.get(name).is_some_and(|&place| is_named[place]) {
                let from = from.iter().filter_map(|name| places.get(&name[..]));
                from.for_each(|&place| is_named[place] = true);
            }
        }
        let is_of = |target: &str| {
            fn of(name: &str, target: &str) -> bool {
                target.strip_prefix(name).is_some_and(|it| it.starts_with('.'))
            }
            fn each(name: &str, target: &str) -> bool {
                name.split_once('/').is_some_and(|(each, _)| of(each, target))
            }
            needed()
                .any(|(draft, _)| of(&draft.name.text, target) || each(&draft.name.text, target))
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

/// A text without its quotes, as it may be given, too.
fn plain(value: &str) -> String {
    let tree = parse(value).0;
    tree.text().unwrap_or(value).to_owned()
}
