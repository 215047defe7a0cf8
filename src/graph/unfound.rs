//! What is said of a name that leads nowhere because it counts too far, or goes into a graph that another one uses: `inspect` shows such
//! names, but links and expectations stop at outputs.

use maquette_syntax::{Help, nearest_or_all, unknown};

use super::Graph;
use super::check::Check;
use super::definition::Definition;
use super::each::element_name;
use super::link::{Named, Names};
use crate::definition::{Draft, What};

impl Check<'_, '_> {
    /// What is wrong with a link to a node whose name has a `/` in it, and what to do; none if nothing of it is known.
    pub(super) fn unfound(
        &self,
        link: &str,
        drafts: &[Draft],
        names: &Names<'_>,
    ) -> Option<(String, Help)> {
        let name = link.split('.').next().unwrap_or_default();
        let (outer, inner) = name.split_once('/')?;
        let number = inner.split('/').next().unwrap_or_default();
        let (draft, node) = match names.find(outer)? {
            Named::Each(each) => {
                let each = &names.eaches[each];
                let count = each.elements.len();
                if count == 0 && each.outputs.is_none() {
                    return None;
                }
                let Some(place) = place_of(number, count) else {
                    return Some(beyond(name, outer, count));
                };
                (&drafts[each.elements[place]], element_name(outer, place))
            }
            Named::Draft(draft) if drafts[draft].repeat.is_some() => {
                if number.parse::<usize>().is_err() {
                    let help = format!("the elements of `{outer}` are `{outer}/1` and so on");
                    return Some((format!("there is no node `{name}`"), help.into()));
                }
                (&drafts[draft], format!("{outer}/{number}"))
            }
            Named::Draft(draft) => (&drafts[draft], outer.to_owned()),
        };
        match &draft.what {
            What::Use(kind, graph) => Some(inside(link, &node, kind, graph)),
            what if what.outputs().contains(&inner) && link == name => {
                let meant = format!("{outer}.{inner}");
                let help = Help::rename(format!("did you mean `{meant}`?"), link, &meant);
                Some((format!("there is no node `{name}`"), help))
            }
            _ => None,
        }
    }
}

/// What is said of a link into the graph that a node is.
fn inside(link: &str, node: &str, kind: &str, graph: &Definition) -> (String, Help) {
    let (name, wanted) = link.split_once('.').map_or((link, None), |(name, it)| (name, Some(it)));
    let message = format!(
        "`{name}` is inside of the graph `{kind}`, which is known here by its outputs alone"
    );
    if let Some(port) = graph.ports.iter().find(|port| {
        port.target.is_some_and(|(draft, output): (usize, usize)| {
            let draft = &graph.drafts[draft];
            name.strip_prefix(node).and_then(|it| it.strip_prefix('/')) == Some(&draft.name.text)
                && wanted
                    .map_or(output == 0, |wanted| draft.what.outputs().get(output) == Some(&wanted))
        })
    }) {
        let same = format!("{node}.{}", port.name);
        return (message, Help::rename(format!("write `{same}`, which is the same"), link, &same));
    }
    let known = graph.ports.iter().map(|port| format!("`{node}.{}`", port.name));
    let known = Vec::from_iter(known).join(", ");
    let help = format!(
        "these can be named: {known}; the file of `{kind}` can give it as an output, or expect something of it"
    );
    (message, help.into())
}

/// The place of an element by its number, if there are so many.
fn place_of(number: &str, count: usize) -> Option<usize> {
    number.parse::<usize>().ok()?.checked_sub(1).filter(|place| *place < count)
}

/// What is said of an element that is not there.
pub(super) fn beyond(name: &str, each: &str, count: usize) -> (String, Help) {
    let message = format!("there is no `{name}`: {}", elements(each, count));
    let help = match count {
        0 => String::new(),
        1 => format!("it is `{each}/1`"),
        _ => format!("they are `{each}/1` to `{each}/{count}`"),
    };
    (message, help.into())
}

/// In words how many elements there are.
pub(super) fn elements(each: &str, count: usize) -> String {
    match count {
        0 => format!("`{each}` has no elements"),
        1 => format!("`{each}` has 1 element"),
        _ => format!("`{each}` has {count} elements"),
    }
}

impl Graph {
    /// A message of one line about a name of what is not there: how many elements there are, or what may have been meant.
    pub fn unknown(&self, what: &str, name: &str, listed: &str, known: &[&str]) -> String {
        let message = format!("the graph has no {what} `{name}`");
        match self.counted_too_far(name) {
            Some(count) => format!("{message}: {count}"),
            None => unknown(message, name, listed, known),
        }
    }

    /// What may have been meant by the name of a value that is not there, in words.
    pub fn value_meant(&self, name: &str) -> String {
        if let Some(count) = self.counted_too_far(name) {
            return count;
        }
        // What is inside of a use is compared with what else is there.
        let outer = name.split_once('/').map(|(outer, _)| format!("{outer}/"));
        let outer = outer.filter(|outer| self.node_names().any(|name| name.starts_with(outer)));
        let known = self.output_names().chain(self.node_names()).filter(|name| match &outer {
            Some(outer) => name.starts_with(outer),
            None => !name.contains('/'),
        });
        nearest_or_all(name, "its outputs and nodes", &Vec::from_iter(known)).into()
    }

    /// In words how many elements there are, if a name has a number that none of them has.
    fn counted_too_far(&self, name: &str) -> Option<String> {
        let name = name.split('.').next().unwrap_or_default();
        let slashes = name.match_indices('/').map(|(at, _)| (&name[..at], &name[at + 1..]));
        slashes.filter(|(each, _)| self.open_loop(each).is_none()).find_map(|(each, inner)| {
            self.uses.iter().find(|it| it.name == each && it.kind.starts_with("ForEach("))?;
            let count = self
                .names()
                .filter_map(|name| {
                    let inner = name.strip_prefix(each)?.strip_prefix('/')?;
                    inner.split('/').next()?.parse::<usize>().ok()
                })
                .max()
                .unwrap_or(0);
            let wanted = inner.split('/').next()?;
            wanted.parse::<usize>().ok()?;
            place_of(wanted, count).is_none().then(|| elements(each, count))
        })
    }
}
