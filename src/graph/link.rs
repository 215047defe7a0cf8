//! Where the links of a graph lead, in which order its nodes come, and what flows on the links.

use std::collections::HashMap;

use super::check::{Check, Draft};
use super::schema::FoundLink;
use super::suggest::nearest_or_all;
use super::{any_of, with_article};
use crate::error::{Span, code};
use crate::value::ValueType;

impl<'a> Check<'a> {
    /// Finds what each link names.
    pub(super) fn link(&mut self, drafts: &mut [Draft<'a>]) {
        let names: HashMap<String, usize> = drafts
            .iter()
            .enumerate()
            .map(|(index, draft)| (draft.name.text.clone(), index))
            .collect();
        for index in 0..drafts.len() {
            let targets = drafts[index].links.iter().map(|link| (link.text.clone(), link.span));
            let targets: Vec<_> = targets.collect();
            drafts[index].targets = targets
                .into_iter()
                .map(|(text, span)| self.target(&text, span, drafts, &names))
                .collect();
        }
    }

    pub(super) fn target(
        &mut self,
        text: &str,
        span: Span,
        drafts: &[Draft<'_>],
        names: &HashMap<String, usize>,
    ) -> Option<(usize, usize)> {
        let (node, output) = match text.split_once('.') {
            Some((node, output)) => (node, Some(output)),
            None => (text, None),
        };
        let Some(&index) = names.get(node) else {
            let known: Vec<&str> = drafts.iter().map(|draft| &draft.name.text[..]).collect();
            let help = nearest_or_all(node, "the graph's nodes", &known);
            self.find(code::UNKNOWN_LINK, span, format!("there is no node `{node}`"), help);
            return None;
        };
        let draft = &drafts[index];
        let (Some(output), Some(entry)) = (output, draft.entry) else { return Some((index, 0)) };
        let names: Vec<&str> = draft.outputs().iter().map(|output| output.name).collect();
        let found = names.iter().position(|name| *name == output);
        if found.is_none() {
            let message = format!(
                "`{node}` is {}, which has no output `{output}`",
                with_article(&entry.name)
            );
            self.find(
                code::UNKNOWN_LINK,
                span,
                message,
                nearest_or_all(output, "its outputs", &names),
            );
        }
        found.map(|output| (index, output))
    }

    /// The nodes, each after those that it hangs on; nodes in a cycle, which is reported, are left out.
    pub(super) fn order(&mut self, drafts: &[Draft<'_>]) -> Vec<usize> {
        const NEW: u8 = 0;
        const OPEN: u8 = 1;
        const DONE: u8 = 2;
        let mut state = vec![NEW; drafts.len()];
        let mut order = Vec::with_capacity(drafts.len());
        for start in 0..drafts.len() {
            // Depth first without recursion: a chain of nodes may be longer than the stack is deep.
            let mut path: Vec<(usize, usize)> = Vec::new();
            if state[start] == NEW {
                state[start] = OPEN;
                path.push((start, 0));
            }
            while let Some(&mut (node, ref mut next)) = path.last_mut() {
                let Some(target) = drafts[node].targets.get(*next) else {
                    state[node] = DONE;
                    order.push(node);
                    path.pop();
                    continue;
                };
                *next += 1;
                let Some((target, _)) = *target else { continue };
                if state[target] == NEW {
                    state[target] = OPEN;
                    path.push((target, 0));
                } else if state[target] == OPEN {
                    let first =
                        path.iter().position(|(node, _)| *node == target).unwrap_or_default();
                    let cycle: Vec<usize> = path[first..].iter().map(|(node, _)| *node).collect();
                    self.cycle(&cycle, drafts);
                }
            }
        }
        order
    }

    fn cycle(&mut self, cycle: &[usize], drafts: &[Draft<'_>]) {
        let lowest =
            (0..cycle.len()).min_by_key(|&k| drafts[cycle[k]].name.span).unwrap_or_default();
        let around =
            (0..=cycle.len()).map(|k| &drafts[cycle[(lowest + k) % cycle.len()]].name.text[..]);
        let path = Vec::from_iter(around).join(" <- ");
        let span = drafts[cycle[lowest]].name.span;
        let message = format!("nodes hang on each other in a circle: {path}");
        self.find(
            code::CYCLE,
            span,
            message,
            "a node cannot need its own result: break one of these links",
        );
    }

    /// Finds the type of every output and checks that every link fits.
    pub(super) fn types(&mut self, drafts: &mut [Draft<'a>], order: &[usize]) {
        for &index in order {
            let draft = &drafts[index];
            let mut came_in: Vec<(&str, &'static ValueType)> = Vec::new();
            let mut misfits = Vec::new();
            for (link, target) in draft.links.iter().zip(&draft.targets) {
                let Some((node, output)) = *target else { continue };
                let Some(kind) = drafts[node].types.get(output).copied().flatten() else {
                    continue;
                };
                if link.types.iter().any(|fits| fits == kind.name) {
                    came_in.push((&link.wants, kind));
                } else {
                    misfits.push((link.clone(), kind));
                }
            }
            let types = draft.outputs().iter().map(|output| match output.types[..] {
                [kind] => Some(kind),
                _ => came_in.iter().find(|(wants, _)| *wants == output.kind).map(|(_, kind)| *kind),
            });
            let types: Vec<_> = types.collect();
            let owner = draft.entry.map_or("", |entry| &entry.name).to_owned();
            drafts[index].types = types;
            for (link, kind) in misfits {
                self.misfit(&owner, &link, kind);
            }
        }
    }

    fn misfit(&mut self, owner: &str, link: &FoundLink, kind: &ValueType) {
        let wanted = any_of(link.types.iter().map(String::as_str));
        let message = format!(
            "port `{}` of {owner} wants {}, but `{}` is {}",
            link.port,
            with_article(&wanted),
            link.text,
            with_article(kind.name)
        );
        let makers =
            link.types.iter().map(|wanted| (wanted, self.catalog.converters(kind.name, wanted)));
        let help = makers.filter_map(|(wanted, makers)| {
            let maker = makers.first()?;
            Some(format!("{} makes {} of it", with_article(maker), with_article(wanted)))
        });
        let help = Vec::from_iter(help).join("; ");
        self.find(code::WRONG_TYPE, link.span, message, help);
    }
}
