//! The values from outside of a graph, such as parameters, that affect an output: those to which the output's node or one of its
//! dependencies refers. A `Switch` counts as a dependency.

use std::collections::HashMap;

use maquette_syntax::parse;

use super::Options;
use super::dependencies::Dependencies;
use super::parameters::{Parameters, names_in};
use crate::definition::{ParsedNode, Repeat};
use crate::flat::Lineage;

impl Lineage {
    /// Collects the values from outside of the graph on which the parsed node at `index` depends.
    pub(super) fn new(
        index: usize,
        parsed_nodes: &[ParsedNode],
        needs: &Dependencies,
        declared: &Parameters,
        options: &Options,
    ) -> Self {
        let Options { draft: is_draft, set, .. } = options;
        let names = declared.names();
        if names.is_empty() && set.is_empty() {
            return Self { draft: *is_draft, ..Self::default() };
        }
        let needed = parsed_nodes.iter().zip(needs.closure_of([index]));
        let needed: Vec<_> =
            needed.filter(|(_, is_needed)| *is_needed).map(|(parsed, _)| parsed).collect();
        let places: HashMap<&str, usize> = names.iter().copied().zip(0..).collect();
        let mut is_named = vec![false; names.len()];
        for parsed in &needed {
            let numbers = parsed.repeat.iter().flat_map(Repeat::numbers);
            for value in numbers.chain([&parsed.tree]) {
                let found = names_in(value, &|name| places.contains_key(name));
                let found = found.iter().filter_map(|name| places.get(&name[..]));
                found.for_each(|&place| is_named[place] = true);
            }
        }
        for (name, from) in declared.derived_parameters().rev() {
            if places.get(name).is_some_and(|&place| is_named[place]) {
                let from = from.iter().filter_map(|name| places.get(&name[..]));
                from.for_each(|&place| is_named[place] = true);
            }
        }
        let set = set.iter().filter(|(target, _)| {
            needed.iter().any(|parsed| sets_field_of(target, &parsed.name.text))
        });
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

/// Returns true if the target of a `--set` is a field of the node `node`. If the node is an element of a `ForEach`, the target may also be
/// a field of that `ForEach`.
fn sets_field_of(target: &str, node: &str) -> bool {
    fn is_in(target: &str, node: &str) -> bool {
        target.strip_prefix(node).is_some_and(|field| field.starts_with('.'))
    }
    is_in(target, node) || node.split_once('/').is_some_and(|(for_each, _)| is_in(target, for_each))
}

/// Returns the text in a quoted value. Returns any other value as it is.
fn plain(value: &str) -> String {
    let tree = parse(value).0;
    tree.text().unwrap_or(value).to_owned()
}
