//! The evaluation order of parameters with computed defaults.

use std::collections::HashMap;

use maquette_syntax::error::code;
use maquette_syntax::{Body, Kind, LocalDiagnostic, SourceMap, Tree};

use super::is_parametric;
use crate::declaration::Declaration;
use crate::expression::named_parameters;
use crate::tree::text_in_call;

/// An order of the declarations in which each parameter comes after those from which its default is computed.
pub(super) struct Order {
    /// The indices of the declarations. Declarations in a cycle are reported and left out.
    pub(super) indices: Vec<usize>,
}

/// The state of a declaration in the depth-first search.
#[derive(Clone, Copy, PartialEq)]
enum State {
    New,
    Open,
    Done,
}

impl Order {
    pub(super) fn compute(
        declarations: &[Declaration],
        source_map: &SourceMap,
        diagnostics: &mut Vec<LocalDiagnostic>,
    ) -> Self {
        let places = declarations.iter().enumerate();
        let places: HashMap<&str, usize> = places.map(|(at, it)| (&it.name[..], at)).collect();
        let needed: Vec<_> = declarations
            .iter()
            .map(|declared| match is_parametric(&declared.default) {
                true => {
                    let names = names_in(&declared.default, &|name| places.contains_key(name));
                    names.iter().filter_map(|name| places.get(&name[..]).copied()).collect()
                }
                false => Vec::new(),
            })
            .collect();
        let mut states = vec![State::New; declarations.len()];
        let mut is_cyclic = vec![false; declarations.len()];
        let mut all = Vec::with_capacity(declarations.len());
        for first in 0..declarations.len() {
            // Use a loop instead of recursion, because a chain of dependent parameters can be long.
            let mut open = Vec::new();
            if states[first] == State::New {
                states[first] = State::Open;
                open.push((first, 0));
            }
            while let Some((at, next)) = open.last_mut() {
                let Some(&other) = needed[*at].get(*next) else {
                    states[*at] = State::Done;
                    all.push(*at);
                    open.pop();
                    continue;
                };
                *next += 1;
                match states[other] {
                    State::New => {
                        states[other] = State::Open;
                        open.push((other, 0));
                    }
                    State::Open => {
                        let place = open.iter().position(|(at, _)| *at == other).unwrap_or(0);
                        let cycle = Vec::from_iter(open[place..].iter().map(|(at, _)| *at));
                        if !cycle.iter().any(|&at| is_cyclic[at]) {
                            diagnostics.push(cycle_diagnostic(declarations, &cycle, source_map));
                        }
                        cycle.iter().for_each(|&at| is_cyclic[at] = true);
                    }
                    State::Done => {}
                }
            }
        }
        all.retain(|&at| !is_cyclic[at]);
        Self { indices: all }
    }
}

/// Returns the error for a cycle of parameters. Each parameter in `cycle` is computed from the next one.
fn cycle_diagnostic(
    declarations: &[Declaration],
    cycle: &[usize],
    source_map: &SourceMap,
) -> LocalDiagnostic {
    let all: Vec<_> = cycle.iter().map(|&at| &declarations[at]).collect();
    let names = all.iter().chain(all.first()).map(|declared| &declared.name[..]);
    let message = format!("cycle: {}", Vec::from_iter(names).join(" -> "));
    let next = all.iter().skip(1).chain(all.first());
    let needs = all.iter().zip(next).map(|(declared, next)| {
        let place = source_map.describe_location(declared.default.span);
        format!("`{}` needs `{}` at {place}", declared.name, next.name)
    });
    let needs = Vec::from_iter(needs).join(", ");
    let note =
        all.get(1).map(|declared| (declared.default.span, format!("`{}` is here", declared.name)));
    LocalDiagnostic {
        code: code::CYCLE,
        span: all.first().map(|declared| declared.default.span).unwrap_or_default(),
        message,
        help: format!("give one of them a number: {needs}").into(),
        note,
    }
}

/// Returns the names of the parameters that occur in a value, in the order of their occurrence.
pub(crate) fn names_in(tree: &Tree, is_known: &dyn Fn(&str) -> bool) -> Vec<String> {
    let mut names = Vec::new();
    collect(tree, is_known, &mut names);
    names
}

fn collect(tree: &Tree, is_known: &dyn Fn(&str) -> bool, names: &mut Vec<String>) {
    if let Some(name) = text_in_call(tree, "Param") {
        return names.push(name.to_owned());
    }
    if let Some(text) = text_in_call(tree, "Expr") {
        let places = named_parameters(text, is_known).into_iter().flatten();
        return names.extend(places.map(|at| text[at].to_owned()));
    }
    match &tree.kind {
        Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
            items.iter().for_each(|item| collect(item, is_known, names));
        }
        Kind::Call { body: Body::Fields(fields), .. } => {
            fields.iter().for_each(|field| collect(&field.value, is_known, names));
        }
        Kind::Map(entries) => entries.iter().for_each(|(_, value)| collect(value, is_known, names)),
        _ => {}
    }
}
